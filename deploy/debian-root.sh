#!/usr/bin/env bash
# Makes a small Debian system in a folder, for what is tried in a system of its own. Keeps one that
# is complete.
#
#   deploy/debian-root.sh SUITE FOLDER PACKAGE...
set -euo pipefail

suite="$1" folder="$2"
packages="$(IFS=,; printf '%s' "${*:3}")"
here="$(cd "$(dirname "$0")" && pwd)"

"$here/install-packages.sh" mmdebstrap
# Written last, so a folder beside it is complete.
stamp="$folder.packages"
if [[ -d "$folder" && "$(cat "$stamp" 2> /dev/null || true)" == "$suite $packages" ]]; then
  exit 0
fi
mkdir -p "$(dirname "$folder")"
rm -rf "$folder" "$stamp"
printf 'debian-root: making Debian %s in %s\n' "$suite" "$folder"
mmdebstrap --quiet --variant=minbase --include="$packages" "$suite" "$folder" \
  "${DEBIAN_MIRROR:-http://deb.debian.org/debian}" 2> "$folder.log" || {
  tail -n 20 "$folder.log" >&2
  exit 1
}
printf '%s' "$suite $packages" > "$stamp"
