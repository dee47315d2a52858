"""Reading datasets: stores, exports and manifests, in folders and buckets."""

from __future__ import annotations

import contextlib
import importlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from brdfarm import _native
from brdfarm._native import StoreError
from brdfarm._specification import Specification

if TYPE_CHECKING:
    import pyarrow as pa
    from torch.utils.data import Dataset as TorchDataset

LABELS = ("roughness", "anisotropy", "angle_deg", "ior", "rgb0_linear", "rgb90_linear")
"""The columns of the ten parameters."""


@dataclass(frozen=True, eq=False)
class Image:
    """One image of a dataset."""

    material: int
    view: int
    pixels: NDArray[np.float32]
    """(height, width, 3): radiance in units of white, linear Rec.709."""
    digest: str
    """The BLAKE3 digest of its file, which was checked."""

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<Image material {self.material}, view {self.view}, {width} x {height}>"


class _Source(Protocol):
    """Where labels and images come from."""

    def table(self) -> pa.Table: ...

    def specification(self) -> Specification: ...

    def file(self, material: int, view: int) -> tuple[bytes, str]: ...


class Dataset:
    """A dataset that is there: labels as a table, images as arrays.

    `name` is a store (a folder or postgres://...), an export with the layout `files`, or a manifest
    in Parquet; exports and manifests may be in a bucket (s3://..., gs://..., abfs://...), which
    pyarrow reads. A dataset can be pickled and read by many processes.

    Raises `FileNotFoundError` where there is none and `StoreError` where it cannot be read.
    """

    def __init__(self, name: str | os.PathLike[str]) -> None:
        self._name = os.fspath(name)
        self._source = _open(self._name)

    def __reduce__(self) -> tuple[Any, ...]:
        return Dataset, (self._name,)

    @cached_property
    def specification(self) -> Specification:
        """What decided the dataset."""
        return self._source.specification()

    @cached_property
    def table(self) -> pa.Table:
        """One row an image: labels, split, geometry, digest and measured error, as in the manifest.
        Needs pyarrow."""
        return self._source.table()

    @cached_property
    def _rows(self) -> dict[tuple[int, int], int]:
        keys = zip(self.table["material"].to_pylist(), self.table["view"].to_pylist(), strict=True)
        return {key: row for row, key in enumerate(keys)}

    @property
    def materials(self) -> list[int]:
        """The materials that are there, in order."""
        return sorted({material for material, _ in self._rows})

    def __len__(self) -> int:
        """How many images there are."""
        return len(self._rows)

    def __iter__(self) -> Iterator[Image]:
        return (self[key] for key in self._rows)

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self._rows

    def __getitem__(self, key: tuple[int, int]) -> Image:
        """The image of a material and a view, checked against its digest."""
        material, view = (int(part) for part in key)
        file, digest = self._source.file(material, view)
        try:
            pixels = _native.decode(file, digest)
        except StoreError as error:
            raise StoreError(f"material {material}, view {view}: {error}") from None
        return Image(material, view, pixels, digest)

    def label(self, material: int) -> NDArray[np.float64]:
        """The ten parameters of a material: roughness, anisotropy, angle in degrees, index of
        refraction, and both colours, linear."""
        return self._labels[material]

    @cached_property
    def _labels(self) -> dict[int, NDArray[np.float64]]:
        columns = [self.table[name].to_pylist() for name in LABELS]
        materials = self.table["material"].to_pylist()
        return {material: np.hstack(values) for material, *values in zip(materials, *columns, strict=True)}

    def rectified(self, material: int, view: int, side: int) -> NDArray[np.float32]:
        """The sample in an image, warped to a square of `side` x `side` pixels."""
        pixels = self[material, view].pixels
        return _native.rectify(self.specification._inner, view, side, pixels)

    def torch(
        self,
        split: str | None = None,
        views: Sequence[int] = (5, 8),
        rectified: int | None = None,
    ) -> TorchDataset:
        """A dataset for PyTorch's loaders, by material: (views, 3, height, width) float32 pixels and
        the ten parameters as `label` has them.

        `split` is 'train', 'validation', 'test' or None for all. With `rectified` each image is the
        sample alone, warped to a square of so many pixels. Materials that lack a view are left out.
        Needs torch.
        """
        pairs = _needed("brdfarm._torch", "torch")
        if split not in (None, "train", "validation", "test"):
            raise ValueError(f"there is no split {split!r}: they are 'train', 'validation' and 'test'")
        splits = dict(zip(self.table["material"].to_pylist(), self.table["split"].to_pylist(), strict=True))
        materials = [
            material
            for material in self.materials
            if (split is None or splits[material] == split)
            and all((material, view) in self._rows for view in views)
        ]
        return pairs.Pairs(self, materials, tuple(views), rectified)

    def __repr__(self) -> str:
        return f"<Dataset {self._name}: {len(self.materials)} materials, {len(self)} images>"


