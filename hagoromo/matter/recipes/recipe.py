"""Recipe: the checked keys of a matter TOML, and what all kinds of matter take from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hagoromo.files.record import inside, number, numbers, positive
from hagoromo.matter.fill import Fineness
from hagoromo.reflectance.material.material_table import reflectance_from_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan


class Recipe(NamedTuple):
    """key: checked, with defaults. where: what messages call the recipe. folder: of the files that it names."""

    key: dict[str, Any]
    element: str
    folder: Path | None
    where: str

    def __getitem__(self, name: Any) -> Any:
        return self.key[name]

    @property
    def material(self) -> Reflectance:
        """The reflectance of [material]."""
        return reflectance_from_table(self.key["material"], self.folder, f"{self.where} [material]", self.element)

    @property
    def fineness(self) -> Fineness:
        """How finely the matter is sampled."""
        return Fineness(self.key["voxel_mm"], self.key["mean_free_path_mm"]).finer(self.key["resolution"])

    def varied(self, name: str) -> Reflectance:
        """The reflectance of [material] with what the table `name` has in its place."""
        record = self.key["material"] | self.key[name]
        return reflectance_from_table(record, self.folder, f"{self.where} [{name}]", self.element)

    def file(self, path: str) -> Path:
        """A file that the recipe names."""
        return Path(path) if self.folder is None else inside(self.folder, path)

    def record(self, kind: type) -> Any:
        """The keys that are fields of a NamedTuple as one."""
        return kind(*(self.key[name] for name in kind._fields))  # pyright: ignore[reportAttributeAccessIssue]


class Kind(NamedTuple):
    """A kind of matter: element of its micro-structure ("": see `element_of`), keys besides those of all, its plan."""

    element: str
    keys: Mapping[str, Any]
    plan: Callable[[Recipe], BoxPlan]
    element_of: Callable[[dict[str, Any]], str] | None = None


def fineness_keys(voxel_mm: float, mean_free_path_mm: float) -> dict[str, Any]:
    """Keys of voxel and mean free path, with defaults [mm]."""
    return {"voxel_mm": (positive, voxel_mm), "mean_free_path_mm": (positive, mean_free_path_mm)}


def with_defaults(record: Any, kinds: Mapping[str, Any], other: Any = positive) -> dict[str, Any]:
    """Keys of a record's fields with its defaults; `kinds` for those that are not of kind `other`."""
    return {name: (kinds.get(name, other), value) for name, value in zip(record._fields, record, strict=True)}


def not_negative(value: Any) -> float:
    """A number, 0 or more."""
    if number(value) < 0:
        raise ValueError("a number, 0 or more")
    return float(value)


def share(value: Any) -> float:
    """A number from 0 to below 1."""
    if not 0 <= number(value) < 1:
        raise ValueError("a number from 0 to below 1")
    return float(value)


def sizes(value: Any) -> tuple[float, ...]:
    """Three numbers above 0."""
    found = numbers(3)(value)
    if min(found) <= 0:
        raise ValueError("a list of 3 numbers above 0")
    return found
