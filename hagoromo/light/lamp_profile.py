"""LampProfile: the intensity of a luminaire over the direction, as measured: a table over C and γ (IES, type C).

γ is the angle from the lamp's axis, which points straight down when it is measured; C turns around the axis,
counterclockwise seen from above. Between the values it is linear in both angles. The colour is no part of it: that is
the lamp's spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.ies import MOST_VALUES, read_ies
from hagoromo.files.record import Record, about, decode, like
from hagoromo.light.spectrum import Spectrum, integrate_product

SHORTEST_STEP_DEG = 0.01  # between angles of a table
LARGEST_GAP_DEG = 45.0  # to 360°, of a table around the whole axis that leaves 360° out
LUMENS_PER_WATT = 683.0  # [lm/W] at 555 nm, the definition of the candela


class LampProfileRecord(Record, frozen=True, kw_only=True):
    """The intensity of a lamp over the direction: lateral angles C, vertical angles γ from the axis."""

    lateral: Annotated[tuple[float, ...], about("angles C [°], increasing; their range states the symmetry")]
    vertical: Annotated[tuple[float, ...], about("angles γ from the axis [°], increasing, 0 to 180")]
    intensity: Annotated[
        tuple[tuple[float, ...], ...], about("relative intensity, a row of values over γ for each C; largest: 1")
    ]
    peak_candela: Annotated[float | None, about("luminous intensity of the brightest direction [cd]")] = None
    name: Annotated[str, about("name of the luminaire")] = ""


PROFILE = like(LampProfileRecord, name={"type": "string"})  # what `LampProfile.load` takes


@dataclass(frozen=True, eq=False)
class LampProfile:
    """Relative intensity of a lamp over the direction; 1 where it is brightest.

    lateral: (C,) [°], 0 to 360. vertical: (γ,) [°], within 0…180; no light outside. intensity: (C, γ). peak_candela:
    luminous intensity where it is brightest [cd], None where unknown. Lateral angles that end at 90 or 180, or go from
    90 to 270, state a symmetry, and a single 0 that of rotation: all are unfolded. `InputError` for other ranges,
    angles that do not increase, negative values or none above 0.

    >>> flood = hg.LampProfile(lateral=[0], vertical=[0, 60, 90], intensity=[[300, 150, 0]])
    >>> float(flood.at(lateral=123, vertical=30)), flood.peak_candela
    (0.75, None)
    """

    lateral: NDArray[np.float64]
    vertical: NDArray[np.float64]
    intensity: NDArray[np.float64]
    peak_candela: float | None
    name: str
    keywords: Mapping[str, str]

    def __init__(
        self,
        lateral: ArrayLike,
        vertical: ArrayLike,
        intensity: ArrayLike,
        peak_candela: float | None = None,
        name: str = "",
        keywords: Mapping[str, str] | None = None,
    ) -> None:
        who = f"profile {name!r}" if name else "a lamp's profile"
        c, gamma, values = (_numbers(v, who) for v in (lateral, vertical, intensity))
        _check_table(c, gamma, values, who)
        if peak_candela is not None and not (math.isfinite(peak_candela) and peak_candela > 0.0):
            raise InputError(f"{who}: peak_candela is {peak_candela}: give a number above 0")
        c, values = _unfolded(c, values / values.max(), who)
        if values.size > MOST_VALUES:
            raise InputError(
                f"{who} has {values.size} values around the whole axis, {MOST_VALUES} at most: thin it out"
            )
        for key, array in (("lateral", c), ("vertical", gamma), ("intensity", values)):
            array.flags.writeable = False
            object.__setattr__(self, key, array)
        object.__setattr__(self, "peak_candela", peak_candela)
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "keywords", dict(keywords or {}))

    def __repr__(self) -> str:
        """The name, the size of the table and the peak."""
        peak = "" if self.peak_candela is None else f", peak {self.peak_candela:.4g} cd"
        return f"LampProfile({self.name!r}, {len(self.lateral)} C × {len(self.vertical)} γ{peak})"

    @staticmethod
    def load(source: Any, folder: str | Path | None = None) -> LampProfile:
        """From what a record may hold: the path of an IES file, or a table of lateral, vertical and intensity.

        folder: where the record lies; the path is then relative to it and may not leave it. `InputError` as `read_ies`.
        """
        if isinstance(source, LampProfile):
            return source
        if isinstance(source, Mapping):
            record = decode(source, LampProfileRecord, "profile")
            if len({len(row) for row in record.intensity}) != 1:
                raise InputError("profile: intensity has rows of different lengths: give one value for each γ")
            table = (np.array(part) for part in (record.lateral, record.vertical, record.intensity))
            lateral, vertical, intensity = table
            return LampProfile(lateral, vertical, intensity, record.peak_candela, record.name)
        if isinstance(source, (str, Path)):
            return LampProfile.from_ies(source if folder is None else inside(folder, str(source)))
        raise InputError(f"a profile is an IES file, or lateral, vertical and intensity: given {source!r:.60}")

    @staticmethod
    def from_ies(path: str | Path) -> LampProfile:
        """The profile in an IES file: LM-63 of any year, photometry of type C, TILT=NONE."""
        table = read_ies(path)
        try:
            return LampProfile(
                table.lateral, table.vertical, table.candela, float(table.candela.max()) or None,
                table.keywords.get("LUMINAIRE", "") or Path(path).stem, table.keywords,
            )  # fmt: skip
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    def at(self, lateral: ArrayLike, vertical: ArrayLike) -> NDArray[np.float64]:
        """Relative intensity at angles C and γ [°], broadcast: bilinear, 0 outside the range of γ."""
        c, g = np.broadcast_arrays(np.mod(np.asarray(lateral, np.float64), 360.0), np.asarray(vertical, np.float64))
        i, across = _interval(self.lateral, c)
        j, along = _interval(self.vertical, g)
        low, high = (
            (1.0 - along) * self.intensity[k, j] + along * self.intensity[k, j + 1] for k in (i, i + 1)
        )  # fmt: skip
        covered = (g >= self.vertical[0] - 1e-9) & (g <= self.vertical[-1] + 1e-9)  # rounding of an angle
        return np.where(covered, (1.0 - across) * low + across * high, 0.0)

    def towards(self, direction: ArrayLike, frame: ArrayLike) -> NDArray[np.float64]:
        """Relative intensity (...) in unit directions (..., 3), world; frame: `Lamp.frame` of the lamp."""
        x, y, z = np.moveaxis(np.asarray(direction, np.float64) @ np.asarray(frame, np.float64).T, -1, 0)
        return self.at(np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(np.hypot(x, y), z)))

    def solid_angle(self) -> float:
        """∫ of the relative intensity over all directions [sr]: lumens are peak_candela times it."""
        gamma = np.radians(self.vertical)
        # ∫ (a + b γ) sin γ dγ = [b sin γ − (a + b γ) cos γ]
        slope = np.diff(self.intensity, axis=1) / np.diff(gamma)
        rings = np.diff(np.sin(gamma)) * slope - np.diff(self.intensity * np.cos(gamma), axis=1)
        turn = np.diff(np.radians(self.lateral))
        return float(np.sum(0.5 * (rings[1:] + rings[:-1]).sum(axis=1) * turn))

    def intensity_of(self, spectrum: Spectrum) -> float:
        """The `intensity` by which a lamp of this profile and `spectrum` has the file's candela.

        peak_candela / (683 lm/W ∫ E ȳ dλ), over 360–830 nm. `InputError` where the candela are unknown or E is dark.
        """
        from hagoromo.light.colour import colour_matching

        if self.peak_candela is None:
            raise InputError(f"profile {self.name!r} states no candela: give the intensity of the lamp")
        bright = integrate_product(spectrum, colour_matching()[1])
        if not bright > 0.0:
            raise InputError(f"profile {self.name!r}: its lamp's spectrum has no light that people see: give another")
        return self.peak_candela / (LUMENS_PER_WATT * bright)

    def record(self) -> dict[str, Any]:
        """What `load` reads back; peak_candela only where it is known."""
        table = {key: getattr(self, key).tolist() for key in ("lateral", "vertical", "intensity")}
        peak = {} if self.peak_candela is None else {"peak_candela": self.peak_candela}
        return {"name": self.name, **table, **peak}


def _unfolded(
    lateral: NDArray[np.float64], values: NDArray[np.float64], who: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The table around the whole axis, 0 to 360°, by the symmetry that the range of `lateral` states."""
    first, last = lateral[0], lateral[-1]
    if (first, last) == (0.0, 0.0):
        return np.array([0.0, 360.0]), np.repeat(values, 2, axis=0)
    if (first, last) == (90.0, 270.0):  # mirrored at the plane through 90° and 270°: I(C) = I(180° − C)
        middle = np.union1d(lateral, 180.0)
        values = np.stack([np.interp(middle, lateral, column) for column in values.T], axis=1)
        low, high = middle <= 180.0, middle >= 180.0
        lateral = np.concatenate([180.0 - middle[low][::-1], middle[1:-1], 540.0 - middle[high][::-1]])
        return lateral, np.concatenate([values[low][::-1], values[1:-1], values[high][::-1]])
    if (first, last) == (0.0, 90.0):
        lateral, values = _mirrored(lateral, values)
        last = 180.0
    if (first, last) == (0.0, 180.0):
        return _mirrored(lateral, values)
    if first == 0.0 and 360.0 - LARGEST_GAP_DEG <= last < 360.0:  # many programs leave 360° out
        return np.append(lateral, 360.0), np.concatenate([values, values[:1]])
    if (first, last) == (0.0, 360.0):
        return lateral, values
    raise InputError(f"{who}: lateral angles go from {first:g}° to {last:g}°: give 0, 0–90, 0–180, 90–270 or 0–360")


