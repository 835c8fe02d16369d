"""Lamp: where light comes from, and its spectrum. Near lamps have a position, far lamps a direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum


@dataclass(frozen=True, eq=False)
class Lamp:
    """A point lamp (`position`) or a far lamp (`to_lamp`): exactly one of the two is given.

    position: (3,) [m], world. to_lamp: (3,) direction from the scene towards the lamp, world, made unit.
    intensity: of a point lamp, irradiance × m² [W/sr times the unit of `spectrum`]; of a far lamp, the irradiance that
    it gives on a plane that faces it; one number, or one per sensor channel.
    spectrum: relative spectrum of the light. `InputError` when the numbers make no lamp.
    """

    position: NDArray[np.float64] | None
    to_lamp: NDArray[np.float64] | None
    intensity: float | tuple[float, ...]
    spectrum: Spectrum
    name: str

    def __init__(
        self,
        position: ArrayLike | None = None,
        to_lamp: ArrayLike | None = None,
        intensity: ArrayLike = 1.0,
        spectrum: Spectrum | None = None,
        name: str = "",
    ) -> None:
        if (position is None) == (to_lamp is None):
            raise InputError(f"lamp {name!r}: give either position (a near lamp) or to_lamp (a far one)")
        at = None if position is None else _vector(position, f"lamp {name!r}: position")
        towards = None if to_lamp is None else _unit(_vector(to_lamp, f"lamp {name!r}: to_lamp"), name)
        object.__setattr__(self, "position", at)
        object.__setattr__(self, "to_lamp", towards)
        object.__setattr__(self, "intensity", _intensity(intensity, name))
        object.__setattr__(self, "spectrum", Spectrum.constant(1.0) if spectrum is None else spectrum)
        object.__setattr__(self, "name", name)

    def direction_and_irradiance(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit directions to the lamp (..., 3) and irradiance facing the lamp at `points` (..., 3) [m].

        E = intensity / d² for a point lamp, E = intensity for a far one; shape (...), or (..., channel) when the
        intensity has one number per channel. A point at the lamp itself has no direction: NaN, and E = inf.
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
            return to_lamp, intensity * (falloff if intensity.ndim else falloff[..., 0])


def _intensity(value: ArrayLike, name: str) -> float | tuple[float, ...]:
    intensity = np.asarray(value, dtype=np.float64)
    if intensity.ndim > 1 or not np.isfinite(intensity).all() or (intensity < 0).any():
        raise InputError(f"lamp {name!r}: intensity {value!r:.60} must be finite and not negative")
    return tuple(intensity.tolist()) if intensity.ndim else float(intensity)


def _unit(direction: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        raise InputError(f"lamp {name!r}: to_lamp is (0, 0, 0): give the direction towards the lamp")
    return _vector(direction / length, f"lamp {name!r}: to_lamp")


def _vector(values: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} must be three numbers: given {values!r:.60}") from error
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{what} must be three finite numbers: given {array.tolist()!r:.60}")
    array.flags.writeable = False
    return array
