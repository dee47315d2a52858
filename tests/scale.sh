#!/usr/bin/env bash
# Exports a synthetic store of the full size, 9,000 materials in 14 views, and tells time and peak
# memory of every manifest and layout, beside `tar` of the same bytes. Needs 15 GB of disk below
# TMPDIR. BRDFARM_SCALE_PROFILE=dev spares the release build.
set -euo pipefail
cd "$(dirname "$0")/.."

profile="${BRDFARM_SCALE_PROFILE:-release}"
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
cargo build --profile "$profile" --features cluster
BRDFARM_SCALE_STORE="$scratch/store" \
  cargo test --quiet --profile "$profile" -p export --test scale -- --ignored
folder="$profile"
[[ "$profile" == dev ]] && folder=debug

BRDFARM="$PWD/target/$folder/brdfarm" SCRATCH="$scratch" python3 - <<'PYTHON'
import os, shutil, subprocess, sys, time
from pathlib import Path

brdfarm, scratch = os.environ["BRDFARM"], Path(os.environ["SCRATCH"])


def measure(name, command):
    os.sync()
    started = time.monotonic()
    process = subprocess.Popen(command, cwd=scratch, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    os.sync()
    seconds = time.monotonic() - started
    if status:
        sys.exit(f"{name} failed")
    cpu = usage.ru_utime + usage.ru_stime
    memory = usage.ru_maxrss / 1024
    print(f"{name:<20} {seconds:7.1f} s {cpu:7.1f} s of a core {memory:6.0f} MiB", flush=True)
    return seconds, usage.ru_maxrss


manifests = [
    measure(f"manifest {format}", [brdfarm, "dataset", "manifest", "export", "--format", format])
    for format in ("parquet", "csv", "jsonl")
]
# The same bytes to one file. The first time fills the page cache, and is not counted.
measure("tar, cold", ["tar", "-cf", "blobs.tar", "store/blobs"])
(scratch / "blobs.tar").unlink()
tar = []
for layout in ("webdataset", "huggingface", "files"):
    tar.append(measure("tar", ["tar", "-cf", "blobs.tar", "store/blobs"])[0])
    (scratch / "blobs.tar").unlink()
    seconds, _ = measure(layout, [brdfarm, "dataset", "export", layout, "--layout", layout])
    print(f"{'':20} {seconds / tar[-1]:7.2f} times tar", flush=True)
    if layout == "webdataset":
        ratio = seconds / tar[-1]
    shutil.rmtree(scratch / layout)
total = sum(seconds for seconds, _ in manifests)
memory = max(memory for _, memory in manifests) / 1024
print(f"manifests {total:.1f} s of 60, {memory:.0f} MiB of 1024; shards {ratio:.2f} of 1.5")
sys.exit(not (total < 60 and memory < 1024 and ratio <= 1.5))
PYTHON
