"""The main job: a dataset rendered into a store."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from brdfarm import _command
from brdfarm._dataset import Dataset
from brdfarm._native import StoreError
from brdfarm._specification import Specification

BAD_INPUT = 2
STOPPED = (130, 143)
LINES_KEPT = 1000


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    images: int
    """Images that are there."""
    total: int
    """Images of the whole set."""
    rate: float
    """Images a second over the last minute; 0 while nothing comes."""
    errors: int
    """Renderings that failed. Each is tried again."""

    @property
    def seconds_left(self) -> float | None:
        """How long the rest takes at this rate; None while nothing comes."""
        return (self.total - self.images) / self.rate if self.rate > 0 else None

    def __str__(self) -> str:
        text = f"{self.images} of {self.total} images"
        if (left := self.seconds_left) is not None:
            time = f"{left / 60:.0f} min" if left >= 90 else f"{left:.0f} s"
            text += f", {self.rate:.1f}/s, {time} left"
        return text + (f", {self.errors} errors" if self.errors else "")


def run(
    specification: Specification | None,
    store: str | os.PathLike[str],
    *,
    materials: int | None = None,
    workers: int = 0,
    blobs: str | None = None,
    progress: bool | Callable[[Progress], None] = False,
) -> Dataset:
    """Renders a dataset into a store, checks it, and opens it.

    The same call again goes on where it was stopped; with more `materials` it adds to what is there.
    Without a specification a store that is there goes on with its own. `workers` 0 takes one a core.
    `blobs` is where images live instead of in the store, such as s3://BUCKET/PREFIX.

    With `progress=True` it writes a line that it keeps up to date; a function is called with a
    `Progress` once a second.

    It runs in a process of its own, the command `brdfarm run`, so a crash of Python harms no store.
    Ctrl-C stops it after the views under way and raises `KeyboardInterrupt`; nothing that was
    completed is lost.
    """
    arguments = ["run", "--store", os.fspath(store), "--workers", str(workers), "--progress", "json"]
    if materials is not None:
        arguments += ["--materials", str(materials)]
    if blobs is not None:
        arguments += ["--blobs", blobs]
    with tempfile.TemporaryDirectory(prefix="brdfarm-") as folder:
        if specification is not None:
            file = Path(folder) / "specification.toml"
            specification.save(file)
            arguments += ["--spec", str(file)]
        code, said = _execute(arguments, _shown(progress))
    if code != 0:
        raise _error(code, said)
    return Dataset(store)


def _execute(arguments: list[str], show: Callable[[Progress], None]) -> tuple[int, str]:
    """Runs the command; returns its exit code and what it said last."""
    process = subprocess.Popen(
        [str(_command.path()), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=_command.environment(),
        # A terminal's Ctrl-C comes to this process alone, which passes it on.
        start_new_session=True,
    )
    lines: deque[str] = deque(maxlen=LINES_KEPT)
    reader = threading.Thread(target=_read, args=(process.stderr, lines, show), daemon=True)
    reader.start()
    interrupted = False
    while True:
        try:
            code = process.wait()
            break
        except KeyboardInterrupt:
            interrupted = True
            process.send_signal(signal.SIGINT)
        except BaseException:
            process.send_signal(signal.SIGTERM)
            process.wait()
            raise
    reader.join()
    if interrupted and code in (0, *STOPPED):
        raise KeyboardInterrupt
    errors = [line for line in lines if line.startswith("error: ")]
    return code, (errors or list(lines) or [""])[-1]


def _read(stream: IO[str], lines: deque[str], show: Callable[[Progress], None]) -> None:
    """Takes what the command writes until it ends."""
    broken = False
    for line in stream:
        try:
            fields = json.loads(line)
            progress = Progress(fields["images"], fields["total"], fields["rate"], fields["errors"])
        except (ValueError, KeyError, TypeError):
            lines.append(line.rstrip("\n"))
            continue
        if not broken:
            try:
                show(progress)
            except Exception as error:  # A run is worth more than its display.
                broken = True
                print(f"brdfarm: progress is shown no more: {error!r}", file=sys.stderr)


def _shown(progress: bool | Callable[[Progress], None]) -> Callable[[Progress], None]:
    if callable(progress):
        return progress
    return _write_line if progress else lambda _: None


def _write_line(progress: Progress) -> None:
    end = "\n" if progress.images >= progress.total else ""
    sys.stderr.write(f"\r{progress!s:<60}{end}")
    sys.stderr.flush()


def _error(code: int, said: str) -> Exception:
    sentence = said.removeprefix("error: ")
    if code == BAD_INPUT:
        return ValueError(sentence)
    if code in STOPPED or code < 0:
        return InterruptedError(sentence or f"the run was ended by signal {-code}")
    return StoreError(sentence or f"brdfarm run ended with code {code}")
