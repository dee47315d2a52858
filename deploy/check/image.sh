#!/usr/bin/env bash
# Checks Dockerfile: what it copies into the build is all that cargo wants, and none of the keys that
# are made below deploy/. try-image.sh builds its last stage and runs it. BRDFARM_SOURCE names another
# checkout than this one.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
source_folder="$(cd "${BRDFARM_SOURCE:-$deploy/..}" && pwd)"
make_scratch
trap 'rm -rf "$scratch"' EXIT

# The folders and files that the ignore file lets through, as links in a folder of their own.
link_context() {
  local line
  while read -r line; do
    case "$line" in
      '' | '#'* | '*' | '**/target') ;;
      '!'*) ln -s "$source_folder/${line#!}" "$scratch/context/${line#!}" ;;
      *) printf 'Dockerfile.dockerignore: this check does not know "%s"\n' "$line" >&2; return 1 ;;
    esac
  done < "$deploy/Dockerfile.dockerignore"
}
context_is_complete() {
  local broken
  mkdir "$scratch/context"
  link_context || return 1
  broken="$(find "$scratch/context" -xtype l)"
  [[ -z "$broken" ]] || { printf 'there is no %s\n' "$broken" >&2; return 1; }
  [[ ! -e "$scratch/context/deploy" ]] || { printf 'deploy/ has keys\n' >&2; return 1; }
  env -C "$scratch/context" cargo metadata --no-deps --locked --offline --format-version 1 > /dev/null
}
if command -v cargo > /dev/null; then
  judge Dockerfile 'cargo metadata, with what is copied into the build' context_is_complete
else
  unchecked Dockerfile 'cargo is not installed'
fi

if command -v docker > /dev/null && docker info > /dev/null 2>&1; then
  judge Dockerfile 'docker build --check' docker build --check -f "$deploy/Dockerfile" "$source_folder"
else
  unchecked Dockerfile 'no Docker engine runs here'
fi
exit "$failed"
