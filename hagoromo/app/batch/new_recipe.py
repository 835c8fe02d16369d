"""New recipe: a commented batch file for the objects in the folders of a shelf, for people to change.

An object is a folder with a capture (transforms.json), or with photographs: their lamps are listed in a file there or
beside the folders, or are read off a chrome ball. Objects that need other options have steps of their own.
"""

from __future__ import annotations

import glob
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_folder
from hagoromo.files.toml_text import toml_value
from hagoromo.files.whole import replaceable_file, whole_file
from hagoromo.photograph.capture import TRANSFORMS
from hagoromo.photograph.photograph_folder import (
    JPEGS,
    LAMPS,
    as_counted,
    files_in,
    lamp_lists_among,
    photographs_among,
    suffix_of,
    visible,
)

RECIPE = "batch.toml"
FEWEST = 4  # photographs under one lamp each that a shape needs

BALL = "taken for photographs of a chrome ball"
CALIBRATE = ": hagoromo calibrate lamps {name}/* --mask auto --out " + LAMPS + ", here, gives the objects its lamps"
HEAD = """\
# What is done with each of {count}. In the folder of this file,
#
#     hagoromo batch {recipe} --out results --dry-run
#
# says what would be done, and without --dry-run it is done: the pages to look at are results/pages/*.html. A second run
# does what changed or failed, and no more. Lines that begin with # are no part of the recipe: remove the # to use one.
# `hagoromo COMMAND --help` explains the options of a command; they stand here without --.
"""
CAPTURE = """\

# {path}, a folder of photographs → captures/{name}: developed, with lamps, camera and mask.
[[step]]
name = "captured{mark}"
verb = "capture"
arguments = ["{path}"]
out = "captures/{name}"
{each}[step.options]
{lamps}
mask = "auto"  # the object is found in the photographs; or your own, white on the object, as in "{path}/mask.png"
{transfer}
# camera = "camera.json"  # of `hagoromo calibrate camera`; without it: the focal length in the files
# response = "response.csv"  # of `hagoromo calibrate response`
"""
MEASURE = """\

# {captured}, a capture → measured/{name}: materials, normals, shape, their errors and a report.
[[step]]
name = "measured{mark}"
verb = "measure"
arguments = ["{captured}"]
out = "measured/{name}"
{each}[step.options]
# distance = 0.6  # [m] from the camera to the object: under near lamps, and for lengths in metres
# n = 1.5  # refractive index, where you know it
# rig = "rig.json"  # of `hagoromo calibrate rig`

# A page to send round: pages/{name}.html.
[[step]]
name = "page{mark}"
verb = "publish"
arguments = ["{measured}"]
out = "pages/{name}.html"
options = { capture = "{captured}", title = "{name}" }
"""


class ObjectSteps(NamedTuple):
    """What the steps of some objects have in common. lamps: the file that lists them; "": read off a chrome ball."""

    captured: bool
    lamps: str = ""
    jpeg: bool = False

    @property
    def said(self) -> str:
        """Where the lamps come from."""
        return f"in {self.lamps.removeprefix('{path}/')}" if self.lamps else "on a chrome ball in them"


class Shelf(NamedTuple):
    """Folders of objects by their steps, and for each folder that is none the reason."""

    objects: dict[ObjectSteps, list[str]]
    left_out: dict[str, str]


def new_recipe(folder: Path, force: bool = False) -> tuple[Path, Shelf]:
    """Write a recipe for the objects in the folders of `folder`; where it is, and which they are.

    `InputError` for a folder without objects, or with a recipe unless force.
    """
    out = existing_folder(folder) / RECIPE
    replaceable_file(out, force)
    shelf = shelf_of(folder)
    with whole_file(out, force) as partial:
        partial.write_text(recipe_text(shelf), encoding="utf-8", newline="\n")
    return out, shelf


def shelf_of(folder: Path) -> Shelf:
    """The objects in the folders of `folder`; `InputError` where there is none."""
    beside = files_in(folder)
    listed = lamp_lists_among(beside)
    objects: dict[ObjectSteps, list[str]] = {}
    left_out: dict[str, str] = {}
    for home in sorted((one for one in visible(folder) if one.is_dir()), key=lambda one: as_counted(one.name)):
        found = _steps_of(home, listed)
        if isinstance(found, ObjectSteps):
            objects.setdefault(found, []).append(home.name)
        else:
            left_out[home.name] = found
    _without_balls(objects, left_out)
    if not objects:
        itself = ": it is one object itself, give the folder that it is in" if photographs_among(beside) else ""
        said = "; ".join(f"{name}: {reason}" for name, reason in list(left_out.items())[:3])
        raise InputError(
            f"{folder} has no folder with a capture or photographs{itself or (f' ({said})' if said else '')}"
        )
    return Shelf(objects, left_out)


