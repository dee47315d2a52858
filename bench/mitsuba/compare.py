"""Compares brdfarm with Mitsuba: CPU seconds at equal mean relative error. See README.md."""

import argparse
import csv
import dataclasses
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import drjit as dr
import mitsuba as mi

mi.set_variant("llvm_ad_rgb")

import reflectance  # noqa: F401  registers the BSDF
import scene
from measure import (
    Crossing,
    Equality,
    Rung,
    counted_pixels,
    crossing,
    equality,
    relative_error,
)
from peer import Peer
from program import Program

TARGETS = (1e-2, 1e-3)
# Least ratios of Mitsuba's CPU seconds to brdfarm's: on every view, and in the median.
MARKS = {1e-2: (1.0, 15.0), 1e-3: (30.0, 400.0)}

# Of the preset's first 64, chosen to span roughness (0.5, 9, 24, 48, 72, 89 percent) and anisotropy.
PRESET_INDICES = (32, 8, 20, 10, 41, 3)
_HARD = {
    "angle_deg": 40.0,
    "ior": 2.0,
    "rgb0": [0.8, 0.5, 0.3],
    "rgb90": [0.9, 0.9, 0.9],
}
HARD_MATERIALS = {
    "near-mirror": {"roughness": 1.0, "anisotropy": 0.0, **_HARD},
    "brushed": {"roughness": 10.0, "anisotropy": 1.0, **_HARD},
    "half-lambert": {"roughness": 95.0, "anisotropy": 0.3, **_HARD},
}

# brdfarm's ladder of relative accuracies, coarse to fine; its default is 1e-3.
ACCURACIES = (1e-1, 5e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 7e-4, 5e-4, 3e-4, 1e-4)
# The reference is the one of these whose stated error is least.
REFERENCE_ACCURACIES = (1e-4, 3e-5)
# Renderings of one setting of brdfarm, of which the median counts: more where they are short.
REPETITIONS_SHORT, REPETITIONS_LONG, SHORT_SECONDS = 9, 3, 0.1

# Of whole processes.
REPETITIONS_PROCESS = 3

# The rung whose renderings, each with a seed of its own, are compared with the reference.
EQUALITY_SAMPLES, EQUALITY_SEEDS = 64, 8
# A view that looks unequal is compared again, with as many renderings of so many samples. A path may
# be so rare and bright that none of the first has it; then their noise does not show it.
EQUALITY_SAMPLES_MANY = 4096
# Renderings of another rung: more where they are short.
LADDER_SEEDS = {1: 7, 4: 7, 16: 5}
# A view's means are equal when they differ by less than this many standard errors, or by less than
# Mitsuba's 32-bit cone density is off by.
EQUALITY_Z, EQUALITY_BIAS = 4.5, 2e-4
# Its pixels are equal when their differences exceed the noise by less than this factor.
EQUALITY_EXCESS = 1.5
# Fewer counted pixels make no mean.
COUNTED_PIXELS_MIN = 32


@dataclasses.dataclass(frozen=True)
class Ours:
    """What brdfarm takes to reach an error; `relative` is the accuracy asked for."""

    cpu_seconds: float
    relative: float
    error: float
    # Of `brdfarm render`, start, scene and file included.
    process_cpu_seconds: float


@dataclasses.dataclass(frozen=True)
class Row:
    """One view of one material."""

    material: str
    view: int
    counted: int
    # The reference's stated mean error over the mean of the counted pixels.
    reference_error: float
    equality: Equality
    theirs: dict[float, Crossing]
    # None where no accuracy tried reaches the target.
    ours: dict[float, Ours | None]

    def ratio(self, target: float, whole_process: bool = False) -> float:
        """Mitsuba's CPU seconds over brdfarm's; 0 where brdfarm misses the target."""
        ours = self.ours[target]
        if ours is None:
            return 0.0
        spent = ours.process_cpu_seconds if whole_process else ours.cpu_seconds
        return self.theirs[target].cpu_seconds / spent


def is_equal(found: Equality) -> bool:
    """Whether Mitsuba converges to the reference."""
    same_mean = abs(found.z) < EQUALITY_Z or abs(found.mean_difference) < EQUALITY_BIAS
    return same_mean and (found.excess < EQUALITY_EXCESS or found.error < EQUALITY_BIAS)


def climb_ours(program, material, view, reference, counted) -> dict[float, Ours | None]:
    """Tries accuracies from coarse to fine until the finest target is met; the cheapest that meets
    a target counts for it."""
    tried = []
    for relative in ACCURACIES:
        rendering = program.render(material, view, relative, REPETITIONS_LONG)
        if rendering.cpu_seconds < SHORT_SECONDS:
            rendering = program.render(material, view, relative, REPETITIONS_SHORT)
        error = relative_error(rendering.pixels, reference, counted)
        tried.append((rendering.cpu_seconds, relative, error))
        if error <= min(TARGETS):
            break
    found = {}
    for target in TARGETS:
        cheapest = min((rung for rung in tried if rung[2] <= target), default=None)
        if cheapest is None:
            found[target] = None
            continue
        process = program.process_cpu_seconds(material, view, cheapest[1], REPETITIONS_PROCESS)
        found[target] = Ours(*cheapest, process)
    return found


