#!/usr/bin/env bash
# Liars against a coordinator with credentials and default settings: each kind twenty times, over 200
# materials with two honest workers; tells how many sets were right, and the share of wrong materials
# that was left. Then what trust costs: the share of 2,000 materials that is rendered twice with eight
# honest workers. Some ten minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo test --release --test trust -- --ignored --nocapture --test-threads 1
