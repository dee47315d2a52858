"""Reads a table of observability as a stranger would, with pyarrow and numpy.

    read_observability.py TABLE.parquet

Prints what it found; any disagreement ends it with an error.
"""

import json
import math
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet

PARAMETERS = 10
LISTS = {"information": PARAMETERS**2, "uncertainty": PARAMETERS, "bound": PARAMETERS, "weight": PARAMETERS}


def check_schema(schema, encodings):
    assert schema.field("material_index").type == pa.uint32()
    views = schema.field("views").type
    assert pa.types.is_list(views) and views.value_type == pa.uint32(), views
    for encoding in encodings:
        for name, length in LISTS.items():
            kind = schema.field(f"{name}_{encoding}").type
            assert pa.types.is_fixed_size_list(kind), kind
            assert kind.list_size == length and kind.value_type == pa.float64(), kind
    for field in schema:
        for key in (b"unit", b"description"):
            assert field.metadata.get(key), f"{field.name} has no {key}"


def check_row(row, encoding, name):
    """Symmetric and without a negative direction; weights are shares; bounds are positive."""
    information = row["information"]
    assert (information == information.T).all(), f"{name}: not symmetric"
    values = np.linalg.eigvalsh(information)
    assert values.min() >= -1e-9 * max(values.max(), 1e-30), f"{name}: {values}"
    assert ((row["weight"] >= 0) & (row["weight"] <= 1)).all(), f"{name}: {row['weight']}"
    assert (row["bound"] > 0).all() and not np.isnan(row["bound"]).any(), f"{name}: {row['bound']}"
    assert (row["uncertainty"] >= 0).all(), f"{name}: {row['uncertainty']}"


def check_set(row, parts, noise_sd, name):
    """More views tell more; information adds up."""
    total = sum(part["information"] for part in parts)
    assert np.allclose(row["information"], total, rtol=1e-12, atol=0), f"{name}: not the sum"
    root = np.sqrt(sum(part["uncertainty"] ** 2 for part in parts))
    assert np.allclose(row["uncertainty"], root, rtol=1e-12, atol=0), f"{name}: not the root"
    for part in parts:
        # Directions that are lost in the derivatives' errors cost up to a factor of the root of 2.
        both = np.isfinite(row["bound"]) & np.isfinite(part["bound"])
        worst = part["bound"][both] * math.sqrt(2) * (1 + 1e-6)
        assert (row["bound"][both] <= worst).all(), f"{name}: a view alone knows more"
        assert (row["weight"] >= part["weight"] - 1e-9).all(), f"{name}: a view alone weighs more"
    # The definition, as numpy inverts.
    posterior = row["information"] / noise_sd**2 + 12 * np.eye(PARAMETERS)
    weight = 1 - 12 * np.diag(np.linalg.inv(posterior))
    assert np.allclose(row["weight"], weight, atol=1e-6), f"{name}: {row['weight']}, not {weight}"
    if np.isfinite(row["bound"]).all():
        bound = noise_sd * np.sqrt(np.diag(np.linalg.inv(row["information"])))
        assert np.allclose(row["bound"], bound, rtol=1e-4), f"{name}: {row['bound']}, not {bound}"


def of_encoding(row, encoding):
    lists = {name: np.array(row[f"{name}_{encoding}"]) for name in LISTS}
    lists["information"] = lists["information"].reshape(PARAMETERS, PARAMETERS)
    return lists


def main(path):
    table = pa.parquet.read_table(path)
    metadata = pa.parquet.read_metadata(path).metadata
    plan = json.loads(metadata[b"brdfarm.observability"])
    specification = json.loads(metadata[b"brdfarm.specification"])
    assert plan["renderer_version"] == metadata[b"brdfarm.renderer_version"].decode()
    assert len(plan["parameters"]) == PARAMETERS and plan["noise_sd"] > 0
    assert max(plan["film"]) == plan["side"]
    check_schema(table.schema, plan["encodings"])
    materials = {}
    for row in table.to_pylist():
        materials.setdefault(row["material_index"], []).append(row)
    assert max(materials) < specification["materials"]
    finite = 0
    for material, rows in materials.items():
        assert [row["views"] for row in rows] == plan["sets"], f"material {material}: other sets"
        for encoding in plan["encodings"]:
            single = {}
            for row in rows:
                name = f"material {material}, views {row['views']}, {encoding}"
                found = of_encoding(row, encoding)
                check_row(found, encoding, name)
                if len(row["views"]) == 1:
                    single[row["views"][0]] = found
                else:
                    parts = [single[view] for view in row["views"]]
                    check_set(found, parts, plan["noise_sd"], name)
                finite += int(np.isfinite(found["bound"]).sum())
    assert finite > 0, "nothing is observed at all"
    print(f"{table.num_rows} rows of {len(materials)} materials, {finite} finite bounds")


if __name__ == "__main__":
    main(*sys.argv[1:])
