"""Scenes by which backends are compared: together they take every kind of kernel there is.

Boxes with shadow maps and with marched shadows, boxes of recipes that the backend itself fills, a lattice of texels,
surfaces that Mitsuba traces, mirrors and glass; light of the first order and of all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from march import EYE, MATTER, TAU, VOXELS, reference_lamps
from orders_scenes import cloth, smoke
from peers_scene import noisy_voxels
from shells import FUZZY, MIDDLE, camera, lamps

import hagoromo as hg
from hagoromo.image.scene.modes import Mode, Shadows

RECIPES = Path(__file__).parents[1] / "examples" / "recipes"
SMALLER = {  # recipes of minutes, made smaller; extinction as light of all orders needs it
    "skin": {"size_mm": 10.0},
    "hair": {"hairs": 8000, "length_mm": 60.0, "locks": 120, "voxel_mm": 1.2},
    "linen": {"width_mm": 6.0, "height_mm": 6.0, "extinction": "projected"},
}
FINE = 4  # halvings of the triangles of an icosahedron
SETTLED = 2e-3  # `field.solve.RESIDUAL`: sweeps end once the light changes by less
WALKS = 64  # a pixel


@dataclass(frozen=True)
class BackendCase:
    """A scene, how it is rendered, and what two backends may differ by, root mean square over root mean square.

    mode: of `hg.render`, or "gradient" for `hg.full_gradient`. bound: None where pictures have noise, see `agree`.
    """

    make: Callable[[int], hg.Scene]
    mode: Mode | Literal["gradient"] = "march"
    shadows: Shadows = "map"
    samples: int = 1
    bound: float | None = 1e-3

    def settings(self, seed: int = 0) -> hg.Settings:
        """Pictures with noise have another seed on every backend. Full is compared without the walks that mend it."""
        walks = 0 if self.mode == "full" else None
        return hg.Settings(self.samples, self.shadows, seed=seed if self.bound is None else 0, walks=walks)


def shell(voxels: int) -> hg.Scene:
    """Fuzzy matter alone."""
    return hg.Scene(camera(64), lamps(3), (FUZZY.box(voxels),))


def shell_and_ball(voxels: int) -> hg.Scene:
    """Beside a ball, on a floor: exact shapes."""
    ball = hg.Surface.sphere(tuple(MIDDLE + np.array([0.15, -0.5, 0.1])), 0.15, matte(0.8))
    return hg.Scene(camera(64), lamps(3), (FUZZY.box(voxels),), (ball, hg.Surface.floor(-0.1, 3.0, matte(0.8))))


def shell_and_mesh(voxels: int) -> hg.Scene:
    """Beside a smooth mesh of triangles whose vertices have colours."""
    ball = coloured_ball(MIDDLE + np.array([0.15, -0.5, 0.1]), 0.15)
    return hg.Scene(camera(64), lamps(3), (FUZZY.box(voxels),), (ball,))


def of_recipe(name: str) -> Callable[[int], hg.Scene]:
    """Matter of a recipe of `examples`, from before and above, under two lamps."""

    def scene(_voxels: int) -> hg.Scene:
        box = hg.build({**hg.read_toml(RECIPES / f"{name}.toml"), **SMALLER[name]})
        low, high = box.corners().min(axis=0), box.corners().max(axis=0)
        middle, size = (low + high) / 2, float((high - low).max())
        eye = middle + np.array([0.0, -0.6, 2.0]) * size
        seen = hg.Camera(64, 64, (120.0, 120.0), (32.0, 32.0)).look_at(eye, middle)
        places = middle + size * np.array([(2.0, -1.0, 3.0), (-3.0, 1.0, 2.0)])
        return hg.Scene(seen, tuple(hg.Lamp(position=place, intensity=size**2) for place in places), (box,))

    return scene


def reference_ball(_voxels: int) -> hg.Scene:
    """The noisy ball of `march.py`."""
    voxels, pose = noisy_voxels(), np.eye(4)
    pose[:3, 3] = -1.0
    box = hg.VolumeBox.from_arrays(voxels[..., 0], voxels[..., 1:], 2 / VOXELS, TAU, [MATTER], pose=pose)
    seen = hg.Camera(64, 64, (80.0, 80.0), (32.0, 32.0)).look_at(EYE, (0, 0, 0), (0, 1, 0))
    return hg.Scene(seen, reference_lamps(0.0), (box,))


def thin_smoke(_voxels: int) -> hg.Scene:
    """The smoke of `orders.py`."""
    return smoke().scene(64)


def weave(_voxels: int) -> hg.Scene:
    """The dense white cloth of `orders.py`."""
    return cloth().scene(64)


def weave_on_floor(_voxels: int) -> hg.Scene:
    """The same above a red floor, which both light each other."""
    alone = weave(0)
    floor = hg.Surface.floor(-0.6, 2.0, matte(hg.Spectrum([400.0, 700.0], [0.1, 0.9])))
    return hg.Scene(alone.camera, alone.lamps, alone.boxes, (floor,))


def room(_voxels: int) -> hg.Scene:
    """Glass, a mirror and a mesh on a floor under a lamp of a size and a sky."""
    clear, grey = hg.Reflectance(0.25, 0.3, 0.2, 1.5, hg.Spectrum.constant(1.0)), matte(0.6)
    sky = np.linspace(0.2, 1.0, 8, dtype=np.float32)[:, None, None] * np.ones((1, 16, 3), np.float32)
    surfaces = (
        hg.Surface(clear, "sphere", pose=placed((-0.35, 0.0, 0.25), 0.25), optics="glass"),
        hg.Surface(clear, "sphere", pose=placed((0.35, 0.2, 0.25), 0.25), optics="mirror"),
        coloured_ball(np.array([0.0, -0.35, 0.15]), 0.15),
        hg.Surface.floor(0.0, 2.0, grey),
    )
    lamp = hg.AreaLamp(position=(0.5, -0.8, 1.5), radius=0.2, radiance=8.0)
    seen = hg.Camera(64, 64, (110.0, 110.0), (32.0, 32.0)).look_at((0.0, -2.0, 1.0), (0.0, 0.0, 0.2))
    return hg.Scene(seen, (), surfaces=surfaces, area_lamps=(lamp,), environment=hg.Environment(sky))


CASES: dict[str, BackendCase] = {
    "reference ball": BackendCase(reference_ball),
    "shell": BackendCase(shell),
    "shell, marched shadows": BackendCase(shell, shadows="march"),
    "shell and ball": BackendCase(shell_and_ball),
    "shell and mesh": BackendCase(shell_and_mesh),
    "skin": BackendCase(of_recipe("skin")),
    "hair": BackendCase(of_recipe("hair")),
    "linen": BackendCase(of_recipe("linen")),
    "smoke, path": BackendCase(thin_smoke, "path", samples=WALKS, bound=None),
    "weave, path": BackendCase(weave, "path", samples=WALKS, bound=None),
    "weave on floor, path": BackendCase(weave_on_floor, "path", samples=WALKS, bound=None),
    "linen, path": BackendCase(of_recipe("linen"), "path", samples=WALKS, bound=None),
    "room, path": BackendCase(room, "path", samples=WALKS, bound=None),
    "smoke, full": BackendCase(thin_smoke, "full", bound=SETTLED),
    "weave, full": BackendCase(weave, "full", bound=SETTLED),
    "weave on floor, full": BackendCase(weave_on_floor, "full", bound=SETTLED),
    "linen, full": BackendCase(of_recipe("linen"), "full", bound=SETTLED),
    "weave, gradient": BackendCase(weave, "gradient", bound=2 * SETTLED),
}


def sized(scene: hg.Scene, lines: int, aspect: float) -> hg.Scene:
    """The scene with a camera of another number of lines, `aspect` times as wide, with the same height of view."""
    first = scene.camera
    focal, width = first.focal[1] * lines / first.height, round(lines * aspect)
    pose = first.world_to_camera
    return scene.with_camera(hg.Camera(width, lines, (focal, focal), (width / 2, lines / 2), world_to_camera=pose))


def matte(colour: Any) -> hg.Reflectance:
    """A surface with a little gloss; colour: a Spectrum, or its value everywhere."""
    body = colour if isinstance(colour, hg.Spectrum) else hg.Spectrum.constant(colour)
    return hg.Reflectance(0.25, 0.1, 0.2, 1.5, body)


def coloured_ball(middle: np.ndarray, radius: float) -> hg.Surface:
    """A ball of triangles whose colour goes from blue to red along x."""
    import trimesh

    ball = trimesh.creation.icosphere(FINE)
    red = 0.1 + 0.4 * (np.asarray(ball.vertices)[:, :1] + 1.0)
    texture = hg.SurfaceTexture(np.concatenate([red, 0.3 + 0.0 * red, 1.0 - red], axis=1), of="vertices")
    return hg.Surface(
        matte(1.0), "mesh", np.asarray(ball.vertices), np.asarray(ball.faces), placed(middle, radius),
        body_texture=texture,
    )  # fmt: skip


def placed(middle: Any, radius: float) -> np.ndarray:
    """The pose of a unit ball."""
    pose = np.diag([radius, radius, radius, 1.0])
    pose[:3, 3] = middle
    return pose
