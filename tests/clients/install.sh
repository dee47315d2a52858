#!/usr/bin/env bash
# Installs the Python readers that the tests run, into target/python-clients and nowhere else, and
# OpenEXR's own tools where they are missing.
set -euo pipefail
cd "$(dirname "$0")/../.."

requirements=tests/clients/requirements.txt
directory=target/python-clients
stamp="$directory/requirements.sha256"
wanted="$(sha256sum "$requirements" | cut -d' ' -f1)"

as_root() {
  if [[ "$(id -u)" == 0 ]]; then "$@"
  elif command -v sudo >/dev/null; then sudo "$@"
  else
    echo "clients: run as root: $*" >&2
    exit 1
  fi
}

missing=()
python3 -m pip --version >/dev/null 2>&1 || missing+=(python3 python3-pip)
command -v exrheader >/dev/null || missing+=(openexr)
if ((${#missing[@]})); then
  echo "clients: installing ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
fi

[[ "$(cat "$stamp" 2>/dev/null || true)" == "$wanted" ]] && exit 0
rm -rf "$directory"
mkdir -p "$directory"
python3 -m pip --disable-pip-version-check --quiet install --root-user-action=ignore --no-warn-conflicts \
  --require-hashes --only-binary=:all: --no-binary=jsonpath-rw --target "$directory" --requirement "$requirements"
echo "$wanted" >"$stamp"
