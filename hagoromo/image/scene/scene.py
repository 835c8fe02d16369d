"""Scene: volume boxes, surfaces, lamps and a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.scene.emitter_mesh import emitters_of
from hagoromo.image.scene.moving import MovingScene
from hagoromo.image.scene.surface import RELIEFS, Surface
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.environment import Environment
from hagoromo.light.lamp import Lamp
from hagoromo.light.wide_light import LightPart, WideLight
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo.volume.box import VolumeBox

PLACE_ERROR = 1e-3  # largest error of places in double precision, in voxels or other finest details


@dataclass(frozen=True, eq=False)
class Scene:
    """What is photographed, by which camera, under which lamps.

    area_lamps: lamps with a size. environment: light from all around, where there is any. moving: how camera, boxes
    and surfaces move while the shutter is open, for mode path; None: all stands still.
    Raises `InputError` for a scene without lamps or matter, or a camera that sees nothing.

    >>> camera = hg.Camera(64, 48, (90, 90), (32, 24)).look_at(eye=(0, -1, 0.2), target=(0, 0, 0))
    >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
    >>> scene = hg.Scene(camera, [hg.Lamp(position=(1, -1, 2))], surfaces=[hg.Surface.floor(0.0, 0.3, matte)])
    >>> scene.with_lamps(hg.Lamp(to_lamp=(0, 0, 1)), hg.Lamp(to_lamp=(1, 0, 1))).record()["lamps"][1]["to_lamp"]
    [0.7071067811865475, 0.0, 0.7071067811865475]
    """

    camera: Camera
    lamps: tuple[Lamp, ...]
    boxes: tuple[VolumeBox, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    area_lamps: tuple[AreaLamp, ...] = ()
    environment: Environment | None = None
    moving: MovingScene | None = None

    def __post_init__(self) -> None:
        for key in ("lamps", "boxes", "surfaces", "area_lamps"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        if not self.lights:
            raise InputError("the scene has no lamp: give at least one")
        if not self.boxes and not self.surfaces:
            raise InputError("the scene is empty: give at least one volume box or surface")
        for thing in (*self.boxes, *self.surfaces):
            _check_place(thing)
        if self.moving is not None and self.moving.boxes.shape[1] != len(self.boxes):
            raise InputError(f"{self.moving.boxes.shape[1]} boxes move, and the scene has {len(self.boxes)}: give all")
        for number in self.moving.surfaces if self.moving else ():
            if not 0 <= number < len(self.surfaces):
                raise InputError(f"surface {number} moves, and the scene has {len(self.surfaces)}: count from 0")
            surface = self.surfaces[number]
            if surface.optics == "glass" or surface.emission is not None:
                what = "is glass" if surface.optics else "gives off light"
                raise InputError(
                    f"surface {surface.name!r} {what}, and moves while the shutter is open: leave its keyframes out, "
                    f"or render the mean of pictures at several times (--times 16)"
                )
        if not any(_in_view(self.camera, thing.corners()) for thing in (*self.boxes, *self.surfaces)):
            where = np.round(self.camera.position, 4).tolist()
            raise InputError(f"the camera at {where} m looks at nothing: turn it towards the scene")

    def __repr__(self) -> str:
        """The camera's size, and the numbers of lamps, boxes and surfaces."""
        size = f"{self.camera.width} × {self.camera.height} px"
        counts = f"lamps: {len(self.lamps)}, boxes: {len(self.boxes)}, surfaces: {len(self.surfaces)}"
        return f"Scene(camera of {size}, {counts})"

    def with_camera(self, camera: Camera) -> Scene:
        """The same scene through another camera, which stands still unless it stands where this one does."""
        if self.moving is None or np.array_equal(camera.world_to_camera, self.camera.world_to_camera):
            return replace(self, camera=camera)
        return replace(self, camera=camera, moving=self.moving.seen_by(camera))

    def with_lamps(self, *lamps: Lamp) -> Scene:
        """The same scene under other lamps, and no other light."""
        return self._lit_by(lamps, ())

    def _lit_by(self, lamps: Sequence[Lamp], wide: Sequence[WideLight]) -> Scene:
        """The same scene under lamps and some of its own `wide_lights`."""
        glowing = {light.surface for light in wide}
        return replace(
            self,
            lamps=tuple(lamps),
            area_lamps=tuple(lamp for lamp in self.area_lamps if lamp in wide),
            environment=self.environment if self.environment in wide else None,
            surfaces=tuple(
                surface if surface.emission is None or number in glowing else surface.traced()
                for number, surface in enumerate(self.surfaces)
            ),
        )

    @property
    def wide_lights(self) -> tuple[WideLight, ...]:
        """Lights beside lamps: area lamps, the environment, surfaces that give off light."""
        environment = (self.environment,) if self.environment else ()
        return *self.area_lamps, *environment, *emitters_of(self.surfaces)

    @property
    def has_wide_lights(self) -> bool:
        """Whether there are lights beside lamps."""
        return bool(self.wide_lights)

    @property
    def lights(self) -> tuple[LightPart, ...]:
        """Lamps, then the parts of wide lights, as a palette orders them."""
        return *self.lamps, *(part for light in self.wide_lights for part in light.parts)

    def under(self, numbers: Sequence[int]) -> Scene:
        """The same scene under some of its `lights`, by their numbers; of a light in parts all of them or none."""
        owners = [light for light in self.wide_lights for _ in light.parts]
        first = len(self.lamps)
        wide = [owners[number - first] for number in numbers if number >= first]
        return self._lit_by([self.lamps[number] for number in numbers if number < first], wide)

    def matter_corners(self) -> NDArray[np.float64]:
        """(n, 3) corners of the bounds of the volume boxes, world [m]; of the surfaces where there is no box.

        Beside boxes, surfaces are floors and backgrounds, far larger than what is looked at.
        """
        return np.concatenate([thing.corners() for thing in self.boxes or self.surfaces])

    def show(self, lamps: int | None = None) -> Any:
        """The scene in a notebook, as a picture whose lamp is moved; see `hagoromo.show`."""
        import hagoromo

        return hagoromo.show(self) if lamps is None else hagoromo.show(self, lamps)

    def record(self) -> dict[str, Any]:
        """The scene as plain values, for the metadata of images."""
        return {
            "camera": {
                "name": self.camera.name, "size": [self.camera.width, self.camera.height],
                "focal": list(self.camera.focal), "principal": list(self.camera.principal),
                "distortion": list(self.camera.distortion), "world_to_camera": self.camera.world_to_camera.tolist(),
                "response": self.camera.response.name if self.camera.response else None,
                **_lens_record(self.camera),
            },
            "lamps": [record_from_lamp(lamp) for lamp in self.lamps],
            **({"area_lamps": [lamp.record() for lamp in self.area_lamps]} if self.area_lamps else {}),
            **({"environment": self.environment.record()} if self.environment else {}),
            **({"moving": self.moving.record()} if self.moving else {}),
            "boxes": [
                {
                    "name": box.name, "voxels": list(box.bricks.shape[::-1]), "voxel_size": box.voxel_size,
                    "tau": box.tau, "extinction": box.extinction, "shadow_bias": box.shadow_bias,
                    "pose": box.pose.tolist(),
                    "materials": [m.record() for m in box.materials], "provenance": box.provenance,
                }
                for box in self.boxes
            ],
            "surfaces": [
                {"name": s.name, "shape": s.shape, "pose": s.pose.tolist(), "reflectance": s.reflectance.record()}
                | ({"optics": s.optics} if s.optics else {})
                | ({"absorption": s.absorption.record()} if s.absorption else {})
                | ({"body_texture": s.body_texture.record()} if s.body_texture else {})
                | ({"beta_texture": s.beta_texture.record()} if s.beta_texture else {})
                | ({"gamma_texture": s.gamma_texture.record()} if s.gamma_texture else {})
                | {key: one.record() for key, one in zip(RELIEFS, s.reliefs, strict=True) if one}
                | ({"emission": s.emission.record()} if s.emission else {})
                for s in self.surfaces
            ],
        }  # fmt: skip


