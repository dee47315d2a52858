#!/usr/bin/env bash
# Renders on an emulated 64-bit ARM processor: 56 small images must have the digests that x86-64
# gives them, and the splits of materials and the elementary functions the same values. Ends with one
# line of counts; fails if anything differs. The build takes four minutes of processor time, and
# what is emulated takes three. On two busy cores it took 8 minutes once everything was built.
#
# Installs what is missing: a cross linker, a C library and qemu from Debian's packages, and Rust's
# standard library for the processor through rustup.
#
# BRDFARM_DIGEST_THREADS=2  how many threads render
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { printf 'arm: %s\n' "$*" >&2; exit 1; }

target=aarch64-unknown-linux-gnu
sysroot=/usr/aarch64-linux-gnu
packages='gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user'

[[ "$(uname -m)" != aarch64 ]] || fail 'this is such a processor: tests/run.sh compares the digests here'

ready() {
  command -v aarch64-linux-gnu-gcc >/dev/null && command -v qemu-aarch64 >/dev/null &&
    [[ -e "$sysroot/lib/libc.so.6" && -e "$sysroot/include/stdio.h" ]]
}

if ! ready; then
  command -v apt-get >/dev/null || fail "there is no apt-get: install what Debian calls $packages"
  step="apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $packages"
  if [[ "$(id -u)" == 0 ]]; then
    sh -c "$step"
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    sudo -n sh -c "$step"
  else
    fail "install the packages $packages, then run this again"
  fi
  ready || fail "programs or libraries are missing though $packages are installed"
fi
command -v rustup >/dev/null || fail 'rustup is needed: it installs the standard library for aarch64'
rustup target add "$target"

export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L $sysroot"
export BRDFARM_DIGEST_THREADS="${BRDFARM_DIGEST_THREADS:-2}"

log="$(mktemp)"
trap 'rm -f "$log"' EXIT
status=0
test_on_arm() {
  cargo test --release --target "$target" "$@" 2>&1 | tee -a "$log" || status=$?
}

# The quickest come first.
test_on_arm -p dataset --lib
test_on_arm -p renderer --lib -- elementary instructions
test_on_arm -p renderer --test determinism -- \
  bytes_are_those_written_down backends_and_instruction_sets_change_no_byte

awk '/^test result:/ { passed += $4; failed += $6; ignored += $8 }
     END { printf "%d passed, %d failed, %d skipped\n", passed, failed, ignored }' "$log"
exit "$status"
