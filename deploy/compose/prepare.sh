#!/usr/bin/env bash
# Makes what compose.yaml needs beside it: keys of a certificate authority of its own, passwords
# drawn at random, the S3 server's accounts, and a specification to change. Keeps what is there.
#
#   BRDFARM=target/release/brdfarm deploy/compose/prepare.sh
set -euo pipefail
cd "$(dirname "$0")"
program="${BRDFARM:-brdfarm}"
[[ "$program" != */* || "$program" == /* ]] || program="$OLDPWD/$program"
umask 077

draw() { od -An -N 24 -t x1 /dev/urandom | tr -d ' \n'; }

[[ -e keys ]] || "$program" credentials keys --host coordinator --host localhost
[[ -e dataset.toml ]] || printf 'name = "maxbrdf"\nmaterials = 60\n' > dataset.toml
if [[ ! -e farm.env ]]; then
  database="$(draw)" access="$(draw)" secret="$(draw)"
  printf '%s' "$database" > database.secret
  printf 'PGPASSWORD=%s\nAWS_ACCESS_KEY_ID=%s\nAWS_SECRET_ACCESS_KEY=%s\n' \
    "$database" "$access" "$secret" > farm.env
  printf '{"identities": [{"name": "brdfarm", "credentials": [{"accessKey": "%s", "secretKey": "%s"}],
 "actions": ["Admin", "Read", "List", "Tagging", "Write"]}]}\n' "$access" "$secret" > s3.json
fi
# The program runs as user 10001 in its container, and reads no more than these.
if [[ "$(id -u)" == 0 ]]; then
  chown -R 10001:10001 keys dataset.toml
else
  chmod -R a+rX keys dataset.toml
fi
