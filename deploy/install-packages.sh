#!/usr/bin/env bash
# Installs those of these Debian packages that are missing, and starts none of their services.
#
#   deploy/install-packages.sh PACKAGE...
set -euo pipefail

missing=()
for package in "$@"; do
  status="$(dpkg-query --show --showformat '${db:Status-Status}' "$package" 2> /dev/null || true)"
  [[ "$status" == installed ]] || missing+=("$package")
done
((${#missing[@]})) || exit 0
if [[ "$(id -u)" != 0 ]] || ! command -v apt-get > /dev/null; then
  printf 'install-packages: missing here: %s; apt-get and root are needed to install them\n' \
    "${missing[*]}" >&2
  exit 1
fi
# Whoever installs packages to try something wants no services of theirs: this file forbids them.
policy=/usr/sbin/policy-rc.d
if [[ ! -e "$policy" ]]; then
  trap 'rm -f "$policy"' EXIT
  printf '#!/bin/sh\nexit 101\n' > "$policy"
  chmod 755 "$policy"
fi
printf 'install-packages: installing %s\n' "${missing[*]}"
{
  apt-get update
  DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}"
} > /dev/null
