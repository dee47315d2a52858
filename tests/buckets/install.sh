#!/usr/bin/env bash
# Installs an emulator, and what it needs, into target/buckets and nowhere else.
#
#   tests/buckets/install.sh azure|gcs|moto|s3s
set -euo pipefail
cd "$(dirname "$0")/../.."

provider="$1"
directory=target/buckets
mkdir -p "$directory"

as_root() {
  if [[ "$(id -u)" == 0 ]]; then "$@"
  elif command -v sudo >/dev/null; then sudo "$@"
  else
    echo "buckets: run as root: $*" >&2
    exit 1
  fi
}

# Debian packages that are missing, for the command that they bring.
need() {
  local command="$1"
  shift
  command -v "$command" >/dev/null && return
  echo "buckets: installing $*"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"
}

# Python packages, all or none, in a virtual environment of their own.
in_venv() {
  local venv="$directory/$1"
  shift
  [[ "$(cat "$venv/installed" 2>/dev/null || true)" == "$*" ]] && return
  rm -rf "$venv"
  python3 -m venv "$venv"
  "$venv/bin/pip" --disable-pip-version-check --quiet install "$@"
  echo "$*" >"$venv/installed"
}

need curl curl ca-certificates
need openssl openssl
case "$provider" in
  azure)
    need npm nodejs npm
    installed="$directory/azurite/node_modules/azurite/package.json"
    grep -qs '"version": "3.35.0"' "$installed" \
      || npm install --silent --no-audit --no-fund --prefix "$directory/azurite" azurite@3.35.0
    ;;
  gcs)
    need python3 python3 python3-venv
    in_venv gcs gcp-storage-emulator==2026.7.19 cryptography==50.0.2
    ;;
  moto)
    need python3 python3 python3-venv
    in_venv moto 'moto[s3,server]==5.2.5'
    ;;
  s3s)
    [[ -x "$directory/s3s/bin/s3s-fs" ]] \
      || cargo install --quiet --locked --root "$directory/s3s" s3s-fs --version 0.14.1 --features binary
    ;;
  *)
    echo "buckets: there is no provider $provider" >&2
    exit 2
    ;;
esac
