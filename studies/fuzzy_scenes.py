"""Captures of simulated fuzzy matter for `recover`: balls of fur and of down, seen from all around, under near lamps.

They are rendered by the house's march from boxes that are finer than any lattice of a recovery. The background is dark;
masks are white wherever fibres cover a little of a pixel.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import arrays, clip
from hagoromo.image.relight.stage import basis_camera
from hagoromo.matter import shape as sd
from hagoromo.reflectance.spectra.body_basis import body_basis
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.hair.fibres import fibre_blocks, one_fibre
from hagoromo_matter.hair.growth import Growth, grown
from hagoromo_matter.noise import value_noise
from studies.recover_scenes import DISTANCE, Shots, Simulated, photograph_of

Array = NDArray[np.float64]
RECIPES = Path(__file__).parents[1] / "examples" / "recipes"
COVERED = 0.02  # opacity of a pixel that the mask holds
BALL = 26.0  # [mm] radius of the ball that fur grows on
FUR = Growth(
    hairs=40_000, diameter_mm=0.12, length_mm=16.0, front=0.0, back=0.0, lean_deg=25.0, bend_mm=14.0, volume_mm=9.0,
    locks=260, gathered=0.6, wave_mm=0.4, stray_mm=2.0,
)  # fmt: skip
FUR_VOXEL, DOWN_VOXEL = 0.5, 0.6  # [mm]
DOWN_RADIUS, DOWN_EDGE = 0.030, 0.014  # [m] of the ball of down, and from its edge to all of its density
DOWN_EXTINCTION = 260.0  # [1/m]


def fur(voxel: float = FUR_VOXEL) -> hg.VolumeBox:
    """A ball of fur in locks, combed downwards, of one brown."""

    def ball(point: Any) -> Any:
        return sd.sphere(point, (0.0, 0.0, 0.0), BALL)

    curves = grown(ball, (np.full(3, -BALL - 1.0), np.full(3, BALL + 1.0)), FUR, 3)
    blocks, pose = fibre_blocks(curves, voxel)
    tau = one_fibre(curves.mean_diameter, voxel) / (1e-3 * curves.mean_diameter)
    wavelengths = np.array([400.0, 500.0, 600.0, 700.0])
    brown = hg.Spectrum(wavelengths, np.array([0.18, 0.26, 0.46, 0.55]))
    hair = hg.Reflectance(1.0 / np.pi, 0.5, 0.25, 1.5, body_colour=brown, element="cylinder", name="hair")
    return BoxPlan(BoxHeader(1e-3 * voxel, tau, (hair,), pose, name="fur"), blocks).box()


def down(voxel: float = DOWN_VOXEL) -> hg.VolumeBox:
    """A ball of soft down in tufts, denser inwards, of three smooth patterns of colour; its fibres stand out."""
    jit, size = arrays(), 1e-3 * voxel
    side = int(np.ceil(2.1 * (DOWN_RADIUS + 0.5 * DOWN_EDGE) / size))
    half, step = 0.5 * side * size, 0.0035
    materials = [
        hg.Reflectance(
            1.0 / np.pi, 0.3, 0.3, 1.5, body_colour=hg.Spectrum.constant(0.8), element="cylinder", name="down"
        )
    ]

    def field(point: Any) -> tuple[Any, ...]:
        p = jit.Array3f(point) - half
        r = dr.norm(p)
        tufts = value_noise(p * float(1.0 / step), 1)
        edge = DOWN_RADIUS + 0.012 * (value_noise(p * (1.0 / 0.011), 2) - 0.5)
        density = clip((edge - r) * float(1.0 / DOWN_EDGE) + 0.5, 0.0, 1.0)
        density = density * density * (0.15 + 1.7 * tufts * tufts)
        aside = [value_noise(p * (1.0 / 0.008), 5 + k) - 0.5 for k in range(3)]
        axis = dr.normalize(p * dr.rcp(dr.fmax(r, 1e-4)) + 1.2 * jit.Array3f(*aside))
        return density, axis, jit.UInt(0), [*down_colours(p), jit.Float(0)]

    pose = np.eye(4)
    pose[:3, 3] = -half
    basis = body_basis(basis_camera(), hg.Spectrum.constant(1.0))
    return hg.VolumeBox.from_field(
        field, (side, side, side), size, DOWN_EXTINCTION, materials, pose=pose, basis=basis, name="down"
    )


def down_colours(p: Any) -> list[Any]:
    """Body colours of the down at points [m]."""
    return [
        0.45 + 0.25 * dr.sin(120.0 * p.x + 2.0) * dr.cos(90.0 * p.z),
        0.4 + 0.2 * dr.sin(140.0 * p.y) * dr.cos(70.0 * p.x + 1.0),
        0.38 + 0.22 * dr.cos(110.0 * p.z + 50.0 * p.x),
    ]


def of_recipe(name: str, **keys: Any) -> hg.VolumeBox:
    """The box of a recipe of this repository, with some keys of its own, its matter about the origin."""
    recipe = tomllib.loads((RECIPES / f"{name}.toml").read_text(encoding="utf-8")) | keys
    box = hg.build({key: value for key, value in recipe.items() if value is not None})
    corners, pose = box.matter_corners(), box.pose.copy()
    pose[:3, 3] -= 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return box.with_pose(pose)


def linen() -> hg.VolumeBox:
    """A flat square of linen, 3 cm wide."""
    return of_recipe("linen", voxel_mm=0.06)


def feather() -> hg.VolumeBox:
    """A primary feather, 9 cm long."""
    return of_recipe("primary", voxel_mm=0.25)


def skin() -> hg.VolumeBox:
    """A ball of skin, of 6 mm."""
    return of_recipe("skin", voxel_mm=0.1, size_mm=None, shape={"form": "sphere", "radius_mm": 6.0})


def fuzzy_simulated(box: hg.VolumeBox, taken: Shots, seed: int = 0, noise: bool = True, size: float = 1.0) -> Simulated:
    """Photographs of a box, one for each view and lamp. size: factor on all distances from the origin."""
    random, response, exact = np.random.default_rng(seed), basis_camera(), []
    photographs: list[hg.Photograph] = []
    for view, lamps in zip(taken.views, taken.lamps, strict=True):
        focal = taken.focal * taken.pixels
        camera = hg.Camera(
            taken.pixels, taken.pixels, (focal, focal), (taken.pixels / 2, taken.pixels / 2), name="simulated",
            response=response,
        ).look_at(tuple(size * DISTANCE * view), (0.0, 0.0, 0.0))  # fmt: skip
        for place in size * lamps:
            lamp = hg.Lamp(position=place, intensity=np.pi * float(place @ place))
            image = hg.render(hg.Scene(camera, (lamp,), boxes=(box,)), hg.Settings(samples=4))
            light, share = np.asarray(image.expose(response), np.float64), np.asarray(image.alpha, np.float64)
            exact.append(light)
            photographs.append(
                photograph_of(light, share, camera, lamp, random if noise else None, len(photographs), COVERED)
            )
    return Simulated(hg.Capture(tuple(photographs), "fuzzy"), exact)
