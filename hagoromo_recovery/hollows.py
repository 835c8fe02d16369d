"""Hollows: where nothing on a surface explains the light of a part, it may be the opening of a hollow, as of a bowl.

Silhouettes do not show a hollow, and steps from the hull make a dent of it: shading alone is nearly the same for a
shallow and a deep one, and shadows have no derivative. So walls of some thicknesses are tried: matter that is further
than that from all well explained places is taken away, where it is open to a badly explained part. What explains the
photographs best after some steps is taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from hagoromo_recovery.descent.gloss_step import HIT, robust
from hagoromo_recovery.descent.pixel_gradient import SILHOUETTE
from hagoromo_recovery.descent.pixel_table import CHUNK, Drawn
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.near_surface import NearSurface
from hagoromo_recovery.surface_shape import SurfaceShape

if TYPE_CHECKING:
    from hagoromo_recovery.descent.descent import Descent

WALLS = (3.0, 4.5, 6.0)  # thicknesses that are tried [voxel]
BAD = 0.1  # of the light of bright pixels, root mean square, that is left at badly explained places
AROUND = 2.0  # voxels, standard deviation of the means over places
LEAST_OPENING = 30  # badly explained places
REACH = 3  # voxels beside what is taken away in which the distance is that to the new wall
AT_ONCE = 1 << 12  # chunks of pixels


@dataclass(frozen=True)
class FoundHollow:
    """A hollow that photographs asked for. wall_m: thickness of the wall that it began with [m]. left_over: what it
    left unexplained after the steps of its trial, over what the dent of the hull left.
    """

    wall_m: float
    left_over: float


def explained_badly(descent: Descent) -> NDArray[np.bool_]:
    """(nz, ny, nx) whether the light of what is seen near each node of the surface is badly explained."""
    shape = descent.field.shape
    sums, seen = np.zeros((2, int(np.prod(shape))))
    for drawn in _all_of(descent):
        light = descent.rendering.light(drawn)
        square = sum((a - b) ** 2 for a, b in zip(light.channels, drawn.values, strict=True)) / COLOURS
        node = descent.field.nearest_node(drawn.rays.at(light.seen.way))
        shown = (light.opacity > HIT) & (np.array(drawn.weights[1]) > 0.0)
        sums += np.bincount(node[shown], np.array(square, np.float64)[shown], len(sums))
        seen += np.bincount(node[shown], minlength=len(seen))
    means = [ndimage.gaussian_filter(each.reshape(shape), AROUND, mode="constant") for each in (sums, seen)]
    return np.asarray(means[0] > (BAD * descent.pixels.scale) ** 2 * np.maximum(means[1], 1e-9))


def hollowed(shape: SurfaceShape, bad: NDArray[np.bool_], wall: float) -> SurfaceShape | None:
    """The shape with walls of a thickness [voxel] where it is open to badly explained nodes (nz, ny, nx); None where
    nothing is to be taken away.
    """
    near, nodes = NearSurface(shape.field()), shape.distance.shape
    opening = bad & near.nodes
    well = ~bad[near.nodes]
    if opening.sum() < LEAST_OPENING or not well.any():
        return None
    every = np.argwhere(np.ones(nodes, bool))[:, ::-1].astype(np.float64)
    away = KDTree(near.places[well]).query(every)[0].reshape(nodes)
    parts, _ = ndimage.label((shape.distance < 1.0) & (away > wall))
    open_to = np.unique(parts[opening & (parts > 0)])
    taken = np.isin(parts, open_to) & (parts > 0)
    if not (taken & (shape.distance < 0.0)).any():
        return None
    beside = ndimage.binary_dilation(taken, iterations=REACH)
    distance = np.where(beside, np.maximum(shape.distance, away - wall), shape.distance)
    usual = np.median(shape.colours[near.nodes][well], axis=0)
    colours = np.where(beside[..., None], usual, shape.colours)
    return replace(shape, distance=distance.astype(np.float32), colours=colours.astype(np.float32))


def left_over(descent: Descent) -> float:
    """What steps make small: the mean robust squared error of the light and of the opacity of all pixels."""
    total, limit = 0.0, descent.pixels.limit
    for drawn in _all_of(descent):
        light = descent.rendering.light(drawn)
        rest = [a - b for a, b in zip(light.channels, drawn.values, strict=True)]
        opacity = (1.0 - dr.exp(-light.seen.depth)) - drawn.share
        each = -(limit**2) * dr.log(robust(drawn, rest, limit)) + SILHOUETTE * drawn.share_weight * opacity * opacity
        total += float(np.sum(np.array(each, np.float64)))
    return total / descent.pixels.count


def _all_of(descent: Descent) -> Iterator[Drawn]:
    """All pixels of a descent, in parts."""
    chunks = np.arange(descent.pixels.count // CHUNK)
    for first in range(0, len(chunks), AT_ONCE):
        yield descent.pixels.of(chunks[first : first + AT_ONCE])
