"""The lamps of photographs of many views: a flash on the camera, lamps that move with it, or lamps fixed in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum

CAMERA = "camera"
Lit = dict[str, tuple[Lamp, ...]]


@dataclass(frozen=True)
class ViewLight:
    """Where the light of photographs of many views comes from; without all three it is fixed and unknown.

    flash: (right, down, forward) of a flash from the camera [m]. lamps: in a camera's axes (x right, y down, z forward)
    [m]. fixed_to: "camera": the lamps move with it, or, which is the same, the object turns before them; or the name of
    the photograph in whose camera's axes they are, where they are fixed in space. intensity, spectrum: of a flash.
    """

    flash: tuple[float, float, float] | None = None
    lamps: Sequence[Lamp] = ()
    fixed_to: str = CAMERA
    intensity: float | tuple[float, ...] = 1.0
    spectrum: Spectrum | None = None

    def __post_init__(self) -> None:
        """Check what goes together."""
        if self.flash is not None and self.lamps:
            raise InputError("the light is a flash (--lamp flash) or comes from lamps of a file (--lamps): give one")
        if self.flash is not None and not np.isfinite(self.flash).all():
            raise InputError(f"the flash is at {self.flash} m from the camera: give three finite numbers")
        profiled = next((lamp for lamp in self.lamps if lamp.profile is not None), None)
        if profiled is not None:
            raise InputError(f"lamp {profiled.name!r} has a profile, which is not turned with the views: leave it out")

    @property
    def needs_scale(self) -> bool:
        """Whether it states lengths in metres."""
        return any(self.flash or ()) or any(lamp.near for lamp in self.lamps)

    def of(self, views: Mapping[str, Camera]) -> tuple[Lit, str]:
        """The lamps of each photograph in the world's axes, and what is said about them."""
        if self.flash is not None:
            lit: Lit = {name: (self._flash(camera),) for name, camera in views.items()}
            where = ", ".join(f"{x:g}" for x in self.flash)
            return lit, f"a flash on the camera, {where} m to the right, down and forward of it"
        if not self.lamps:
            return dict.fromkeys(
                views, ()
            ), "unknown and fixed: the light that the object sends out stands for its colour"
        if self.fixed_to == CAMERA:
            each = {name: [_turned(lamp, camera) for lamp in self.lamps] for name, camera in views.items()}
            said = "that move with the camera, or the object turned before them"
        else:
            named = {key: name for name in views for key in (name, Path(name).stem)}
            if self.fixed_to not in named:
                raise InputError(
                    f"lamps are fixed to {self.fixed_to!r:.60} (--lamps-fixed-to), which is no photograph that could "
                    f"be placed: give {CAMERA}, or the name of one"
                )
            still = [_turned(lamp, views[named[self.fixed_to]]) for lamp in self.lamps]
            each, said = dict.fromkeys(views, still), f"fixed in space, in the axes of the camera of {self.fixed_to}"
        number = {Path(lamp.name).stem.lower(): k for k, lamp in enumerate(self.lamps) if lamp.name}
        own = [number.get(Path(name).stem.lower()) for name in views]
        if len(set(own)) == len(views) and None not in own:
            lit = {name: (each[name][k],) for name, k in zip(views, own, strict=True) if k is not None}
            return lit, f"{len(self.lamps)} {said}; each photograph has the one of its name"
        return {name: tuple(each[name]) for name in views}, f"{len(self.lamps)} {said}; all are on in each photograph"

    def _flash(self, camera: Camera) -> Lamp:
        return Lamp(
            _place(np.array(self.flash), camera), intensity=self.intensity, spectrum=self.spectrum, name="flash"
        )


def _place(offset: NDArray[np.floating], camera: Camera) -> NDArray[np.float64]:
    """(3,) the place in the world of an offset (right, down, forward) from a camera."""
    return camera.position + camera.world_to_camera[:3, :3].T @ offset


def _turned(lamp: Lamp, camera: Camera) -> Lamp:
    """A lamp in the axes of a camera, in the world's."""
    back = camera.world_to_camera[:3, :3].T
    axis = None if lamp.axis is None else back @ lamp.axis
    return Lamp(
        _place(lamp.place, camera) if lamp.near else None,
        None if lamp.near else back @ lamp.place,
        lamp.intensity,
        lamp.spectrum,
        lamp.name,
        axis,
        lamp.axis_power,
    )
