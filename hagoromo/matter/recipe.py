"""Recipe: the checked tables of a matter TOML, and what all kinds of matter take from it.

Registry: the kinds of matter that recipes may name, the recipes that ship, and the plan of the box of a recipe.

A package adds a kind by the name of the kind, and where its `Kind` is; those of `hagoromo_matter` are added so, too.

    [project.entry-points."hagoromo.matter"]
    lichen = "my_package.lichen:KIND"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, NamedTuple, TypeVar

from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.format import installed
from hagoromo.files.record import Count, ForeignRecord, Positive, Record, about, decode, read_toml
from hagoromo.matter.fill import Fineness
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.material.material_table import MATERIAL, reflectance_from_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.store.header import EXTINCTION
from hagoromo.volume.store.plan import BoxPlan

Voxel = Annotated[Positive, about("edge of a voxel, at resolution 1 [mm]")]
MeanFreePath = Annotated[Positive, about("mean free path of light where the density is 1 [mm]")]
GROUP = "hagoromo.matter"
NAME = re.compile(r"[a-z][a-z0-9_]*")


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

    record: a `RecipeTable` with the keys of this kind; its JSON Schema is made from it. check: raises `InputError` at
    once for a recipe that `plan`, which may take minutes, would refuse.
    """

    element: Element | Literal[""]
    record: type[RecipeTable]
    plan: Callable[[Recipe[Any]], BoxPlan]
    element_of: Callable[[Any], Element] | None = None
    check: Callable[[Recipe[Any]], object] | None = None


@cache
def _points() -> dict[str, EntryPoint]:
    """The kinds by name; the metadata of all packages is read for it once."""
    return {point.name: point for point in reversed(installed(GROUP))}  # of one name the first is taken


def kind_names() -> tuple[str, ...]:
    """The names of all kinds, in the order of the alphabet; no package that has them is imported."""
    return tuple(sorted(_points()))


def kind_of(name: str) -> Kind:
    """The kind of matter called `name`, one of `kind_names()`.

    `InputError` when the package that names it cannot be imported, or holds no `Kind` there.
    """
    point = _points()[name]
    try:
        kind = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"the kind of matter {name!r} ({point.value}) cannot be loaded: {error}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"the kind of matter {name!r} ({point.value}) is a {type(kind).__name__}: it must be a Kind")
    return kind


def planned(recipe: Mapping[str, Any] | str | Path, folder: Path | None = None) -> tuple[BoxPlan, str, Path | None]:
    """The plan of a recipe's box; what messages call the recipe; the folder of the files that it names.

    folder: that of a recipe that is given by its tables; None: its files are named from where the program runs.
    """
    if isinstance(recipe, (str, Path)):
        recipe = recipe_place(recipe)
        record, where, folder = read_toml(recipe), str(recipe), recipe.parent
    else:
        record, where = dict(recipe), "recipe"
    kind, decoded = _decoded(record, folder, where)
    with described(where):
        plan = kind.plan(decoded).with_extinction(decoded.table.extinction)
    return plan.named(decoded.table.name, {"recipe": record}), where, folder


def check_recipe(tables: Mapping[str, Any], folder: Path | None, where: str) -> None:
    """`InputError` for a recipe that is seen to be wrong without planning its box: keys, values, and what the kind of
    matter checks of them together. folder: as of `planned`.
    """
    kind, decoded = _decoded(tables, folder, where)
    if kind.check is not None:
        with described(where):
            kind.check(decoded)


def _decoded(record: Mapping[str, Any], folder: Path | None, where: str) -> tuple[Kind, Recipe[Any]]:
    kind = kind_of_tables(record, where)
    table = decode(record, kind.record, where)
    element = kind.element_of(table) if kind.element_of else kind.element or "plane"
    return kind, Recipe(table, element, folder, where)


def kind_of_tables(record: Mapping[str, Any], where: str) -> Kind:
    """The kind of matter of a recipe's tables; `InputError` for one that is not installed."""
    name = decode(record, _OfKind, where).kind
    if name not in kind_names():
        raise InputError(f"{where}: kind must be one of {', '.join(kind_names())}: given {name!r:.60}")
    return kind_of(name)


class _OfKind(ForeignRecord, frozen=True):
    kind: str


def shipped_recipes() -> dict[str, Path]:
    """Name → file of every recipe that comes with the package, by name.

    They are `examples/recipes` of the repository, which the wheel holds as `hagoromo/matter/recipes`.
    """
    installed = Path(__file__).parent / "recipes"
    folder = installed if installed.is_dir() else Path(__file__).parents[2] / "examples" / "recipes"
    return {file.stem: file for file in sorted(folder.glob("*.toml"))}


def recipe_place(recipe: str | Path) -> Path:
    """The file of a recipe: a path, or where there is nothing at it the name of a recipe that comes with the package.

    `InputError`, with the names that there are, for a name of none.
    """
    path = Path(recipe)
    if not NAME.fullmatch(str(recipe)) or path.exists():
        return path
    known = shipped_recipes()
    if path.name not in known:
        raise InputError(f"{recipe} is neither a file nor a recipe that comes with Hagoromo: {', '.join(known)} are")
    return known[path.name]


def summary(recipe: Path) -> str:
    """What a recipe says of itself: its first comment, up to its first sentence's end."""
    for line in recipe.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            return re.split(r"\.\s|\.$|  ", line[2:])[0]
    return ""
