#!/usr/bin/env bash
# Drives the pages in Chromium (see tests/browser/drive.py), with axe-core from npm. Installs Chromium
# and its driver through apt-get where they are missing. Screenshots land in target/browser. Arguments
# are those of cargo test, as `--workspace --features training` where all of that is built already.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v chromedriver >/dev/null || ! command -v chromium >/dev/null; then
  sudo="$([ "$(id -u)" = 0 ] || echo sudo)"
  $sudo apt-get update
  $sudo apt-get install --yes --no-install-recommends chromium chromium-driver
fi
npm install --prefix target/axe --no-audit --no-fund --silent axe-core@4.14.1

cargo test --test pages "$@" -- --ignored --nocapture chromium
python3 tests/browser/drive.py "$PWD/target/debug/brdfarm" \
  target/axe/node_modules/axe-core/axe.min.js target/browser
