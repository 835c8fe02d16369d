"""Medium: a volume box as Mitsuba's nearest stock medium: a heterogeneous one, of grids, in a cube without a surface.

Spheres: their phase function depends on one angle only, and is tabulated: exact for one colour. Planes and cylinders:
the body light of a sphere, and for the light of the interface SGGX micro-flakes (Heitz et al. 2015) along the axes, of
which planes and fibres are the limits, blended by their shares of the light. What is lost is said in lines.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.facets import HALF_OF_GGX
from hagoromo.reflectance.parameters import PLAIN_BODY
from hagoromo.reflectance.parameters import lost as lost_parameters
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_formats.mitsuba.colours import LIMITS
from hagoromo_formats.mitsuba.xml_text import Element, plugin
from hagoromo_formats.volumes.mitsuba_volume import write_mitsuba_volume

ANGLES = 721  # of a tabulated phase function, alike in the cosine
NARROWEST = 0.02  # roughness of SGGX: with less, single precision has no flakes
PROJECTED_MEAN = 0.5  # projected area of an element, mean over all directions
BYTES = 80.0  # memory of a voxel while its grids are written


def box_shape(box: VolumeBox, folder: Path, name: str) -> tuple[Element, list[str]]:
    """The element <shape> of a volume box, whose grids are written to `folder`, and what is lost, a line each.

    `InputError` for a box of texels, and one that does not fit the memory.
    """
    if box.texel:
        raise InputError(f"volume box {box.name!r} is a shell of texels, which Mitsuba has not: leave it out")
    require(BYTES * float(np.prod(box.bricks.shape, dtype=float)), f"all voxels of volume box {box.name!r}")
    held = box.bricks.dense()
    density, axis = np.asarray(held[0], np.float32), np.asarray(held[1], np.float32)
    material, lost = box.materials[0], _lost(box)
    pose = box.pose @ np.diag([*(n * box.voxel_size for n in box.bricks.shape[::-1]), 1.0])
    write_mitsuba_volume(folder / f"{name}_density.vol", density, box.voxel_size)
    scale = box.tau * (PROJECTED_MEAN if box.extinction == "projected" else 1.0)
    parts = [
        plugin("volume", "gridvolume", "sigma_t", filename=f"{name}_density.vol", raw=True, to_world=pose),
        plugin("volume", "constvolume", "albedo", value=albedo_of(material)),
        *_phase(material, axis, pose, folder / f"{name}_flakes.vol", box.voxel_size),
    ]
    medium = plugin("medium", "heterogeneous", "interior", parts, scale=float(scale))
    cube = pose @ np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    return plugin("shape", "cube", parts=[plugin("bsdf", "null"), medium], to_world=cube), lost


def _lost(box: VolumeBox) -> list[str]:
    who, (first, *others) = f"volume box {box.name!r}", box.materials
    lost = [f"{who}: {len(others)} of its materials: all voxels have the first"] if others else []
    lost += [f"{who}: the colours of its voxels"] if box.basis else []
    lost += [f"{who}: {said}"] if (said := lost_parameters("mitsuba medium", first)) else []
    lost += [f"{who}: the offset of its shadows"] if box.shadow_bias else []
    if first.element != "sphere":
        lost.append(
            f"{who}: the shape of its {first.element}s; body light as of spheres, gloss as of SGGX micro-flakes"
        )
    elif first.beta > 0.0:
        lost.append(f"{who}: the colour of body and gloss apart: each direction has the mean of both")
    if box.extinction == "projected" and first.element != "sphere":
        lost.append(f"{who}: extinction by direction, of which the mean stands")
    return lost


def albedo_of(material: Reflectance) -> Spectrum:
    """Share of the light that an element sends on, by wavelength, mean over the directions."""
    body, interface = shares_of(material)
    colour, gloss = material.body_colour, material.interface_colour
    waves = np.unique(np.concatenate([colour.wavelengths, gloss.wavelengths, LIMITS]))
    inside = waves[(waves >= LIMITS[0]) & (waves <= LIMITS[1])]
    values = body * colour.held(*LIMITS).at(inside) + interface * gloss.held(*LIMITS).at(inside)
    if np.ptp(values) <= 1e-9:
        return Spectrum.constant(float(values[0]))
    return Spectrum(inside, np.clip(values, 0.0, 1.0))


def shares_of(material: Reflectance) -> tuple[float, float]:
    """What a sphere of the material sends on of body and of interface, each for a white colour: ∫ f dL."""
    cosines, weights = np.polynomial.legendre.leggauss(2048)
    body, interface = _sphere(material, cosines)
    return tuple(float(2.0 * math.pi * np.sum(weights * each)) for each in (body, interface))  # type: ignore[return-value]


def _sphere(material: Reflectance, cosines: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights of a sphere of the material at cosχ = L·V [1/sr]."""
    real = arrays().Array3f64
    ball = replace(material, element="sphere", transmission=0.0, clearness=0.0, **PLAIN_BODY)
    sine = np.sqrt(np.maximum(1.0 - cosines**2, 0.0))
    weights = ball.weights(real(0, 0, 1), real(np.stack([sine, 0.0 * sine, cosines])), real(0, 0, 1))
    return np.array(weights.body), np.array(weights.interface)


def _phase(
    material: Reflectance, axis: NDArray[np.float32], pose: NDArray[np.float64], file: Path, edge: float
) -> list[Element]:
    """The phase function of the medium; Mitsuba counts the angle from straight on, so that cosθ = −cosχ."""
    body, interface = _sphere(material, -np.linspace(-1.0, 1.0, ANGLES))
    colour, gloss = material.body_colour.mean(), material.interface_colour.mean()
    if material.element == "sphere":
        return [_table(body * colour + interface * gloss, "phase")]
    sent = shares_of(material)
    of_body, of_gloss = sent[0] * colour, sent[1] * gloss
    if of_gloss <= 0.0:
        return [_table(body, "phase")]
    write_mitsuba_volume(file, flakes(material, axis @ pose_rotation(pose).T), edge)
    flake = plugin(
        "phase", "sggx", "flakes", [plugin("volume", "gridvolume", "S", filename=file.name, raw=True, to_world=pose)]
    )
    weight = plugin("volume", "constvolume", "weight", value=float(of_gloss / (of_body + of_gloss)))
    return [plugin("phase", "blendphase", "phase", [weight, _table(np.maximum(body, 1e-9), "body"), flake])]


def _table(values: NDArray[np.float64], name: str) -> Element:
    return plugin("phase", "tabphase", name, values=", ".join(f"{value:.7g}" for value in np.maximum(values, 0.0)))


def pose_rotation(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) of a pose without its scale."""
    return pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0)


def flakes(material: Reflectance, axis: NDArray[np.floating]) -> NDArray[np.float32]:
    """S of SGGX, as xx, yy, zz, xy, xz, yz: along the normal of planes and across the tangent of fibres it is 1."""
    rough = max(min(math.tan(min(material.gamma, 1.2)) / HALF_OF_GGX, 1.0), NARROWEST) ** 2
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    unit = np.where(length > 0.0, axis / np.maximum(length, 1e-9), (0.0, 0.0, 1.0))
    along, across = (1.0, rough) if material.element == "plane" else (rough, 1.0)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    parts = [(along - across) * unit[..., i] * unit[..., j] + (across if i == j else 0.0) for i, j in pairs]
    return np.stack(parts, axis=-1).astype(np.float32)
