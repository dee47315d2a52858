#!/usr/bin/env bash
# Builds the Python wheels, for Linux with glibc 2.28 or newer, into target/wheels, and tries each in
# a fresh virtual environment where there is no Rust. One wheel serves every Python from 3.10 on.
# Compiler and linker for both processors is zig, from PyPI; nothing is installed outside of target.
# The wheel of another processor is tried under qemu-user (Debian: qemu-user-static), with a Python of
# that processor from uv.
#
#   deploy/wheels.sh                    x86_64 and aarch64
#   deploy/wheels.sh x86_64             one of them
#
# The wheel of this machine's processor also runs examples/quickstart.ipynb there; with WHEELS_TORCH=1
# PyTorch is installed as well, and the cells that need it run too.
set -euo pipefail
cd "$(dirname "$0")/.."

glibc='2.28'
tools='target/wheel-tools'
out="$PWD/target/wheels"
bin='python/package/brdfarm/bin'
requirements='maturin==1.16.0 ziglang==0.15.2 cargo-zigbuild==0.24.1 uv==0.13.9'

say() { printf 'wheels: %s\n' "$*"; }
fail() { printf 'wheels: %s\n' "$*" >&2; exit 1; }

install_tools() {
  if [[ "$(cat "$tools/requirements" 2>/dev/null || true)" != "$requirements" ]]; then
    rm -rf "$tools"
    python3 -m venv "$tools"
    # shellcheck disable=SC2086 # a list
    "$tools/bin/pip" --disable-pip-version-check --quiet install $requirements
    echo "$requirements" > "$tools/requirements"
  fi
  PATH="$PWD/$tools/bin:$PATH"
}

build() {
  local processor="$1" target="$1-unknown-linux-gnu"
  rustup target add "$target" > /dev/null 2>&1 || fail "rustup cannot add the target $target"
  say "the command for $processor"
  cargo zigbuild --release --features training,cluster --bin brdfarm --target "$target.$glibc" \
    --config 'profile.release.strip = true' --config 'profile.release.debug = false'
  mkdir -p "$bin"
  cp "${CARGO_TARGET_DIR:-target}/$target/release/brdfarm" "$bin/brdfarm"
  say "the wheel for $processor"
  maturin build --manifest-path python/Cargo.toml --release --strip --zig --target "$target" \
    --compatibility "manylinux_${glibc/./_}" --out "$out" \
    --config 'profile.release.debug = false' --config 'profile.release.strip = true'
  rm -r "$bin"
}

# Installs a wheel where no Rust can be found, and does with it what the README says; then runs the
# notebook if there is one.
try() {
  local wheel="$1" python="$2" notebook="${3:-}" place packages
  place="$(mktemp -d)"
  (
    cd "$place"
    PATH='/usr/local/bin:/usr/bin:/bin'
    "$python" -m venv environment
    before="$SECONDS"
    environment/bin/pip --disable-pip-version-check --quiet install "$wheel"
    say "installed in $((SECONDS - before)) s"
    environment/bin/brdfarm --version
    environment/bin/brdfarm run --materials 12 --store store
    environment/bin/python - <<'PYTHON'
import brdfarm

spec = brdfarm.Specification.preset()
image = brdfarm.render(spec, spec.material(3), 5)
print(image, f"{image.seconds:.2f} s")
assert brdfarm.Dataset("store")[3, 5].digest == image.digest
PYTHON
    if [[ -n "$notebook" ]]; then
      packages=(pyarrow pandas matplotlib nbclient ipykernel pytest)
      [[ -z "${WHEELS_TORCH:-}" ]] || packages+=(torch)
      environment/bin/pip --disable-pip-version-check --quiet install "${packages[@]}"
      environment/bin/python -m pytest --quiet -p no:cacheprovider "$notebook"
    fi
    environment/bin/pip --quiet uninstall --yes brdfarm
    left="$(find environment -iname '*brdfarm*')"
    [[ -z "$left" ]] || fail "uninstalled, and still there: $left"
  )
  rm -rf "$place"
}

install_tools
mkdir -p "$out"
here="$(uname -m)"
processors=("$@")
((${#processors[@]})) || processors=(x86_64 aarch64)
for processor in "${processors[@]}"; do
  case "$processor" in x86_64 | aarch64) ;; *) fail "no wheel is built for $processor" ;; esac
  build "$processor"
  wheel="$(find "$out" -name "brdfarm-*_$processor.whl" -printf '%T@ %p\n' | sort -n | tail -1 | cut -d' ' -f2)"
  say "$(du -h "$wheel" | cut -f1) $wheel"
  if [[ "$processor" == "$here" ]]; then
    try "$wheel" "$(command -v python3)" "$PWD/tests/python/notebook"
  else
    command -v "qemu-$processor-static" > /dev/null ||
      fail "qemu-$processor-static is missing (Debian: qemu-user-static): the wheel is not tried"
    uv python install --install-dir "$tools/pythons" "cpython-3.11-linux-$processor-gnu"
    python="$(find "$tools/pythons" -path "*$processor*/bin/python3.11" | head -1)"
    try "$wheel" "$PWD/$python"
  fi
done
