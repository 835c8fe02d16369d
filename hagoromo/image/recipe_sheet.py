"""Recipe sheet: one recipe under one or two parameters that vary, each cell a picture, under one lamp, by one camera.

Enters: a recipe, and values of its keys. Leaves: pictures of one exposure, and a PNG with their labels.
"""

from __future__ import annotations

import copy
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError, described
from hagoromo.files.cache import cache
from hagoromo.files.content import content_of_texts
from hagoromo.files.png import write_png
from hagoromo.files.record import read_toml
from hagoromo.files.record_keys import meaning_of_key, named_unit, unit_of_key
from hagoromo.files.whole import whole_file
from hagoromo.image.box_camera import TO_KEY, brick_corners, camera_of_corners, width_in_middle
from hagoromo.image.picture.image import Image, auto_exposure
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.render import picture_of_mode
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.sheet_labels import labelled
from hagoromo.light.colour import srgb_encode
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import build, kept_box
from hagoromo.matter.recipe import check_recipe, kind_of_tables, recipe_place
from hagoromo.progress import Progress, part_of, silent
from hagoromo.volume.box import VolumeBox

MOST_CELLS = 100
CELL_PX, SMALLEST_PX, LARGEST_PX = 320, 64, 2048  # side of a cell
SAMPLES = 4  # rays a pixel
BUILDING = 0.8  # of the work, where no box is in the cache


@dataclass(frozen=True)
class VariedKey:
    """A key of a recipe and its values. path: tables on the way to it, then its name, such as ("warp", "hand").

    unit: of the values, "" where the recipe's schema states none.
    """

    path: tuple[str, ...]
    values: tuple[Any, ...]
    unit: str = ""

    @property
    def name(self) -> str:
        """As it is written: warp.hand."""
        return ".".join(self.path)

    def label(self, value: Any) -> str:
        """A value with the key's name, and its unit where the name does not end in it."""
        number = f"{value:g}" if isinstance(value, float) else _text(value)
        return f"{self.name} = {number}" + (f" {_after(self.unit)}" if self.unit and not named_unit(self.name) else "")


@dataclass(frozen=True, eq=False)
class RecipeSheet:
    """Pictures (rows, columns, side, side, 3) of 8-bit sRGB, all of one exposure.

    rows, columns: what varies downwards and along; None where nothing does. title: the recipe, the keys that have one
    value, the seed, and what a cell shows.
    """

    pictures: NDArray[np.uint8]
    rows: VariedKey | None
    columns: VariedKey | None
    title: str

    def __repr__(self) -> str:
        """The number of cells, and their size."""
        rows, columns, side = self.pictures.shape[:3]
        return f"RecipeSheet({rows} × {columns} cells of {side} px)"

    def labels(self) -> list[list[str]]:
        """What each cell is called, by rows."""
        down = [""] if self.rows is None else [self.rows.label(value) for value in self.rows.values]
        along = [""] if self.columns is None else [self.columns.label(value) for value in self.columns.values]
        return [["\n".join(filter(None, (column, row))) for column in along] for row in down]

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the sheet as PNG; `InputError` for another name, or where `path` exists without `force`."""
        target = checked_png(path)
        with whole_file(target, force) as partial:
            write_png(partial, labelled(self.pictures, self.labels(), self.title), srgb=True)
        return target


def recipe_sheet(
    recipe: str | Path,
    vary: Mapping[str, Sequence[Any]],
    across: float | None = None,
    side: int = CELL_PX,
    progress: Progress = silent,
) -> RecipeSheet:
    """Pictures of the boxes of `recipe` for all values of the keys in `vary`, such as {"warp.twist_per_cm": (2, 6)}.

    recipe: a TOML file, or the name of one that comes with the package. A key names tables with dots. Two
    keys at most have several values; others are set to their one. All cells have the seed of the recipe, one far lamp
    (D65), one camera that sees the largest box, or `across` [m] of its middle, and one exposure. side: of a cell [px].
    Boxes are taken from the cache, and put there. `InputError` for a key or a value that the recipe does not take; it
    names those that it has: before any box is built, where the recipe's schema and its kind of matter know it.
    """
    place = recipe_place(recipe)
    tables, where, folder = read_toml(place), str(place), place.parent
    if not SMALLEST_PX <= side <= LARGEST_PX:
        raise InputError(f"a cell is {side} px wide: give {SMALLEST_PX} to {LARGEST_PX}")
    if across is not None and not 0.0 < across < math.inf:
        raise InputError(f"a cell shows {across:g} m: give a width above 0")
    keys = _known(tables, _split(vary), where)
    columns, rows = (*(key for key in keys if len(key.values) > 1), None, None)[:2]
    fixed = [(key, key.values[0]) for key in keys if len(key.values) == 1]
    boxes = _Boxes(folder, where)
    for down in rows.values if rows else (None,):
        for along in columns.values if columns else (None,):
            own = [(key, value) for key, value in ((columns, along), (rows, down)) if key is not None]
            boxes.add(_with(tables, fixed + own), _stated(own or fixed))
    boxes.check()
    count = len(boxes.varied)
    parts = [part_of(progress, BUILDING * k / count, BUILDING / count) for k in range(count)]
    bounds = [brick_corners(boxes.box(k, part)) for k, part in enumerate(parts)]
    camera = camera_of_corners(bounds, side, across)
    images = _pictures(boxes, camera, part_of(progress, BUILDING, 1.0 - BUILDING))
    linear = np.stack([image.linear_srgb() for image in images])
    exposure = auto_exposure(linear, np.stack([image.alpha for image in images]))
    shape = len(rows.values) if rows else 1, len(columns.values) if columns else 1
    width = 1e3 * width_in_middle(bounds, camera)
    said = [place.stem, *([_stated(fixed)] if fixed else [])]
    title = ", ".join([*said, f"seed {tables.get('seed', 0)}", f"a cell is {width:.3g} mm wide"])
    return RecipeSheet(srgb_encode(linear * exposure).reshape(*shape, side, side, 3), rows, columns, title)


def varied_keys(texts: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Keys and values of texts such as warp.twist_per_cm=2,6: values of TOML, words without quotes taken as texts.

    >>> varied_keys(["warp.twist_per_cm=2,6.5", "warp.hand=Z,S", "shape={form = 'sphere', radius_mm = 3}"])
    {'warp.twist_per_cm': (2, 6.5), 'warp.hand': ('Z', 'S'), 'shape': ({'form': 'sphere', 'radius_mm': 3},)}
    """
    found: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip()
        if not (key and equals and values.strip(" ,")):
            raise InputError(
                f"{text!r:.80} does not say what varies: give KEY=VALUE,VALUE, such as warp.twist_per_cm=2,6"
            )
        if key in found:
            raise InputError(f"{key} varies twice: give all its values at once, {key}=VALUE,VALUE")
        try:
            found[key] = tuple(tomllib.loads(f"values = [{values}]")["values"])
        except tomllib.TOMLDecodeError:
            found[key] = tuple(_word(value.strip()) for value in values.split(","))
    return found


