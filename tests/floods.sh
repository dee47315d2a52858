#!/usr/bin/env bash
# Floods against honest workers, at their full size; each ends with its figures and fails where they
# miss their marks: honest workers lose less than a fifth of their jobs a second, 99 of 100 leases
# stay below 200 ms, a new worker is admitted within 10 s, all complete.
#
#   tests/floods.sh           all of them
#   tests/floods.sh list      ListJobs with 4,096 overlapping ranges over a million materials
#   tests/floods.sh stage     images staged under hundreds of leases and never completed
#   tests/floods.sh connect   4,095 TLS handshakes without a call
#   tests/floods.sh unread    peers that ask for parts of a mesh and read none of them
#   tests/floods.sh large     28 workers with 100 MB a material each
#
# Wants a machine that does nothing else, and 3 GB of room for `large`.
set -euo pipefail
cd "$(dirname "$0")/.."

throughput() {
  cargo test --release --test throughput "$1" -- --ignored --nocapture --test-threads 1
}

list() { throughput a_reader_with_4096_ranges; }
stage() { throughput somebody_stages; }
large() { throughput all_of_28_workers; }
connect() {
  cargo test --release --test farm_security four_thousand_handshakes -- --ignored --nocapture
}

unread() {
  cargo test --release --test farm_security who_reads_no_answers -- --include-ignored --nocapture
}

case "${1:-all}" in
  all) list; stage; connect; unread; large ;;
  list | stage | connect | unread | large) "$1" ;;
  *) sed -n '2,/^set/{s/^# \{0,1\}//;/^set/!p}' "$0" >&2; exit 2 ;;
esac
