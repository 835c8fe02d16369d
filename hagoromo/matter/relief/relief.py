"""Relief: a surface seen from one side → a volume box, a thin opaque skin of plane particles with its reflectance.

Particles in a skin shade each other: with the light attenuated on its way in and out, an opaque skin of particles
that reflect f shows f cosθ_i / (cosθ_i + cosθ_r) (Lommel 1889, Seeliger 1887), and where it bends some light passes the
terminator. A surface does not: the box has a `shadow_bias` past its own skin, and shows f under every lamp.

Measured relief: the surface and the materials in the folder of a measurement, ready to be filled with matter.

Gloss classes: β, γ and tail of every pixel as a few materials, as each voxel of a box has the number of one.

Pixels of a material are cut in two by ln β, ln γ or 1/ν, whichever differs more, again and again, as Heckbert (1982)
cuts colours. A class has the mean of its pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.relief.relief_field import DEPTH, LEAST_SKIN_COSINE, SKIN_VOXELS, ReliefField, ReliefLattice
from hagoromo.measurement.gloss.gloss_map import GLOSS_CHANNELS, TAIL_CHANNELS
from hagoromo.measurement.measurement_files import read_maps, read_surface
from hagoromo.reflectance.facets import GAUSSIAN, LEAST_NU
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.reflectance import NEUTRAL, Reflectance
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import MATERIALS
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan

SPIKE = 3.0  # voxels by which a single pixel may stand out towards the eye: spikes of the rim would throw shadows
MARGIN_VOXELS = 4  # voxels around the surface
# [voxels] from the visible surface past the outer half of the edge
SHADOW_BIAS_VOXELS = 1.0
CLASSES = 32  # of a material, at most
LEAST_SPREAD = 0.02  # standard deviation of ln β, of ln γ and of 1/ν within a class that is not cut
LEAST_TAIL = 1e-3  # 1/ν below which facets count as Gaussian
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Relief:
    """A measured surface: points (h, w, 3) [m], world, 0 where unknown; normals (h, w, 3) unit; body (h, w, j) α c_b
    per pixel on a basis of j spectra; labels (h, w) of its materials, −1 unknown. surfaces: (h, w) labels of what is
    alike in all but its gloss, between whose pixels normals and colours go over; None: the materials.
    """

    points: NDArray[np.floating]
    normals: NDArray[np.floating]
    body: NDArray[np.floating]
    labels: NDArray[np.integer]
    surfaces: NDArray[np.integer] | None = None

    def known(self) -> NDArray[np.bool_]:
        """(h, w) pixels with point, normal and label; `InputError` without any."""
        known = (np.linalg.norm(self.points, axis=2) > 0) & (np.linalg.norm(self.normals, axis=2) > 0.5)
        known &= self.labels >= 0
        if not known.any():
            raise InputError("the relief has no pixel with point, normal and label: there is nothing to fill")
        return np.asarray(known, np.bool_)


def relief_plan(
    relief: Relief,
    camera: Camera,
    materials: Sequence[Reflectance],
    basis: Sequence[Spectrum] | None = None,
) -> BoxPlan:
    """The box of the skin of `relief`, as `camera` saw it.

    The box lies along the camera's axes (x right, y down, z away), with voxels of one pixel at the mean depth.
    materials: by label, of the surface; in the box they have one α, so that colours between two of them are between
    theirs. The body colour of a voxel is that of its pixel, on `basis` (default `smooth_rgb_basis`), over that α.
    `InputError` when nothing is known or the lens is distorted.
    """
    if any(camera.distortion):
        raise InputError("a relief needs photographs without lens distortion: undistort them first")
    known = relief.known()
    rows, columns = np.nonzero(known)
    pose = camera.world_to_camera[:3]
    local = relief.points[rows, columns].astype(np.float64) @ pose[:, :3].T + pose[:, 3]
    if local[:, 2].min() <= 0.0:
        raise InputError("the relief has points behind the camera: give the camera that saw it")
    voxel = float(local[:, 2].mean() / np.mean(camera.focal))
    local = _without_spikes(known, local, voxel)
    behind = local * (
        1.0 + SKIN_VOXELS / LEAST_SKIN_COSINE * voxel / local[:, 2:]
    )  # where the skin of a steep pixel may end
    low = np.minimum(local, behind).min(axis=0) - MARGIN_VOXELS * voxel
    high = np.maximum(local, behind).max(axis=0) + MARGIN_VOXELS * voxel
    low[2] = max(low[2], 0.5 * local[:, 2].min())
    # a voxel has the colour of one pixel: their centres coincide at the mean depth
    low[:2] = (np.floor(low[:2] / voxel + camera.principal) - camera.principal) * voxel
    to_world = camera.camera_to_world.copy()
    to_world[:3, 3] += to_world[:3, :3] @ low
    facing = relief.normals @ pose[:, :3].T
    alpha = max(material.alpha for material in materials) or 1.0  # where nothing has a body
    colour = np.asarray(relief.body, np.float64) / alpha
    places = np.zeros((*known.shape, 3))
    places[known] = local - low
    surfaces = relief.labels if relief.surfaces is None else relief.surfaces
    field = ReliefField(known, places, facing, colour, (relief.labels, surfaces), ReliefLattice(camera, low, voxel))
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel))
    header = BoxHeader(
        voxel,
        DEPTH / (SKIN_VOXELS * voxel),
        tuple(_with_alpha(material, alpha) for material in materials),
        to_world,
        tuple(smooth_rgb_basis() if basis is None else basis),
        "relief",
        shadow_bias=SHADOW_BIAS_VOXELS * voxel,
    )
    return BoxPlan(header, FieldBlocks(field, (shape[2], shape[1], shape[0]), voxel, field.occupied))


def _with_alpha(material: Reflectance, alpha: float) -> Reflectance:
    """The material on plane elements, of the same α c_b."""
    body = material.body_colour
    scaled = Spectrum(body.wavelengths, body.values * (material.alpha / alpha))
    return replace(material, element="plane", alpha=alpha, body_colour=scaled)


def _without_spikes(known: NDArray[np.bool_], local: NDArray[np.float64], voxel: float) -> NDArray[np.float64]:
    """`local` (n, 3), known points in the camera's axes, none nearer by a SPIKE than the median within two pixels."""
    import cv2

    depth = np.full(known.shape, np.inf, np.float32)
    depth[known] = local[:, 2]
    around = cv2.medianBlur(depth, 5)[known].astype(np.float64)
    stands_out = np.isfinite(around) & (local[:, 2] < around - SPIKE * voxel)
    return local * np.where(stands_out, np.where(stands_out, around, 1.0) / local[:, 2], 1.0)[:, None]


