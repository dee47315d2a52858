"""Derivatives by the ten parameters."""

import dataclasses

import numpy as np
import pytest

import brdfarm

# Rough enough that pixels change smoothly, and in the middle of every range.
MATERIAL = brdfarm.Material(
    roughness=45, anisotropy=0.4, angle_deg=30, ior=2.5, rgb0=(0.5, 0.3, 0.2), rgb90=(0.6, 0.7, 0.8)
)
RANGES = {"roughness": 100, "anisotropy": 1, "angle_deg": 180, "ior": 9}


@pytest.fixture(scope="module")
def small():
    return brdfarm.Specification.preset().replace(
        image={"width": 12, "height": 10}, accuracy={"relative": 1e-4, "absolute": 1e-6}
    )


def test_they_are_the_slopes_of_renderings(small):
    found = brdfarm.derivatives(small, MATERIAL, view=5)
    assert found.pixels.shape == small.shape
    assert found.values.shape == found.errors.shape == (*small.shape, len(brdfarm.PARAMETERS))
    rendered = brdfarm.render(small, MATERIAL, view=5)
    assert np.allclose(found.pixels, rendered.pixels, rtol=1e-6)
    for place, (name, length) in enumerate(RANGES.items()):
        step = 2e-3
        low, high = (
            dataclasses.replace(MATERIAL, **{name: getattr(MATERIAL, name) + sign * step * length})
            for sign in (-1, 1)
        )
        films = [brdfarm.render(small, one, view=5).pixels.astype(float) for one in (low, high)]
        slope = (films[1] - films[0]) / (2 * step)
        off = np.abs(found.values[..., place] - slope)
        # What central differences leave out, and what the renderings may be off by.
        allowed = found.errors[..., place] + 0.02 * np.abs(slope).max()
        assert (off <= allowed).all(), f"{name}: off by {off.max()}, slopes to {np.abs(slope).max()}"


def test_a_common_factor_of_both_colours_shows_nowhere(small):
    """Up to R = 90 only the hue shows: the images do not change along the colours."""
    found = brdfarm.derivatives(small, MATERIAL, view=5)
    codes = np.array([*MATERIAL.rgb0, *MATERIAL.rgb90])
    codes = np.where(codes <= 0.0031308, 12.92 * codes, 1.055 * codes ** (1 / 2.4) - 0.055)
    # d code / d ln(factor), for codes above the linear part.
    along = (codes + 0.055) / 2.4
    change = found.values[..., 4:] @ along
    assert np.abs(change).max() < 0.01 * np.abs(found.values[..., 4:]).max()


def test_what_is_wrong_is_said(small):
    with pytest.raises(ValueError, match="there is no view 14"):
        brdfarm.derivatives(small, MATERIAL, view=14)
    with pytest.raises(ValueError, match="there is no view -1"):
        brdfarm.derivatives(small, MATERIAL, view=-1)
    with pytest.raises(ValueError, match="threads is -1"):
        brdfarm.derivatives(small, MATERIAL, view=0, threads=-1)
    with pytest.raises(ValueError, match="optix"):
        brdfarm.derivatives(small, MATERIAL, view=0, backend="optix")
