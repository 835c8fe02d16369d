"""Hull: where the object can be, by its silhouettes in all photographs (Laurentini 1994)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError, listed
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView

Array = NDArray[np.float64]
COARSE = 48  # nodes along an edge while the box is looked for
MARGIN = 0.06  # of the object's extent, free on each side of it
ROUNDS = 3
LEAST_SHOWN = 0.5  # share of the photographs that must show a place of the object
ALLOWED = 0.15  # share of the photographs whose silhouettes may miss a part, where no masks state them
CRUMB = 0.01  # size of a part, in that of the largest, below which it is a crumb


class Outline(NamedTuple):
    """The outline of the object in a photograph. distance: (h, w) signed distance of pixels to it [px], float32."""

    name: str
    camera: Camera
    distance: NDArray[np.float32]

    def seen_at(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Signed distance [m] to the cone of the silhouette at points (n, 3), and where the photograph shows them."""
        depth = (points - self.camera.position) @ self.camera.world_to_camera[2, :3]
        ahead = depth > 0.0
        with np.errstate(all="ignore"):
            image = self.camera.project(points)
        image = np.where(ahead[:, None] & np.isfinite(image), image, -1.0)
        height, width = self.distance.shape
        shown = (image[:, 0] >= 0.0) & (image[:, 0] < width) & (image[:, 1] >= 0.0) & (image[:, 1] < height)
        at = [image[:, 1] - 0.5, image[:, 0] - 0.5]
        value = ndimage.map_coordinates(self.distance, at, np.float64, order=1, mode="nearest")
        return value * depth / min(self.camera.focal), shown

    def holds(self, points: Array, margin: float) -> NDArray[np.bool_]:
        """Whether points (n, 3) are shown within `margin` [m] of the silhouette."""
        distance, shown = self.seen_at(points)
        return shown & (distance < margin)


def outlines_of(views: Sequence[ObjectView]) -> list[Outline]:
    """The outlines of the object in all views."""
    return [
        Outline(v.photograph.name, v.photograph.camera, signed_distance(v.silhouette).astype(np.float32)) for v in views
    ]


def box_of(outlines: Sequence[Outline], misses: int = 0) -> tuple[Array, Array]:
    """Low and high corner (3,) [m] of the object, with a margin. `InputError` where the silhouettes meet nowhere.

    misses: see `hull_distance`.
    """
    centre, size = first_cube(outlines)
    low, high = centre - size, centre + size
    for _ in range(ROUNDS):
        lattice = Lattice.around(low, high, COARSE)
        inside = hull_distance(outlines, lattice, misses) < 1.0  # voxel: thin parts between nodes count
        if not inside.any():
            raise InputError(_no_hull(outlines, lattice))
        held = [np.flatnonzero(inside.any(axis=tuple(k for k in range(3) if k != axis))) for axis in (2, 1, 0)]
        first, last = (np.array([each[end] for each in held], float) for end in (0, -1))
        low, high = lattice.to_world(first - 1.0), lattice.to_world(last + 1.0)
    edge = MARGIN * (high - low).max()
    return low - edge, high + edge


def hull_distance(outlines: Sequence[Outline], lattice: Lattice, misses: int = 0) -> Array:
    """Signed distance (nz, ny, nx) [voxel] to the hull, about right near its surface: negative inside.

    A place that a photograph does not show is not carved by it; one that fewer than a share of LEAST_SHOWN of the
    photographs show is outside. misses: photographs whose silhouettes may miss a place, as where it is in shadow; 0
    where silhouettes are exact.
    """
    nodes = lattice.nodes().reshape(-1, 3)
    largest = [np.full(len(nodes), -np.inf)] * (1 + misses)
    views = np.zeros(len(nodes), np.int32)
    for outline in outlines:
        own, shown = outline.seen_at(nodes)
        own, views = np.where(shown, own / lattice.voxel, -np.inf), views + shown
        for k, held in enumerate(largest):
            largest[k], own = np.maximum(held, own), np.minimum(held, own)
    distance = largest[-1].copy()
    distance[(views < LEAST_SHOWN * len(outlines)) | ~np.isfinite(distance)] = 1e3
    return distance.reshape(lattice.shape)


