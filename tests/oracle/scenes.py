"""Scenes whose light the oracle knows: small boxes of every kind of matter, under far, near and grazing lamps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from tests.oracle.lattice import Array, OracleVoxels
from tests.oracle.radiance import camera_rays, radiance

PIXELS, FEW = 20, 13  # a side of a picture, and of one that takes the oracle long
SIDE = 0.24  # of most boxes [m]
WAVELENGTHS = np.array([450.0, 550.0, 650.0])  # [nm], at which radiances are compared
GREY = hg.Spectrum.constant(1.0)
RED = hg.Spectrum((380, 500, 600, 780), (0.1, 0.15, 0.7, 0.8))
BLUE = hg.Spectrum((380, 480, 560, 780), (0.7, 0.6, 0.2, 0.1))
DAY = hg.Spectrum((380, 560, 780), (0.8, 1.0, 0.9))
BULB = hg.Spectrum((380, 780), (0.2, 1.4))
SHINY = hg.Reflectance(0.25, 0.3, 0.25, 1.5, RED)
MATTE = hg.Reflectance(0.3, 0.0, 0.2, 1.5, GREY)
GRAINS = hg.Reflectance(0.25, 0.3, 0.3, 1.4, BLUE, element="sphere")
MATTE_GRAINS = hg.Reflectance(0.3, 0.0, 0.3, 1.5, GREY, element="sphere")
DARK_GRAINS = hg.Reflectance(0.03, 0.0, 0.3, 1.5, GREY, element="sphere")
THREADS = hg.Reflectance(0.25, 0.3, 0.3, 1.5, RED, element="cylinder")


TAILED = hg.Reflectance(0.2, 0.25, 0.15, 1.6, RED, BLUE, nu=1.2)


@dataclass(frozen=True, repr=False)
class OracleCase:
    """A scene, and the rays to compare: those of its camera's pixels, or given ones (an orthographic camera's)."""

    name: str
    boxes: list[OracleVoxels]
    scene: hg.Scene
    rays: tuple[Array, Array]
    by_camera: bool = True

    def truth(self) -> tuple[Array, Array]:
        """Radiance of the rays at WAVELENGTHS, (rays, wavelengths), and their transmittance (rays,)."""
        return radiance(self.boxes, self.scene.lamps, self.rays, WAVELENGTHS)

    def seen(self, settings: hg.Settings) -> NDArray[np.float64]:
        """What the march sees, as absolute radiance at WAVELENGTHS: (rays, wavelengths)."""
        if self.by_camera:
            image = hg.render(self.scene, settings)
            weights, palette = image.weights.reshape(-1, image.weights.shape[-1]), image.palette
        else:
            march = hg.RayMarch(self.scene, settings)
            weights, palette = march(*self.rays).weights, march.palette
        spectra = [lamp.at(WAVELENGTHS) * body.at(WAVELENGTHS) for lamp in palette.lamps for body in palette.colours]
        return weights.astype(np.float64) @ np.array(spectra)


def cases() -> list[OracleCase]:
    """All scenes."""
    return [
        _case("Gaussian ball", [gaussian_ball()], [DAYLIGHT]),
        _case("Gaussian ball of grains", [gaussian_ball(matter=GRAINS)], [DAYLIGHT]),
        _case("hard ball", [hard_ball()], [DAYLIGHT]),
        _case("hard ball, two lamps", [hard_ball()], [DAYLIGHT, hg.Lamp(position=(-0.5, -0.4, 0.5), spectrum=BULB)]),
        *(_case(f"noisy slab of depth {depth:g}", [noisy_slab(depth)], [DAYLIGHT]) for depth in (10.0, 50.0, 100.0)),
        _case("thin cloud of grains", [cloud(1.0)], [DAYLIGHT]),
        _case("cloud of grains, depth 10", [cloud(10.0)], [DAYLIGHT]),
        _case("two equal boxes in one place", [half_dense(), half_dense()], [DAYLIGHT]),
        _case("two boxes that overlap", [gaussian_ball(), cloud(6.0, (0.05, -0.04, 0.03), 30.0)], [DAYLIGHT], FEW),
        _case("threads", [threads()], [DAYLIGHT]),
        _case("threads, projected area", [threads(count=21, extinction="projected")], [DAYLIGHT], FEW),
        _case("ball of flakes", [flakes()], [DAYLIGHT], FEW),
        _case("tailed facets under a spot", [hard_ball(matter=TAILED)], [SPOT]),
        _case("lamp close to a box", [gaussian_ball(8.0)], [hg.Lamp(position=(0.06, -0.16, 0.1), intensity=0.05)]),
        _case("two materials, colour of voxels", [coloured_block()], [DAYLIGHT, LOW_LAMP], FEW),
        _case("patches of two materials", [patches()], [DAYLIGHT]),
        _orthographic("turned ball, parallel rays", [hard_ball(20.0, 35.0)], [DAYLIGHT]),
        *(_case(f"block, {each:g} depths a voxel", [block(each)], [DAYLIGHT]) for each in (0.5, 1.0, 4.0)),
        _case("block, 1 depth a voxel, lamp at 5°", [block(1.0)], [lamp_above_face(5.0)]),
        _case("soft face, 1 depth a voxel, lamp at 5°", [block(1.0, margin=2)], [lamp_above_face(5.0)]),
    ]


def lamp_above_face(degrees: float, spectrum: hg.Spectrum = DAY) -> hg.Lamp:
    """A far lamp `degrees` above a face whose normal is +z."""
    angle = math.radians(degrees)
    return hg.Lamp(to_lamp=(0.8 * math.cos(angle), -0.6 * math.cos(angle), math.sin(angle)), spectrum=spectrum)


SPOT = hg.Lamp(position=(0.5, -0.5, 0.6), axis=(-0.5, 0.6, -0.6), axis_power=40.0, spectrum=BULB)
DAYLIGHT = hg.Lamp(to_lamp=(0.5, -0.6, 0.7), intensity=2.0, spectrum=DAY)
LOW_LAMP = hg.Lamp(position=(-0.6, -0.9, 0.4), intensity=1.5, spectrum=BULB)


def centres(shape: tuple[int, int, int], side: float = SIDE) -> list[Array]:
    """x, y, z [m] of voxel centres about the middle of a box whose longest edge is `side`: arrays (z, y, x)."""
    axes = [(np.arange(n) + 0.5 - 0.5 * n) * side / max(shape) for n in shape]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    return [x, y, z]


def box_of(
    density: Array,
    axis: Array | tuple[float, ...],
    depth_per_voxel: float,
    matter: hg.Reflectance | list[hg.Reflectance],
    middle: tuple[float, float, float] = (0.0, 0.0, 0.0),
    degrees: float = 0.0,
    **fields: Any,
) -> OracleVoxels:
    """A box about `middle` [m], turned about (1, 2, 3), its longest edge SIDE; depth_per_voxel: at density 1."""
    axis = np.broadcast_to(np.asarray(axis, float), (*density.shape, 3))
    voxel, pose = SIDE / max(density.shape), np.eye(4)
    pose[:3, :3] = turned(degrees)
    pose[:3, 3] = np.asarray(middle) - pose[:3, :3] @ (0.5 * voxel * np.array(density.shape[::-1]))
    materials = matter if isinstance(matter, list) else [matter]
    return OracleVoxels(density, axis, voxel, depth_per_voxel / voxel, tuple(materials), pose, **fields)


def turned(degrees: float) -> Array:
    """Rotation about (1, 2, 3), by Rodrigues' formula."""
    x, y, z = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def outwards(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Distance from the middle, and unit vectors away from it (z, y, x, 3)."""
    offset = np.stack([x, y, z], axis=-1)
    radius = np.linalg.norm(offset, axis=-1)
    return radius, offset / np.maximum(radius, 1e-9)[..., None]


def gaussian_ball(depth: float = 3.0, matter: hg.Reflectance = SHINY, count: int = 29) -> OracleVoxels:
    """exp(−r²/2s²), s = 4 cm; `depth` through the middle."""
    radius, normal = outwards(*centres((count, count, count)))
    per_voxel = depth / (math.sqrt(2.0 * math.pi) * 0.04 / (SIDE / count))
    return box_of(np.exp(-0.5 * (radius / 0.04) ** 2), normal, per_voxel, matter)


def flakes(count: int = 13) -> OracleVoxels:
    """A soft ball of flakes that lean this way and that; extinction by their projected area."""
    x, y, z = centres((count, count, count))
    axis = np.stack([np.sin(30.0 * y) + 0.3, np.cos(25.0 * z) - 0.8, 1.0 + np.sin(20.0 * x)], axis=-1)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    density = np.exp(-0.5 * (x * x + y * y + z * z) / 0.05**2)
    return box_of(density, axis, 1.0, SHINY, extinction="projected")


def hard_ball(
    depth: float = 20.0, degrees: float = 0.0, matter: hg.Reflectance = SHINY, count: int = 29
) -> OracleVoxels:
    """Density 1 within 9 cm, else 0; `depth` through the middle."""
    radius, normal = outwards(*centres((count, count, count)))
    return box_of((radius < 0.09).astype(float), normal, depth / (0.18 / (SIDE / count)), matter, degrees=degrees)


def noisy_slab(depth: float, seed: int = 3) -> OracleVoxels:
    """A plate of noise with hard faces, `depth` from top to bottom."""
    shape = (11, 23, 23)
    return box_of(np.random.default_rng(seed).uniform(0.5, 1.5, shape), (0.0, 0.0, 1.0), depth / shape[0], SHINY)


def cloud(depth: float, middle: tuple[float, float, float] = (0.0, 0.0, 0.0), degrees: float = 0.0) -> OracleVoxels:
    """A soft lopsided ball of noise, of grains."""
    count = 23
    x, y, z = centres((count, count, count))
    ball = np.clip((0.1 - np.sqrt(x * x + y * y + z * z)) / 0.05, 0.0, 1.0) * (1.0 + 4.0 * x)
    noise = np.random.default_rng(1).uniform(0.3, 1.7, ball.shape)
    return box_of(ball * noise, (0.0, 0.0, 1.0), depth / (0.15 / SIDE * count), GRAINS, middle, degrees)


def half_dense() -> OracleVoxels:
    """A full box, 0.6 optical depths a voxel."""
    return box_of(np.ones((13, 17, 19)), (0.0, -0.6, 0.8), 0.6, MATTE)


def threads(count: int = 31, **fields: Any) -> OracleVoxels:
    """Ten layers of soft threads, across each other in turn, of cylinders along them; tangents of either sign."""
    x, y, z = centres((count, count, count))
    pitch = SIDE / 5.0
    layer = np.floor(z / (0.5 * pitch)).astype(int)
    along_x = layer % 2 == 0
    height = z - (layer + 0.5) * 0.5 * pitch
    across = (np.where(along_x, y, x) / pitch - 0.5) % 1.0 * pitch - 0.5 * pitch
    core = np.clip(1.5 - np.sqrt(across**2 + (1.6 * height) ** 2) / (0.25 * pitch), 0.0, 1.0)
    inside = (np.abs(z) < 0.07) & (np.maximum(np.abs(x), np.abs(y)) < 0.1)
    tangent = np.where(along_x[..., None], (1.0, 0.3, 0.0), (-0.1, 1.0, 0.0))
    tangent = tangent * np.random.default_rng(2).choice([-1.0, 1.0], (*core.shape, 1))
    return box_of(
        core * inside, tangent / np.linalg.norm(tangent, axis=-1, keepdims=True), 24.8 / count, THREADS, **fields
    )


def coloured_block() -> OracleVoxels:
    """A full block of two materials side by side; the body colour of its voxels runs from red to blue."""
    x, _, z = centres((19, 23, 13))
    share = 0.5 + 0.5 * np.sin(40.0 * x + 20.0 * z)
    colour = np.stack([share, 1.0 - share], axis=-1)
    number = (x > 0.02).astype(np.uint8)
    axis = np.array([0.2, -0.5, 0.8]) / math.sqrt(0.93)
    return box_of(np.ones(x.shape), axis, 0.5, [SHINY, GRAINS], material=number, body_colour=colour, basis=(RED, BLUE))


def patches() -> OracleVoxels:
    """A Gaussian ball of grains, bright ones and dark ones in patches of a few voxels."""
    count = 29
    radius, normal = outwards(*centres((count, count, count)))
    waves = np.meshgrid(*(np.sin(1.3 * np.arange(count) + k) for k in range(3)), indexing="ij")
    number = np.sum(waves, axis=0)
    density = np.exp(-0.5 * (radius / 0.05) ** 2)
    return box_of(density, normal, 1.2, [MATTE_GRAINS, DARK_GRAINS], material=(number > 0.0).astype(np.uint8))


def block(
    depth_per_voxel: float, margin: int = 0, shape: tuple[int, int, int] = (11, 23, 23), matter: hg.Reflectance = MATTE
) -> OracleVoxels:
    """Homogeneous matter with a flat face upwards, at the edge of the box or `margin` voxels within it."""
    density = np.ones(shape)
    density[len(density) - margin :] = 0.0
    return box_of(density, (0.0, 0.0, 1.0), depth_per_voxel, matter)


def camera(pixels: int = PIXELS) -> hg.Camera:
    """A pinhole camera that sees the boxes fill most of its picture."""
    lens = hg.Camera(pixels, pixels, (2.9 * pixels, 2.9 * pixels), (0.5 * pixels, 0.5 * pixels))
    return lens.look_at((0.25, -0.75, 0.55), (0.0, 0.0, 0.0))


def _case(name: str, boxes: list[OracleVoxels], lamps: list[hg.Lamp], pixels: int = PIXELS) -> OracleCase:
    scene = hg.Scene(camera(pixels), tuple(lamps), tuple(voxels.box() for voxels in boxes))
    return OracleCase(name, boxes, scene, camera_rays(scene.camera))


def _orthographic(name: str, boxes: list[OracleVoxels], lamps: list[hg.Lamp]) -> OracleCase:
    """Parallel rays, side by side across the picture."""
    scene = hg.Scene(camera(), tuple(lamps), tuple(voxels.box() for voxels in boxes))
    right, down, ahead = scene.camera.world_to_camera[:3, :3]
    y, x = ((np.mgrid[:PIXELS, :PIXELS] + 0.5) / PIXELS - 0.5).reshape(2, -1) * SIDE
    origin = x[:, None] * right + y[:, None] * down - ahead
    return OracleCase(name, boxes, scene, (origin, np.broadcast_to(ahead, origin.shape)), by_camera=False)


def error_and_ratio(seen: Array, true: Array, transmittance: Array) -> tuple[float, float]:
    """Root mean square error over the mean, and ratio of the means, over rays that meet matter, all wavelengths."""
    matter = transmittance < 1.0 - 1e-3
    a, b = seen[matter], true[matter]
    return float(np.sqrt(np.mean((a - b) ** 2)) / b.mean()), float(a.mean() / b.mean())
