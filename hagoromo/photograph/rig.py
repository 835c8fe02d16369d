"""Rig: how strong each lamp of a fixed set-up is beside the others, and how its light falls off over the picture.

    E_kc(p) = E stated · e_kc · exp(a_k · p),   p = (x − w/2, y − h/2) / (w/2)

Measured once on an object or a flat card (`calibrate_rig`), it holds for everything that stands in its place under the
same lamps. What all lamps have in common is no part of it: the product of the e of all lamps is 1. Lamps are found
again by where they stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, structs, to_builtins
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.record import ForeignRecord, Record, Vector, WrittenBy, about, decode, read_json, save_json
from hagoromo.files.record import written_by as written
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Array = NDArray[np.float64]
SAME_ANGLE = np.radians(3.0)  # between readings of one far lamp: two chrome balls differ by 1°
SAME_PLACE = 0.05  # between readings of one near lamp, over its distance from the world's origin
SAME_SHAPE = 0.01  # relative, of pictures of one view
MOST_LAMPS = 100_000
Strength = Annotated[float, Meta(gt=0, le=1e6)]
Slope = Annotated[float, Meta(ge=-20, le=20)]  # its exponential times a value is a number in pictures of usual shapes


class RigLampRecord(Record, frozen=True, kw_only=True):
    """One lamp of rig.json."""

    name: Annotated[str, about("name of the lamp")] = ""
    to_lamp: Annotated[Vector | None, about("stated direction of a far lamp, world")] = None
    position: Annotated[Vector | None, about("stated position of a near lamp, world [m]")] = None
    strength: Annotated[
        tuple[Strength, ...], Meta(min_length=1, max_length=1000), about("in the middle of the picture, per channel")
    ]
    slope: Annotated[
        tuple[Slope, Slope], about("change of ln irradiance by x and y, over half of the picture's width")
    ] = (0.0, 0.0)
    turn: Annotated[Vector, about("to be added to the direction of a far lamp [rad]")] = (0.0, 0.0, 0.0)
    covariance: Annotated[
        tuple[Vector, Vector, Vector], about("of the errors of ln strength and of the slope by x and y")
    ] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    turn_error: Annotated[float, about("standard error of each number of turn [rad]")] = 0.0


class RigRecord(ForeignRecord, frozen=True, kw_only=True):
    """rig.json: the lamps of a fixed set-up beside one another."""

    size: Annotated[tuple[Annotated[int, Meta(ge=1)], Annotated[int, Meta(ge=1)]], about("of the picture [px]")]
    lamps: Annotated[list[RigLampRecord], Meta(min_length=1, max_length=MOST_LAMPS), about("the lamps")]
    sources: Annotated[list[str], about("captures that it was measured on")] = []
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """size: width and height [px] of the pictures that it was measured in; other sizes of the same view do as well."""

    size: tuple[int, int]
    lamps: tuple[RigLampRecord, ...]
    sources: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The number of lamps, and how far their strengths differ."""
        strength = np.array([np.mean(lamp.strength) for lamp in self.lamps])
        return f"Rig({len(self.lamps)} lamps, relative strengths {strength.min():.3f} to {strength.max():.3f})"

    @staticmethod
    def load(path: str | Path) -> Rig:
        """The rig in a rig.json; `InputError` for another file."""
        record = decode(read_json(path), RigRecord, str(path))
        for number, lamp in enumerate(record.lamps):
            if (lamp.to_lamp is None) == (lamp.position is None):
                raise InputError(f"{path} lamp {number} needs to_lamp (a far lamp) or position (a near one): give one")
            if len(lamp.strength) != len(record.lamps[0].strength):
                raise InputError(f"{path} lamp {number} has another number of channels than the first: make them alike")
        return Rig(record.size, tuple(record.lamps), tuple(record.sources))

    def record(self) -> dict[str, Any]:
        """The content of rig.json."""
        lamps = [{key: value for key, value in to_builtins(lamp).items() if value is not None} for lamp in self.lamps]
        return {"hagoromo": written(), "size": list(self.size), "sources": list(self.sources), "lamps": lamps}

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write rig.json; `InputError` where it exists without `force`."""
        return save_json(path, self.record(), force)

    def lamp_of(self, lamp: Lamp) -> RigLampRecord:
        """The lamp of the rig that stands where `lamp` does; of several the one of its name, else the nearest.

        `InputError` where none stands there.
        """
        apart = [_apart(lamp, one) for one in self.lamps]
        near = [(gap, one) for gap, one in zip(apart, self.lamps, strict=True) if gap <= 1.0]
        if not near:
            raise InputError(
                f"the rig has no lamp where lamp {lamp.name!r} stands: calibrate it with all lamps, or leave this "
                "photograph out"
            )
        named = [pair for pair in near if lamp.name and pair[1].name == lamp.name]
        return min(named or near, key=lambda pair: pair[0])[1]

    def place(self, shape: tuple[int, int]) -> Array:
        """(h, w, 2) p of the pixels of a picture; `InputError` for the shape (h, w) of another view."""
        height, width = shape
        if abs(width * self.size[1] / (height * self.size[0]) - 1.0) > SAME_SHAPE:
            raise InputError(
                f"the rig was measured in pictures of {self.size[0]} × {self.size[1]} px, these have {width} × "
                f"{height} px: it holds for the view of its own pictures"
            )
        rows, columns = np.mgrid[:height, :width] + 0.5
        return np.stack([columns - width / 2, rows - height / 2], axis=2) / (width / 2)

    def field(self, photograph: Photograph) -> NDArray[np.float32]:
        """(h, w, C) irradiance by the lamp of `photograph` over what is stated of it.

        `InputError` for a photograph under several lamps, of another view, or of another number of channels.
        """
        if len(photograph.lamps) != 1:
            raise InputError(
                f"photograph {photograph.name!r} has {len(photograph.lamps)} lamps: a rig needs one in each"
            )
        lamp, channels = self.lamp_of(photograph.lamps[0]), photograph.values.shape[2]
        if len(lamp.strength) not in (1, channels):
            raise InputError(
                f"the rig has {len(lamp.strength)} channels, the photographs {channels}: calibrate it anew"
            )
        falloff = np.exp(self.place(photograph.values.shape[:2]) @ np.array(lamp.slope))
        return (falloff[..., None] * np.broadcast_to(lamp.strength, channels)).astype(np.float32)

    def corrected(self, photograph: Photograph) -> Photograph:
        """The photograph as it is, with a far lamp where the rig has it."""
        lamps = tuple(
            lamp.shifted(self.lamp_of(lamp).turn) if lamp.position is None else lamp for lamp in photograph.lamps
        )
        return replace(photograph, lamps=lamps)

    def evened(self, photograph: Photograph) -> Photograph:
        """The photograph as an even lamp of mean strength would give it."""
        field = self.field(photograph)
        return replace(
            self.corrected(photograph), values=photograph.values / field, variance=photograph.variance / field**2
        )

    def evened_capture(self, capture: Capture) -> Capture:
        """The capture with all its photographs evened."""
        return replace(capture, photographs=tuple(self.evened(one) for one in capture.photographs))

    def strengths_at(self, lamps: Sequence[Lamp], place: Array) -> Array:
        """(K,) ln of the mean channel's irradiance of `lamps` at p = `place` (2,), over what is stated of them."""
        own = [self.lamp_of(lamp) for lamp in lamps]
        return np.array([np.mean(np.log(one.strength)) + np.dot(one.slope, place) for one in own])

    def weakened(self, share: float, place: Array) -> Rig:
        """The rig with `share` of the differences in strength that it has at p = `place` (2,); slopes stay."""
        lamps = []
        for lamp in self.lamps:
            at = np.mean(np.log(lamp.strength)) + np.dot(lamp.slope, place)
            factor = float(np.exp((share - 1.0) * at))
            strength = tuple(float(factor * one) for one in lamp.strength)
            lamps.append(structs.replace(lamp, strength=strength))
        return replace(self, lamps=tuple(lamps))


def as_rows(matrix: Array) -> tuple[Vector, Vector, Vector]:
    """A (3, 3) matrix as `RigLampRecord.covariance`."""
    first, second, third = ((float(a), float(b), float(c)) for a, b, c in matrix)
    return first, second, third


def _apart(lamp: Lamp, other: RigLampRecord) -> float:
    """How far two lamps are from one another, in what is allowed; infinity for a near and a far one."""
    if lamp.position is not None and other.position is not None:
        gap = float(np.linalg.norm(lamp.position - np.array(other.position)))
        return gap / (SAME_PLACE * max(float(np.linalg.norm(lamp.position)), 1e-12))
    if lamp.to_lamp is not None and other.to_lamp is not None:
        towards = np.array(other.to_lamp) / max(float(np.linalg.norm(other.to_lamp)), 1e-12)
        return float(np.arccos(np.clip(lamp.to_lamp @ towards, -1.0, 1.0)) / SAME_ANGLE)
    return np.inf
