"""Scenes of the benchmark of all orders of light, and their matter on one lattice for programs without our elements.

Thin smoke and a dense white cloth are of matte spheres, which Mitsuba has too: the same medium. A head of white hair
(the angel's, of matte cylinders) and the angel of figure 8 it has not: its nearest medium has their extinction and
albedo on one lattice, and the phase function of matte spheres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.matter.build import kept_box
from hagoromo_matter.demo.figures import wardrobe
from hagoromo_matter.demo.samples import FOCAL_MM, PRESET, true_reflectances
from hagoromo_matter.demo.studio import ball_around, studio_lamps
from hagoromo_matter.figure.figure import PART_MATERIALS, figure_part

WAVELENGTH = 550.0  # nm, that pictures are compared at
MEAN_AREA = 0.5  # of every element, over all directions
MOST_SIDE = 256  # of the lattice
WHITE_HAIR = 0.85
RESOLUTION = 0.5  # of the figure
AWAY = 5.0  # half diagonals of the matter from its middle to the camera
Array = NDArray[Any]
Place = tuple[float, float, float]


class PlainLattice(NamedTuple):
    """Extinction [1/m] and albedo (z, y, x) in the box from `low` of size `edges` [m] (x, y, z)."""

    extinction: NDArray[np.float32]
    albedo: NDArray[np.float32]
    low: Array
    edges: Array


class OrdersContest(NamedTuple):
    """A scene of the benchmark. focal: length in widths of the picture. same: whether `lattice` is the same medium."""

    title: str
    boxes: tuple[hg.VolumeBox, ...]
    lattice: PlainLattice
    same: bool
    lamps: tuple[hg.Lamp, ...]
    eye: Place
    other_eye: Place
    target: Place
    up: Place
    focal: float

    def scene(self, pixels: int, eye: Place | None = None) -> hg.Scene:
        """Ours, with a picture of `pixels` a side."""
        focal, middle = self.focal * pixels, 0.5 * pixels
        camera = hg.Camera(pixels, pixels, (focal, focal), (middle, middle))
        return hg.Scene(camera.look_at(eye or self.eye, self.target, self.up), self.lamps, self.boxes)


def smoke(side: int = 128) -> OrdersContest:
    """A soft ball of smooth noise, a mean free path deep."""
    from scipy.ndimage import gaussian_filter

    z, y, x = grid_points(side)
    noise = gaussian_filter(np.random.default_rng(1).normal(size=x.shape), side / 24)
    ball = np.clip((0.9 - np.sqrt(x**2 + y**2 + z**2)) * 2.0, 0.0, 1.0)
    return in_cube("thin smoke", (ball * np.exp(1.5 * noise / noise.std()) / 3.0).astype(np.float32), 1.0, 0.6)


def cloth(side: int = 96, yarns: int = 6) -> OrdersContest:
    """A plain weave, its yarns several mean free paths wide: along x and y, over and under each other."""
    z, y, x = grid_points(side)
    pitch = 2.0 / yarns
    radius, wave = 0.42 * pitch, 0.22 * pitch
    density = np.zeros(x.shape, bool)
    for number in range(yarns):
        at, sign = (number + 0.5) * pitch - 1.0, (-1) ** number
        for along, across in ((x, y), (y, x)):
            turn = sign if along is x else -sign
            height = turn * wave * np.sin(math.pi * (along + 1.0) / pitch + math.pi / 2)
            density |= (across - at) ** 2 + (z - height) ** 2 < radius**2
    return in_cube("dense white cloth", density.astype(np.float32), 40.0, 0.94)


def hair() -> OrdersContest:
    """The angel's head of hair, white, from behind, under one lamp."""
    matte = hg.Reflectance(1.0 / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(WHITE_HAIR), name="white hair")
    boxes = (figure_box("hair", matte),)
    middle, extent = ball_around(boxes)
    lamp = hg.Lamp(position=middle + extent * np.array((1.5, 3.0, 2.5)), intensity=(4.2 * extent) ** 2)
    eyes = around(middle, extent, (0.2, 0.97, 0.1)), around(middle, extent, (-0.4, 0.9, 0.2))
    return OrdersContest(
        "head of white hair", boxes, lattice_of(boxes), False, (lamp,), *eyes, around(middle, 0.0), (0, 0, 1), 2.6
    )


def figure_8() -> OrdersContest:
    """The whole angel of figure 8 under its three lamps, without the wall behind."""
    camera = hg.Camera.preset(PRESET, FOCAL_MM, 4)
    materials = wardrobe(true_reflectances(camera))
    boxes = tuple(figure_box(part, materials[name]) for part, name in PART_MATERIALS["angel"].items())
    middle, extent = ball_around(boxes)
    eyes = around(middle, extent, (0.16, -0.98, 0.1)), around(middle, extent, (-0.4, -0.9, 0.1))
    lamps, target = studio_lamps(middle, extent), around(middle, 0.0)
    return OrdersContest("angel of figure 8", boxes, lattice_of(boxes), False, lamps, *eyes, target, (0, 0, 1), 2.6)


