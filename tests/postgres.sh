#!/usr/bin/env bash
# The job store on PostgreSQL, at length.
#
#   tests/postgres.sh model     100,000 and more random operations against the model (an hour)
#   tests/postgres.sh measure   claims and completions a second with 1 to 64 clients, and three
#                               million jobs; dead tuples and sizes
#   tests/postgres.sh pages     how long pages of three million jobs take, by state
#   tests/postgres.sh migrate   a store of 27,000 images copied into a database and back: time, memory
#
# BRDFARM_TEST_POSTGRES=URL      for model: use this server, not a private one
# BRDFARM_MODEL_RUNS=512         for model: 200 to 300 operations each
# BRDFARM_MEASURE_SECONDS=30     how long each is measured
# BRDFARM_SOAK_SECONDS=600       go on for so long afterwards, telling of dead tuples every minute
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/install-postgres.sh
case "${1:-}" in
  model) cargo test -p jobstore-postgres --lib for_long -- --ignored --nocapture ;;
  measure) cargo test --release -p jobstore-postgres --lib three_million_jobs -- --ignored --nocapture ;;
  pages) cargo test --release -p jobstore-postgres --lib pages_of_three -- --ignored --nocapture ;;
  migrate) cargo test --release --test shared_store scale -- --ignored --nocapture ;;
  *) sed -n '2,/^set/{s/^# \{0,1\}//;/^set/!p}' "$0" >&2; exit 2 ;;
esac
