"""Labelled material datasets: rendered, read, and learned from.

    import brdfarm

    spec = brdfarm.Specification.preset().replace(materials=24)
    image = brdfarm.render(spec, spec.material(3), view=5)
    data = brdfarm.run(spec, "store", progress=True)
    data[3, 5].pixels

Units: radiance is in units of white (1 is a perfect white diffuser at the origin that faces the
bulb), colours are linear Rec.709, angles are degrees, directions point away from the surface whose
normal is +z.
"""

from brdfarm._dataset import LABELS, Dataset, Image
from brdfarm._derivatives import PARAMETERS, Derivatives, derivatives
from brdfarm._material import Material, Sample
from brdfarm._native import RENDERER_VERSION, StoreError
from brdfarm._rendering import Rendering, render
from brdfarm._run import Progress, run
from brdfarm._specification import Specification

__all__ = [
    "LABELS",
    "PARAMETERS",
    "RENDERER_VERSION",
    "Dataset",
    "Derivatives",
    "Image",
    "Material",
    "Progress",
    "Rendering",
    "Sample",
    "Specification",
    "StoreError",
    "derivatives",
    "render",
    "run",
]
