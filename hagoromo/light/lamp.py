"""Lamp: where light comes from, and its spectrum. Near lamps have a position, far lamps a direction."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.directions import turned_z_to
from hagoromo.errors import InputError
from hagoromo.light.beams import beam_of
from hagoromo.light.beams.beam import Beam, BeamKeys, frame_about
from hagoromo.light.lamp_profile import LampProfile
from hagoromo.light.other_programs import GltfLight, MitsubaPlugin, UsdLight, at
from hagoromo.light.spectrum import Spectrum, checked_spectrum

WIDEST_BEAM = 89.0  # [°] of a spot of Mitsuba
WIDEST_CONE = 89.94  # [°] of one of glTF
POINT = 0.005  # [m] radius by which programs of USD show a lamp without size
DOWN = np.array([0.0, 0.0, -1.0])  # world: the axis of a lamp with a profile that states none


@dataclass(frozen=True, eq=False)
class Lamp:
    """A point lamp (`position`) or a far lamp (`to_lamp`): exactly one of the two is given.

    position: (3,) [m], world. to_lamp: (3,) direction from the scene towards the lamp, world, made unit.
    intensity: of a point lamp, irradiance × m² [W/sr times the unit of `spectrum`]; of a far lamp, the irradiance that
    it gives on a plane that faces it; one number, or one per sensor channel.
    spectrum: relative spectrum of the light. axis: (3,) where a point lamp shines brightest, world, made unit, and
    axis_power: μ of its fall-off max(cosθ, 0)^μ, θ the angle from there (1: a bare LED); without an axis it shines
    alike all around. profile: measured intensity over the direction, in place of axis_power: intensity is then that of
    the brightest direction, axis the direction of γ = 0 (default: straight down), and roll [rad] turns C = 0 about it,
    see `frame`.
    `InputError` when the numbers make no lamp.

    >>> to_lamp, irradiance = hg.Lamp(position=(0, 0, 2), intensity=8).direction_and_irradiance([0, 0, 0])
    >>> to_lamp.tolist(), float(irradiance)  # 8 W/sr at 2 m: 2 W/m²
    ([0.0, 0.0, 1.0], 2.0)
    >>> spot = hg.Lamp(position=(0, 0, 2), intensity=8, axis=(0, 0, -1), axis_power=2)
    >>> round(float(spot.relative_intensity([0.6, 0, -0.8])), 4)  # cos² of 36.9°
    0.64
    """

    position: NDArray[np.float64] | None
    to_lamp: NDArray[np.float64] | None
    intensity: float | tuple[float, ...]
    spectrum: Spectrum
    name: str
    axis: NDArray[np.float64] | None
    axis_power: float
    profile: LampProfile | None
    roll: float

    def __init__(
        self,
        position: ArrayLike | None = None,
        to_lamp: ArrayLike | None = None,
        intensity: ArrayLike = 1.0,
        spectrum: Spectrum | None = None,
        name: str = "",
        axis: ArrayLike | None = None,
        axis_power: float = 1.0,
        profile: LampProfile | None = None,
        roll: float = 0.0,
    ) -> None:
        if (position is None) == (to_lamp is None):
            raise InputError(f"lamp {name!r}: give either position (a near lamp) or to_lamp (a far one)")
        at = None if position is None else _vector(position, f"lamp {name!r}: position")
        towards = None if to_lamp is None else _unit(to_lamp, f"lamp {name!r}: to_lamp", "towards the lamp")
        if profile is not None and axis is None:
            axis = DOWN
        along = None if axis is None else _unit(axis, f"lamp {name!r}: axis", "of its light")
        if axis is not None and position is None:
            what = "axis" if profile is None else "profile"
            raise InputError(f"lamp {name!r}: a far lamp has no {what}: leave it out, or give the position")
        if not (np.isfinite(axis_power) and axis_power >= 0.0):
            raise InputError(f"lamp {name!r}: axis_power {axis_power!r:.60} must be finite and not negative")
        if profile is not None and axis_power != 1.0:
            raise InputError(f"lamp {name!r}: its profile says how light falls off: leave axis_power out")
        if not np.isfinite(roll) or (roll != 0.0 and profile is None):
            raise InputError(f"lamp {name!r}: roll {roll!r:.60} turns a profile: give a finite number, or leave it out")
        object.__setattr__(self, "position", at)
        object.__setattr__(self, "to_lamp", towards)
        object.__setattr__(self, "intensity", _intensity(intensity, name))
        object.__setattr__(
            self,
            "spectrum",
            Spectrum.constant(1.0) if spectrum is None else checked_spectrum(spectrum, f"lamp {name!r}: spectrum"),
        )
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "axis", along)
        object.__setattr__(self, "axis_power", float(axis_power))
        object.__setattr__(self, "profile", profile)
        object.__setattr__(self, "roll", float(roll))

    def __repr__(self) -> str:
        """The name, where the light comes from, how strong it is, and its axis."""
        place = ", ".join(f"{x:.4g}" for x in self.place)
        where = f"{self.place_key} ({place})" + (" m" if self.near else "")
        axis = "" if self.axis is None else f", axis ({', '.join(f'{x:.4g}' for x in self.axis)})"
        profile = "" if self.profile is None else f", profile {self.profile.name!r}"
        return f"Lamp({self.name!r}, {where}, intensity {self.intensity}{axis}{profile})"

    @property
    def near(self) -> bool:
        """Whether it has a position."""
        return self.position is not None

    @property
    def place_key(self) -> str:
        """The key of files that says where its light comes from: position or to_lamp."""
        return "to_lamp" if self.position is None else "position"

    @property
    def place(self) -> NDArray[np.float64]:
        """(3,) its position [m], or the direction towards it, world."""
        place = self.to_lamp if self.position is None else self.position
        assert place is not None
        return place

    @property
    def stands_at(self) -> NDArray[np.float64]:
        """(n, 3) places where it stands [m], world: none of a far lamp."""
        return np.empty((0, 3)) if self.position is None else self.position[None]

    @cached_property
    def beam(self) -> Beam:
        """How a near lamp shines in its directions, see `hagoromo.light.beams`."""
        return beam_of(BeamKeys(self.axis, self.axis_power, self.profile, self.roll))

    @property
    def frame(self) -> NDArray[np.float64]:
        """(3, 3): directions of C = 0, of C = 90° and of γ = 0 of the profile, as rows, world.

        Of a lamp that points straight down they are +x, +y and −z. Another axis turns them the shortest way; straight
        up, about x. Then C = 0 is put where C = roll was. `InputError` for a lamp without an axis.
        """
        if self.axis is None:
            raise InputError(f"lamp {self.name!r} has no axis: give one")
        return frame_about(self.axis, self.roll)

    def relative_intensity(self, directions: ArrayLike) -> NDArray[np.float64]:
        """Intensity in the unit `directions` (..., 3) away from a point lamp, relative to the brightest: (...)."""
        return self.beam.relative_intensity(np.asarray(directions, np.float64))

    def direction_and_irradiance(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit directions to the lamp (..., 3) and irradiance facing the lamp at `points` (..., 3) [m].

        E = intensity · relative intensity / d² for a point lamp, intensity for a far one; shape (...), or (...,
        channel) when the intensity has one number per channel. A point at the lamp itself has no direction: NaN, and
        E = inf.
        """
        points = np.asarray(points, dtype=np.float64)
        intensity = np.asarray(self.intensity)
        if self.position is None:
            to_lamp = np.broadcast_to(np.asarray(self.to_lamp), points.shape).copy()
            return to_lamp, np.broadcast_to(intensity, points.shape[:-1] + intensity.shape).copy()
        offset = self.position - points
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_lamp, falloff = offset / distance, 1.0 / distance**2
            if self.axis is not None:
                falloff = falloff * self.relative_intensity(-to_lamp)[..., None]
            return to_lamp, intensity * (falloff if intensity.ndim else falloff[..., 0])

    def shifted(self, by: ArrayLike) -> Lamp:
        """The lamp with `by` (3,) added to its position [m], or to its direction [rad]."""
        position = None if self.position is None else self.position + np.asarray(by)
        to_lamp = None if self.to_lamp is None else self.to_lamp + np.asarray(by)
        return replace(self, position=position, to_lamp=to_lamp)

    def moved(self, by: ArrayLike) -> Lamp:
        """The lamp with `by` (3,) added to its position [m]; a far one as it is."""
        return self if self.position is None else replace(self, position=self.position + np.asarray(by))

    def turned_record(self, turn: NDArray[np.float64], middle: NDArray[np.float64]) -> dict[str, Any]:
        """The keys that change when it is turned by a rotation (3, 3) about `middle` (3,) [m], as plain values."""
        if self.position is None:
            return {self.place_key: (turn @ self.place).tolist()}
        return {self.place_key: (turn @ (self.place - middle) + middle).tolist(), **self.beam.turned_record(turn)}

    def mitsuba(self) -> tuple[MitsubaPlugin, list[str]]:
        """A directional, point or spot emitter."""
        light, lost = self.spectrum * float(np.mean(self.intensity)), self._lost_channels()
        if self.position is None:
            return MitsubaPlugin("emitter", "directional", {"direction": -self.place, "irradiance": light}), lost
        if self.beam.axis is None:
            return MitsubaPlugin("emitter", "point", {"position": self.position, "intensity": light}), lost
        cone = self.beam.cone()
        if cone is None:
            lost = [f"lamp {self.name!r}: its fall-off or profile; here it falls linearly, as a spot", *lost]
        begins, ends = cone or self.beam.nearest_cone(WIDEST_BEAM)
        place = {"to_world": at(self.position, turned_z_to(self.beam.axis))}
        return MitsubaPlugin("emitter", "spot", {
            **place, "intensity": light, "cutoff_angle": ends, "beam_width": begins,
        }), lost  # fmt: skip

    def gltf(self) -> tuple[GltfLight, list[str]]:
        """A directional, point or spot light."""
        strength, lost, axis = float(np.mean(self.intensity)), self._lost_channels(), self.beam.axis
        if self.position is None:
            return GltfLight("directional", at(np.zeros(3), turned_z_to(self.place)), self.spectrum, strength), lost
        if axis is None:
            return GltfLight("point", at(self.position), self.spectrum, strength), lost
        if self.beam.focus is None:
            lost = [f"lamp {self.name!r}: its profile; here it is a spot, half as bright at the same angle", *lost]
        begins, ends = np.radians(self.beam.nearest_cone(WIDEST_CONE)).tolist()
        place = at(self.position, turned_z_to(-axis))
        return GltfLight("spot", place, self.spectrum, strength, (begins, ends)), lost

    def usd(self) -> tuple[UsdLight, list[str]]:
        """Far: lux of a lamp without size. Near: a sphere as a point, of 4 I by its area."""
        strength, lost, axis = float(np.mean(self.intensity)), self._lost_channels(), self.beam.axis
        if self.position is None:
            place = at(np.zeros(3), turned_z_to(self.place))
            return UsdLight("DistantLight", place, self.spectrum, strength, {"angle": 0.0}), lost
        if axis is not None and self.beam.focus is None:
            lost = [f"lamp {self.name!r}: its profile; it shines alike all around", *lost]
        place = at(self.position, None if axis is None else turned_z_to(-axis))
        inputs = {"radius": POINT, "normalize": True}
        return UsdLight("SphereLight", place, self.spectrum, 4.0 * strength, inputs, True, self.beam.focus), lost

    def _lost_channels(self) -> list[str]:
        """What all formats lose of a lamp with an intensity per channel."""
        by_channel = isinstance(self.intensity, tuple)
        return [f"lamp {self.name!r}: its intensity by channel, of which the mean stands"] if by_channel else []