def climb_theirs(peer, reference, counted, samples_max) -> tuple[list[Rung], Equality]:
    """Renders with 1, 4, 16, ... samples a pixel; the rung for the test of equality among them."""
    rungs = []
    samples = 1
    while samples <= samples_max:
        seed_count = EQUALITY_SEEDS if samples == EQUALITY_SAMPLES else LADDER_SEEDS.get(samples, 1)
        images, costs = peer.render(samples, range(seed_count))
        if samples == EQUALITY_SAMPLES:
            found = equality(images, reference, counted)
        error = statistics.fmean(relative_error(image, reference, counted) for image in images)
        rungs.append(Rung(samples, statistics.median(costs), error))
        # The rung for the test is always climbed.
        if error <= min(TARGETS) and samples >= EQUALITY_SAMPLES:
            break
        samples *= 4
    return rungs, found


def compare(program, name, material, view, arguments) -> Row | None:
    """Both on one view of one material; `None` where there is nothing to see."""
    reference = min(
        (program.render(material, view, relative, 1) for relative in REFERENCE_ACCURACIES),
        key=lambda rendering: rendering.stated_error,
    )
    counted = counted_pixels(reference.pixels, arguments.floor)
    count = int(counted.sum())
    if count < COUNTED_PIXELS_MIN:
        return None
    peer = Peer(scene.load(program.specification, view, material))
    rungs, found = climb_theirs(peer, reference.pixels, counted, arguments.samples_max)
    if not is_equal(found):
        images, _ = peer.render(EQUALITY_SAMPLES_MANY, range(EQUALITY_SEEDS))
        found = equality(images, reference.pixels, counted)
    return Row(
        material=name,
        view=view,
        counted=count,
        reference_error=reference.stated_error / float(reference.pixels[counted].mean()),
        equality=found,
        theirs={target: crossing(rungs, target) for target in TARGETS},
        ours=climb_ours(program, material, view, reference.pixels, counted),
    )


def cells(row: Row) -> list[str]:
    """The row of the Markdown table."""
    found = row.equality
    line = [row.material, str(row.view), str(row.counted)]
    line += [f"{found.mean_difference:+.1e}", f"{found.z:+.1f}", f"{found.excess:.2f}"]
    marks = {"extrapolated": "*", "at most": "<=", "measured": ""}
    for target in TARGETS:
        theirs, ours = row.theirs[target], row.ours[target]
        mark = marks[theirs.kind]
        seconds = f"{theirs.cpu_seconds:.3g}"
        line.append(f"{mark} {seconds}" if mark == "<=" else seconds + mark)
        line.append(f"{ours.cpu_seconds:.4f} ({ours.relative:g})" if ours else "not reached")
        line.append(f"{row.ratio(target):.1f}")
    return line


HEADINGS = ["material", "view", "pixels", "mean diff.", "z", "excess"] + [
    f"{what} {100 * target:g}%" for target in TARGETS for what in ("Mitsuba", "brdfarm", "ratio")
]


def markdown(rows: list[Row]) -> str:
    """The table."""
    lines = [HEADINGS, ["---"] * len(HEADINGS)] + [cells(row) for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def judge(holds: bool, text: str) -> str:
    """A line of the verdict."""
    return f"- {'met' if holds else 'MISSED'}: {text}"


def judge_equality(rows: list[Row]) -> tuple[str, bool]:
    """Whether both render the same images, and a line that says so."""
    unequal = [f"{row.material} view {row.view}" for row in rows if not is_equal(row.equality)]
    text = "both render the same image" + ": not " * bool(unequal) + ", ".join(unequal)
    return judge(not unequal, text), not unequal


def judge_marks(rows: list[Row], whole_process: bool) -> tuple[str, bool]:
    """Whether all marks are met, and lines that say so."""
    lines, met = [], True
    for target, (least, middle) in MARKS.items():
        ratios = {
            f"{row.material} at view {row.view}": row.ratio(target, whole_process)
            for row in rows
        }
        median = statistics.median(ratios.values())
        high_enough = sum(ratio >= least for ratio in ratios.values())
        worst = min(ratios, key=ratios.get)
        percent = f"at {100 * target:g} percent"
        lines.append(
            judge(median >= middle, f"{percent} the median ratio is {median:.1f}, mark {middle:g}")
        )
        lines.append(
            judge(
                high_enough == len(rows),
                f"{percent} {high_enough} of {len(rows)} views have a ratio of {least:g} or more; "
                f"the least is {ratios[worst]:.2f}, of {worst}",
            )
        )
        met &= median >= middle and high_enough == len(rows)
    return "\n".join(lines), met


def write_csv(rows: list[Row], path: Path):
    """One line a row, everything in it."""
    heads = ["material", "view", "counted_pixels", "reference_error"]
    heads += ["mean_difference", "z", "excess", "equality_error"]
    for target in TARGETS:
        heads += [
            f"{name}_{target:g}"
            for name in (
                "mitsuba_cpu_seconds",
                "mitsuba_kind",
                "brdfarm_cpu_seconds",
                "brdfarm_accuracy",
                "brdfarm_error",
                "brdfarm_process_cpu_seconds",
                "ratio",
            )
        ]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heads)
        for row in rows:
            line = [row.material, row.view, row.counted, row.reference_error]
            line += dataclasses.astuple(row.equality)
            for target in TARGETS:
                line += dataclasses.astuple(row.theirs[target])
                ours = row.ours[target]
                line += dataclasses.astuple(ours) if ours else [""] * 4
                line.append(row.ratio(target))
            writer.writerow(line)