def check_no_optics(scene: Scene) -> None:
    """`InputError` for a mirror or glass, which only walks follow."""
    for surface in scene.surfaces:
        if surface.optics:
            raise InputError(
                f"surface {surface.name!r} is {surface.optics}: only mode path follows it: use --mode path"
            )


def check_still(scene: Scene, what: str) -> None:
    """`InputError` for a scene that moves while the shutter is open. what: is asked for, and shows one instant."""
    if scene.moving is not None:
        raise InputError(
            f"the scene moves while the shutter is open, and {what} shows one instant: render by mode path, "
            f"or the mean of pictures at several times (--times 16)"
        )


def check_lamps_outside(scene: Scene) -> None:
    """`InputError` for a lamp inside a volume box, whose light the march does not follow."""
    for number, lamp in enumerate(scene.lamps):
        for box, place in product(scene.boxes, lamp.stands_at):
            if box.contains(place):
                where = ", ".join(f"{x:g}" for x in place)
                raise InputError(
                    f"lamp {lamp.name or number} stands inside the volume box {box.name!r} ({where} m): move it out, "
                    f"or render by mode path"
                )


def _lens_record(camera: Camera) -> dict[str, float | None]:
    """Aperture and focus [m] of a camera that is no pinhole; focus None: infinitely far away."""
    focus = camera.focus if np.isfinite(camera.focus) else None
    return {"aperture": camera.aperture, "focus": focus} if camera.aperture else {}


def _check_place(thing: VolumeBox | Surface) -> None:
    """Raise `InputError` for a box or surface whose details double precision cannot place so far from (0, 0, 0)."""
    away = float(np.abs(thing.corners()).max())
    if not np.spacing(away) <= PLACE_ERROR * thing.finest:
        what, error = "volume box" if isinstance(thing, VolumeBox) else "surface", np.spacing(away)
        raise InputError(
            f"{what} {thing.name!r} stands {away:.3g} m from (0, 0, 0), where numbers are {error:.2g} m apart, and its "
            f"details are {thing.finest:.2g} m: move the scene nearer"
        )


def _in_view(camera: Camera, corners: np.ndarray) -> bool:
    """Whether the convex hull of `corners` (n, 3) may be visible: it is not wholly outside one side of the picture.

    The sides are planes through the camera's centre; a lens with distortion is given a tenth of its width more.
    """
    local = corners @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    margin = 0.1 * camera.width if any(camera.distortion) else 0.0
    (ax, ay), (x0, y0) = camera.focal, camera.principal
    x, y, z = local.T
    sides = (
        z,
        ax * x + (x0 + margin) * z,
        (camera.width + margin - x0) * z - ax * x,
        ay * y + (y0 + margin) * z,
        (camera.height + margin - y0) * z - ay * y,
    )
    return all(bool((side > 0).any()) for side in sides)
