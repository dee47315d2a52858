"""The specification: everything that decides a dataset."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from brdfarm import _native
from brdfarm._material import Material


class Specification:
    """A dataset's specification, complete and checked.

    Make one with `preset`, `load` or `from_toml`, and others from it with `replace` and `with_mesh`.
    Fields, units and defaults are those of the TOML file, which `to_toml` writes.
    """

    __slots__ = ("_inner",)
    _inner: _native.Specification

    @classmethod
    def preset(cls, name: str = "maxbrdf") -> Specification:
        """The built-in preset: the paper's dataset."""
        if name != "maxbrdf":
            raise ValueError(f"there is no preset {name!r}: the only one is 'maxbrdf'")
        return cls._of(_native.Specification.preset())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Specification:
        """Reads a TOML file, and the mesh beside it if it names one. What it leaves out is as in the
        preset."""
        return cls._of(_native.Specification.load(os.fspath(path)))

    @classmethod
    def from_toml(cls, text: str) -> Specification:
        """Reads TOML. What it leaves out is as in the preset. A mesh is named by its digest, and is
        loaded by `with_mesh`."""
        return cls._of(_native.Specification.from_toml(text, "TOML"))

    @classmethod
    def _of(cls, native: _native.Specification) -> Specification:
        specification = object.__new__(cls)
        object.__setattr__(specification, "_inner", native)
        return specification

    def __init__(self) -> None:
        raise TypeError("make one with Specification.preset(), .load(path) or .from_toml(text)")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a specification does not change: use replace(), which makes another")

    def replace(self, **changes: Any) -> Specification:
        """Another specification with other values: `spec.replace(materials=300, image=dict(width=64))`.

        A dict changes the fields that it names and leaves the others. A list replaces a list. A mesh
        stays loaded.
        """
        fields = _merged(self.to_dict(), changes)
        try:
            text = json.dumps(fields, default=_plain, allow_nan=False)
        except ValueError:
            raise ValueError("a number of a specification has to be finite") from None
        return self._of(_native.Specification.from_json(text).with_mesh_of(self._inner))

    def with_mesh(self, mesh: str | os.PathLike[str] | bytes) -> Specification:
        """Another specification whose sample is a mesh: the path of an OBJ or PLY file, or its bytes.

        Where the sample is a mesh already, this loads it: from the file that the digest in `sample.mesh`
        names, and from no other. `replace(sample=dict(shape="square", mesh=None))` takes a mesh away.
        """
        return self._of(self._inner.with_mesh(_mesh_bytes(mesh)))

    @property
    def mesh(self) -> bytes | None:
        """The bytes of the mesh's file. None where the sample is no mesh, or the mesh is not loaded."""
        return self._inner.mesh()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file that `load` and the command's `--spec` read, and beside it the mesh, whose
        file is named by its digest."""
        self._inner.check_mesh()
        file = Path(path)
        mesh, name = self.mesh, self._inner.mesh_file_name()
        if mesh is not None and name is not None:
            (file.parent / name).write_bytes(mesh)
        file.write_text(self.to_toml())

    def to_dict(self) -> dict[str, Any]:
        """All fields, as the TOML file has them."""
        fields: dict[str, Any] = json.loads(self._inner.to_json())
        return fields

    def to_toml(self) -> str:
        """The text of the file that `load` and the command's `--spec` read. It names a mesh by its
        digest: `save` writes the mesh as well."""
        return self._inner.to_toml()

    @property
    def name(self) -> str:
        """What the set is called."""
        return str(self.to_dict()["name"])

    @property
    def seed(self) -> int:
        """Decides materials, splits and light paths."""
        return int(self.to_dict()["seed"])

    @property
    def materials(self) -> int:
        """How many materials the set has."""
        return int(self.to_dict()["materials"])

    @property
    def views(self) -> list[dict[str, Any]]:
        """The views of every material, in order."""
        return list(self.to_dict()["views"])

    @property
    def shape(self) -> tuple[int, int, int]:
        """The shape of an image: height, width, 3."""
        image = self.to_dict()["image"]
        return image["height"], image["width"], 3

    @property
    def hash(self) -> str:
        """What tells this dataset from others, in hexadecimal. The name and the number of materials
        are left out: they change no image."""
        return self._inner.hash()

    def material(self, index: int) -> Material:
        """Material `index` of the set. It depends on the seed and on the ranges of the parameters
        alone, so every index has one, whatever `materials` says."""
        roughness, anisotropy, angle_deg, ior, rgb0, rgb90 = self._inner.material(_index(index))
        return Material(roughness, anisotropy, angle_deg, ior, rgb0, rgb90, index=int(index))

    def split(self, index: int) -> str:
        """The split of material `index`: 'train', 'validation' or 'test'."""
        return self._inner.split(_index(index))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Specification):
            return NotImplemented
        return self._inner.to_json() == other._inner.to_json()

    def __hash__(self) -> int:
        return hash(self._inner.to_json())

    def __repr__(self) -> str:
        height, width, _ = self.shape
        return (
            f"<Specification {self.name}: {self.materials} materials, {len(self.views)} views of "
            f"{width} x {height}, {self.hash[:12]}>"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return _from_json, (self._inner.to_json(), self.mesh)


def _from_json(text: str, mesh: bytes | None = None) -> Specification:
    native = _native.Specification.from_json(text)
    return Specification._of(native if mesh is None else native.with_mesh(mesh))


def _mesh_bytes(mesh: str | os.PathLike[str] | bytes) -> bytes:
    """The bytes of a mesh, none of which is read of a file that is too large."""
    if isinstance(mesh, bytes | bytearray | memoryview):
        return bytes(mesh)
    path = Path(mesh)
    size = path.stat().st_size
    if size > _native.MESH_BYTES_MAX:
        raise ValueError(
            f"{path} has {size} bytes, and a mesh has at most {_native.MESH_BYTES_MAX}: simplify it"
        )
    return path.read_bytes()


def _plain(value: Any) -> Any:
    """A number or an array of NumPy as Python has it."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a specification has numbers, texts and lists, and no {type(value).__name__}")


def _index(index: int) -> int:
    index = int(index)
    if not 0 <= index < 2**32:
        raise ValueError(f"there is no material {index}: they are counted from 0")
    return index


def _merged(fields: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(fields)
    for name, value in changes.items():
        before = merged.get(name)
        if isinstance(before, dict) and isinstance(value, Mapping):
            value = _merged(before, value)
        merged[name] = value
    return merged
