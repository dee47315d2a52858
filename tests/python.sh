#!/usr/bin/env bash
# The Python package with PyTorch: its loaders with 0 and 4 workers, forked and spawned, beside all of
# the package's other tests and the whole notebook. PyTorch comes from PyPI into target/python-torch:
# 5 GB, which is why the default suite does without.
#
#   tests/python.sh
set -euo pipefail
cd "$(dirname "$0")/.."

tests/clients/install.sh
directory='target/python-torch'
if [[ ! -x "$directory/bin/python" ]]; then
  python3 -m venv "$directory"
  "$directory/bin/pip" --disable-pip-version-check --quiet install 'torch>=2.2' ||
    { rm -rf "$directory"; exit 1; }
fi
PATH="$PWD/$directory/bin:$PATH" cargo test --workspace --features training --test python -- --include-ignored