def checked_png(path: str | Path) -> Path:
    """The path; `InputError` unless its name ends in .png."""
    if Path(path).suffix.lower() != ".png":
        raise InputError(f"{path} is no PNG name: a sheet of a recipe is written as NAME.png")
    return Path(path)


def _word(text: str) -> Any:
    """A value of TOML, or else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


class _Boxes:
    """The boxes of varied tables, each built once: they are kept in the cache of this user, or else here."""

    def __init__(self, folder: Path, where: str) -> None:
        self.folder, self.where = folder, where
        self.varied: list[tuple[dict[str, Any], str]] = []
        self.held: dict[int, VolumeBox] = {}

    def add(self, tables: dict[str, Any], name: str) -> None:
        self.varied.append((tables, name))

    def check(self) -> None:
        """`InputError` for the first that its kind of matter refuses, before any is built."""
        for tables, name in self.varied:
            with described(f"{self.where} with {name}"):
                check_recipe(tables, self.folder, "recipe")

    def box(self, number: int, progress: Progress = silent) -> VolumeBox:
        if number in self.held:
            return self.held[number]
        tables, name = self.varied[number]
        progress(0.0, f"building {name}")
        with described(f"{self.where} with {name}"):
            depends_on = ["sheet", tables, content_of_texts(tables, self.folder)]
            box = kept_box(depends_on, lambda: build(tables, folder=self.folder))
        if not cache().used:
            self.held[number] = box
        return box


def _pictures(boxes: _Boxes, camera: Camera, progress: Progress) -> list[Image]:
    """A picture of each box alone."""
    settings, kept, images = Settings(samples=SAMPLES), SceneCache(), []
    lamp = Lamp(to_lamp=TO_KEY, spectrum=Spectrum.named("D65"), name="key")
    for number, (_, name) in enumerate(boxes.varied):
        part = part_of(progress, number / len(boxes.varied), 1.0 / len(boxes.varied), f"rendering {name}")
        scene = Scene(camera, (lamp,), (boxes.box(number),))
        images.append(picture_of_mode("march", scene, settings, kept, part))
    return images


def _split(vary: Mapping[str, Sequence[Any]]) -> list[VariedKey]:
    keys = [VariedKey(tuple(key.split(".")), tuple(values)) for key, values in vary.items()]
    if not keys or not all(key.values for key in keys):
        raise InputError("a contact sheet needs a key that varies, and its values, such as warp.twist_per_cm=2,6")
    several = [key.name for key in keys if len(key.values) > 1]
    if len(several) > 2:
        raise InputError(f"{', '.join(several)} have several values: give several to two keys at most, to others one")
    count = math.prod(len(key.values) for key in keys)
    if count > MOST_CELLS:
        raise InputError(f"the sheet would have {count} cells: give values for {MOST_CELLS} at most")
    return keys


def _known(tables: Mapping[str, Any], keys: Sequence[VariedKey], where: str) -> list[VariedKey]:
    """The keys with their units; `InputError` for those that the recipe does not know, and values it does not take."""
    record, known = kind_of_tables(tables, where).record, []
    for key in keys:
        if key.name == "kind":
            raise InputError("kind cannot vary: it says which keys there are")
        others, meaning = [(one, one.values[0]) for one in keys if one is not key], ""
        for value in key.values:
            meaning = meaning_of_key(_with(tables, [*others, (key, value)]), key.path, record, where)
        known.append(replace(key, unit=unit_of_key(key.path[-1], meaning)))
    return known


def _with(tables: Mapping[str, Any], values: Sequence[tuple[VariedKey, Any]]) -> dict[str, Any]:
    """The tables with values of keys."""
    changed: dict[str, Any] = copy.deepcopy(dict(tables))
    for key, value in values:
        table = changed
        for step in key.path[:-1]:
            table = table.setdefault(step, {})
            if not isinstance(table, dict):
                raise InputError(f"{key.name}: {step} is no table in the recipe, which has no key {key.path[-1]!r}")
        table[key.path[-1]] = copy.deepcopy(value)
    return changed


def _stated(values: Sequence[tuple[VariedKey, Any]]) -> str:
    return ", ".join(key.label(value) for key, value in values)


def _text(value: Any) -> str:
    text = "true" if value is True else "false" if value is False else str(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _after(unit: str) -> str:
    """A unit as it stands after a number: /cm for 1/cm."""
    return unit.removeprefix("1") if unit.startswith("1/") else unit
