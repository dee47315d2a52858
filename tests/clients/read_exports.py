"""Reads a store and its three manifests as a stranger would, with pyarrow and OpenEXR.

    read_exports.py STORE MANIFEST.parquet MANIFEST.csv MANIFEST.jsonl

Prints what it found; any disagreement ends it with an error.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.csv
import pyarrow.json
import pyarrow.parquet


def flat_rows(table):
    """Rows of a table whose lists are spread over columns name_0, name_1, ..."""
    rows = []
    for row in table.to_pylist():
        flat = {}
        for name, value in row.items():
            if isinstance(value, list):
                flat.update({f"{name}_{i}": element for i, element in enumerate(value)})
            else:
                flat[name] = value
        rows.append(flat)
    return rows


def equal(a, b):
    """Equal to the last bit; integers may have become floats or text in a format without types."""
    return a == b or (isinstance(a, str) != isinstance(b, str) and str(a) == str(b))


def check_agreement(parquet, csv, jsonl):
    reference = flat_rows(parquet)
    for name, table in (("CSV", csv), ("JSON Lines", jsonl)):
        rows = flat_rows(table)
        assert len(rows) == len(reference), f"{name}: {len(rows)} rows, not {len(reference)}"
        for number, (row, expected) in enumerate(zip(rows, reference)):
            assert list(row) == list(expected), f"{name}, row {number}: other columns"
            for column, value in expected.items():
                assert equal(row[column], value), (
                    f"{name}, row {number}, {column}: {row[column]!r}, not {value!r}"
                )


def check_schema(schema):
    for name, size in (("rgb0_linear", 3), ("world_from_camera", 16), ("sample_from_film", 9)):
        kind = schema.field(name).type
        assert pa.types.is_fixed_size_list(kind) and kind.list_size == size, f"{name}: {kind}"
    for field in schema:
        assert b"description" in (field.metadata or {}), f"{field.name} has no description"


def check_image(store, row):
    path = store / row["path"]
    assert path.stat().st_size == row["bytes"]
    file = OpenEXR.File(str(path), separate_channels=True)
    header, channels = file.header(), file.channels()
    assert sorted(channels) == ["B", "G", "R"], sorted(channels)
    pixels = np.stack([channels[name].pixels for name in "RGB"], axis=-1)
    assert pixels.shape == (row["height"], row["width"], 3)
    assert pixels.dtype == {"half": np.float16, "float": np.float32}[row["pixel"]]
    assert np.isfinite(pixels).all() and (pixels >= 0).all()

    identity = json.loads(header["brdfarm"])
    for name in ("specification", "seed", "material", "view", "tint", "renderer_version"):
        assert identity[name] == row[name], f"{path}: {name}"
    parameters = identity["parameters"]
    for name in ("roughness", "anisotropy", "angle_deg", "ior"):
        assert parameters[name] == row[name], f"{path}: {name}"
    assert parameters["rgb0"] == row["rgb0_linear"]
    assert parameters["rgb90"] == row["rgb90_linear"]

    # 17,600 lm at 1 m on a white diffuser.
    white = 17600 / (4 * math.pi) / math.pi
    assert abs(header["whiteLuminance"] - white) < 1e-3, header["whiteLuminance"]
    rec709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    assert np.allclose(header["chromaticities"], rec709, atol=1e-6), header["chromaticities"]
    assert "ZIP" in str(header["compression"]), header["compression"]

    # OpenEXR's own tool.
    printed = subprocess.run(["exrheader", path], capture_output=True, text=True, check=True).stdout
    for expected in ("brdfarm (type string)", "whiteLuminance", "R, 16-bit floating-point"):
        assert expected in printed, f"exrheader {path}: no {expected!r} in\n{printed}"
    return pixels


def check_homography(row):
    """The film point where the camera sees the sample's centre maps to (1/2, 1/2)."""
    film_from_centre = [row["width"] / 2, row["height"] / 2, 1]
    u, v, w = np.array(row["sample_from_film"]).reshape(3, 3) @ film_from_centre
    assert abs(u / w - 0.5) < 1e-12 and abs(v / w - 0.5) < 1e-12, (u / w, v / w)


def main(store, parquet_path, csv_path, jsonl_path):
    parquet = pa.parquet.read_table(parquet_path)
    csv = pa.csv.read_csv(csv_path)
    jsonl = pa.json.read_json(jsonl_path)
    check_schema(parquet.schema)
    check_agreement(parquet, csv, jsonl)
    rows = parquet.to_pylist()
    images = [(row["material"], row["view"]) for row in rows]
    assert len(set(images)) == len(images), "an image twice"
    brightest = 0.0
    for row in rows:
        brightest = max(brightest, float(check_image(Path(store), row).max()))
        check_homography(row)
    assert brightest > 0.1, "everything is dark"
    print(f"{len(rows)} images, {len(parquet.schema)} columns, brightest pixel {brightest:g}")


if __name__ == "__main__":
    main(*sys.argv[1:])