def read_relief(folder: Path) -> tuple[Relief, tuple[MaterialEstimate, ...]]:
    """The relief in the folder of a measurement, and its materials; see `read_surface` for the files.

    Without body.exr each pixel has the colour of its material. Where gloss.exr has the gloss of each pixel, it is in
    materials of its own (`gloss_classes`), after those of the measurement. `InputError` where the files do not go
    together.
    """
    surface = read_surface(folder)
    if surface.points is None:
        raise InputError(f"{folder / 'points.exr'} does not exist: measure again")
    body = None if surface.body is None else surface.body.astype(np.float64)
    if body is None:
        colours = np.array([material.alpha * np.array(material.body_colour) for material in surface.materials])
        body = np.where((surface.labels >= 0)[..., None], colours[np.maximum(surface.labels, 0)], 0.0)
    labels, materials = surface.labels, surface.materials
    path = inside(folder, "gloss.exr")
    maps = read_maps(path, GLOSS_CHANNELS[:2], surface)
    if maps is not None:
        tails = read_maps(path, TAIL_CHANNELS[:1], surface, optional=True) or ()
        labels, materials = with_gloss_classes(labels, materials, *maps, *tails)
    return Relief(surface.points, surface.normals, body, labels, surface.labels), materials


def surface_reflectances(
    materials: Sequence[MaterialEstimate], basis: Sequence[Spectrum], dim: float
) -> list[Reflectance]:
    """The materials on plane elements, their colours on `basis` and their weights times `dim`."""
    reflectances = []
    for material in materials:
        coloured = len(set(material.interface_colour)) > 1  # otherwise it has the lamp's colour
        interface = _on_basis(material.interface_colour, basis) if coloured else NEUTRAL
        colours = _on_basis(material.body_colour, basis), interface
        reflectances.append(material.with_spectra(*colours, factor=dim))
    return reflectances


