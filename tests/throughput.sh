#!/usr/bin/env bash
# 1,000 simulated workers (real gRPC, no rendering) against one coordinator; ends with leases and
# completions a second, latencies and memory.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --release -p worker --test throughput a_thousand -- --ignored --nocapture
