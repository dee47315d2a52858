"""Loads training pairs from an export made by

    brdfarm dataset export DIR --layout files --views 5,8 --split train --rectified 64

A pair is one material from 30 and from 90 degrees, the sample warped to a square, as the paper's
networks see it. Needs numpy, pyarrow and OpenEXR.
"""

import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow.parquet as pq

LABELS = ("roughness", "anisotropy", "angle_deg", "ior", "rgb0_lab", "rgb90_lab")
BINS = ("roughness", "anisotropy", "angle", "ior", "l0", "a0", "b0", "l90", "a90", "b90")


def load_exr(path):
    """Linear Rec.709 in units of white, (N, N, 3)."""
    return OpenEXR.File(str(path)).channels()["RGB"].pixels.astype(np.float32)


def pairs(folder):
    """Yields (2, N, N, 3) pixels, ten labels (colours as CIELAB) and their ten bins of 100."""
    wanted = [("split", "=", "train"), ("light_elevation_deg", "=", 45.0),
              ("rotation_deg", "=", 0.0), ("camera_elevation_deg", "in", [30.0, 90.0])]
    rows = pq.read_table(folder / "manifest.parquet", filters=wanted).to_pylist()
    rows.sort(key=lambda row: (row["material"], row["camera_elevation_deg"]))
    for oblique, above in zip(rows[::2], rows[1::2], strict=True):
        assert oblique["material"] == above["material"], "a view is missing"
        paths = [folder / row["path"].replace(".exr", ".rectified.exr") for row in (oblique, above)]
        labels = np.hstack([above[name] for name in LABELS])
        bins = np.array([above[f"bin_{name}"] for name in BINS])
        yield np.stack([load_exr(path) for path in paths]), labels, bins


if __name__ == "__main__":
    for number, (pixels, labels, bins) in enumerate(pairs(Path(sys.argv[1]))):
        print(number, pixels.shape, pixels.max(), labels.round(3), bins)