class _Store:
    """A store, in a folder or a database."""

    def __init__(self, name: str) -> None:
        self.native = _native.Store.open(name)

    def specification(self) -> Specification:
        return Specification._of(self.native.specification())

    def table(self) -> pa.Table:
        pq = _needed("pyarrow.parquet", "table")
        with tempfile.TemporaryDirectory(prefix="brdfarm-") as folder:
            path = Path(folder) / "manifest.parquet"
            self.native.write_manifest(str(path))
            return pq.read_table(path, memory_map=False)

    def file(self, material: int, view: int) -> tuple[bytes, str]:
        return self.native.read(material, view)


class _Manifest:
    """A manifest in Parquet, with images beside it."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.places: dict[tuple[int, int], tuple[str, str]] | None = None

    @cached_property
    def filesystem(self) -> tuple[Any, str]:
        """A file system of pyarrow, and the path of the manifest in it."""
        fs = _needed("pyarrow.fs", "table")
        if "://" in self.name:
            filesystem, path = fs.FileSystem.from_uri(self.name)
            return filesystem, str(path)
        return fs.LocalFileSystem(), str(Path(self.name).absolute())

    def bytes_of(self, path: str) -> bytes:
        filesystem, _ = self.filesystem
        with filesystem.open_input_stream(path) as stream:
            return bytes(stream.read())

    def table(self) -> pa.Table:
        pa, pq = _needed("pyarrow", "table"), _needed("pyarrow.parquet", "table")
        _, path = self.filesystem
        table = pq.read_table(pa.BufferReader(self.bytes_of(path)))
        missing = {"material", "view", "path", "digest"} - set(table.column_names)
        if missing:
            raise StoreError(f"{self.name} is no manifest: it has no column {min(missing)!r}")
        return table

    def specification(self) -> Specification:
        _, path = self.filesystem
        with tempfile.TemporaryDirectory(prefix="brdfarm-") as folder:
            copy = Path(folder) / "manifest.parquet"
            copy.write_bytes(self.bytes_of(path))
            native = _native.manifest_specification(str(copy))
        # An export has the mesh beside the manifest; a manifest alone tells labels all the same.
        mesh = native.mesh_file_name()
        if mesh is not None:
            with contextlib.suppress(FileNotFoundError):
                native = native.with_mesh(self.bytes_of(f"{path.rpartition('/')[0]}/{mesh}"))
        return Specification._of(native)

    def file(self, material: int, view: int) -> tuple[bytes, str]:
        if self.places is None:
            columns = [self.table()[name].to_pylist() for name in ("material", "view", "path", "digest")]
            self.places = {
                (material, view): (path, digest)
                for material, view, path, digest in zip(*columns, strict=True)
            }
        if (material, view) not in self.places:
            raise IndexError(f"{self.name} has no image of material {material}, view {view}")
        path, digest = self.places[material, view]
        # The manifest may be a stranger's.
        if path.startswith("/") or ".." in path.split("/"):
            raise StoreError(f"{self.name}: the path {path!r} leads out of the dataset")
        _, manifest = self.filesystem
        return self.bytes_of(f"{manifest.rpartition('/')[0]}/{path}"), digest


def _needed(module: str, extra: str) -> Any:
    """A module of a package that not everybody has."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ImportError(f"this needs {error.name}: pip install 'brdfarm[{extra}]'") from error


def _open(name: str) -> _Source:
    if name.startswith(("postgres://", "postgresql://")):
        return _Store(name)
    if name.endswith(".parquet"):
        return _Manifest(name)
    if "://" in name:
        return _Manifest(f"{name.rstrip('/')}/manifest.parquet")
    folder = Path(name)
    if not folder.exists():
        raise FileNotFoundError(f"there is no dataset in {name}: no such folder")
    if not (folder / "specification.json").exists() and (folder / "manifest.parquet").exists():
        return _Manifest(str(folder / "manifest.parquet"))
    return _Store(name)
