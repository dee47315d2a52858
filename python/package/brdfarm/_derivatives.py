"""Derivatives of a view's pixels by the ten parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from brdfarm import _embree, _native
from brdfarm._material import Material
from brdfarm._rendering import check_call
from brdfarm._specification import Specification

PARAMETERS = (
    "roughness",
    "anisotropy",
    "angle",
    "ior",
    "red0",
    "green0",
    "blue0",
    "red90",
    "green90",
    "blue90",
)
"""What derivatives are taken by, in this order. Each is a fraction of its range: R/100, A, psi/180,
(N_d - 1)/9, and the sRGB codes of both colours, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Derivatives:
    """How the pixels of a view change with its material."""

    pixels: NDArray[np.float64]
    """(height, width, 3): radiance in units of white, linear Rec.709."""
    values: NDArray[np.float64]
    """(height, width, 3, 10): the derivatives of `pixels` by `PARAMETERS`, in units of white."""
    errors: NDArray[np.float64]
    """(height, width, 3, 10): bounds of their errors. They are wide: most derivatives are much better.
    Infinite where there is no derivative, as by the colours at black."""


def derivatives(
    specification: Specification,
    material: Material,
    view: int,
    *,
    backend: str = "auto",
    threads: int = 0,
) -> Derivatives:
    """The derivatives of the pixels of view `view`, counted from 0, by the ten parameters.

    They are differences of 40 to 80 renderings with the accuracy of the specification, extrapolated
    (Richardson); at the ends of ranges they are taken to one side. With `threads` 0 all cores work.
    Other threads of Python run meanwhile, and Ctrl-C interrupts.
    """
    check_call(specification, view, threads)
    _embree.find()
    pixels, values, errors = _native.derivatives(
        specification._inner, material._parameters, view, backend, threads
    )
    return Derivatives(pixels=pixels, values=values, errors=errors)
