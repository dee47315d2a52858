#!/usr/bin/env bash
# Runs the tests of networks on a GPU: their logits are PyTorch's and NumPy's, and they learn. A cold
# build takes 10 minutes of two cores.
#
#   tests/gpu.sh          # through Vulkan or Metal; Debian's mesa-vulkan-drivers computes without a GPU
#   tests/gpu.sh cuda     # through CUDA; cuda:1 is the second card. The build downloads LLVM
set -euo pipefail
cd "$(dirname "$0")/.."

device="${1:-wgpu}"
tests/clients/install.sh
TRAINING_TEST_DEVICE="$device" \
  cargo test --release -p training --features "${device%%:*}" --test learning
