#!/usr/bin/env bash
# Installs what the tests need and runs them all; ends with their count.
#
#   tests/run.sh [ARGUMENTS OF cargo test ...]
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/fetch-embree.sh
deploy/install-postgres.sh
tests/clients/install.sh

log="$(mktemp)"
trap 'rm -f "$log"' EXIT
status=0
cargo test --workspace --features training --no-fail-fast "$@" 2>&1 | tee "$log" || status=$?
# cargo prints one line a test binary; this is their sum.
awk '/^test result:/ { passed += $4; failed += $6; ignored += $8 }
     END { printf "%d passed, %d failed, %d skipped\n", passed, failed, ignored }' "$log"
exit "$status"
