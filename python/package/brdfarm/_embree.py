"""Where the Embree of the wheel `embreex` is."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

VARIABLE = "EMBREE_LIBRARY"


def library() -> Path | None:
    """The shared library that came with the package `embreex`, without importing that."""
    spec = importlib.util.find_spec("embreex")
    for place in spec.submodule_search_locations or [] if spec else []:
        for found in sorted((Path(place).parent / "embreex.libs").glob("libembree4*.so*")):
            return found
    return None


def find() -> None:
    """Tells the renderer of it, unless somebody named another."""
    if not os.environ.get(VARIABLE) and (found := library()):
        os.environ[VARIABLE] = str(found)