def _without_balls(objects: dict[ObjectSteps, list[str]], left_out: dict[str, str]) -> None:
    """Leave out photographs of a chrome ball by itself, by the name of their folder, where objects lack lamps."""
    for steps in [one for one in objects if not one.captured and one.lamps in ("", LAMPS)]:
        balls = [name for name in objects[steps] if "ball" in name.lower()]
        others = [name for name in objects[steps] if name not in balls]
        if balls and others:
            objects[steps] = others
            for name in balls:
                left_out[name] = BALL + ("" if steps.lamps else CALIBRATE.format(name=shlex.quote(name)))


def _steps_of(home: Path, beside: Sequence[str]) -> ObjectSteps | str:
    """The steps of an object in the folder `home`, or why there is none. beside: lists of lamps above it."""
    names = files_in(home)
    if not _plain(home.name):
        return "its name has { or }, a line's end or letters that are not Unicode: rename it"
    if TRANSFORMS in names:
        return ObjectSteps(captured=True)
    photographs = photographs_among(names)
    if len(photographs) < FEWEST:
        return f"{len(photographs) or 'no'} photographs: a shape needs {FEWEST} or more"
    jpeg = suffix_of(photographs[0]) in JPEGS
    for lists, place in ((lamp_lists_among(names), "{path}/"), (beside, "")):
        if len(lists) > 1:
            return f"{' and '.join(lists[:2])} {'in it' if place else 'beside it'} list lamps: keep one of them there"
        if lists and not _plain(lists[0]):
            return f"the name of {lists[0]} has {{ or }}: rename it"
        if lists:
            return ObjectSteps(False, f"{place}{lists[0]}", jpeg)
    return ObjectSteps(False, "", jpeg)


def _plain(name: str) -> bool:
    """Whether a recipe can name it: braces stand for placeholders there."""
    return name.isprintable() and not set("{}") & set(name)


def recipe_text(shelf: Shelf) -> str:
    """The recipe, with its comments."""
    groups = sorted(shelf.objects.items(), key=lambda group: -len(group[1]))
    several = len(groups) > 1
    count = sum(map(len, shelf.objects.values()))
    text = _filled(HEAD, count=f"{count} objects" if count > 1 else "one object", recipe=RECIPE)
    if not several:
        text += '\n# The objects: folders beside this file, or patterns such as "vase*". Remove a line, or add one.\n'
        text += _each(groups[0][1])
    for number, (steps, names) in enumerate(groups, 1):
        mark = f"_{number}" if number > 1 else ""
        text += "".join(_steps_text(steps, mark, _each(names) if several else ""))
    return text


def _steps_text(steps: ObjectSteps, mark: str, each: str) -> Iterator[str]:
    """The steps of some objects. mark: the end of their names; each: which objects, where others have other steps."""
    if not steps.captured:
        lamps = f"lamps = {toml_value(steps.lamps)}  # the direction to the lamp of each photograph"
        ball = 'ball = "auto"  # lamps are read off a chrome ball in the photographs; or lamps = "dome.lp"'
        linear = '# transfer = "srgb"  # of files of 8 bits; those of more bits and RAW files are linear'
        transfer = 'transfer = "srgb"  # what the numbers of most JPEG files mean; "estimate": found by the shading'
        yield _filled(
            CAPTURE, mark=mark, each=each, lamps=lamps if steps.lamps else ball,
            transfer=transfer if steps.jpeg else linear,
        )  # fmt: skip
    captured = "{path}" if steps.captured else f"{{captured{mark}}}"
    yield _filled(
        MEASURE, mark=mark, captured=captured, measured=f"{{measured{mark}}}", each=each if steps.captured else "",
    )  # fmt: skip


def _each(names: Sequence[str]) -> str:
    return "each = [\n" + "".join(f"  {toml_value(glob.escape(name))},\n" for name in names) + "]\n"


def _filled(text: str, **values: str) -> str:
    """The text with {NAME} replaced for each of the values; other braces stay, as placeholders of the recipe."""
    for name, value in values.items():
        text = text.replace(f"{{{name}}}", value)
    return text
