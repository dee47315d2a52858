#!/usr/bin/env bash
# Compares brdfarm with Mitsuba; see README.md. Exit code 0: every mark is met.
#
#   bench/mitsuba/run.sh [--program PATH] [--materials LIST] [--views LIST] [...]
set -euo pipefail
cd "$(dirname "$0")/../.."

# Mitsuba's LLVM variants load LLVM at run time, from where this variable says.
if [[ -z "${DRJIT_LIBLLVM_PATH:-}" ]]; then
    library() { /sbin/ldconfig -p | awk '$1 == "libLLVM.so.19.1" { print $NF; exit }'; }
    if [[ -z "$(library)" ]]; then
        if [[ "$(id -u)" != 0 ]]; then
            echo "LLVM 19 is missing: install Debian's package libllvm19, or set DRJIT_LIBLLVM_PATH" >&2
            exit 2
        fi
        apt-get update -q
        apt-get install -y -q libllvm19
    fi
    DRJIT_LIBLLVM_PATH="$(library)"
    export DRJIT_LIBLLVM_PATH
fi

environment=target/bench-mitsuba/python
if ! "$environment/bin/pip" freeze 2>/dev/null | cmp -s - bench/mitsuba/requirements.txt; then
    python3 -m venv --clear "$environment"
    "$environment/bin/pip" install -q -r bench/mitsuba/requirements.txt
fi
exec "$environment/bin/python" bench/mitsuba/compare.py "$@"
