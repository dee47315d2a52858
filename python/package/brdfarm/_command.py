"""The command `brdfarm`, which comes in the same wheel."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from brdfarm import _embree

VARIABLE = "BRDFARM_COMMAND"


def path() -> Path:
    """The program. The variable BRDFARM_COMMAND names another, as for those who build their own."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    return Path(__file__).parent / "bin" / "brdfarm"


def environment() -> dict[str, str]:
    """The environment that it runs in: it is told where Embree is."""
    variables = dict(os.environ)
    if not variables.get(_embree.VARIABLE) and (library := _embree.library()):
        variables[_embree.VARIABLE] = str(library)
    return variables


def main() -> None:
    """Becomes the program: the console script."""
    program = path()
    try:
        os.execve(program, ["brdfarm", *sys.argv[1:]], environment())
    except OSError as error:
        sys.exit(f"error: {program}: {error.strerror}: install the package brdfarm again")
