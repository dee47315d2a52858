#!/usr/bin/env bash
# Rays a second and memory on a mesh of a million triangles: our 64-bit triangles under Embree, Embree's own
# 32-bit ones (through embreex) and Mitsuba's, on one thread, in turn. Three rounds of all.
set -euo pipefail
cd "$(dirname "$0")/../.."

environment=target/bench-meshes/python
requirements='embreex==4.4.0.post1
drjit==1.4.0
mitsuba==3.9.0
numpy==2.4.6'
if [[ ! -e "$environment/complete" ]]; then
    python3 -m venv --clear "$environment"
    # shellcheck disable=SC2086
    "$environment/bin/pip" install -q $requirements
    touch "$environment/complete"
fi
[[ -n "${DRJIT_LIBLLVM_PATH:-}" ]] || /sbin/ldconfig -p | grep -q libLLVM.so.19.1 ||
    { apt-get update -q && apt-get install -y -q libllvm19; } >&2
DRJIT_LIBLLVM_PATH="${DRJIT_LIBLLVM_PATH:-$(/sbin/ldconfig -p | awk '$1 == "libLLVM.so.19.1" { print $NF; exit }')}"
export DRJIT_LIBLLVM_PATH
cargo build -q --release -p renderer --example rays
folder=target/bench-meshes
for round in 1 2 3; do
    printf '%s brdfarm %s\n' "$round" "$(taskset -c 0 target/release/examples/rays "$folder/mesh" "$folder/rays")"
    for peer in embree mitsuba; do
        printf '%s %s %s\n' "$round" "$peer" \
            "$(taskset -c 0 "$environment/bin/python" bench/meshes/peers.py "$folder/mesh" "$folder/rays" "$peer")"
    done
done
