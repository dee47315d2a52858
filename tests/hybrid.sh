#!/usr/bin/env bash
# The tests of the hybrid integrator on more than the default suite has time for: against the path tracer on
# films of 12 x 12 pixels, against finer renderings on films of 32 x 32, and a million pixels of extreme materials
# for values out of range. Some 4 minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
BRDFARM_MORE=1 exec cargo test --workspace --features training --test hybrid