def _on_basis(colour: Sequence[float], basis: Sequence[Spectrum]) -> Spectrum:
    """The spectrum Σ colour_c B_c, 0 where that is negative."""
    values = np.sum([c * s.values for c, s in zip(colour, basis, strict=True)], axis=0)
    return Spectrum(basis[0].wavelengths, np.maximum(values, 0.0))


def with_gloss_classes(
    labels: NDArray[np.integer],
    materials: Sequence[MaterialEstimate],
    beta: NDArray,
    gamma: NDArray,
    nu: NDArray | None = None,
) -> tuple[NDArray[np.integer], tuple[MaterialEstimate, ...]]:
    """Labels (h, w) and materials with those of the classes added; where β and γ (h, w) are not above 0, as they were.

    No more than a box can have: MATERIALS. nu: (h, w) of the tails, 0 for Gaussian facets; None: that of the materials.
    """
    known = (beta > 0.0) & (gamma > 0.0) & (labels >= 0)
    varied = [number for number in range(len(materials)) if (known & (labels == number)).any()]
    most = min(CLASSES, (MATERIALS - len(materials)) // max(len(varied), 1))
    found, all_materials = labels.copy(), list(materials)
    for number in varied:
        mine = known & (labels == number)
        gloss = np.log(np.stack([beta[mine], gamma[mine]], axis=1).astype(np.float64))
        if nu is not None:
            gloss = np.c_[gloss, np.where(nu[mine] > 0.0, 1.0 / np.maximum(nu[mine], LEAST_NU), 0.0)]
        classes = gloss_classes(gloss, most)
        found[mine] = len(all_materials) + classes
        for one in range(int(classes.max(initial=-1)) + 1):
            mean = gloss[classes == one].mean(axis=0)
            mean_beta, mean_gamma = np.exp(mean[:2]).tolist()
            name = f"{materials[number].name}, gloss {one + 1}"
            own = materials[number].with_gloss(mean_beta, mean_gamma, None if nu is None else nu_of(float(mean[2])))
            all_materials.append(replace(own, name=name))
    return found, tuple(all_materials)


def nu_of(tail: float) -> float:
    """ν of a tail 1/ν; Gaussian facets where that is next to 0."""
    return GAUSSIAN if tail < LEAST_TAIL else 1.0 / tail


def gloss_classes(gloss: Array, most: int) -> NDArray[np.intp]:
    """(P,) classes 0, 1, … of rows (P, G) of ln β, ln γ …: `most` at most, fewer where all are narrow."""
    classes = np.zeros(len(gloss), np.intp)
    for new in range(1, most):
        spreads = [len(part) * part.var(axis=0) for part in (gloss[classes == one] for one in range(new))]
        wide = [
            np.where(spread > np.count_nonzero(classes == one) * LEAST_SPREAD**2, spread, 0.0)
            for one, spread in enumerate(spreads)
        ]
        cut, axis = np.unravel_index(int(np.argmax(wide)), (new, gloss.shape[1]))
        if wide[int(cut)][axis] == 0.0:
            break
        column = gloss[:, axis]
        classes[(classes == cut) & (column > column[classes == cut].mean())] = new
    return classes