CONTESTS: dict[str, Callable[[], OrdersContest]] = {"smoke": smoke, "cloth": cloth, "hair": hair, "figure8": figure_8}


def around(middle: Array, extent: float, way: Place = (0.0, 0.0, 0.0)) -> Place:
    """The place AWAY half diagonals from the middle of the matter."""
    x, y, z = middle + AWAY * extent * np.array(way)
    return float(x), float(y), float(z)


def grid_points(side: int) -> tuple[Array, ...]:
    """z, y, x of the middles of voxels in the cube −1…1 m."""
    return np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 3, indexing="ij")


def in_cube(title: str, density: NDArray[np.float32], tau: float, albedo: float) -> OrdersContest:
    """Grey matte spheres in the cube −1…1 m under a point lamp."""
    grey = hg.Reflectance(albedo / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    pose, axes = np.eye(4), np.zeros((*density.shape, 3))
    pose[:3, 3] = -1.0
    box = hg.VolumeBox.from_arrays(density, axes, 2.0 / density.shape[0], tau, [grey], pose=pose)
    lattice = PlainLattice(tau * density, np.full_like(density, albedo), np.full(3, -1.0), np.full(3, 2.0))
    lamps = (hg.Lamp(position=(2.0, 2.5, 2.0), intensity=27.0),)
    eye, other, middle, up = (0.3, 0.5, 3.0), (-1.5, 0.5, 2.6), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    return OrdersContest(title, (box,), lattice, True, lamps, eye, other, middle, up, 2.2)


def figure_box(part: str, material: hg.Reflectance) -> hg.VolumeBox:
    """A part of the angel with projected extinction, kept in the cache."""
    depends_on = ["orders", part, material.record(), RESOLUTION]
    return kept_box(depends_on, lambda: figure_part("angel", part, material, RESOLUTION, 1, "projected").box())


def lattice_of(boxes: Sequence[hg.VolumeBox]) -> PlainLattice:
    """Matter of boxes on one lattice, with the mean of extinction over all directions."""
    corners = np.concatenate([box.corners() for box in boxes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    cell = max(float((high - low).max()) / MOST_SIDE, *(box.voxel_size for box in boxes))
    shape = tuple(np.ceil((high - low) / cell).astype(int)[::-1])
    taken, sent = np.zeros(shape), np.zeros(shape)
    for box in boxes:
        places, extinction, albedo = voxels_of(box)
        index = np.clip(((places - low) / cell).astype(int), 0, np.array(shape[::-1]) - 1)
        flat = np.ravel_multi_index((index[:, 2], index[:, 1], index[:, 0]), shape)
        weight = extinction * (box.voxel_size / cell) ** 3
        taken += np.bincount(flat, weight, taken.size).reshape(shape)
        sent += np.bincount(flat, weight * albedo, taken.size).reshape(shape)
    albedo = np.where(taken > 0.0, sent / np.maximum(taken, 1e-30), 0.0)
    return PlainLattice(taken.astype(np.float32), albedo.astype(np.float32), low, cell * np.array(shape[::-1], float))


def voxels_of(box: hg.VolumeBox) -> tuple[Array, Array, Array]:
    """Middles of the voxels with matter (n, 3) [m], mean extinction [1/m] and albedo."""
    held = {name: values[:, :8, :8, :8] for name, values in box.bricks.read(0, box.bricks.kept).items()}
    inner = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1)
    index = box.bricks.corners()[:, None, None, None] + inner
    density = held["density"].astype(float)
    if box.texel is not None:  # heights in the band of a chart: matter of the mean density of the texel
        inside = (density > 0.0) & (density < 1.0)
        density = np.where(inside, float(box.texel.levels[0].density.astype(float).sum(axis=0).mean()), 0.0)
    each = np.array([math.pi * m.alpha for m in box.materials])
    body = np.array([m.body_colour.at(WAVELENGTH) for m in box.materials], float)
    interface = np.array([m.interface_albedo * m.interface_colour.at(WAVELENGTH) for m in box.materials], float)
    number = held["material"].astype(int) if "material" in held else np.zeros(density.shape, int)
    colour = body[number]
    if box.basis:
        basis = np.array([spectrum.at(WAVELENGTH) for spectrum in box.basis], float)
        colour = held["colour"][..., : len(basis)].astype(float) @ basis
    matter = density > 0.0
    local = (index[matter][:, ::-1] + 0.5) * box.voxel_size
    places = local @ box.pose[:3, :3].T + box.pose[:3, 3]
    area = MEAN_AREA if box.extinction == "projected" else 1.0
    return (
        places,
        area * box.tau * density[matter],
        np.minimum((each[number] * colour + interface[number])[matter], 1.0),
    )
