#!/usr/bin/env bash
# Memory of `coordinator serve` and of `run` while a set of many cheap materials is completed, by
# how many are: 9,000 in the preset's 14 views, and MATERIALS (1,000,000) in one. Films of 8 x 8
# pixels, so that rendering takes little of the time. Needs 6 GB of disk below TMPDIR for a million.
#
#   tests/memory.sh [MATERIALS]
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release
folder="${CARGO_TARGET_DIR:-$PWD/target}/release"
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT

BRDFARM="$folder/brdfarm" SCRATCH="$scratch" MATERIALS="${1:-1000000}" python3 - <<'PYTHON'
import os, re, shutil, subprocess, sys, time
from pathlib import Path

brdfarm, scratch = os.environ["BRDFARM"], Path(os.environ["SCRATCH"])
AT = [600, 2_100, 3_800, 9_000, 30_000, 100_000, 300_000, 1_000_000]
SMALL = """
[image]
width = 8
height = 8
[accuracy]
absolute = 1e-2
relative = 1e-1
"""
ONE_VIEW = """
[[views]]
camera_elevation_deg = 45.0
light_elevation_deg = 90.0
rotation_deg = 0.0
checker = false
"""


def memory(process, what):
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(rf"{what}:\s+(\d+) kB", status)[1]) / 1024


def watch(process, log, materials):
    """Memory in MiB at each number of completed materials of AT, and the most there ever was."""
    lines, found, most, file = 0, [], 0.0, None
    marks = [mark for mark in AT if mark <= materials]
    while process.poll() is None:
        file = file or (log.exists() and log.open("rb")) or None
        while file and (block := file.read(1 << 20)):
            lines += block.count(b"\n")
        try:
            most = max(most, memory(process, "VmHWM"))
            if marks and lines >= marks[0]:
                found.append(f"{marks.pop(0):>9,}: {memory(process, 'VmRSS'):4.0f}")
        except (OSError, TypeError):
            break
        time.sleep(0.02)
    if process.wait() != 0:
        sys.exit("it failed")
    return found, most


def measure(name, views, materials):
    spec = scratch / "spec.toml"
    spec.write_text(SMALL + (ONE_VIEW if views == 1 else ""))
    store = scratch / f"{name}-{views}"
    options = f"--spec {spec} --materials {materials} --store {store}"
    quiet = dict(stdout=subprocess.PIPE, text=True)
    began = time.monotonic()
    worker = None
    if name == "run":
        process = subprocess.Popen([brdfarm, "run", *options.split()], stdout=subprocess.DEVNULL)
    else:
        serve = f"coordinator serve {options} --listen 127.0.0.1:0 --exit-when-complete"
        process = subprocess.Popen([brdfarm, *serve.split()], **quiet)
        url = process.stdout.readline().split()[-1]
        connect = [brdfarm, "worker", "connect", url]
        worker = subprocess.Popen(connect, stdout=subprocess.DEVNULL)
    found, most = watch(process, store / "completions.log", materials)
    if worker:
        worker.wait()
    print(f"{name}, {materials:,} materials in {views} views, {time.monotonic() - began:.0f} s")
    print("  completed: MiB  ", ", ".join(found), f"; at most {most:.0f}", flush=True)
    shutil.rmtree(store)


for name in ("coordinator", "run"):
    measure(name, 14, 9_000)
    measure(name, 1, int(os.environ["MATERIALS"]))
PYTHON
