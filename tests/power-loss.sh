#!/usr/bin/env bash
# 40 power losses of a store on an ext4 image behind a loop device: nothing that was acknowledged is
# lost, and every store opens. Needs root and e2fsprogs.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --test farm_faults power_losses -- --ignored --nocapture
