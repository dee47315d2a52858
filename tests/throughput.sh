#!/usr/bin/env bash
# 1,000 simulated workers (real gRPC, no rendering) against one coordinator; ends with leases and
# completions a second, latencies as the workers and as the coordinator see them, processor time and
# memory of both. Three times: jobs of one small image without a pause, which the marks are about
# (2,000 jobs a second, 99 of 100 leases within 100 ms); the same with a second for each job, as
# workers at work have it; and jobs of the preset's 14 images. Every image is uploaded, checked and
# durable before its job counts. Wants a machine that does nothing else.
#
#   tests/throughput.sh          the three measurements
#   tests/throughput.sh costs    what calls cost with 1 to 64 clients: the service times of simulation/
set -euo pipefail
cd "$(dirname "$0")/.."

# Stores are removed when all is measured, not before the next begins: see the test.
TMPDIR="$(mktemp -d)"
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

measured=a_thousand
[[ "${1:-}" == costs ]] && measured=what_calls_cost
cargo test --release --test throughput "$measured" --no-fail-fast -- \
  --ignored --nocapture --test-threads 1