def numbers(text: str) -> list[int]:
    """A list of numbers and ranges: 0-3,8."""
    found = []
    for part in text.split(","):
        low, _, high = part.partition("-")
        found += range(int(low), int(high or low) + 1)
    return found


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", type=Path, default=Path("target/release/brdfarm"))
    parser.add_argument("--timed", type=Path, default=Path("target/release/examples/timed"))
    parser.add_argument("--out", type=Path, default=Path("target/bench-mitsuba"))
    parser.add_argument(
        "--materials",
        default=",".join([*map(str, PRESET_INDICES), *HARD_MATERIALS]),
        help=f"indices into the preset and names among {', '.join(HARD_MATERIALS)}",
    )
    parser.add_argument("--views", type=numbers, default="0-13", help="as in 4-6,8")
    parser.add_argument("--samples-max", type=int, default=256, help="last rung of Mitsuba")
    parser.add_argument("--floor", type=float, default=1e-2, help="least counted pixel, of white")
    parser.add_argument("--cores", type=numbers, help="as in 0-1: what both may use (default: all)")
    parser.add_argument("--threads", type=int, help="of both (default: one a core)")
    arguments = parser.parse_args()
    if arguments.samples_max < EQUALITY_SAMPLES:
        parser.error(f"--samples-max: at least {EQUALITY_SAMPLES}, for the test of equality")
    return arguments


def main() -> int:
    arguments = parse_arguments()
    # Before any thread is made; children inherit it.
    if arguments.cores:
        os.sched_setaffinity(0, arguments.cores)
    threads = arguments.threads or len(os.sched_getaffinity(0))
    # Materials come in EXR files, and with one thread Mitsuba never returns from reading one.
    dr.set_thread_count(max(2, threads))
    arguments.out.mkdir(parents=True, exist_ok=True)

    with tempfile.TemporaryDirectory() as folder:
        program = Program(arguments.program, arguments.timed, threads, Path(folder))
        materials = {
            name: HARD_MATERIALS.get(name) or program.preset_material(int(name))
            for name in arguments.materials.split(",")
        }
        dr.set_thread_count(threads)
        rows, dark = [], []
        begin = time.monotonic()
        total = len(materials) * len(arguments.views)
        for name, material in materials.items():
            for view in arguments.views:
                row = compare(program, name, material, view, arguments)
                if row is None:
                    dark.append(f"{name} view {view}")
                    continue
                rows.append(row)
                seconds = time.monotonic() - begin
                done = len(rows) + len(dark)
                print(f"{done}/{total} {seconds:.0f} s:", *cells(row), file=sys.stderr, flush=True)
        program.close()

    if not rows:
        print("no view has light enough", file=sys.stderr)
        return 1
    same, equal = judge_equality(rows)
    judged, met = judge_marks(rows, whole_process=False)
    text = f"""# brdfarm and Mitsuba {mi.__version__}: CPU seconds at equal mean relative error

{threads} threads each. `*`: extrapolated. In brackets: brdfarm's relative accuracy. Left out as
dark: {", ".join(dark) or "none"}.

{markdown(rows)}

{same}

{judged}

For comparison, with brdfarm's start, scene and EXR file, which Mitsuba's seconds have no part of:

{judge_marks(rows, whole_process=True)[0]}
"""
    print(text)
    (arguments.out / "table.md").write_text(text)
    write_csv(rows, arguments.out / "table.csv")
    return 0 if met and equal else 1


if __name__ == "__main__":
    sys.exit(main())
