#!/usr/bin/env bash
# The long tests of meshes: ten million rays at edges and vertices on every instruction set, a million
# triangles with one digest, also without a hierarchy, and the stated errors of drawn materials. On two busy
# cores the rays alone took 55 minutes.
set -euo pipefail
cd "$(dirname "$0")/.."
deploy/fetch-embree.sh
exec cargo test --workspace --features training --test watertight --test meshes -- --ignored
