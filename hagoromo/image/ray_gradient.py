"""Gradient of the light along rays: from the derivative of a loss by it to that by what a scene is made of.

Enters: a prepared scene, rays, and what the loss has to say of their light. Leaves: NumPy arrays, those of voxels on
the lattice of the user's boxes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeAlias

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import Array3f, Float, arrays, column
from hagoromo.errors import InputError
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.transport.adjoint import MarchAdjoint
from hagoromo.transport.differentiable_medium import DifferentiableMedium
from hagoromo.transport.moving import Moving, Rays
from hagoromo.transport.shadows_back import ShadowsBack
from hagoromo.volume.bricks import Grid
from hagoromo.volume.lattice import on_lattice
from hagoromo.volume.voxels import PlainVoxels, SplitVoxels

COPIED_BYTES = 1 << 30  # of a gradient of which each core sums a copy of its own; a larger one is summed by atomics
NAMES = ("density", "axis", "colour", "materials", "lamps", "rays")


class RayLight(NamedTuple):
    """Of each ray: weights (rays, channels), radiance per unit of lamp spectrum and colour as in `Image`, and the
    transmittance (rays,), the share of the light from behind the boxes that passes them.
    """

    weights: NDArray[np.floating]
    transmittance: NDArray[np.floating]


class RayGradient(NamedTuple):
    """The light along rays, and the gradient of a loss of it by what was asked for; None for all else.

    Of each box, 0 in bricks that it does not store: density (nz, ny, nx); axis (nz, ny, nx, 3), by x, y, z in box axes
    of the stored axis, of any length; colour (nz, ny, nx, 4), by the coefficients of the body colour on the basis of
    the box, None of a box without. Boxes that share their voxels have the gradient by these, of all of them together.
    materials: (materials, columns), of what `RayMarch.materials` holds; `RayMarch.columns` names the columns, and rows
    are those of the materials of all boxes, then of all surfaces. lamps: (lamps, 4), by position [1/m], or by the unit
    direction of a far lamp, and by intensity. rays: by origins [1/m] and by directions, (rays, 3) each; those by
    directions are at a right angle to them.
    """

    light: RayLight
    density: tuple[NDArray[np.float64], ...] | None = None
    axis: tuple[NDArray[np.float64], ...] | None = None
    colour: tuple[NDArray[np.float64] | None, ...] | None = None
    materials: NDArray[np.float64] | None = None
    lamps: NDArray[np.float64] | None = None
    rays: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None


ByLight: TypeAlias = ArrayLike | RayLight | Callable[[RayLight], ArrayLike | RayLight]


def ray_gradient(
    prepared: PreparedScene, origin: Array3f, direction: Array3f, by_light: ByLight, by: Sequence[str]
) -> RayGradient:
    """See `RayMarch.gradient`. The origins count from that of the scene; directions are unit."""
    medium = prepared.medium
    if not isinstance(medium, DifferentiableMedium):
        raise InputError("gradients are of boxes that are prepared for them: RayMarch(scene, differentiable=True)")
    _check(prepared, medium, by)
    count = dr.width(origin, direction)
    lamps = [row.light for row in prepared.lighting.lamps] if "lamps" in by else []
    moving = Moving("rays" in by, lamps, count)
    with _tracked(prepared, medium, by, moving) as (tracked, adjoint):
        with dr.suspend_grad():
            back, far = prepared.behind(origin, direction)
        rays, on_surface = Rays(origin, direction, far), dr.isfinite(far)
        front, passed = adjoint.forward(rays)
        dr.eval(front, passed, back, far)
        seen = [dr.fma(passed, surface, matter) for matter, surface in zip(front, back, strict=True)]
        light = as_light(seen, dr.select(on_surface, 0.0, passed))
        if not by:
            return RayGradient(light)
        by_weights, by_passed = _by_light(by_light, light)
        by_all = _product(by_weights, back) + dr.select(on_surface, 0.0, by_passed)
        moved = adjoint.backward(rays, by_weights, dr.fma(passed, by_all, _product(by_weights, front)))
        if prepared.surfaces:
            on_surfaces = _surfaces_back(prepared, adjoint, rays, [passed * each for each in by_weights])
            moved = [one + other for one, other in zip(moved, on_surfaces, strict=True)]
        found = {name: _read(values, medium, name) for name, values in tracked.items() if name in by}
    return RayGradient(light, **found, **_moved(np.array([np.array(each, np.float64) for each in moved]), moving, by))


def _check(prepared: PreparedScene, medium: DifferentiableMedium, by: Sequence[str]) -> None:
    """`InputError` for what has no gradient."""
    unknown = [name for name in by if name not in NAMES]
    if isinstance(by, str) or unknown:
        raise InputError(f"by is {by!r}: give a tuple of some of {', '.join(NAMES)}")
    if "colour" in by and medium.colours is None:
        raise InputError("by colour: no box has a colour per voxel; ask for materials")
    if "rays" in by and prepared.surfaces:
        raise InputError("by rays: the scene has surfaces, on which rays have no gradient; leave them out")
    if "lamps" in by and any(row.shares for row in prepared.lighting.lamps):
        raise InputError("by lamps: some stand at one place; give them places of their own, or join their spectra")


@contextmanager
def _tracked(
    prepared: PreparedScene, medium: DifferentiableMedium, by: Sequence[str], moving: Moving
) -> Iterator[tuple[dict[str, Any], MarchAdjoint]]:
    """Arrays of the march, those that the gradient is by being tracked, and the adjoint. The march is as it was
    afterwards.
    """
    lighting, threshold = prepared.lighting, dr.expand_threshold()
    before, jit = (medium.voxels, medium.colours, lighting.materials.rows), arrays()
    assert isinstance(medium.voxels, PlainVoxels)
    medium.voxels = voxels = SplitVoxels.of(medium.voxels)
    try:
        medium.colours = None if medium.colours is None else jit.Float(medium.colours)
        lighting.materials.rows = rows = jit.Float(dr.detach(lighting.materials.rows))
        tracked = {"density": voxels.densities, "axis": voxels.axes, "colour": medium.colours, "materials": rows}
        dr.enable_grad([values for name, values in tracked.items() if name in by])
        dr.set_expand_threshold(COPIED_BYTES // (4 * dr.thread_count()))
        shaded, turned = medium.flakes is not None and "axis" in by, medium.shadow_biases is not None and "axis" in by
        shadows = ShadowsBack(medium, "density" in by or shaded, moving.count > 0 or turned)
        medium.marched_back = shadows
        yield tracked, MarchAdjoint(medium, lighting, shadows, "density" in by, moving)
    finally:
        medium.voxels, medium.colours, lighting.materials.rows = before
        medium.marched_back = None
        moving.release()
        dr.set_expand_threshold(threshold)


def _surfaces_back(prepared: PreparedScene, adjoint: MarchAdjoint, rays: Rays, by_channels: list[Float]) -> list[Float]:
    """Differentiate the light of surfaces behind all boxes, with the shadows of the boxes; that by what moves."""
    moving, shadows = adjoint.moving, adjoint.shadows
    moving.track(rays)

    def light() -> Float:
        channels, _ = prepared.behind(rays.origin, rays.direction)
        return _product(by_channels, channels)

    shadows.differentiate(light)
    return moving.gradients()


def _product(some: Sequence[Float], others: Sequence[Float]) -> Float:
    """Σ some · others."""
    return sum((one * other for one, other in zip(some, others, strict=True)), arrays().Float(0))


def _read(values: Any, medium: DifferentiableMedium, name: str) -> Any:
    """The gradient of an array of the march, as `RayGradient` has it."""
    gradient = np.array(dr.grad(values), np.float64)
    if name == "materials":
        return gradient
    grids: list[Grid | None] = [
        getattr(box.bricks, "colour" if name == "colour" else "density") for box in medium.boxes
    ]
    each = gradient if name == "density" else gradient.reshape(-1, 4)[:, : 3 if name == "axis" else 4]
    pairs = zip(medium.boxes, grids, strict=True)
    return tuple(None if grid is None else on_lattice(box.bricks, grid, each) for box, grid in pairs)


def _moved(numbers: NDArray[np.float64], moving: Moving, by: Sequence[str]) -> dict[str, Any]:
    """Gradients by rays and lamps, from those by all that moves (numbers, rays)."""
    found: dict[str, Any] = {}
    if moving.rays:
        found["rays"] = numbers[:3].T.copy(), numbers[3:6].T.copy()
    if "lamps" in by:
        found["lamps"] = numbers[6 * moving.rays :].reshape(len(moving.lamps), 4, -1).sum(axis=2)
    return found


def _by_light(by_light: ByLight, light: RayLight) -> tuple[list[Float], Float]:
    """The derivative of the loss by each channel and by the transmittance, of every ray."""
    given = by_light(light) if callable(by_light) else by_light
    both = given if isinstance(given, RayLight) else (given, np.zeros(len(light.transmittance)))
    checked = []
    for what, numbers, like in zip(RayLight._fields, both, light, strict=True):
        try:
            numbers = np.asarray(numbers, np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"by_light: {what} hold what is no number: give numbers, {like.shape}") from error
        if numbers.shape != like.shape or not np.isfinite(numbers).all():
            raise InputError(f"by_light: {what} of shape {numbers.shape}: give finite numbers, {like.shape}")
        checked.append(numbers)
    return [column(arrays().Float, each) for each in checked[0].T], column(arrays().Float, checked[1])


def as_light(weights: Sequence[Any], transmittance: Any) -> RayLight:
    """Light of Dr.Jit arrays."""
    dr.eval(weights, transmittance)  # together: one march
    count = max(dr.width(channel) for channel in (*weights, transmittance))
    columns = [np.broadcast_to(np.array(channel, np.float32), (count,)) for channel in weights]
    return RayLight(np.stack(columns, axis=1), np.broadcast_to(np.array(transmittance, np.float32), (count,)).copy())