def by_place(lamps: Sequence[Lamp]) -> list[list[int]]:
    """Numbers of the lamps, those together that stand at one place and shine alike in their directions."""
    places: dict[Hashable, list[int]] = {}
    for number, lamp in enumerate(lamps):
        places.setdefault((lamp.near, lamp.place.tobytes(), lamp.beam.key), []).append(number)
    return list(places.values())


def common_spectrum(lamps: Sequence[Lamp]) -> Spectrum | None:
    """The one spectrum of all lamps, but for a factor; None where they differ, or one has an intensity by channel."""
    if not lamps or any(isinstance(lamp.intensity, tuple) for lamp in lamps):
        return None
    first = lamps[0].spectrum
    return first if all(lamp.spectrum.equals(first, up_to_factor=True) for lamp in lamps) else None


def stated_spectrum(lamps: Sequence[Lamp]) -> Spectrum | None:
    """As `common_spectrum`; None also where nobody stated it: a lamp of unknown spectrum is given a constant."""
    common = common_spectrum(lamps)
    unstated = common is None or common.equals(Spectrum.constant(1.0), up_to_factor=True)
    return None if unstated else common


def _intensity(value: ArrayLike, name: str) -> float | tuple[float, ...]:
    intensity = np.asarray(value, dtype=np.float64)
    if intensity.ndim > 1 or not np.isfinite(intensity).all() or (intensity < 0).any():
        raise InputError(f"lamp {name!r}: intensity {value!r:.60} must be finite and not negative")
    return tuple(intensity.tolist()) if intensity.ndim else float(intensity)


def _unit(values: ArrayLike, what: str, way: str) -> NDArray[np.float64]:
    direction = _vector(values, what)
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(direction))
    if length == 0.0:
        raise InputError(f"{what} is (0, 0, 0): give the direction {way}")
    if not np.isfinite(length):
        raise InputError(f"{what} is longer than numbers go: give the direction {way} in smaller numbers")
    return _vector(direction / length, what)


def _vector(values: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} must be three numbers: given {values!r:.60}") from error
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{what} must be three finite numbers: given {array.tolist()!r:.60}")
    array.flags.writeable = False
    return array
