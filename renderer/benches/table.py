#!/usr/bin/env python3
"""Prints what `cargo bench -p renderer` measured last as the README's table, medians."""

import json
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

# In the order of the table: what an iteration is, and what one item of it is.
ROWS = {
    "reflectance/evaluate": ("the model, for 1,024 directions", "evaluation"),
    "reflectance/sample": ("directions drawn from the lobe, 1,024", "direction"),
    "cubature/pixel/ordinary": ("the bulb's light in one pixel, ordinary", "evaluation"),
    "cubature/pixel/mirror": ("the same, mirror", "evaluation"),
    "cubature/pixel/brushed-mirror": ("the same, brushed mirror", "evaluation"),
    "path/sample/with chart": ("1,024 light paths, view 5 with chart", "path"),
    "path/sample/without chart": ("1,024 light paths, view 10 without", "path"),
    "intersect/ray/native": ("1,024 camera rays, native", "ray"),
    "intersect/ray/embree": ("the same, Embree's widest", "ray"),
    "intersect/ray/embree:sse2": ("the same, Embree on SSE2", "ray"),
    "intersect/ray/embree:sse4.2": ("the same, Embree on SSE4.2", "ray"),
    "intersect/ray/embree:avx": ("the same, Embree on AVX", "ray"),
    "intersect/ray/embree:avx2": ("the same, Embree on AVX2", "ray"),
    "intersect/ray/embree:avx512": ("the same, Embree on AVX-512", "ray"),
    "exr/encode": ("a 128 x 128 image as EXR", None),
    "view/hybrid/without chart": ("view 10, hybrid, 128 x 128", None),
    "view/hybrid/with chart": ("view 5 with chart, hybrid", None),
    "view/path/64 samples with chart": ("the same, path tracer, 64 samples", None),
}


def readable(nanoseconds):
    for unit, size in (("s", 1e9), ("ms", 1e6), ("µs", 1e3)):
        if nanoseconds >= size:
            return f"{nanoseconds / size:.3g} {unit}"
    return f"{nanoseconds:.3g} ns"


def main():
    measured = {}
    for path in (ROOT / "target/criterion").glob("**/new/benchmark.json"):
        benchmark = json.loads(path.read_text())
        estimates = json.loads((path.parent / "estimates.json").read_text())
        throughput = benchmark["throughput"] or {}
        measured[benchmark["full_id"]] = (
            estimates["median"]["point_estimate"],
            throughput.get("Elements"),
        )
    unknown = sorted(set(measured) - set(ROWS))
    if unknown:
        sys.exit(f"table.py has no words for {', '.join(unknown)}")
    print("| what | time | of one |")
    print("| --- | ---: | ---: |")
    for name, (what, item) in ROWS.items():
        if name in measured:
            time, items = measured[name]
            one = f"{item} {readable(time / items)}" if item and items else ""
            print(f"| {what} | {readable(time)} | {one} |")


if __name__ == "__main__":
    main()
