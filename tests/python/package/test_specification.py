"""Specifications: made, changed, refused, compared, pickled."""

import pickle

import numpy as np
import pytest

import brdfarm


def test_the_preset_is_the_papers_dataset():
    preset = brdfarm.Specification.preset()
    assert (preset.materials, len(preset.views), preset.shape) == (9000, 14, (128, 128, 3))
    assert preset == brdfarm.Specification.from_toml("")
    assert "maxbrdf" in repr(preset)


def test_replace_changes_what_it_names_and_nothing_else(spec):
    other = spec.replace(image=dict(width=32), seed=7)
    assert other.shape == (20, 32, 3) and other.seed == 7 and spec.shape == (20, 24, 3)
    assert other.replace(image=dict(width=24), seed=spec.seed) == spec
    assert other.hash != spec.hash
    assert spec.replace(materials=5).hash == spec.hash


def test_numpys_numbers_are_numbers(spec):
    other = spec.replace(seed=np.int64(7), parameters=dict(roughness=np.array([40.0, 50.0])))
    assert other == spec.replace(seed=7, parameters=dict(roughness=[40.0, 50.0]))
    with pytest.raises(TypeError, match="no object"):
        spec.replace(seed=object())


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (dict(image=dict(widht=64)), "unknown field `widht`"),
        (dict(materials=-1), "materials|invalid value"),
        (dict(materials=0), "materials"),
        (dict(image=dict(width=0)), "width"),
        (dict(accuracy=dict(relative=float("nan"))), "has to be finite"),
        (dict(views=[]), "views"),
        (dict(seed="seven"), "seed|invalid type"),
    ],
)
def test_what_is_out_of_range_is_refused(spec, changes, says):
    with pytest.raises(ValueError, match=says):
        spec.replace(**changes)


def test_files(spec, tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(spec.to_toml())
    assert brdfarm.Specification.load(path) == spec
    with pytest.raises(FileNotFoundError, match="absent.toml"):
        brdfarm.Specification.load(tmp_path / "absent.toml")
    path.write_text("[image]\nwidth = 'wide'\n")
    with pytest.raises(ValueError, match="spec.toml:2:"):
        brdfarm.Specification.load(path)
    with pytest.raises(ValueError, match="no preset"):
        brdfarm.Specification.preset("other")


def test_values_are_values(spec):
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert len({spec, pickle.loads(pickle.dumps(spec))}) == 1
    assert spec != "a string"
    with pytest.raises(AttributeError, match="replace"):
        spec.seed = 3
    with pytest.raises(TypeError, match="preset"):
        brdfarm.Specification()


def test_materials_of_the_set(spec):
    material = spec.material(3)
    assert material.index == 3 and material == brdfarm.Specification.preset().material(3)
    assert {spec.split(index) for index in range(12)} == {"train", "validation", "test"}
    for index in (-1, 2**32):
        with pytest.raises(ValueError, match="no material"):
            spec.material(index)
