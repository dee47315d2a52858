#!/usr/bin/env bash
# Photographs made from films of test materials, estimated: gains, readings and refined intervals
# against the truth.
#
#   tests/photographs.sh MODEL [N [FROM]]
#
# MODEL is what `brdfarm train` wrote; N, 50 unless given, counts materials, from the index FROM on.
set -euo pipefail
cd "$(dirname "$0")/.."

export PHOTOGRAPHS_MODEL
PHOTOGRAPHS_MODEL="$(realpath "$1")"
export PHOTOGRAPHS="${2:-50}"
export PHOTOGRAPHS_FROM="${3:-0}"
deploy/fetch-embree.sh
cargo test --workspace --features training --test train -- --ignored --exact \
  estimate::campaign_of_photographs --nocapture
