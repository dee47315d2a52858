#!/usr/bin/env bash
# Draws N admitted specifications and materials at random, from draw FIRST (0) on, renders each and
# compares its pixels with those of a finer film, with those to a smaller tolerance and with an
# independent reference. Prints what failed, each with the files and the command that render it
# again, and ends with counts: draws, who rendered them, pixels compared with the reference, those
# whose reference stayed coarser than their tolerance, failed draws by kind ("traced" are the path
# tracer's), and the longest rendering in processor seconds. A draw that takes minutes is reported
# and left out. BRDFARM_SEED=N repeats a search; RAYON_NUM_THREADS draws are examined at a time.
#
#   tests/scenes.sh [--coarse | --traced | --streaks | --glints] N [FIRST]
#
# --coarse draws accuracies from 0.01 to 0.1, where the renderer takes series of fewer terms.
#
# --traced draws scenes for the path tracer: small films, 16 to 1,024 paths a pixel, spheres and
# cylinders among the samples. It states intervals that hold in 95 of 100 pixels; one that is off by
# three times as much, and in two of four other images by more than it states, has failed.
#
# --streaks draws such scenes in which a bulb of no more than a hundredth of its distance lights a
# sphere or a cylinder that is all but smooth along one axis; --glints such in which it lights a near
# mirror of any shape but a mesh.
set -euo pipefail
cd "$(dirname "$0")/.."

search=a_long_search_finds
case "${1:-}" in
  --coarse)
    search=a_long_search_at_coarse_accuracies
    shift
    ;;
  --traced)
    search=a_long_search_of_the_path_tracer
    shift
    ;;
  --streaks)
    search=a_long_search_of_streaks
    shift
    ;;
  --glints)
    search=a_long_search_of_glints
    shift
    ;;
esac
count="${1:?how many draws}"
first="${2:-0}"
end=$((first + count))
export BRDFARM_SEED="${BRDFARM_SEED:-$(date +%s)}"
log="$(mktemp)"
trap 'rm -f "$log"' EXIT

status=0
while ((first < end)); do
  code=0
  BRDFARM_SCENES_FIRST="$first" BRDFARM_SCENES=$((end - first)) \
    cargo test -q --release -p renderer --test scenes "$search" -- --ignored --nocapture |
    tee "$log.part" || code=$?
  cat "$log.part" >>"$log"
  next="$(sed -n 's/^go on with draw //p' "$log.part")"
  rm -f "$log.part"
  ((code == 0)) || status=1
  [[ -n "$next" ]] || break
  first="$next"
done
awk '/^counts: / {
    for (i = 2; i < NF; i += 2) {
      if ($i == "slowest") { if ($(i + 1) > slowest) { slowest = $(i + 1); draw = $(i + 3) } break }
      if (!($i in sums)) names[++n] = $i
      sums[$i] += $(i + 1)
    }
  }
  /^Unbounded: / { unbounded++ }
  END {
    for (i = 1; i <= n; i++) printf "%s %d, ", names[i], sums[names[i]]
    printf "unbounded %d, slowest %.1f s (draw %d)\n", unbounded, slowest, draw
  }' "$log"
exit "$status"
