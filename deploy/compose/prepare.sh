#!/usr/bin/env bash
# Makes what compose.yaml needs beside it: keys of a certificate authority of its own, passwords
# drawn at random, the S3 server's accounts, and a specification to change. Keeps what is there.
#
#   BRDFARM=target/release/brdfarm deploy/compose/prepare.sh
#
# Only whoever runs this reads what it makes. The containers of coordinators and workers run as that
# user, or as user 10001 where root runs this, which then owns the two folders that they mount. The
# keys in keys/operator and keys/reader are in no container.
set -euo pipefail
program="${BRDFARM:-brdfarm}"
[[ "$program" != */* ]] || program="$(realpath "$program")"
cd "$(dirname "$0")"
umask 077

draw() { od -An -N 24 -t x1 /dev/urandom | tr -d ' \n'; }

if [[ ! -e keys ]]; then
  rm -rf keys.new
  "$program" credentials keys.new --host coordinator --host localhost > /dev/null
  mv keys.new keys
fi
[[ -e dataset.toml ]] || printf 'name = "maxbrdf"\nmaterials = 60\n' > dataset.toml
if [[ ! -e farm.env ]]; then
  database="$(draw)" access="$(draw)" secret="$(draw)"
  printf '%s' "$database" > database.secret
  printf '{"identities": [{"name": "brdfarm", "credentials": [{"accessKey": "%s", "secretKey": "%s"}],
 "actions": ["Admin", "Read", "List", "Tagging", "Write"]}]}\n' "$access" "$secret" > s3.json
  printf 'PGPASSWORD=%s\nAWS_ACCESS_KEY_ID=%s\nAWS_SECRET_ACCESS_KEY=%s\n' \
    "$database" "$access" "$secret" > farm.env
fi
# What an earlier version of this made, others could read.
chmod -R go= keys farm.env database.secret s3.json
user="$(id -u):$(id -g)"
if docker info --format '{{.SecurityOptions}}' 2> /dev/null | grep -q rootless; then
  # Of a rootless engine root within is whoever runs it.
  user=0:0
elif [[ "$(id -u)" == 0 ]]; then
  user=10001:10001
  chown -R 0:0 keys
  chown -R "$user" keys/coordinator keys/worker dataset.toml
fi
printf 'BRDFARM_USER=%s\n' "$user" > .env
