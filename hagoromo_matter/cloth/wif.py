"""WIF: drafts in the weavers' exchange format (Weaving Information File 1.1), read as data, with every key checked.

Threading, tie-up and treadling or a lift plan make the draft; colours, spacing and thickness of the yarns are read
where a file states them. Other sections and keys are ignored.
"""

from __future__ import annotations

import configparser
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo_matter.cloth.draft import LARGEST_DRAFT, Draft, smallest_repeat
from hagoromo_matter.cloth.weave import LINEN, Woven
from hagoromo_matter.cloth.yarn import Yarn

MOST_BYTES = 1 << 24
GROWTH = 100.0  # memory of the keys of a file, in its sizes
MOST_SHAFTS = 4096  # a jacquard loom has one for every end of a repeat
UNITS = {"centimeters": 10.0, "inches": 25.4, "decipoints": 25.4 / 720.0}  # mm
Section = dict[str, str]


class Threads(NamedTuple):
    """Warp or weft of a file: colour of every thread (R, G, B, 0…1), distance and thickness [mm], or None each."""

    colours: tuple[tuple[float, ...], ...] | None
    spacing_mm: float | None
    thickness_mm: float | None


class Wif(NamedTuple):
    """The cloth that a file describes."""

    draft: Draft
    warp: Threads
    weft: Threads


def read_wif(path: str | Path) -> Wif:
    """The cloth in a WIF file. Raises `InputError`, naming section and key, for what is missing, wrong or too large."""
    source = sized_file(path, MOST_BYTES, "a WIF file")
    file = WifFile(path, read_bytes(source, GROWTH).decode("utf-8", "replace"))
    ends, picks = (file.whole(section, "threads", None, LARGEST_DRAFT) for section in ("warp", "weft"))
    if ends * picks > LARGEST_DRAFT:
        raise InputError(
            f"{path}: {ends} ends and {picks} picks are more than {LARGEST_DRAFT} crossings: give one repeat"
        )
    shafts = file.whole("weaving", "shafts", None, MOST_SHAFTS)
    threading = file.marks("threading", ends, shafts)
    if "liftplan" in file.sections:
        lifted = file.marks("liftplan", picks, shafts)
    else:
        treadles = file.whole("weaving", "treadles", None, MOST_SHAFTS)
        tie_up = file.marks("tieup", treadles, shafts)
        lifted = file.marks("treadling", picks, treadles).astype(np.float32) @ tie_up.astype(np.float32) > 0
    up = lifted.astype(np.float32) @ threading.T.astype(np.float32) > 0
    if not file.flag("weaving", "rising shed", True):
        up = ~up
    try:
        draft = Draft(up)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return Wif(draft, file.threads("warp", ends), file.threads("weft", picks))


def cloth_of(wif: Wif, warp: Yarn, weft: Yarn) -> tuple[Woven, tuple[tuple[float, ...], ...]]:
    """The cloth of a file, of yarns like `warp` and `weft`, and its colours (R, G, B, 0…1), numbered from 0.

    Spacing and thickness are those of the file where it states them, otherwise those of LINEN and of the yarns.
    """
    palette: list[tuple[float, ...]] = []
    sets = []
    for threads, yarn, usual in ((wif.warp, warp, LINEN.warp_per_cm), (wif.weft, weft, LINEN.weft_per_cm)):
        colours = threads.colours or ((1.0, 1.0, 1.0),)
        palette += [colour for colour in dict.fromkeys(colours) if colour not in palette]
        numbers = np.array([palette.index(colour) for colour in colours])
        repeat = tuple(numbers[: smallest_repeat(numbers)].tolist())
        per_cm = 10.0 / threads.spacing_mm if threads.spacing_mm else usual
        sets.append((per_cm, yarn._replace(diameter_mm=threads.thickness_mm or yarn.diameter_mm), repeat))
    (ends, warp, first), (picks, weft, second) = sets
    cloth = Woven(wif.draft.smallest(), ends, picks, warp, weft, warp_colours=first, weft_colours=second)
    return cloth, tuple(palette)


