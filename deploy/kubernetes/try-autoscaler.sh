#!/usr/bin/env bash
# Asks what the autoscaler asks, of a real PostgreSQL with the schema that the program makes, as the
# role that the job database-reader makes with its own statements: while materials wait, while second
# renderings are due that nobody else is there to do, while the farm is paused, and when all is done.
#
#   deploy/kubernetes/try-autoscaler.sh PROGRAM QUERY.sql
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
program="$(realpath "$1")" query="$(realpath "$2")"

fail() { printf 'try-autoscaler: %s\n' "$*" >&2; exit 1; }
binaries="$(printf '%s\n' /usr/lib/postgresql/*/bin | sort -V | tail -n 1)"
[[ -x "$binaries/initdb" ]] || fail 'PostgreSQL is wanted: deploy/install-postgres.sh'

scratch="$(mktemp -d)"
chmod 711 "$scratch"
processes=()
tear_down() {
  for process in "${processes[@]}"; do
    kill "$process" 2> /dev/null || true
    wait "$process" 2> /dev/null || true
  done
  as_server "$binaries/pg_ctl" stop --pgdata "$scratch/data" --mode immediate --silent 2> /dev/null || true
  rm -rf "$scratch"
}
# PostgreSQL does not run as root.
as_server() {
  if [[ "$(id -u)" == 0 ]]; then
    setpriv --reuid postgres --regid postgres --clear-groups env -C "$scratch" "$@"
  else
    "$@"
  fi
}
within() {
  local tenths
  for ((tenths = 0; tenths < $1 * 10; tenths++)); do
    if "${@:2}" > /dev/null 2>&1; then return; fi
    sleep 0.1
  done
  fail "not within $1 s: ${*:2}"
}

export PGHOST=127.0.0.1 PGPORT PGDATABASE=brdfarm PGSSLMODE=disable
# A port that is free now.
PGPORT="$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')"
trap tear_down EXIT
install -d -m 700 "$scratch/data"
[[ "$(id -u)" != 0 ]] || chown postgres: "$scratch/data"
install -m 600 /dev/null "$scratch/admin-password"
printf 'of-the-admin' > "$scratch/admin-password"
[[ "$(id -u)" != 0 ]] || chown postgres: "$scratch/admin-password"
as_server "$binaries/initdb" --pgdata "$scratch/data" --username postgres --no-sync \
  --auth scram-sha-256 --pwfile "$scratch/admin-password" > /dev/null
as_server "$binaries/pg_ctl" start --pgdata "$scratch/data" --silent --wait --log "$scratch/data/log" \
  --options "-c listen_addresses=127.0.0.1 -c port=$PGPORT -c unix_socket_directories='' -c fsync=off"

as_admin() { PGUSER=postgres PGPASSWORD=of-the-admin psql --no-psqlrc --quiet --set=ON_ERROR_STOP=1 "$@"; }
as_reader() {
  PGUSER=brdfarm_reader PGPASSWORD="$1" psql --no-psqlrc --quiet --no-align --tuples-only \
    --set=ON_ERROR_STOP=1 "${@:2}"
}
# As the job runs them.
make_reader() {
  READER_PASSWORD="$1" PGUSER=postgres PGPASSWORD=of-the-admin psql --no-psqlrc --no-password --quiet \
    --set=ON_ERROR_STOP=1 --single-transaction --file="$here/base/database-reader.sql"
}
asked() { as_reader of-the-reader --file "$query"; }
wants() {
  local answer
  answer="$(asked)"
  [[ "$answer" == "$1" ]] || fail "$2: the autoscaler hears $answer, not $1"
}
hears() { [[ "$(asked)" == "$1" ]]; }
worker() { "$program" worker connect "$url" --name "$1" --threads 1 "${@:2}" > "$scratch/$1" 2>&1; }
control() { "$program" "$@" --coordinator "$url" > /dev/null; }

PGDATABASE=postgres as_admin --command "CREATE ROLE brdfarm LOGIN PASSWORD 'of-the-farm'" \
  --command 'CREATE DATABASE brdfarm OWNER brdfarm'
if make_reader of-the-reader 2> /dev/null; then
  fail 'the role is made before there are tables: the job would not be tried again'
fi
printf 'materials = 12\n[image]\nwidth = 16\nheight = 16\n' > "$scratch/dataset.toml"
PGPASSWORD=of-the-farm "$program" coordinator serve --spec "$scratch/dataset.toml" --listen 127.0.0.1:0 \
  --store "postgres://brdfarm@127.0.0.1:$PGPORT/brdfarm" --blobs "$scratch/blobs" --check-percent 100 \
  > "$scratch/coordinator" 2>&1 &
processes+=("$!")
within 20 grep -q '^listening on ' "$scratch/coordinator"
url="$(sed -n 's/^listening on //p' "$scratch/coordinator")"
within 20 control coordinator health

make_reader earlier
make_reader of-the-reader
if as_reader earlier --command 'SELECT 1' > /dev/null 2>&1; then fail 'the earlier password works still'; fi
if as_reader of-the-reader --command 'SELECT token FROM leases' > /dev/null 2>&1; then
  fail 'the reader reads tokens of leases'
fi
if as_reader of-the-reader --command 'UPDATE tallies SET pending = 0' > /dev/null 2>&1; then
  fail 'the reader writes'
fi

wants 12 'twelve materials wait'
control pause
wants 0 'the farm is paused'
control resume
worker first || fail "the first worker failed: $(cat "$scratch/first")"
# Nobody else is there to render them a second time: three workers' share.
wants 60 'twelve second renderings are due'
worker second || fail "the second worker failed: $(cat "$scratch/second")"
within 10 hears 0
count() { as_admin --command "UPDATE tallies SET $1 WHERE shard = 0"; }
count 'disputed = disputed + 1, completed = completed - 1'
wants 60 'one dispute is open'
count 'disputed = disputed - 1, leased = leased + 45, pending = pending + 100'
wants 145 '45 are being rendered and 100 wait'
