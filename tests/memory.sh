#!/usr/bin/env bash
# Memory of a coordinator while 9,000 materials of 14 images are completed, and a million of one;
# then of `run`, which completes 60 more in each of these stores, verifies all and writes the
# manifest. Images are of 8 x 8 pixels; the coordinator's workers render nothing. Wants 12 GB below
# TMPDIR, and 8 GB of memory for the workers.
set -euo pipefail
cd "$(dirname "$0")/.."

TMPDIR="$(mktemp -d)"
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT

cargo test --release --test throughput memory_while -- --ignored --nocapture --test-threads 1
brdfarm="${CARGO_TARGET_DIR:-target}/release/brdfarm"
shopt -s dotglob
for spec in "$TMPDIR"/*/spec.toml; do
  completed="$(wc -l < "${spec%/*}/store/completions.log")"
  "$brdfarm" run --spec "$spec" --materials "$((completed + 60))" --store "${spec%/*}/store" \
    > "$TMPDIR/run.log" &
  run=$!
  most=0
  while most_now="$(awk '/^VmHWM/ { print int($2 / 1024) }' "/proc/$run/status" 2>/dev/null)" &&
    [[ -n "$most_now" ]]; do
    grep -q '^rendered' "$TMPDIR/run.log" || rendering="$most_now"
    most="$most_now"
    sleep 0.05
  done
  wait "$run"
  echo "run, $completed completed before: $rendering MiB at most while rendering, $most MiB at all"
done
