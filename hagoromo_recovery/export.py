"""Export: what was recovered as a volume box, for scenes under any lamp, and as a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.backend import arrays, clip, vectors
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.shape import coverage, unit
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.spectra.body_basis import body_basis
from hagoromo.volume.box import VolumeBox
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.near_surface import STEEP
from hagoromo_recovery.fuzzy_shape import THIN, FuzzyShape
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.recovered import BRIGHTEST, Recovered, RecoveredMesh
from hagoromo_recovery.shading.shading import ALPHA, each_gloss, figures

EDGE = 2.0  # voxels of the box from no density to all of it
DEPTH = 7.0  # optical depth of a full voxel that is seen straight on
INWARDS = 0.6  # voxels of the box that the edge is shifted inwards: light comes from before its middle
EXTINCTION = "projected"  # as of elements that face the ray: an outline is not seen before the surface
FINENESS, MOST_SIDE = 5, 768  # voxels of a box by default, per node; along its longest edge at most
SHADOW_BIAS = 1.0  # voxels of the box
LEAST_BOX, LARGEST_BOX = 8, 2048  # voxels along the longest edge
SKIN = 6.0  # voxels of the box that hold matter behind the surface
LEAST_EXTINCTION = 1e-3  # [1/node] of fuzzy matter that a box holds
SHARE_LEVELS = 33  # materials of a box whose places have shares of two glosses
LEAST_DIM = 1e-3  # factor on the reflectance below which it cannot be made to conserve energy


def recovered_box(recovered: Recovered, side: int | None = None) -> VolumeBox:
    """The object as a box of plane elements, `side` voxels along its longest edge (default: five a node).

    Body colours are on the basis of the camera's response under the lamp, or on `smooth_rgb_basis` where one of both
    is not known. A reflectance that would give back more than it receives is dimmed: the name of the box says by how
    much, and lamps must be stronger by that factor. Where places have shares of two glosses, each voxel has the one of
    SHARE_LEVELS materials that is nearest to its share.
    """
    lattice = recovered.lattice
    edges, voxel = _edges_and_voxel(lattice, side, min(FINENESS * max(lattice.shape), MOST_SIDE))
    shape: Any = tuple(int(np.ceil(edge / voxel)) + 1 for edge in edges)
    field = recovered.surface_field
    materials, dim = conserving(recovered)
    last = float(len(materials) - 1)
    per_node, jit = float(voxel / lattice.voxel), arrays()
    scale = dim * ALPHA / materials[0].alpha

    def place_of(point: Any) -> Any:
        return jit.Array3f(point) * float(1.0 / lattice.voxel) - 0.5 * per_node

    def matter(point: Any) -> tuple[Any, ...]:
        place = place_of(point)
        distance = field.value_at(place) * (1.0 / per_node)  # voxels of the box
        there = coverage(distance + INWARDS, EDGE) * dr.select(distance > -SKIN, 1.0, 0.0)
        slope = field.axis_at(place)  # not of length 1: see `on_surface`
        way = distance * per_node * dr.rcp(dr.fmax(dr.squared_norm(slope), STEEP))
        on = place - slope * way  # of the surface, where colours are known
        colours = [dr.fmin(each * scale, BRIGHTEST) for each in field.colours_at(on)]
        material = jit.UInt(0) if field.shares is None else jit.UInt(clip(field.share_at(on), 0.0, 1.0) * last + 0.5)
        return there, unit(field.axis_at(on)), material, [*colours, jit.Float(0)]

    def occupied(middle: Any, radius: float) -> Any:
        distance = field.value_at(place_of(middle)) * (1.0 / per_node)
        reach = 1.3 * radius / voxel + EDGE  # the distance is not exact
        return (distance < reach) & (distance > -SKIN - reach)

    basis = basis_of(recovered.photographs)
    return VolumeBox.from_field(
        matter, shape, voxel, DEPTH / voxel, materials, occupied, pose=_pose(recovered, voxel), basis=basis,
        name=_name(recovered, dim), shadow_bias=SHADOW_BIAS * voxel, extinction=EXTINCTION,
    )  # fmt: skip


def fuzzy_box(recovered: Recovered, fuzzy: FuzzyShape, side: int | None = None) -> VolumeBox:
    """The matter as a box of fibres, `side` voxels along its longest edge (default: one a node).

    Density, axes and colours are linear between nodes, as in the box. See `recovered_box` for colours and dimming.
    """
    lattice, field = recovered.lattice, fuzzy.field()
    edges, voxel = _edges_and_voxel(lattice, side, max(lattice.shape))
    shape: Any = tuple(max(round(edge / voxel), 1) for edge in edges)
    materials, dim = conserving(recovered)
    jit, densest = arrays(), float(fuzzy.density.max())
    scale = dim * ALPHA / materials[0].alpha

    def matter(point: Any) -> tuple[Any, ...]:
        place = jit.Array3f(point) * float(1.0 / lattice.voxel) - 0.5
        density = field.value_at(place)
        there = dr.select(density > LEAST_EXTINCTION, density * (1.0 / densest), 0.0)
        colours = [dr.fmin(each * scale, BRIGHTEST) for each in field.colours_at(place)]
        return there, unit(field.axis_at(place)), jit.UInt(0), [*colours, jit.Float(0)]

    return VolumeBox.from_field(
        matter, shape, voxel, densest / lattice.voxel, materials, pose=_pose(recovered, lattice.voxel),
        basis=basis_of(recovered.photographs), name=_name(recovered, dim),
    )  # fmt: skip


def _edges_and_voxel(lattice: Lattice, side: int | None, usual: int) -> tuple[NDArray[np.float64], float]:
    """Edges of a lattice, and the edge of a voxel of which the longest one has `side`, or else `usual` [m]."""
    if side is not None and not LEAST_BOX <= side <= LARGEST_BOX:
        raise InputError(f"side is {side}: give {LEAST_BOX} to {LARGEST_BOX} voxels")
    edges = np.array(lattice.shape[::-1]) * lattice.voxel
    return edges, float(edges.max()) / (side or usual)


def _name(recovered: Recovered, dim: float) -> str:
    dimmed = "" if dim == 1.0 else f", dimmed by {dim:g}"
    return f"{recovered.name or 'recovered'}{dimmed}"


def _pose(recovered: Recovered, voxel: float) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, 3] = recovered.lattice.corner - 0.5 * voxel  # the middle of the first voxel is the first node
    return pose


def conserving(recovered: Recovered) -> tuple[list[Reflectance], float]:
    """The materials, one for each level of the share, and the factor by which they are dimmed to conserve energy.

    Body colours are dimmed where many are more than 1, then the whole reflectance where its gloss gives back too much.
    """
    near = np.abs(recovered.distance) < 1.0 if recovered.fuzzy is None else recovered.fuzzy.density > THIN
    first = recovered.dim
    brightest = min(first * float(recovered.colours[near].max(initial=0.1)), BRIGHTEST)
    dim = first
    while True:
        try:
            return [
                Reflectance(
                    alpha=ALPHA * dim / first,
                    beta=lobes[0][0] * dim,
                    gamma=lobes[0][1],
                    n=recovered.n,
                    body_colour=Spectrum.constant(brightest),
                    element=recovered.field.element,
                    name=recovered.name or "recovered",
                    lobes=tuple((beta * dim, gamma) for beta, gamma in lobes[1:]),
                )
                for lobes in _lobes(recovered)
            ], dim
        except InputError:
            dim *= 0.9
            if dim < LEAST_DIM * first:
                raise


def _lobes(recovered: Recovered) -> list[list[tuple[float, float]]]:
    """β and γ of the lobes of each material of a box."""
    if not recovered.lit:
        return [[(0.0, recovered.gamma)]]
    glosses = [figures(recovered.gloss[one])[:2] for one in each_gloss(recovered.gloss)]
    if recovered.shares is None:
        return [glosses]
    levels = [(1.0 - share, share) for share in np.linspace(0.0, 1.0, SHARE_LEVELS)]
    return [
        [(float(share * beta), gamma) for share, (beta, gamma) in zip(both, glosses, strict=True) if share > 0.0]
        for both in levels
    ]


def basis_of(photographs: Sequence[Photograph]) -> tuple[Spectrum, ...]:
    """Spectra that body colours are coefficients of."""
    first = photographs[0]
    lamp = first.lamps[0].spectrum if first.lamps else Spectrum.constant(1.0)
    response = first.camera.response
    known = response is not None and len(response.channels) == COLOURS
    return body_basis(response if known else None, lamp)


def recovered_mesh(recovered: Recovered) -> RecoveredMesh:
    """The surface as triangles (marching cubes, Lorensen and Cline 1987), with the normals of the field."""
    from skimage.measure import marching_cubes

    if not (recovered.distance.min() < 0.0 < recovered.distance.max()):
        raise InputError("no surface was recovered: the distance has one sign everywhere")
    values = _spline_values(recovered.distance)
    corners, faces, _, _ = marching_cubes(values, 0.0)
    places = corners[:, ::-1].astype(np.float64)
    field, at = recovered.surface_field, vectors(places)
    normals = np.array(unit(field.axis_at(at)), np.float64).T
    colours = recovered.dim * np.stack([np.array(each, np.float64) for each in field.colours_at(at)], axis=1)
    vertices = recovered.lattice.to_world(places)
    corner = vertices[faces[:, :3]]
    outwards = np.einsum(
        "ni,ni->n", np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), normals[faces[:, 0]]
    )
    faces = np.where((outwards < 0.0)[:, None], faces[:, ::-1], faces).astype(np.int64)
    node = np.unravel_index(field.nearest_node(at), recovered.distance.shape)
    known, errors = recovered.evidence, recovered.errors
    shown = np.zeros(len(vertices), np.int32) if known is None else known.photographs[node]
    nothing = np.full(len(vertices), np.nan, np.float32)
    position, normal = (nothing, nothing) if errors is None else (errors.position[node], errors.normal[node])
    if recovered.shares is None:
        return RecoveredMesh(vertices, faces, normals, colours, shown, position, normal)
    gloss_errors = np.full((len(vertices), 2), np.nan, np.float32)
    if errors is not None and errors.gloss is not None:
        gloss_errors = errors.gloss[node]
    return RecoveredMesh(
        vertices, faces, normals, colours, shown, position, normal, recovered.gloss_at(at), gloss_errors
    )


def _spline_values(nodes: NDArray[np.floating]) -> NDArray[np.float64]:
    """Values at the nodes of the quadratic spline: each a mean of its neighbours."""
    values = np.asarray(nodes, np.float64)
    for axis in range(3):
        values = ndimage.correlate1d(values, [0.125, 0.75, 0.125], axis=axis, mode="nearest")
    return values
