#!/usr/bin/env bash
# The first dataset: installs Embree, builds brdfarm, renders 12 materials from 14 views, checks
# them and writes manifest and contact sheet.
#
#   deploy/first-dataset.sh [STORE [ARGUMENTS OF brdfarm run ...]]
set -euo pipefail
cd "$(dirname "$0")/.."

store="${1:-store}"
shift || true
deploy/fetch-embree.sh
cargo build --release
"${CARGO_TARGET_DIR:-target}/release/brdfarm" run --materials 12 --store "$store" "$@"
