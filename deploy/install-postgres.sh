#!/usr/bin/env bash
# Installs a PostgreSQL server of Debian's packages, for the tests, which start one of their own:
# none is started here, and none that runs is touched. Run it again at will.
set -euo pipefail

say() { printf 'install-postgres: %s\n' "$*"; }
fail() { printf 'install-postgres: %s\n' "$*" >&2; exit 1; }

if compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null; then
  say 'already installed'
  exit 0
fi

command -v apt-get >/dev/null || fail 'there is no apt-get: install PostgreSQL 15 or newer with the package manager of this system, so that its programs are in /usr/lib/postgresql/VERSION/bin'
# Without this file the package starts a server of its own.
step='mkdir -p /etc/postgresql-common && { [ -e /etc/postgresql-common/createcluster.conf ] || echo "create_main_cluster = false" >/etc/postgresql-common/createcluster.conf; } && apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends postgresql'
if [[ "$(id -u)" == 0 ]]; then
  sh -c "$step"
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
  sudo -n sh -c "$step"
else
  fail 'the package postgresql is needed: install it, then run this again'
fi
compgen -G '/usr/lib/postgresql/*/bin/initdb' >/dev/null || fail 'the package has no initdb'
say 'installed'