class WifFile:
    """The sections of a file, names and keys in lower case, and the checks that values pass."""

    def __init__(self, path: str | Path, text: str) -> None:
        reader = configparser.RawConfigParser(
            strict=False, delimiters=("=",), comment_prefixes=(";",), inline_comment_prefixes=(";",),
            allow_no_value=True, default_section="\0",
        )  # fmt: skip
        try:
            reader.read_string(text.lstrip("\ufeff"))
        except (configparser.Error, AttributeError) as error:  # a line that continues a key without a value
            said = str(error).splitlines()[0] if isinstance(error, configparser.Error) else "a line is indented"
            raise InputError(f"{path} is not a valid WIF file: {said}") from error
        self.path = path
        self.sections = {name.strip().lower(): dict(reader.items(name)) for name in reader.sections()}

    def whole(self, section: str, key: str, default: int | None, most: int) -> int:
        """A whole number from 1 to `most`."""
        return self._whole(section, key, self._text(section, key, None if default is None else str(default)), most)

    def flag(self, section: str, key: str, default: bool) -> bool:
        """A boolean, in the spellings of the format."""
        text = self._text(section, key, "true" if default else "false").lower()
        if text not in ("true", "on", "yes", "1", "false", "off", "no", "0"):
            raise self._wrong(section, key, text, "true or false")
        return text in ("true", "on", "yes", "1")

    def marks(self, section: str, rows: int, columns: int) -> np.ndarray:
        """Lists of numbers as marks: (rows, columns) bool; a row that the file does not list has none."""
        marks = np.zeros((rows, columns), bool)
        for key, text in self._section(section).items():
            row = self._whole(section, key, key, rows) - 1
            for part in (text or "").split(","):
                if part.strip() not in ("", "0"):
                    marks[row, self._whole(section, key, part.strip(), columns) - 1] = True
        return marks

    def threads(self, section: str, count: int) -> Threads:
        """Colours, distance and thickness of the threads of `warp` or `weft`."""
        unit = UNITS.get(self._text(section, "units", "centimeters").lower())
        if unit is None:
            raise self._wrong(section, "units", self._text(section, "units", ""), f"one of {', '.join(UNITS)}")
        spacing, thickness = (self._length(section, key, unit) for key in ("spacing", "thickness"))
        return Threads(self._colours(section, count), spacing, thickness)

    def _colours(self, section: str, count: int) -> tuple[tuple[float, ...], ...] | None:
        if "color table" not in self.sections or not (
            "color" in self.sections[section] or f"{section} colors" in self.sections
        ):
            return None
        low, high = self._numbers("color palette", "range", "0,255", 2)
        if not low < high:
            raise self._wrong("color palette", "range", f"{low:g},{high:g}", "a low and a higher number")
        number = self._text(section, "color", "1").split(",")[0].strip()  # later numbers repeat the entry as R, G, B
        names = [str(self._whole(section, "color", number, MOST_BYTES))] * count
        for key, text in self.sections.get(f"{section} colors", {}).items():
            row = self._whole(f"{section} colors", key, key, count) - 1
            names[row] = str(self._whole(f"{section} colors", key, text or "", MOST_BYTES))
        table = {name: self._numbers("color table", name, None, 3) for name in set(names)}
        return tuple(tuple(min(max((x - low) / (high - low), 0.0), 1.0) for x in table[name]) for name in names)

    def _length(self, section: str, key: str, unit: float) -> float | None:
        if key not in self.sections[section]:
            return None
        (length,) = self._numbers(section, key, None, 1)
        if length < 0:
            raise self._wrong(section, key, f"{length:g}", "a length above 0")
        return length * unit or None  # some programs write 0 for unknown values

    def _numbers(self, section: str, key: str, default: str | None, count: int) -> list[float]:
        text = self._text(section, key, default)
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            raise self._wrong(section, key, text, f"{count} number{'s' * (count > 1)}")
        return values

    def _whole(self, section: str, key: str, text: str, most: int) -> int:
        if not re.fullmatch(r"[0-9]{1,9}", text) or not 1 <= int(text) <= most:
            raise self._wrong(section, key, text, f"a whole number from 1 to {most}")
        return int(text)

    def _text(self, section: str, key: str, default: str | None) -> str:
        table = self.sections.get(section, {}) if default is not None else self._section(section)
        if table.get(key) is None and default is None:
            raise InputError(f"{self.path} [{section.upper()}] lacks the key {key!r}: add it")
        return (table.get(key) or default or "").strip()

    def _section(self, section: str) -> Section:
        if section not in self.sections:
            raise InputError(f"{self.path} lacks the section [{section.upper()}]: add it")
        return self.sections[section]

    def _wrong(self, section: str, key: str, text: str, wanted: str) -> InputError:
        return InputError(f"{self.path} [{section.upper()}] {key}: given {text[:40]!r}, give {wanted}")
