"""Rendering one view of one material."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from brdfarm import _embree, _native
from brdfarm._material import Material
from brdfarm._specification import Specification


@dataclass(frozen=True, eq=False, repr=False)
class Rendering:
    """A rendered view, with its stated error."""

    pixels: NDArray[np.float32]
    """(height, width, 3): radiance in units of white, linear Rec.709. 1 is a perfect white diffuser
    at the origin that faces the bulb. The file rounds these to 16 bits where the specification says
    so."""
    error: NDArray[np.float32]
    """(height, width): half the width of the 95 percent interval of each pixel's worst channel,
    rounded up. The rounding of `pixels` to 32 bits is not included."""
    digest: str
    """The BLAKE3 digest of the EXR file: that of the command's file."""
    exr: bytes
    """The EXR file."""
    integrator: str
    """'hybrid' or 'path'. The path tracer renders also what the hybrid integrator cannot."""
    error_mean: float
    """The mean of the stated errors."""
    error_p95: float
    """Their 95th percentile."""
    error_max: float
    """The largest."""
    within_target: float
    """The share of pixels whose stated error is within the accuracy that was asked for, 0 to 1."""
    samples: int
    """Light paths traced."""
    evaluations: int
    """Evaluations of the hybrid integrator."""
    seconds: float
    """How long it took."""
    _inner: _native.Rendering

    @property
    def error_exr(self) -> bytes:
        """The errors as an EXR file of one channel, `error`: what the command's `--error-out` writes."""
        return self._inner.error_exr()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the EXR file."""
        Path(path).write_bytes(self.exr)

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return (
            f"<Rendering {width} x {height}, {100 * self.within_target:.1f}% within target, "
            f"{self.digest[:12]}>"
        )


def check_call(specification: Specification, view: int, threads: int) -> None:
    """Raises `ValueError` where there is no such view, or fewer than no threads."""
    if not 0 <= view < len(specification.views):
        raise ValueError(
            f"there is no view {view}: the specification has {len(specification.views)}, counted from 0"
        )
    if threads < 0:
        raise ValueError(f"threads is {threads}: it is 0 for all cores, or how many")


def render(
    specification: Specification,
    material: Material,
    view: int,
    *,
    relative: float | None = None,
    absolute: float | None = None,
    backend: str = "auto",
    threads: int = 0,
) -> Rendering:
    """Renders view `view`, counted from 0, of a material.

    `relative` and `absolute` replace the accuracy of the specification: a pixel's error is to be
    within the larger of `absolute` and `relative` times its value. With `threads` 0 all cores work.
    Other threads of Python run meanwhile, and Ctrl-C interrupts.
    """
    accuracy = {"relative": relative, "absolute": absolute}
    accuracy = {name: value for name, value in accuracy.items() if value is not None}
    if accuracy:
        specification = specification.replace(accuracy=accuracy)
    check_call(specification, view, threads)
    _embree.find()
    native = _native.render(
        specification._inner, material._parameters, material.index, view, backend, threads
    )
    mean, p95, largest, within_target, samples, evaluations = native.statistics()
    error = native.error()
    rounded = error.astype(np.float32)
    # Never below what was stated.
    rounded = np.where(rounded < error, np.nextafter(rounded, np.float32(np.inf)), rounded)
    return Rendering(
        pixels=native.pixels().astype(np.float32),
        error=rounded,
        digest=native.digest(),
        exr=native.exr(),
        integrator=native.integrator(),
        error_mean=mean,
        error_p95=p95,
        error_max=largest,
        within_target=within_target,
        samples=samples,
        evaluations=evaluations,
        seconds=native.seconds(),
        _inner=native,
    )
