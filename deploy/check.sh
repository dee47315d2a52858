#!/usr/bin/env bash
# Checks what stands in this folder: engines understand it, names that refer resolve, and credentials
# are read by those who need them and nobody else. Ends with 1 where something is wrong, and says what
# was checked by what, and what was not.
#
#   deploy/check.sh [SECTION...]    # scripts systemd slurm kubernetes compose image; all where none is named
#   deploy/check.sh --self-test     # breaks each thing on purpose: the checks have to see it
#
# Looking at files as other users do wants root, and the program: target/release/brdfarm or what BRDFARM
# names. CHECK_OFFLINE=1 downloads nothing.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"

if [[ "${1:-}" == --self-test ]]; then
  exec "$here/check/self-test.sh"
fi
sections=("$@")
((${#sections[@]})) || sections=(scripts systemd slurm kubernetes compose image)
failed=0
for section in "${sections[@]}"; do
  if [[ ! -x "$here/check/$section.sh" ]]; then
    printf 'check.sh: there is no section %s\n' "$section" >&2
    exit 2
  fi
  "$here/check/$section.sh" || failed=1
done
exit "$failed"
