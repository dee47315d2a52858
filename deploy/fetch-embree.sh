#!/usr/bin/env bash
# Installs Embree 4.4.0 for the current user, where brdfarm looks for it: two shared libraries from
# a Python wheel pinned by its hash. No compiler and no root needed; run it again at will.
#
#   deploy/fetch-embree.sh
#
# BRDFARM_EMBREE_DIR  install there instead (then set EMBREE_LIBRARY to its libembree4.so.4)
set -euo pipefail

wheel='embreex==4.4.0.post1'
wheel_sha256='2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f'

say() { printf 'fetch-embree: %s\n' "$*"; }
fail() { printf 'fetch-embree: %s\n' "$*" >&2; exit 1; }

case "$(uname -s) $(uname -m)" in
  'Linux x86_64') ;;
  'Linux aarch64')
    fail 'the wheel has no library for aarch64: install libembree4-4 with apt-get (Debian 13, Ubuntu 24.10 or later) or embree with dnf, which brdfarm finds by itself' ;;
  Darwin*)
    fail 'the wheel is for Linux: run "brew install embree" and set EMBREE_LIBRARY to its libembree4.dylib' ;;
  *)
    fail "there is no Embree to fetch for $(uname -s) on $(uname -m): brdfarm renders without it" ;;
esac

if [[ -n "${BRDFARM_EMBREE_DIR:-}" ]]; then
  directory="$BRDFARM_EMBREE_DIR"
else
  data="${XDG_DATA_HOME:-}"
  if [[ "$data" != /* ]]; then
    [[ "${HOME:-}" == /* ]] || fail 'HOME is not set: set BRDFARM_EMBREE_DIR to the directory to install in'
    data="$HOME/.local/share"
  fi
  directory="$data/brdfarm/embree"
fi

# Written last, so a directory that holds it is complete.
stamp='wheel.sha256'
if [[ "$(cat "$directory/$stamp" 2>/dev/null || true)" == "$wheel_sha256" ]]; then
  say "already installed: $directory/libembree4.so.4"
  exit 0
fi

if ! python3 -m pip --version >/dev/null 2>&1; then
  install='apt-get install -y --no-install-recommends python3 python3-pip'
  if ! command -v apt-get >/dev/null; then
    fail 'python3 with pip is needed: install both with the package manager of this system'
  elif [[ "$(id -u)" == 0 ]]; then
    say 'installing python3 and pip'
    apt-get update
    DEBIAN_FRONTEND=noninteractive $install
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    say 'installing python3 and pip through sudo'
    sudo -n apt-get update
    sudo -n DEBIAN_FRONTEND=noninteractive $install
  else
    fail "python3 with pip is needed: run \"sudo $install\", then this again"
  fi
fi

# Beside the destination, so that the last step is a rename within one file system.
mkdir -p "$(dirname "$directory")"
work="$(mktemp -d "$(dirname "$directory")/.embree.XXXXXXXX")"
trap 'rm -rf "$work"' EXIT

say "downloading $wheel"
printf '%s --hash=sha256:%s\n' "$wheel" "$wheel_sha256" >"$work/requirements.txt"
python3 -m pip --disable-pip-version-check --quiet download \
  --require-hashes --only-binary=:all: --no-deps \
  --python-version 3.11 --implementation cp --abi cp311 --platform manylinux_2_28_x86_64 \
  --dest "$work/wheel" --requirement "$work/requirements.txt"

# Embree looks for its threading library beside itself and by the name it has in the wheel; its
# own name is ours to choose. The last line proves that the two load.
mkdir "$work/new"
python3 - "$work/wheel" "$work/new" <<'PYTHON'
import ctypes, pathlib, shutil, sys, zipfile

source, destination = map(pathlib.Path, sys.argv[1:])
(wheel,) = source.glob("*.whl")
with zipfile.ZipFile(wheel) as archive:
    for member in archive.namelist():
        folder, _, name = member.rpartition("/")
        if folder != "embreex.libs":
            continue
        if name.startswith("libembree4") and name.endswith(".so.4"):
            name = "libembree4.so.4"
        elif not (name.startswith("libtbb") and name.endswith(".so.12")):
            continue
        with archive.open(member) as packed, open(destination / name, "wb") as unpacked:
            shutil.copyfileobj(packed, unpacked)
        (destination / name).chmod(0o755)
ctypes.CDLL(str(destination / "libembree4.so.4")).rtcNewDevice
PYTHON
printf '%s\n' "$wheel_sha256" >"$work/new/$stamp"
chmod 755 "$work/new"

if [[ -e "$directory" ]]; then
  mv "$directory" "$work/old"
fi
mv -T "$work/new" "$directory"
say "installed $directory/libembree4.so.4"
