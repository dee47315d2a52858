#!/usr/bin/env bash
# At least 100 kill -9 of coordinator and workers, at random instants of one run of 60 materials,
# once with images in files and once in a bucket; then at least 50 of three coordinators, their
# PostgreSQL and six workers. Each ends with counts. Before that a connection that dies without a
# word, which takes a minute. BRDFARM_SEED=N repeats a run that failed.
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/install-postgres.sh
cargo test --workspace --features training --test farm_faults a_connection_that_dies -- --ignored
cargo test --workspace --features training --test farm_faults campaign_of -- --ignored --nocapture --test-threads 1
