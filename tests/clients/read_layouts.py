"""Reads a store's exports as strangers would, each with its own stock loader.

    read_layouts.py STORE MANIFESTS FILES WEBDATASET HUGGINGFACE

MANIFESTS is a folder with manifest.parquet, .csv and .jsonl; the others are exports with --npy and
--png, and with --rectified where the sample is a square. Prints what it found; any disagreement with
the store ends it with an error.
"""

import hashlib

import io
import json
import logging
import os
import sys
import tempfile
import tomllib
from pathlib import Path

os.environ["HF_HUB_OFFLINE"] = "1"
os.environ["HF_DATASETS_OFFLINE"] = "1"
os.environ["HF_HOME"] = tempfile.mkdtemp()
os.environ["CROISSANT_CACHE"] = tempfile.mkdtemp()

import datasets
import mlcroissant
import numpy as np
import OpenEXR
import pandas
import polars
import pyarrow.parquet
import webdataset
from PIL import Image

SPLITS = ("train", "validation", "test")


def read_exr(path):
    return OpenEXR.File(str(path)).channels()["RGB"].pixels


def read_npy(file):
    return np.load(io.BytesIO(file), allow_pickle=False)


def to_srgb8(linear):
    linear = np.clip(linear.astype(np.float64), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded)


class Reference:
    """What the store's own manifest and images say."""

    def __init__(self, store, manifest):
        self.rows = {}
        self.pixels = {}
        self.files = {}
        self.is_square = True
        for row in pyarrow.parquet.read_table(manifest).to_pylist():
            key = row["material"], row["view"]
            path = store / row.pop("path")
            self.rows[key] = row
            self.files[key] = path.read_bytes()
            self.is_square = row["sample_shape"] == "square"
            self.pixels[key] = read_exr(path)

    def check_row(self, row, who):
        """A row with other columns beside, whose lists may be arrays."""
        expected = self.rows[row["material"], row["view"]]
        for name, value in expected.items():
            found = row[name]
            found = list(found) if isinstance(value, list) else found
            assert found == value, f"{who}: {name} is {found!r}, not {value!r}"

    def check_all(self, rows, who):
        rows = list(rows)
        assert len(rows) == len(self.rows), f"{who}: {len(rows)} rows"
        for row in rows:
            self.check_row(row, who)

    def check_image(self, key, exr, npy, preview, who):
        assert exr == self.files[key], f"{who}: the file of {key} differs"
        pixels = self.pixels[key]
        assert npy.dtype == pixels.dtype == np.float16 and np.array_equal(npy, pixels), who
        assert preview.size == pixels.shape[1::-1], who
        off = np.abs(np.asarray(preview, dtype=float) - to_srgb8(pixels)).max()
        assert off <= 1, f"{who}: the preview of {key} is off by {off}"


def check_tables(reference, folder):
    """pandas and polars, in all three formats. CSV has no types, so the version would be read as a
    number; a list in it is columns name_0, name_1, ..."""
    tables = {
        "pandas Parquet": pandas.read_parquet(folder / "manifest.parquet").to_dict("records"),
        "pandas JSON Lines": pandas.read_json(
            folder / "manifest.jsonl", lines=True, precise_float=True, dtype=False
        ).to_dict("records"),
        "polars Parquet": polars.read_parquet(folder / "manifest.parquet").to_dicts(),
        "polars JSON Lines": polars.read_ndjson(folder / "manifest.jsonl").to_dicts(),
    }
    for who, rows in tables.items():
        reference.check_all(rows, who)
    flat = {
        "pandas CSV": pandas.read_csv(
            folder / "manifest.csv", dtype={"renderer_version": str}
        ).to_dict("records"),
        "polars CSV": polars.read_csv(
            folder / "manifest.csv", schema_overrides={"renderer_version": polars.String}
        ).to_dicts(),
    }
    some = next(iter(reference.rows.values()))
    lists = {name: len(value) for name, value in some.items() if isinstance(value, list)}
    for who, rows in flat.items():
        for row in rows:
            for name, length in lists.items():
                row[name] = [row.pop(f"{name}_{place}") for place in range(length)]
        reference.check_all(rows, who)


