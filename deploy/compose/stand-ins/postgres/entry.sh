#!/bin/sh
# In the place of the official image's entrypoint: on the first start makes a database for
# POSTGRES_USER, whose password is in POSTGRES_PASSWORD_FILE, then serves it. Starts as root.
set -eu
programs=/usr/lib/postgresql/17/bin
data=/var/lib/postgresql/data
as_postgres() { setpriv --reuid postgres --regid postgres --init-groups "$@"; }

if [ ! -e "$data/PG_VERSION" ]; then
  chown postgres: "$data"
  chmod 700 "$data"
  install -o postgres -m 600 "$POSTGRES_PASSWORD_FILE" /tmp/password
  as_postgres "$programs/initdb" -D "$data" -U "$POSTGRES_USER" --auth-host scram-sha-256 --pwfile /tmp/password
  rm /tmp/password
  echo 'host all all all scram-sha-256' >> "$data/pg_hba.conf"
  as_postgres "$programs/pg_ctl" -D "$data" -w start \
    -o '-c listen_addresses= -c unix_socket_directories=/tmp'
  "$programs/createdb" -h /tmp -U "$POSTGRES_USER" "$POSTGRES_DB"
  as_postgres "$programs/pg_ctl" -D "$data" -w stop
fi
exec setpriv --reuid postgres --regid postgres --init-groups "$programs/postgres" -D "$data" \
  -c 'listen_addresses=*'
