#!/usr/bin/env bash
# Liars against a coordinator with credentials and default settings: each kind twenty times, over 200
# materials with two honest workers; tells how many sets were right, and the share of wrong materials
# that was left. Then what trust costs: the share of 2,000 materials that is rendered twice with eight
# honest workers. Takes long on a busy machine: a set took 12 s there.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --release --test trust -- --ignored --nocapture --test-threads 1