def check_files(reference, folder):
    rows = pyarrow.parquet.read_table(folder / "manifest.parquet").to_pylist()
    reference.check_all(rows, "files")
    for row in rows:
        path = folder / row["path"]
        assert path.parts[-3] == row["split"] and path.parts[-2] == f"{row['material']:06}", path
        key = row["material"], row["view"]
        preview = Image.open(path.with_suffix(".png"))
        assert preview.text["exposure_stops"] == "0", preview.text
        npy = np.load(path.with_suffix(".npy"), mmap_mode="r")
        reference.check_image(key, path.read_bytes(), npy, preview, "files")
        if not reference.is_square:
            continue
        rectified = read_exr(path.with_suffix(".rectified.exr"))
        assert np.array_equal(rectified, np.load(path.with_suffix(".rectified.npy")))
        assert rectified.shape == (16, 16, 3) and np.isfinite(rectified).all()
        # Seen from straight above, with nothing else on the film, the square has all the light.
        if row["camera_elevation_deg"] == 90.0 and not row["checker"]:
            square = rectified.astype(float).mean() * (0.1 / 0.12) ** 2
            film = reference.pixels[key].astype(float).mean()
            assert np.isclose(square, film, rtol=0.03, atol=1e-6), f"{key}: {square}, {film}"
    return len(rows)


def sample_pixels(row, pixels):
    """The pixels of the sample, N x 3: those whose centre the homography takes into the square."""
    height, width = pixels.shape[:2]
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    homography = np.reshape(row["sample_from_film"], (3, 3))
    u, v, w = homography @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
    is_sample = (w > 0) & (u >= 0) & (u <= w) & (v >= 0) & (v <= w)
    return pixels.reshape(-1, 3).astype(np.float64)[is_sample]


def check_brightness(folder):
    """Recomputes what manifest and card say of pixels."""
    rows = pyarrow.parquet.read_table(folder / "manifest.parquet").to_pylist()
    everything = []
    for row in rows:
        pixels = read_exr(folder / row["path"])
        of_sample = sample_pixels(row, pixels)
        everything.append(of_sample)
        luminance = of_sample @ [0.2126, 0.7152, 0.0722]
        expected = {
            "sample_share": len(luminance) / pixels[..., 0].size,
            "brightness_mean": luminance.mean(),
            "brightness_p99": np.percentile(luminance, 99),
            "dark_share": (luminance < 1 / 255).mean(),
            "above_white_share": (luminance > 1).mean(),
            "angle_twice_sin": np.sin(2 * np.radians(row["angle_deg"])),
            "angle_twice_cos": np.cos(2 * np.radians(row["angle_deg"])),
        }
        for name, value in expected.items():
            assert np.isclose(row[name], value, rtol=1e-6, atol=1e-12), f"{name}: {row[name]}, {value}"
        colours = np.array([row["rgb0_linear"], row["rgb90_linear"]])
        if row["roughness"] <= 90 and row["tint"] == "hue":
            colours /= colours.max()
        assert np.allclose([row["rgb0_scaled"], row["rgb90_scaled"]], colours, rtol=1e-12)
    check_card(folder, rows, np.concatenate(everything))


def check_card(folder, rows, pixels):
    """Six digits of each number in the card's table of channels."""
    card = (folder / "README.md").read_text()
    for channel, name in enumerate("RGB"):
        line = next(line for line in card.splitlines() if line.startswith(f"| {name} |"))
        told = [float(cell) for cell in line.strip("| ").split(" | ")[1:]]
        values = pixels[:, channel]
        percentiles = np.percentile(values, [1, 25, 50, 75, 99], method="inverted_cdf")
        logs = np.log1p(values)
        expected = [
            values.mean(), values.std(), *percentiles, values.max(), logs.mean(), logs.std()
        ]
        assert np.allclose(told, expected, rtol=1e-6, atol=1e-12), f"{told}, {expected}"
    # A table needs as many columns in its second line as in its first.
    lines = card.splitlines()
    first = next(place for place, line in enumerate(lines) if line.startswith("| channel |"))
    assert len({line.count("|") for line in lines[first : first + 5]}) == 1, lines[first : first + 5]
    within = 100 * np.mean([row["within_target"] for row in rows])
    assert f"{within:.4f} percent of the pixels are within it" in card, within