def _mirrored(
    lateral: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Twice the range: mirrored at the last angle."""
    return (
        np.concatenate([lateral, 2.0 * lateral[-1] - lateral[-2::-1]]), np.concatenate([values, values[-2::-1]])
    )  # fmt: skip


def _interval(knots: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Number of the interval, and the place in it, 0…1."""
    i = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    return i, np.clip((at - knots[i]) / (knots[i + 1] - knots[i]), 0.0, 1.0)


def _check_table(
    lateral: NDArray[np.float64], vertical: NDArray[np.float64], values: NDArray[np.float64], who: str
) -> None:
    if lateral.ndim != 1 or vertical.ndim != 1 or values.shape != (len(lateral), len(vertical)):
        raise InputError(
            f"{who} has {lateral.shape} lateral and {vertical.shape} vertical angles, and values {values.shape}: "
            "give (C,), (γ,) and (C, γ)"
        )
    if len(vertical) < 2 or vertical[0] < 0.0 or vertical[-1] > 180.0:
        raise InputError(f"{who}: give two or more vertical angles within 0° to 180°")
    _check_steps(lateral, f"{who}: lateral angles")
    _check_steps(vertical, f"{who}: vertical angles")
    if (values < 0.0).any() or not values.max() > 0.0:
        raise InputError(f"{who}: intensities must be 0 or more, one of them above 0")


def _check_steps(angles: NDArray[np.float64], what: str) -> None:
    steps = np.diff(angles)
    if (steps < SHORTEST_STEP_DEG).any():
        at = angles[1:][steps < SHORTEST_STEP_DEG][0]
        raise InputError(f"{what} must increase by {SHORTEST_STEP_DEG:g}° or more: they do not at {at:g}°")


def _numbers(values: ArrayLike, who: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{who} must hold numbers: given {values!r:.60}") from error
    if not array.size or not np.isfinite(array).all():
        raise InputError(f"{who} must hold finite numbers")
    return array
