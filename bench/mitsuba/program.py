"""Drives brdfarm: one process that renders on request, and `brdfarm render`."""

import json
import os
import statistics
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

# What the accuracy of a specification holds: absolute (of white) over relative, as in the preset.
ABSOLUTE_OVER_RELATIVE = 0.1
VIEW_WITHOUT_CHART = 13


@dataclass
class Rendering:
    """An image of shape (rows, columns, 3), in units of white."""

    pixels: np.ndarray
    # User and system, all threads, from the material to the film: the median of several.
    cpu_seconds: float
    # The program's own bound on its error, meant to hold for 95 percent of pixels; its mean.
    stated_error: float


class Program:
    """The program, and its renderer as a process that stays (`renderer/examples/timed.rs`), with a
    number of threads and their files in a folder."""

    def __init__(self, path: Path, timed: Path, threads: int, folder: Path):
        self.path, self.threads, self.folder = path, threads, folder
        text = subprocess.check_output([path, "dataset", "specification"], text=True)
        self.specification = tomllib.loads(text)
        image = self.specification["image"]
        self.shape = (image["height"], image["width"], 3)
        self.timed = subprocess.Popen(
            [timed],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "RAYON_NUM_THREADS": str(threads)},
        )

    def close(self):
        """Ends the process that renders."""
        self.timed.stdin.close()
        self.timed.wait()

    def preset_material(self, index: int) -> dict:
        """The ten parameters of a material of the preset."""
        out = self.folder / "material.exr"
        self._run(
            ["--spec", self._next_to_nothing(), "--material", str(index)]
            + ["--view", str(VIEW_WITHOUT_CHART), "--out", out]
        )
        header = json.loads(mi.Bitmap(str(out)).metadata()["brdfarm"])
        return header["parameters"]

    def render(self, material: dict, view: int, relative: float, repetitions: int) -> Rendering:
        """A view of a material, to a relative accuracy, in the process that stays."""
        out = self.folder / "image.f64"
        request = {"material": material, "view": view, "repetitions": repetitions, "out": str(out)}
        request |= {"relative": relative, "absolute": ABSOLUTE_OVER_RELATIVE * relative}
        print(json.dumps(request), file=self.timed.stdin, flush=True)
        line = self.timed.stdout.readline()
        if not line:
            raise RuntimeError(f"no answer to {request}: the renderer ended")
        answer = json.loads(line)
        pixels = np.fromfile(out, dtype="<f8").reshape(self.shape)
        cpu_seconds = statistics.median(answer["cpu_seconds"])
        return Rendering(pixels, cpu_seconds, answer["stated_error"])

    def process_cpu_seconds(
        self, material: dict, view: int, relative: float, repetitions: int
    ) -> float:
        """What `brdfarm render` takes for it, from its start to the file: the median of several."""
        material_file = self.folder / "material.json"
        material_file.write_text(json.dumps(material))
        arguments = ["--spec", self._specification_file(relative), "--material-file", material_file]
        arguments += ["--view", str(view), "--out", self.folder / "image.exr"]
        return statistics.median(self._run(arguments) for _ in range(repetitions))

    def _next_to_nothing(self) -> Path:
        """A specification of one small pixel."""
        path = self.folder / "next-to-nothing.toml"
        path.write_text("[image]\nwidth = 1\nheight = 1\n[camera]\nfilm_half_width = 0.001\n")
        return path

    def _specification_file(self, relative: float) -> Path:
        path = self.folder / f"accuracy-{relative:g}.toml"
        path.write_text(
            '[image]\npixel = "float"\n[accuracy]\n'
            f"relative = {relative!r}\nabsolute = {ABSOLUTE_OVER_RELATIVE * relative!r}\n"
        )
        return path

    def _run(self, arguments: list) -> float:
        command = [self.path, "render", "--threads", str(self.threads), *arguments]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        # The usage of this child alone; what it left of the parent's would sum over all.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise RuntimeError(f"{self.path} render ended with exit code {process.returncode}")
        return usage.ru_utime + usage.ru_stime