def check_webdataset(reference, folder):
    found = 0
    for split in SPLITS:
        shards = sorted(str(path) for path in (folder / split).glob("*.tar"))
        samples = webdataset.WebDataset(shards, shardshuffle=False).decode("pil")
        for sample in samples:
            views = sorted({name.split(".")[0] for name in sample if name.startswith("v")})
            for name in views:
                row = sample[f"{name}.json"]
                assert row["split"] == split and f"{row['material']:06}" == sample["__key__"]
                assert f"v{row['view']:02}" == name
                reference.check_row(row, "webdataset")
                reference.check_image(
                    (row["material"], row["view"]),
                    sample[f"{name}.exr"],
                    sample[f"{name}.npy"],
                    sample[f"{name}.png"],
                    "webdataset",
                )
                if reference.is_square:
                    assert sample[f"{name}.rectified.npy"].shape == (16, 16, 3)
                found += 1
    assert found == len(reference.rows), f"webdataset: {found} images"


def check_huggingface(reference, folder):
    sets = datasets.load_dataset(str(folder))
    assert set(sets) == set(SPLITS), set(sets)
    found = 0
    for split, rows in sets.items():
        assert isinstance(rows.features["preview"], datasets.Image), rows.features
        for row in rows:
            assert row["split"] == split
            reference.check_row(row, "datasets")
            reference.check_image(
                (row["material"], row["view"]),
                row["exr"],
                read_npy(row["npy"]),
                row["preview"],
                "datasets",
            )
            if reference.is_square:
                assert read_npy(row["rectified_npy"]).shape == (16, 16, 3)
            found += 1
    assert found == len(reference.rows), f"datasets: {found} images"


def check_croissant(reference, folder):
    warnings = io.StringIO()
    handler = logging.StreamHandler(warnings)
    logging.getLogger().addHandler(handler)
    metadata = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
    logging.getLogger().removeHandler(handler)
    assert not metadata.metadata.issues.errors, metadata.metadata.issues.report()
    assert not warnings.getvalue(), warnings.getvalue()
    described = json.loads((folder / "croissant.json").read_text())
    assert described["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    rows = []
    for record in metadata.records("images"):
        row = {name.removeprefix("images/"): value for name, value in record.items()}
        rows.append({
            name: value.decode() if isinstance(value, bytes) else value
            for name, value in row.items()
        })
    reference.check_all(rows, "mlcroissant")
    pixels = next(one for one in described["recordSet"] if one["@id"] == "pixels")["field"][0]
    height, width, _ = next(iter(reference.pixels.values())).shape
    assert pixels["arrayShape"] == f"{height},{width},3", pixels


def check_mesh(reference, folder):
    """The mesh of the sample, as rows, specification and Croissant name it; it is an OBJ file here. A
    sample that is no mesh has none."""
    row = next(iter(reference.rows.values()))
    meshes = sorted(path.name for path in folder.glob("*.mesh"))
    specification = tomllib.loads((folder / "specification.toml").read_text())
    if row["sample_shape"] != "mesh":
        assert (meshes, row["sample_triangles"], row["sample_mesh"]) == ([], 0, "none"), meshes
        assert "mesh" not in specification["sample"]
        return
    name = f"{row['sample_mesh']}.mesh"
    assert meshes == [name] and specification["sample"]["mesh"] == row["sample_mesh"], meshes
    content = (folder / name).read_bytes()
    corners = [len(line.split()) - 1 for line in content.decode().splitlines() if line.startswith("f ")]
    assert row["sample_triangles"] == sum(count - 2 for count in corners) > 0, row["sample_triangles"]
    described = json.loads((folder / "croissant.json").read_text())["distribution"]
    file = next(one for one in described if one["@id"] == name)
    assert file["sha256"] == hashlib.sha256(content).hexdigest()
    assert file["contentSize"] == f"{len(content)} B"


def main(store, manifests, files, webdataset_folder, huggingface):
    reference = Reference(store, manifests / "manifest.parquet")
    check_tables(reference, manifests)
    images = check_files(reference, files)
    if reference.is_square:
        check_brightness(files)
    check_webdataset(reference, webdataset_folder)
    check_huggingface(reference, huggingface)
    for folder in (files, webdataset_folder, huggingface):
        check_croissant(reference, folder)
        check_mesh(reference, folder)
    print(f"{images} images in three layouts")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
