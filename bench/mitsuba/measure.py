"""The error of an image, the ladder from cost to error, and the test that two images are equal."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

# Monte Carlo's: an extrapolation toward less error never climbs more steeply in cost than this
# implies, whatever noise there is in the last two rungs.
SLOPE_MONTE_CARLO = -0.5


def counted_pixels(reference: np.ndarray, floor: float) -> np.ndarray:
    """Which pixels the error is a mean over: those whose mean channel exceeds `floor`."""
    return reference.mean(axis=-1) > floor


def relative_error(image: np.ndarray, reference: np.ndarray, counted: np.ndarray) -> float:
    """The mean over counted pixels of sum |image - reference| / sum reference, over channels."""
    difference = np.abs(image - reference).sum(axis=-1)[counted]
    return float((difference / reference.sum(axis=-1)[counted]).mean())


@dataclass(frozen=True)
class Rung:
    """One setting: what it costs and how wrong its image is."""

    setting: float
    cpu_seconds: float
    error: float


@dataclass(frozen=True)
class Crossing:
    """Where a ladder reaches an error. `kind` is "measured" between two rungs, "at most" where the
    cheapest rung is already there, "extrapolated" past the last."""

    cpu_seconds: float
    kind: str


def crossing(rungs: list[Rung], error: float) -> Crossing:
    """The CPU seconds at which a ladder, linear in the logarithms of both, first falls to `error`.
    Rungs come in order of cost; there are at least two unless the first is already there."""
    if rungs[0].error <= error:
        return Crossing(rungs[0].cpu_seconds, "at most")
    for low, high in itertools.pairwise(rungs):
        if high.error <= error:
            slope = _slope(low, high)
            return Crossing(_along(low, slope, error), "measured")
    low, high = rungs[-2:]
    slope = min(_slope(low, high), SLOPE_MONTE_CARLO)
    return Crossing(_along(high, slope, error), "extrapolated")


def _slope(low: Rung, high: Rung) -> float:
    return math.log(high.error / low.error) / math.log(high.cpu_seconds / low.cpu_seconds)


def _along(rung: Rung, slope: float, error: float) -> float:
    return rung.cpu_seconds * (error / rung.error) ** (1 / slope)


@dataclass(frozen=True)
class Equality:
    """How the mean of independent images compares with a reference."""

    # Of the view's mean, over counted pixels and channels, as a fraction of the reference's.
    mean_difference: float
    # That over its own standard error.
    z: float
    # The mean of |difference| over pixels and channels, over what the images' noise explains: 1
    # when equal.
    excess: float
    # The relative error that the difference would be if it were no noise.
    error: float


def equality(images: np.ndarray, reference: np.ndarray, counted: np.ndarray) -> Equality:
    """Compares `images`, independent renderings along the first axis, with `reference`."""
    count = len(images)
    differences = images[:, counted] - reference[counted]
    white = reference[counted].mean()
    means = differences.mean(axis=(1, 2)) / white
    standard_error = means.std(ddof=1) / math.sqrt(count)
    spread = differences.std(axis=0, ddof=1) / math.sqrt(count)
    # Of a normal variable, the mean size over the standard deviation; the estimate of the latter
    # from `count` values falls short by the factor c4.
    c4 = math.sqrt(2 / (count - 1)) * math.gamma(count / 2) / math.gamma((count - 1) / 2)
    explained = math.sqrt(2 / math.pi) * spread.mean() / c4
    mean = differences.mean(axis=0)
    return Equality(
        mean_difference=float(means.mean()),
        z=float(means.mean() / standard_error) if standard_error > 0 else 0.0,
        excess=float(np.abs(mean).mean() / explained) if explained > 0 else 1.0,
        error=relative_error(images.mean(axis=0), reference, counted),
    )
