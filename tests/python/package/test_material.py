"""Materials: values, shapes, and what is refused."""

import json
import subprocess

import numpy as np
import pytest

import brdfarm
from brdfarm import _command

MATERIAL = brdfarm.Material(12, 0.4, 30, 1.6, (0.8, 0.4, 0.2), 1)


def directions(seed, *shape):
    drawn = np.random.default_rng(seed).normal(size=(*shape, 3))
    drawn[..., 2] = np.abs(drawn[..., 2])
    return drawn


def test_a_colour_is_one_number_or_three():
    assert MATERIAL.rgb90 == (1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="rgb0 has the shape"):
        brdfarm.Material(12, 0.4, 30, 1.6, (0.8, 0.4), 1)


@pytest.mark.parametrize(
    ("field", "value"),
    [("roughness", -1), ("roughness", float("nan")), ("anisotropy", 1.5), ("angle_deg", 181), ("ior", 0.5)],
)
def test_parameters_out_of_range_are_refused_by_name(field, value):
    fields = dict(roughness=12, anisotropy=0.4, angle_deg=30, ior=1.6, rgb0=0.5, rgb90=1)
    with pytest.raises(ValueError, match=field):
        brdfarm.Material(**{**fields, field: value})


def test_evaluate_says_what_the_command_says():
    wi, wo = directions(1, 50), directions(2, 50)
    material = dict(
        roughness=12, anisotropy=0.4, angle_deg=30, ior=1.6, rgb0=[0.8, 0.4, 0.2], rgb90=[1, 1, 1]
    )
    for tint in ("hue", "product"):
        lines = [
            json.dumps(dict(material=material, wi=i.tolist(), wo=o.tolist(), tint=tint))
            for i, o in zip(wi, wo, strict=True)
        ]
        said = subprocess.run(
            [_command.path(), "brdf"], input="\n".join(lines), capture_output=True, text=True, check=True
        )
        expected = [json.loads(line)["f"] for line in said.stdout.splitlines()]
        assert np.array_equal(MATERIAL.evaluate(wi, wo, tint=tint), expected)


def test_shapes_broadcast():
    wi, wo = directions(1, 5, 1), directions(2, 7)
    value = MATERIAL.evaluate(wi, wo)
    assert value.shape == (5, 7, 3)
    assert np.array_equal(value[2, 3], MATERIAL.evaluate(wi[2, 0], wo[3]))
    assert MATERIAL.evaluate([0, 0, 1], [0, 0, 1]).shape == (3,)
    assert MATERIAL.pdf(wi, wo).shape == (5, 7)
    assert MATERIAL.evaluate(np.zeros((0, 3)), [0, 0, 1]).shape == (0, 3)
    drawn = MATERIAL.sample(wo, np.full((4, 1, 2), 0.5))
    assert drawn.wi.shape == (4, 7, 3) and drawn.weight.shape == (4, 7, 3) and drawn.pdf.shape == (4, 7)


def test_other_dtypes_and_strides_give_the_same():
    wi, wo = directions(1, 6).astype(np.float32), directions(2, 6).astype(np.float32)
    expected = MATERIAL.evaluate(wi.astype(np.float64), wo.astype(np.float64))
    assert np.array_equal(MATERIAL.evaluate(wi, wo), expected)
    assert np.array_equal(MATERIAL.evaluate(np.asfortranarray(wi), wo[::-1][::-1]), expected)
    whole = MATERIAL.evaluate([[0, 3, 4]], [[0, 0, 2]])
    assert np.allclose(whole, MATERIAL.evaluate([[0, 0.6, 0.8]], [[0, 0, 1]]), rtol=1e-12)


@pytest.mark.parametrize(
    ("wi", "error", "says"),
    [
        (np.zeros((4, 2)), ValueError, r"wi has the shape \(4, 2\)"),
        (np.float64(1.0), ValueError, "wi has the shape"),
        (directions(1, 4), ValueError, "do not broadcast"),
        (np.zeros((5, 3)), ValueError, "direction 0 of wi has length zero"),
        (np.diag([1.0, 1, np.nan, 1, 1])[:, :3] + 1, ValueError, "direction 2 of wi is not finite"),
        (np.full((5, 3), np.inf), ValueError, "direction 0 of wi is not finite"),
        (directions(1, 5) * 1j, TypeError, "wi is of dtype complex128"),
        (np.full((5, 3), "up"), TypeError, "wi is of dtype"),
        (np.ones((5, 3), dtype=bool), TypeError, "wi is of dtype bool"),
    ],
)
def test_what_is_no_direction_is_refused(wi, error, says):
    with pytest.raises(error, match=says):
        MATERIAL.evaluate(wi, directions(2, 5))


def test_lengths_do_not_matter():
    wi, wo = directions(1, 5), directions(2, 5)
    expected = MATERIAL.evaluate(wi, wo)
    for scale in (1e-300, 1e-160, 3.0, 1e160, 1e300):
        assert np.allclose(MATERIAL.evaluate(wi * scale, wo), expected, rtol=1e-12)


def test_samples_have_the_density_and_weight_that_they_say():
    wo = np.array([0.3, -0.2, 0.9])
    u = np.random.default_rng(3).random((20_000, 2))
    for material in (MATERIAL, brdfarm.Material(95, 0, 0, 2, 0.6, 1)):
        drawn = material.sample(wo, u)
        above = drawn.pdf > 0
        assert np.array_equal(drawn.weight[~above], np.zeros((np.sum(~above), 3)))
        assert np.allclose(material.pdf(drawn.wi[above], wo), drawn.pdf[above], rtol=1e-9)
        f = material.evaluate(drawn.wi[above], wo)
        expected = f * drawn.wi[above, 2:] / drawn.pdf[above, None]
        assert np.allclose(drawn.weight[above], expected, rtol=1e-6)
        assert drawn.weight.max() <= 1


def test_the_edges_of_the_unit_square():
    wo = [0.0, 0.0, 1.0]
    assert np.isfinite(MATERIAL.sample(wo, [[0.0, 0.0], [np.nextafter(1, 0), np.nextafter(1, 0)]]).wi).all()
    for u in ([1.0, 0.5], [-0.1, 0.5], [np.nan, 0.5]):
        with pytest.raises(ValueError, match="outside"):
            MATERIAL.sample(wo, u)
    with pytest.raises(ValueError, match='tint is "blue"'):
        MATERIAL.evaluate(wo, wo, tint="blue")
