"""Whether brdfarm and Mitsuba render the same images of a mesh: 8 materials and 4 views of a cloth, each
pixel compared by the standard errors of both.

    target/bench-meshes/python/bin/python bench/meshes/equal.py [--program PATH] [--side 64] [--spp 64]

Mitsuba renders each image 16 times, with seeds of their own; the spread of these is its standard error, with
15 degrees of freedom. brdfarm's is its stated error, half of a 95 percent interval, over 1.96. Of 131,072
pixels one is off by more than Z_MAX of both with a probability of 1e-3; a scene that differs shifts
many by a few, which the shares beyond 3 and the mean show.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "bench/mitsuba"), str(ROOT / "examples")]

import cloth
import reflectance  # noqa: F401  registers the BSDF
import scene

SEEDS = 16
VIEWS = (0, 5, 9, 12)
# The quantile of Student's t, 15 degrees of freedom, for 1e-3 of 131,072 pixels, two-sided.
Z_MAX = 11.5
# Of pixels, when equal: t beyond 3 is 0.9 percent, and brdfarm's stated errors are not smaller than true.
BEYOND_3_MAX = 0.015
# brdfarm's stated error holds terms that are no spread, so the mean is compared by Mitsuba's alone.
MEAN_MAX = 0.004

MATERIALS = {
    f"R {roughness}, A {anisotropy}": {
        "roughness": roughness,
        "anisotropy": anisotropy,
        "angle_deg": angle,
        "ior": ior,
        "rgb0": [0.8, 0.5, 0.3],
        "rgb90": [0.9, 0.9, 0.8],
    }
    for roughness, anisotropy, angle, ior in (
        (20.0, 0.0, 0.0, 1.5),
        (30.0, 0.6, 30.0, 2.0),
        (40.0, 0.3, 120.0, 1.3),
        (50.0, 0.9, 75.0, 4.0),
        (60.0, 0.0, 0.0, 8.0),
        (75.0, 0.5, 160.0, 1.8),
        (92.0, 0.4, 45.0, 2.5),
        (98.0, 0.0, 0.0, 1.5),
    )
}


def pixels(path):
    return np.array(mi.Bitmap(str(path)), dtype=np.float64)


def ours(program, folder, specification, material, view):
    """The image and its stated error."""
    (folder / "material.json").write_text(json.dumps(material))
    arguments = ["--spec", specification, "--material-file", folder / "material.json"]
    arguments += ["--view", str(view), "--out", folder / "image.exr"]
    arguments += ["--error-out", folder / "error.exr"]
    subprocess.run([program, "render", *arguments], check=True, stdout=subprocess.DEVNULL)
    error = pixels(folder / "error.exr")
    return pixels(folder / "image.exr"), error.reshape(error.shape[0], error.shape[1])


def theirs(loaded, spp):
    """The mean image and its standard error, by channel."""
    images = np.stack([np.array(mi.render(loaded, spp=spp, seed=seed)) for seed in range(SEEDS)])
    return images.mean(axis=0), images.std(axis=0, ddof=1) / np.sqrt(SEEDS)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/brdfarm")
    parser.add_argument("--side", type=int, default=64)
    parser.add_argument("--spp", type=int, default=64)
    arguments = parser.parse_args()
    text = subprocess.check_output([arguments.program, "dataset", "specification"], text=True)
    specification = tomllib.loads(text)
    specification["image"] = {"width": arguments.side, "height": arguments.side}
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cloth.write(folder / "cloth.ply", 200)
        (folder / "cloth.toml").write_text(
            f'image = {{ width = {arguments.side}, height = {arguments.side}, pixel = "float" }}\n'
            'sample = { shape = "mesh", mesh = "cloth.ply" }\n'
            "accuracy = { relative = 0.02, absolute = 0.0005 }\n"
        )
        print("| material | view | mean diff. | largest z | beyond 3 |")
        print("| --- | --- | --- | --- | --- |")
        for label, material in MATERIALS.items():
            for view in VIEWS:
                image, stated = ours(
                    arguments.program, folder, folder / "cloth.toml", material, view
                )
                loaded = scene.load(specification, view, material, folder / "cloth.ply")
                mean, error = theirs(loaded, arguments.spp)
                spread = np.sqrt(error**2 + (stated[..., None] / 1.96) ** 2)
                z = np.abs(image - mean) / np.maximum(spread, 1e-9)
                z[np.abs(image - mean) < 1e-6] = 0
                beyond = float((z > 3).mean())
                shift = float(image.mean() / mean.mean() - 1)
                own = float(np.sqrt((error**2).sum()) / mean.sum())
                passes = z.max() < Z_MAX and beyond < BEYOND_3_MAX
                passes = passes and abs(shift) < MEAN_MAX + 4 * own
                failed += not passes
                mark = "" if passes else " FAILED"
                print(f"| {label} | {view} | {shift:+.1e} | {z.max():.1f} | {beyond:.2%} |{mark}")
                sys.stdout.flush()
    print(f"{failed} of {len(MATERIALS) * len(VIEWS)} images differ")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
