#!/usr/bin/env bash
# Fuzzes every target, each for SECONDS (60), or those that are named, from the seeds and
# the inputs in fuzz/corpus on. What it finds stands in fuzz/libfuzzer/artifacts; an input that
# failed belongs into fuzz/corpus once its fault is mended. Needs `cargo install cargo-fuzz` and a
# C++ compiler; no nightly toolchain.
#
#   fuzz/run.sh [SECONDS [TARGET ...]]
set -euo pipefail
cd "$(dirname "$0")"

seconds="${1:-60}"
shift || true
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || mapfile -t targets < <(ls corpus)

# Targets write small files by the million, and sync some of them.
[[ -w /dev/shm ]] && export TMPDIR=/dev/shm
work="$PWD/libfuzzer/corpus"
BRDFARM_SEEDS="$work" cargo test -q -p fuzz --test corpora write_seeds -- --ignored
# Sanitizers and coverage are unstable flags, which a stable compiler takes with this.
export RUSTC_BOOTSTRAP=1
# Nothing that is parsed may take more memory than this at one time, nor for one thing, MiB.
limits=(-rss_limit_mb=1024 -malloc_limit_mb=256 -timeout=10 -max_len=32768)
status=0
for target in "${targets[@]}"; do
  cargo fuzz run --fuzz-dir libfuzzer "$target" "$work/$target" "corpus/$target" -- \
    "${limits[@]}" -max_total_time="$seconds" -print_final_stats=1 2>"libfuzzer/$target.log" ||
    status=1
  grep -aE 'stat::number_of_executed_units|SUMMARY|panicked at' "libfuzzer/$target.log" |
    sed "s/^/$target: /"
done
exit "$status"
