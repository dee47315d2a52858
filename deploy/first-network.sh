#!/usr/bin/env bash
# The first network: installs Embree, builds brdfarm with the training step, renders the two
# photographs of 9,000 materials, trains the paper's nested networks on them and judges them on the
# test split. Stopped, the same command goes on.
#
#   deploy/first-network.sh [FOLDER [ARGUMENTS OF brdfarm train ...]]
#
# FIRST_NETWORK_MATERIALS=N renders N materials instead.
set -euo pipefail
cd "$(dirname "$0")/.."

folder="${1:-network}"
shift || true
target="${CARGO_TARGET_DIR:-target}"
deploy/fetch-embree.sh
cargo build --release --features training
brdfarm="$target/release/brdfarm"
mkdir -p "$folder"
"$brdfarm" run --spec examples/pairs.toml --materials "${FIRST_NETWORK_MATERIALS:-9000}" \
  --store "$folder/store"
"$brdfarm" dataset export "$folder/pairs" --store "$folder/store" --layout files --rectified 64
"$brdfarm" train "$folder/pairs" --out "$folder/nested" "$@"
"$brdfarm" evaluate "$folder/nested/model.safetensors" --data "$folder/pairs" --spec preset \
  --out "$folder/evaluation"
