"""Recipe: the checked tables of a matter TOML, and what all kinds of matter take from it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, NamedTuple, TypeVar

from hagoromo.files.checks import inside
from hagoromo.files.record import Count, Positive, Record, about
from hagoromo.matter.fill import Fineness
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.material.material_table import MATERIAL, reflectance_from_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.store.header import EXTINCTION
from hagoromo.volume.store.plan import BoxPlan

Voxel = Annotated[Positive, about("edge of a voxel, at resolution 1 [mm]")]
MeanFreePath = Annotated[Positive, about("mean free path of light where the density is 1 [mm]")]


class RecipeTable(Record, frozen=True, kw_only=True):
    """What recipes of every kind of matter have."""

    version_key = "format_version"

    format_version: Annotated[Count, about("version of the format of recipes")] = 1
    kind: Annotated[str, about("kind of matter")]
    material: Annotated[dict[str, Any], MATERIAL, about("reflectance of the micro-elements")]
    name: Annotated[str, about("name of the box")] = ""
    seed: Annotated[Count, about("seed of the random numbers: another one grows another piece")] = 0
    resolution: Annotated[Positive, about("1: voxels as stated; 2: voxels half as large")] = 1.0
    extinction: Annotated[Extinction, EXTINCTION] = "isotropic"


T = TypeVar("T", bound=RecipeTable)


class Recipe(NamedTuple, Generic[T]):
    """table: checked, with defaults. where: what messages call the recipe. folder: of the files that it names."""

    table: T
    element: Element
    folder: Path | None
    where: str

    @property
    def material(self) -> Reflectance:
        """The reflectance of [material]."""
        return self.reflectance(self.table.material, "[material]")

    @property
    def fineness(self) -> Fineness:
        """How finely the matter is sampled, of a kind with `voxel_mm` and `mean_free_path_mm`."""
        table: Any = self.table
        return Fineness(table.voxel_mm, table.mean_free_path_mm).finer(table.resolution)

    def varied(self, name: str) -> Reflectance:
        """The reflectance of [material] with what the table `name` has in its place."""
        return self.reflectance(self.table.material | getattr(self.table, name), f"[{name}]")

    def reflectance(self, material: dict[str, Any], part: str) -> Reflectance:
        """The reflectance of a table; part: what messages call it."""
        return reflectance_from_table(material, self.folder, f"{self.where} {part}", self.element)

    def file(self, path: str) -> Path:
        """A file that the recipe names."""
        return Path(path) if self.folder is None else inside(self.folder, path)


class Kind(NamedTuple):
    """A kind of matter: element of its micro-structure ("": see `element_of`), its tables, its plan.

    record: a `RecipeTable` with the keys of this kind; its JSON Schema is made from it.
    """

    element: Element | Literal[""]
    record: type[RecipeTable]
    plan: Callable[[Recipe[Any]], BoxPlan]
    element_of: Callable[[Any], Element] | None = None
