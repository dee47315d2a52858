"""Materials: ten parameters, and the reflectance that they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brdfarm import _native

Tint = Literal["hue", "product"]
Colour = tuple[float, float, float]


class Sample(NamedTuple):
    """Directions drawn by `Material.sample`."""

    wi: NDArray[np.float64]
    """Toward the light, unit vectors, (..., 3). Zeros where the drawn direction lies below the surface."""
    weight: NDArray[np.float64]
    """f cos_i / pdf, (..., 3); at most 1. Zero where the drawn direction lies below the surface."""
    pdf: NDArray[np.float64]
    """The density of wi, a steradian, (...)."""


@dataclass(frozen=True)
class Material:
    """A material of the anisotropic reflectance model (Vidaurre et al. 2019, section 3).

    Raises `ValueError` where a parameter is out of range.
    """

    roughness: float
    """R, percent, 0 to 100."""
    anisotropy: float
    """A, 0 to 1."""
    angle_deg: float
    """psi, degrees, 0 to 180, counter-clockwise from +x about the normal."""
    ior: float
    """N_d, 1 to 10."""
    rgb0: Sequence[float] | float
    """Reflectance at 0 degrees, linear Rec.709, each channel 0 to 1. One number is taken for all
    three. Kept as a tuple."""
    rgb90: Sequence[float] | float
    """Reflectance at 90 degrees, in the same way."""
    index: int | None = field(default=None, kw_only=True)
    """The material's number in its set. It seeds the light paths, so two materials that differ in it
    alone have images of different bytes. None for a material that belongs to no set."""

    def __post_init__(self) -> None:
        for name in ("roughness", "anisotropy", "angle_deg", "ior"):
            object.__setattr__(self, name, float(getattr(self, name)))
        for name in ("rgb0", "rgb90"):
            object.__setattr__(self, name, _colour(name, getattr(self, name)))
        if self.index is not None and not 0 <= self.index < 2**32:
            raise ValueError(f"index is {self.index}: materials of a set are counted from 0")
        _native.check_material(self._parameters)

    @property
    def _parameters(self) -> tuple[float, float, float, float, Colour, Colour]:
        rgb0, rgb90 = _colour("rgb0", self.rgb0), _colour("rgb90", self.rgb90)
        return (self.roughness, self.anisotropy, self.angle_deg, self.ior, rgb0, rgb90)

    def evaluate(self, wi: ArrayLike, wo: ArrayLike, *, tint: Tint = "hue") -> NDArray[np.float64]:
        """The BRDF f(wi, wo), a steradian, linear Rec.709.

        `wi` points to the light and `wo` to the viewer; both are (..., 3) and broadcast against each
        other. The normal is +z. Lengths do not matter. Returns (..., 3), zero where a direction lies
        below the surface. The model is not reciprocal: do not swap the two.
        """
        shape, (wi, wo) = _rows((3, 3), wi=wi, wo=wo)
        return _native.evaluate(self._parameters, tint, wi, wo).reshape(*shape, 3)

    def pdf(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """The density, a steradian, with which `sample` draws `wi` for `wo`. (...) for (..., 3)."""
        shape, (wi, wo) = _rows((3, 3), wi=wi, wo=wo)
        return _native.pdf(self._parameters, wi, wo).reshape(shape)

    def sample(self, wo: ArrayLike, u: ArrayLike, *, tint: Tint = "hue") -> Sample:
        """Draws directions to the light.

        `wo` points to the viewer, (..., 3); `u` is uniform in [0, 1), (..., 2). Both broadcast.
        The mean of `weight` is the light that comes back of a uniform white surrounding.
        """
        shape, (wo, u) = _rows((3, 2), wo=wo, u=u)
        wi, weight, pdf = _native.sample(self._parameters, tint, wo, u)
        return Sample(wi.reshape(*shape, 3), weight.reshape(*shape, 3), pdf.reshape(shape))


def _colour(name: str, value: float | Sequence[float]) -> Colour:
    channels = np.asarray(value, dtype=np.float64)
    if channels.shape not in ((), (3,)):
        raise ValueError(f"{name} has the shape {channels.shape}: a colour is one number or three")
    red, green, blue = np.broadcast_to(channels, 3).tolist()
    return red, green, blue


def _rows(columns: tuple[int, int], **arrays: ArrayLike) -> tuple[tuple[int, ...], list[NDArray[np.float64]]]:
    """Broadcasts two arrays but for their last axes; returns their common shape, and each as rows."""
    found = []
    for (name, value), width in zip(arrays.items(), columns, strict=True):
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            raise TypeError(f"{name} is of dtype {array.dtype}: directions are real numbers")
        if array.ndim == 0 or array.shape[-1] != width:
            raise ValueError(f"{name} has the shape {array.shape}: its last axis has to have {width}")
        found.append(array)
    try:
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in found))
    except ValueError:
        shapes = " and ".join(f"{name} {array.shape}" for name, array in zip(arrays, found, strict=True))
        raise ValueError(f"{shapes} do not broadcast") from None
    rows = [
        np.ascontiguousarray(np.broadcast_to(array, (*shape, width)), dtype=np.float64).reshape(-1, width)
        for array, width in zip(found, columns, strict=True)
    ]
    return shape, rows