def check_all_show_it(outlines: Sequence[Outline], lattice: Lattice, hull: Array) -> None:
    """`InputError` that names the photographs whose silhouettes hold nothing of the hull that the others make."""
    inside = lattice.nodes()[hull < 1.0]
    against = [each.name for each in outlines if not each.holds(inside, lattice.voxel).any()]
    if against:
        raise InputError(_said(against, len(outlines)))


def without_crumbs(distance: NDArray[np.floating]) -> NDArray[np.floating]:
    """The distance without parts that are much smaller than the largest one: clouds that no photograph forbids."""
    from skimage.measure import label

    parts = np.asarray(label(distance < 0.0, connectivity=1))
    sizes = np.bincount(parts.ravel())[1:]
    if len(sizes) < 2:
        return distance
    small = np.flatnonzero(sizes < CRUMB * sizes.max()) + 1
    crumbs = np.isin(parts, small)
    near = (way_to(crumbs) <= 2.0) & ~((parts > 0) & ~crumbs)
    return np.where(near, np.maximum(np.abs(distance), 1.0), distance)


def redistanced(distance: NDArray[np.floating], reach: float = 2.0) -> NDArray[np.float32]:
    """A signed distance with the same surface whose far values are distances again [voxel]."""
    inside = distance < 0.0
    if not inside.any() or inside.all():
        return np.asarray(distance, np.float32)
    far = signed_distance(inside)
    share = np.clip(np.abs(far) / reach - 1.0, 0.0, 1.0)  # near the surface the old values stay
    near = np.clip(distance, -2.0 * reach, 2.0 * reach)
    return np.asarray(share * far + (1.0 - share) * near, np.float32)


def signed_distance(inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each place to the border of what is `inside`, in steps of the array; negative inside."""
    return np.where(inside, 0.5 - way_to(~inside), way_to(inside) - 0.5)


def way_to(there: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each place to the nearest one that is `there`, in steps of the array."""
    return np.asarray(ndimage.distance_transform_edt(~there), np.float64)


def first_cube(outlines: Sequence[Outline]) -> tuple[Array, float]:
    """The place that is nearest to the rays through the middles of all silhouettes, and half an edge that holds all."""
    places, ways, sizes = [], [], []
    for outline in outlines:
        rows, columns = np.nonzero(outline.distance < 0.0)
        if not rows.size:
            continue
        low, high = (np.array([f(columns), f(rows)], float) for f in (np.min, np.max))
        places.append(outline.camera.position)
        ways.append(outline.camera.unproject(0.5 * (low + high) + 0.5))
        sizes.append(0.5 * float((high - low + 1.0).max()) / min(outline.camera.focal))
    if len(places) < 2:
        raise InputError("fewer than two photographs show the object: give masks that are white on it")
    origin, way = np.stack(places), np.stack(ways)
    across = np.eye(3) - way[:, :, None] * way[:, None, :]
    centre = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, origin), rcond=None)[0]
    depth = np.linalg.norm(centre - origin, axis=1)
    return centre, 1.3 * float(np.max(np.array(sizes) * depth))


def _no_hull(outlines: Sequence[Outline], lattice: Lattice) -> str:
    """What is said where no place is in all silhouettes: the photographs that disagree with most."""
    nodes = lattice.nodes().reshape(-1, 3)
    inside = [outline.holds(nodes, lattice.voxel) for outline in outlines]
    votes = np.sum(inside, axis=0)
    best = votes == votes.max()
    against = [outline.name for outline, own in zip(outlines, inside, strict=True) if not own[best].any()]
    return _said(against, len(outlines))


def _said(against: Sequence[str], count: int) -> str:
    """The message that names photographs that disagree."""
    return (
        f"the masks of {count} photographs meet nowhere: {listed(against) or 'some'} disagree with the others; check "
        "their poses (units, axes) and masks"
    )
