"""Meshes: given, kept, written, rendered, run and read."""

import multiprocessing
import pickle

import pytest

import brdfarm

TENT = b"v -1 -1 0\nv 0 -1 1\nv 1 -1 0\nv -1 1 0\nv 0 1 1\nv 1 1 0\nf 1 2 5 4\nf 2 3 6 5\n"


@pytest.fixture(scope="module")
def flat():
    """16 x 12 pixels, one view, two materials, and an accuracy that takes no time."""
    preset = brdfarm.Specification.preset()
    return preset.replace(
        image=dict(width=16, height=12),
        views=[preset.views[5]],
        materials=2,
        accuracy=dict(relative=0.2, absolute=0.02),
    )


@pytest.fixture(scope="module")
def spec(flat):
    return flat.with_mesh(TENT)


@pytest.fixture
def unloaded(spec):
    """As its text has it: named and not loaded."""
    return brdfarm.Specification.from_toml(spec.to_toml())


def test_a_mesh_is_given_by_its_file_or_its_bytes(flat, spec, tmp_path):
    path = tmp_path / "tent.obj"
    path.write_bytes(TENT)
    for given in (path, str(path), bytearray(TENT), memoryview(TENT)):
        assert flat.with_mesh(given) == spec
    assert spec.mesh == TENT and flat.mesh is None
    assert spec.to_dict()["sample"]["shape"] == "mesh" and spec.hash != flat.hash
    assert spec.replace(sample=dict(shape="square", mesh=None)) == flat


def test_a_mesh_that_is_named_is_loaded_and_no_other(spec, unloaded):
    assert unloaded == spec and unloaded.mesh is None
    assert unloaded.with_mesh(TENT).mesh == TENT
    digest = spec.to_dict()["sample"]["mesh"]
    with pytest.raises(ValueError, match=f"is {digest}, but the mesh that was given is"):
        unloaded.with_mesh(TENT + b"\n")


def test_a_mesh_stays_with_its_specification(spec):
    assert spec.replace(seed=7, image=dict(width=8)).mesh == TENT
    assert pickle.loads(pickle.dumps(spec)).mesh == TENT
    # Another digest names another mesh.
    assert spec.replace(sample=dict(mesh="0" * 64)).mesh is None


def test_what_is_no_mesh_is_refused_with_a_sentence(flat, tmp_path):
    with pytest.raises(ValueError, match="the mesh cannot be rendered: "):
        flat.with_mesh(b"f 1 2 3\n")
    with pytest.raises(FileNotFoundError, match="absent.ply"):
        flat.with_mesh(tmp_path / "absent.ply")
    with pytest.raises(IsADirectoryError):
        flat.with_mesh(tmp_path)
    with pytest.raises(ValueError, match=r"large.ply has \d+ bytes, and a mesh has at most"):
        with open(tmp_path / "large.ply", "wb") as file:
            file.truncate((512 << 20) + 1)
        flat.with_mesh(tmp_path / "large.ply")
    with pytest.raises(TypeError):
        flat.with_mesh(7)


def test_a_mesh_is_saved_beside_the_specification(spec, tmp_path):
    spec.save(tmp_path / "spec.toml")
    digest = spec.to_dict()["sample"]["mesh"]
    assert (tmp_path / f"{digest}.mesh").read_bytes() == TENT
    loaded = brdfarm.Specification.load(tmp_path / "spec.toml")
    assert loaded == spec and loaded.mesh == TENT


def test_a_rendering_is_the_commands(spec, command, tmp_path):
    spec.save(tmp_path / "spec.toml")
    said = command("render", "--spec", "spec.toml", "--material", 1, "--view", 0, "--out", "a.exr")
    image = brdfarm.render(spec, spec.material(1), 0)
    assert image.digest == said.split()[0]
    assert image.exr == (tmp_path / "a.exr").read_bytes()
    # Also where the accuracy is another, which makes another specification.
    coarse = brdfarm.render(spec, spec.material(1), 0, relative=0.5, absolute=0.1)
    assert coarse.digest != image.digest


def test_a_mesh_that_is_not_loaded_is_an_error_that_says_what_to_do(spec, unloaded, tmp_path):
    says = r"^the sample is the mesh [0-9a-f]{64}, which is not loaded: give its file or its bytes to \w+\.with_mesh\(\)$"
    # The renderer of the same mesh is kept, and changes nothing.
    brdfarm.render(spec, spec.material(0), 0)
    with pytest.raises(ValueError, match=says):
        brdfarm.render(unloaded, unloaded.material(0), 0)
    with pytest.raises(ValueError, match="is not loaded"):
        unloaded.save(tmp_path / "spec.toml")
    assert not (tmp_path / "spec.toml").exists()
    with pytest.raises(ValueError, match="is not loaded"):
        brdfarm.run(unloaded, tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_derivatives_are_for_flat_samples(spec, unloaded):
    with pytest.raises(ValueError, match="for flat samples: images of a mesh are traced"):
        brdfarm.derivatives(spec, spec.material(0), 0)
    with pytest.raises(ValueError, match="is not loaded"):
        brdfarm.derivatives(unloaded, unloaded.material(0), 0)


def test_a_run_has_the_mesh_and_its_store_is_read(spec, tmp_path):
    data = brdfarm.run(spec, tmp_path / "store", workers=2)
    assert len(data) == 2 and data.specification == spec
    # The store keeps the mesh: what is read from it can be rendered, and run further.
    again = brdfarm.Dataset(tmp_path / "store").specification
    assert again.mesh == TENT
    for material in range(2):
        image = brdfarm.render(again, again.material(material), 0)
        assert image.digest == data[material, 0].digest
    assert set(data.table["sample_shape"].to_pylist()) == {"mesh"}
    assert data[0, 0].pixels.shape == spec.shape
    assert len(brdfarm.run(again, tmp_path / "store", materials=3)) == 3


def _digest(spec, index):
    return brdfarm.render(spec, spec.material(index), 0).digest


def test_another_process_has_the_mesh(spec):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.starmap(_digest, [(spec, 0)]) == [_digest(spec, 0)]
