"""Drives `brdfarm render` and reads what it writes."""

import json
import os
import re
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
LAMBERTIAN = {
    "roughness": 100.0,
    "anisotropy": 0.0,
    "angle_deg": 0.0,
    "ior": 1.5,
    "rgb0": [0.5, 0.5, 0.5],
    "rgb90": [0.5, 0.5, 0.5],
}


@dataclass
class Rendering:
    """An image of shape (rows, columns, 3), in units of white."""

    pixels: np.ndarray
    # Of the whole process, user and system, all threads: start, EXR file and all.
    cpu_seconds: float
    # The program's own bound on its error, meant to hold for 95 percent of pixels; its mean.
    stated_error: float


class Program:
    """The program at a path, rendering with a number of threads, its files in a folder."""

    def __init__(self, path: Path, threads: int, folder: Path):
        self.path, self.threads, self.folder = path, threads, folder
        text = subprocess.check_output([path, "dataset", "specification"], text=True)
        self.specification = tomllib.loads(text)

    def preset_material(self, index: int) -> dict:
        """The ten parameters of a material of the preset."""
        out = self.folder / "material.exr"
        self._run(
            ["--spec", self._next_to_nothing(), "--material", str(index)]
            + ["--view", str(VIEW_WITHOUT_CHART), "--out", out]
        )
        header = json.loads(mi.Bitmap(str(out)).metadata()["brdfarm"])
        return header["parameters"]

    def start_cpu_seconds(self, repetitions: int) -> float:
        """What a process takes to render next to nothing: a pixel of a Lambertian sample."""
        material_file = self.folder / "lambertian.json"
        material_file.write_text(json.dumps(LAMBERTIAN))
        arguments = ["--spec", self._next_to_nothing(), "--material-file", material_file]
        arguments += ["--view", str(VIEW_WITHOUT_CHART), "--out", self.folder / "start.exr"]
        return statistics.median(self._run(arguments)[0] for _ in range(repetitions))

    def render(self, material: dict, view: int, relative: float) -> Rendering:
        """A view of a material, to a relative accuracy."""
        out = self.folder / "image.exr"
        material_file = self.folder / "material.json"
        material_file.write_text(json.dumps(material))
        cpu_seconds, printed = self._run(
            ["--spec", self._specification_file(relative), "--material-file", material_file]
            + ["--view", str(view), "--out", out]
        )
        stated = re.search(r"error mean (\S+),", printed)
        if stated is None:
            raise RuntimeError(f"{self.path} printed no mean error: {printed!r}")
        pixels = np.array(mi.Bitmap(str(out)), dtype=np.float64)
        return Rendering(pixels, cpu_seconds, float(stated[1]))

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

    def _run(self, arguments: list) -> tuple[float, str]:
        command = [self.path, "render", "--threads", str(self.threads), *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        printed = process.stdout.read()
        process.stdout.close()
        # The usage of this child alone; what it left of the parent's would sum over all.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise RuntimeError(f"{self.path} render ended with exit code {process.returncode}")
        return usage.ru_utime + usage.ru_stime, printed
