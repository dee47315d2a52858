#!/usr/bin/env bash
# What the tests of derivatives and bounds show on a few materials, on many.
#
#   tests/inverse.sh bounds [MATERIALS [COPIES [FIRST]]]
#
# Refines COPIES (200) noisy copies of the pair of photographs of each of MATERIALS (10), and compares
# the spread of every parameter with its Cramer-Rao bound.
#
#   tests/inverse.sh derivatives [CASES [SIDE [ACCURACY [TIGHT [FIRST [VIEWS]]]]]]
#
# Compares derivatives of images of SIDE x SIDE (8) pixels rendered to a relative ACCURACY (1e-5)
# with extrapolated differences of images rendered to TIGHT (1e-5), over VIEWS (all, or as in 0,5) of
# CASES (62): the 12 hard cases, then materials drawn from the preset. A view in which a notable derivative is off by
# a percent, any is off by more than it states, or the differences do not tell one, is compared again
# with both accuracies a tenth as large, and once more. A case takes one to fifteen minutes of a core.
#
#   tests/inverse.sh starts [MATERIALS [FIRST]]
#
# Fits noisy pairs of photographs of each of MATERIALS (80), from the nearest of 300 others, and counts
# the fits that end above the truth's cost.
#
# FIRST (0) is how many materials, or cases, an earlier run has done.
set -euo pipefail
cd "$(dirname "$0")/.."

case "${1:-}" in
  bounds)
    export BRDFARM_MATERIALS="${2:-10}" BRDFARM_COPIES="${3:-200}" BRDFARM_FIRST="${4:-0}"
    ;;
  derivatives)
    export BRDFARM_CASES="${2:-62}" BRDFARM_SIDE="${3:-8}"
    export BRDFARM_ACCURACY="${4:-1e-5}" BRDFARM_TIGHT_ACCURACY="${5:-1e-5}"
    export BRDFARM_FIRST="${6:-0}" BRDFARM_VIEWS="${7:-all}"
    ;;
  starts)
    export BRDFARM_MATERIALS="${2:-80}" BRDFARM_FIRST="${3:-0}"
    ;;
  *)
    sed -n '2,/^set /{/^#/p}' "$0" >&2
    exit 2
    ;;
esac
cargo test --release -p inverse --test inverse "campaign_of_$1" -- --ignored --nocapture
