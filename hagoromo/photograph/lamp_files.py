"""Files of lamps: lamps.json of `calibrate lamps`, and the .lp of reflectance transformation imaging (RTI).

An .lp has the number of photographs in its first line and then, for each, its name and the direction to its lamp: x
right, y up, z from the object to the camera. Relight's info.json lists the same directions as `lights`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any

import numpy as np

from hagoromo.errors import InputError, listed
from hagoromo.files.checks import existing_file, read_bytes
from hagoromo.files.record import ForeignRecord, WrittenBy, about, decode, like, read_json
from hagoromo.files.whole import whole_file
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.transforms import LampRecord, lamp_from_record

LP = ".lp"
FITTED = (".rti", ".ptm", ".hsh")  # hold the coefficients of a fit and no lamps
DOUBTFUL_DEG = 3.0  # standard error of a lamp's direction: normals are then about as wrong
NAMES_SHOWN = 3  # of photographs or lamps, in a message


def load_lamps(path: str | Path) -> tuple[Lamp, ...]:
    """The lamps in a lamps.json of `hagoromo calibrate lamps`, an .lp, or an info.json of Relight.

    `InputError` for a file that lists none, or an .lp whose first line states another number than it has.
    """
    suffix = Path(path).suffix.lower()
    if suffix == LP:
        return read_lp(path)
    if suffix in FITTED:
        existing_file(path)
        raise InputError(f"{path} holds a fitted picture and no lamps: give the .lp that it was made with")
    if suffix not in ("", ".json"):
        existing_file(path)
        raise InputError(f"{path} is no list of lamps: give a lamps.json of `hagoromo calibrate lamps`, or an {LP}")
    record = read_json(path)
    if isinstance(record, Mapping) and "lamps" not in record and isinstance(record.get("lights"), list):
        return tuple(_far(light, f"{k + 1}", f"{path} light {k}") for k, light in enumerate(record["lights"]))
    listed = decode({"lamps": record} if isinstance(record, list) else record, LampsRecord, str(path)).lamps
    if not listed:
        raise InputError(f"{path} lists no lamps: give the lamps.json of `hagoromo calibrate lamps`")
    return tuple(lamp_from_record(lamp, Path(path).parent, f"{path} lamp {i}") for i, lamp in enumerate(listed))


def faults_of_lamps(path: str | Path) -> str:
    """What the calibration in a lamps.json says against its lamps: fits that did not converge, directions hardly known.

    "" where it says nothing against them, or is not there, as in an .lp.
    """
    record = read_json(path) if Path(path).suffix.lower() in ("", ".json") else None
    if not isinstance(record, Mapping) or "lamps" not in record:
        return ""
    known = decode(record, LampsRecord, str(path))
    ends = (known.object or {}).get("convergence")
    open_ends = ends.items() if isinstance(ends, Mapping) else ()
    unsettled = [str(name) for name, end in open_ends if isinstance(end, Mapping) and end.get("converged") is False]
    errors = [one.get("standard_error_deg") for one in known.readings]
    worst = max((error for error in errors if isinstance(error, (int, float))), default=0.0)
    said = [f"their fit did not converge ({', '.join(unsettled)})"] if unsettled else []
    said += [f"their directions are doubtful: known to {worst:.2g}° only"] if worst > DOUBTFUL_DEG else []
    return "; ".join(said)


def faces_up(path: str | Path) -> bool:
    """Whether the directions of the file are always x right, y up, z to the camera, as those of an .lp are."""
    if Path(path).suffix.lower() == LP:
        return True
    record = read_json(path)
    return isinstance(record, Mapping) and "lamps" not in record and "lights" in record


def read_lp(path: str | Path) -> tuple[Lamp, ...]:
    """The far lamps of an .lp, each with the name of its photograph (without the folder)."""
    lines = [line.strip() for line in read_bytes(path).decode("utf-8", "replace").splitlines() if line.strip()]
    if not lines or not re.fullmatch(r"\d{1,6}", lines[0]):
        raise InputError(f"{path} must state the number of photographs in its first line: it is {lines[:1]!r:.60}")
    if int(lines[0]) != len(lines) - 1:
        raise InputError(f"{path} states {lines[0]} photographs and lists {len(lines) - 1}: correct its first line")
    lamps = []
    for number, line in enumerate(lines[1:], 2):
        parts = line.rsplit(maxsplit=3)
        try:
            direction = [float(part) for part in parts[1:]]
        except ValueError:
            direction = []
        if len(direction) != 3:
            raise InputError(f"{path} line {number} is {line!r:.60}: it must be a name and x y z")
        lamps.append(_far(direction, PureWindowsPath(parts[0]).name, f"{path} line {number}"))
    return tuple(lamps)


def write_lp(path: str | Path, lamps: Sequence[Lamp], force: bool = False) -> Path:
    """Write far lamps as an .lp, which `read_lp` reads; `InputError` for a near lamp, or one without a name."""
    near = [lamp.name for lamp in lamps if lamp.to_lamp is None]
    if near:
        raise InputError(f"lamp {near[0]!r} is near, and an .lp has directions only: write lamps.json")
    if not all(lamp.name for lamp in lamps):
        raise InputError("a lamp has no name, and an .lp needs that of its photograph: name it")
    rows = [f"{lamp.name} {' '.join(f'{x:.9f}' for x in np.asarray(lamp.to_lamp))}" for lamp in lamps]
    with whole_file(path, force) as partial:
        partial.write_text("\n".join([str(len(rows)), *rows]) + "\n", encoding="utf-8", newline="\n")
    return Path(path)


def lamp_of_each(lamps: Sequence[Lamp], paths: Sequence[Path]) -> tuple[list[Lamp], str]:
    """The lamp of each photograph, and how they were matched: by name where the names match, else in order.

    `InputError` where the numbers differ, or only some of the names match.
    """
    by_stem = {Path(lamp.name).stem.lower(): lamp for lamp in lamps if lamp.name}
    stems = [path.stem.lower() for path in paths]
    lacking = [path.name for path, stem in zip(paths, stems, strict=True) if stem not in by_stem]
    spare = [lamp.name for lamp in lamps if Path(lamp.name).stem.lower() not in set(stems)]
    if len(lamps) != len(paths):
        named = lacking if len(paths) > len(lamps) else spare
        which = (
            f" ({listed(named, NAMES_SHOWN)} without its match)"
            if by_stem and 0 < len(named) < max(len(lamps), len(paths))
            else ""
        )
        raise InputError(f"{len(paths)} photographs and {len(lamps)} lamps{which}: give one photograph per lamp")
    if not lacking and len(by_stem) == len(set(stems)) == len(paths):
        return [by_stem[stem] for stem in stems], "by name"
    if 0 < len(lacking) < len(paths):
        raise InputError(
            f"no lamp has the name of {listed(lacking, NAMES_SHOWN)}, and no photograph that of "
            f"{listed(spare, NAMES_SHOWN)}: correct the names, or leave these photographs and lamps out"
        )
    return list(lamps), "in order, because their names are not those of the photographs"


def _far(direction: Any, name: str, where: str) -> Lamp:
    try:
        vector = np.asarray(direction, np.float64)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.linalg.norm(vector) > 0.0:
        raise InputError(f"{where} has the direction {direction!r:.40}: it must be x y z, not all 0")
    return Lamp(to_lamp=tuple(vector), name=name)


class LampsRecord(ForeignRecord, frozen=True, kw_only=True):
    """lamps.json, as `calibrate lamps` writes it; other programs may write `lamps` only."""

    version_key = "hagoromo.format_version"
    takes_null = True

    lamps: Annotated[list[Annotated[dict[str, Any], like(LampRecord)]], about("the lamps, as a capture lists them")]
    ball: Annotated[dict[str, Any] | None, about("the first chrome ball: centre and radius in the image [px]")] = None
    balls: Annotated[list[dict[str, Any]], about("all chrome balls [px]")] = []
    spread: Annotated[dict[str, Any] | None, about("how well directions determine normals; null: not at all")] = None
    object: Annotated[dict[str, Any] | None, about("the object that took the place of a ball")] = None
    readings: Annotated[
        list[dict[str, Any]], about("each lamp with its standard errors [°], [m], and where its intensity comes from")
    ] = []
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()
