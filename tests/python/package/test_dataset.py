"""Datasets: stores, exports, manifests, buckets' file systems, damage."""

import multiprocessing
import pickle
import shutil
import struct
import sys

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import brdfarm
from brdfarm import _native


@pytest.fixture(params=["store", "export", "manifest", "url"])
def data(request, store, command, tmp_path):
    """The same dataset by each of its names."""
    if request.param == "store":
        return brdfarm.Dataset(store)
    if request.param == "manifest":
        return brdfarm.Dataset(store / "manifest.parquet")
    command("dataset", "export", "export", "--store", store, "--layout", "files")
    export = tmp_path / "export"
    return brdfarm.Dataset(export if request.param == "export" else export.as_uri())


def test_labels_and_images(data, spec):
    assert len(data) == 12 and data.materials == [0, 1, 2, 3]
    assert data.specification == spec
    assert data.table.num_rows == 12
    image = data[2, 1]
    assert image.pixels.shape == spec.shape and image.pixels.dtype == np.float32
    rendered = brdfarm.render(spec, spec.material(2), 1)
    assert image.digest == rendered.digest
    assert np.allclose(image.pixels, rendered.pixels, rtol=2**-10, atol=1e-7)
    material = spec.material(2)
    expected = [material.roughness, material.anisotropy, material.angle_deg, material.ior]
    assert np.array_equal(data.label(2), np.hstack([expected, material.rgb0, material.rgb90]))
    assert sum(1 for _ in data) == 12 and (2, 1) in data and (9, 0) not in data


def test_pixels_are_openexrs(data, store, tmp_path):
    image = data[1, 2]
    (path,) = store.glob(f"blobs/*/*{image.digest[4:]}*")
    pixels = OpenEXR.File(str(path)).channels()["RGB"].pixels.astype(np.float32)
    assert np.array_equal(image.pixels, pixels)


def test_what_is_not_there(data):
    for key in ((9, 0), (0, 3)):
        with pytest.raises(IndexError):
            data[key]


def test_a_damaged_image_is_never_returned(store, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(store, copy)
    for path in copy.glob("blobs/*/*"):
        content = bytearray(path.read_bytes())
        content[-5] ^= 1
        path.write_bytes(content)
    for name in (copy, copy / "manifest.parquet"):
        with pytest.raises(brdfarm.StoreError, match="digest"):
            brdfarm.Dataset(name)[0, 0]
    for path in copy.glob("blobs/*/*"):
        path.unlink()
    with pytest.raises(brdfarm.StoreError, match="missing"):
        brdfarm.Dataset(copy)[0, 0]


def test_a_strangers_manifest_leads_nowhere_else(store, tmp_path):
    table = brdfarm.Dataset(store).table
    for path in ("../../../dev/zero", "/dev/zero", "blobs/../../x"):
        column = pa.array([path] * table.num_rows)
        changed = table.set_column(table.column_names.index("path"), "path", column)
        pq.write_table(changed, tmp_path / "manifest.parquet")
        with pytest.raises(brdfarm.StoreError, match="leads out of the dataset"):
            brdfarm.Dataset(tmp_path)[0, 0]


def test_a_strangers_image_asks_for_no_memory(spec, tmp_path):
    exr = brdfarm.render(spec, spec.material(0), 0).exr
    height, width, _ = spec.shape
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    assert exr.count(window) == 2
    for side in (2**14, 2**30):
        huge = exr.replace(window, struct.pack("<4i", 0, 0, side, side))
        with pytest.raises(brdfarm.StoreError, match="pixels|read"):
            _native.decode(huge)
    with pytest.raises(brdfarm.StoreError, match="read"):
        _native.decode(b"no image")


def test_names_that_name_nothing(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        brdfarm.Dataset(tmp_path / "absent")
    with pytest.raises(FileNotFoundError, match="there is no store"):
        brdfarm.Dataset(tmp_path)
    (tmp_path / "manifest.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(Exception, match="[Pp]arquet"):
        _ = brdfarm.Dataset(tmp_path).table


def test_rectified_is_what_an_export_has(store, command, tmp_path):
    command("dataset", "export", "export", "--store", store, "--layout", "files", "--npy", "--rectified", 16)
    data = brdfarm.Dataset(store)
    found = data.rectified(3, 1, 16)
    split = data.specification.split(3)
    (array,) = (tmp_path / "export" / split).glob("000003/*01.rectified.npy")
    assert np.allclose(found, np.load(array), rtol=2**-10, atol=1e-7)
    (path,) = (tmp_path / "export" / split).glob("000003/*01.rectified.exr")
    pixels = OpenEXR.File(str(path)).channels()["RGB"].pixels
    assert np.allclose(found, pixels, rtol=2**-10, atol=1e-7)
    with pytest.raises(ValueError, match="side|pixels"):
        data.rectified(3, 1, 0)


def test_without_pyarrow_images_are_read_and_labels_say_what_they_need(store, monkeypatch):
    for name in ("pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, name, None)
    data = brdfarm.Dataset(store)
    assert data[0, 0].pixels.any()
    with pytest.raises(ImportError, match="brdfarm\\[table\\]"):
        _ = data.table


def _digest(data, key):
    return data[key].digest


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_read(store, method):
    data = brdfarm.Dataset(store)
    keys = [(0, 0), (1, 1), (2, 2)]
    expected = [data[key].digest for key in keys]
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.starmap(_digest, [(data, key) for key in keys]) == expected
    assert pickle.loads(pickle.dumps(data))[1, 1].digest == expected[1]


def test_a_mesh_comes_along(command, tmp_path):
    (tmp_path / "tent.obj").write_text(
        "v -1 -1 0\nv 0 -1 1\nv 1 -1 0\nv -1 1 0\nv 0 1 1\nv 1 1 0\nf 1 2 5 4\nf 2 3 6 5\n"
    )
    (tmp_path / "tent.toml").write_text(
        "materials = 1\n[image]\nwidth = 12\nheight = 12\n[accuracy]\nabsolute = 0.02\nrelative = 0.2\n"
        '[sample]\nshape = "mesh"\nmesh = "tent.obj"\n[[views]]\n'
    )
    loaded = brdfarm.Specification.load(tmp_path / "tent.toml")
    # Neither a change nor the way to another process loses it.
    spec = pickle.loads(pickle.dumps(loaded.replace(name="tents")))
    data = brdfarm.run(spec, tmp_path / "tents")
    digest = data[0, 0].digest
    command("dataset", "export", "out", "--store", tmp_path / "tents", "--layout", "files")
    export = brdfarm.Dataset(tmp_path / "out")
    assert export.table["sample_triangles"].to_pylist() == [4]
    assert brdfarm.render(export.specification, spec.material(0), 0).digest == digest
    # Labels and images are there without it; who renders is told.
    (mesh,) = (tmp_path / "out").glob("*.mesh")
    mesh.unlink()
    bare = brdfarm.Dataset(tmp_path / "out")
    assert bare.specification == spec and bare[0, 0].digest == digest
    other = bare.specification.replace(image=dict(width=13))
    with pytest.raises((ValueError, RuntimeError), match="mesh"):
        brdfarm.render(other, spec.material(0), 0)
