"""Hull: where the object can be, by its silhouettes in all photographs (Laurentini 1994)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.photograph.photograph import Photograph
from hagoromo.recovery.lattice import Lattice

Array = NDArray[np.float64]
COARSE = 48  # nodes along an edge while the box is looked for
MARGIN = 0.06  # of the object's extent, free on each side of it
ROUNDS = 3
LEAST_SHOWN = 0.5  # share of the photographs that must show a place of the object
ALLOWED = 0.15  # share of the photographs whose silhouettes may miss a part, where no masks state them
CRUMB = 0.01  # size of a part, in that of the largest, below which it is a crumb
NAMED = 5  # photographs that a message names


def box_of(
    photographs: Sequence[Photograph], silhouettes: Sequence[NDArray[np.bool_]], stated: bool = True
) -> tuple[Array, Array]:
    """Low and high corner (3,) [m] of the object, with a margin. `InputError` where the silhouettes meet nowhere.

    stated: see `hull_distance`.
    """
    centre, size = _first_cube(photographs, silhouettes)
    low, high = centre - size, centre + size
    for _ in range(ROUNDS):
        lattice = Lattice.around(low, high, COARSE)
        inside = hull_distance(photographs, silhouettes, lattice, stated) < 1.0  # voxel: thin parts between nodes count
        if not inside.any():
            raise InputError(_no_hull(photographs, silhouettes, lattice))
        held = [np.flatnonzero(inside.any(axis=tuple(k for k in range(3) if k != axis))) for axis in (2, 1, 0)]
        first, last = (np.array([each[end] for each in held], float) for end in (0, -1))
        low, high = lattice.to_world(first - 1.0), lattice.to_world(last + 1.0)
    edge = MARGIN * (high - low).max()
    return low - edge, high + edge


def hull_distance(
    photographs: Sequence[Photograph],
    silhouettes: Sequence[NDArray[np.bool_]],
    lattice: Lattice,
    stated: bool = True,
) -> Array:
    """Signed distance (nz, ny, nx) [voxel] to the hull, about right near its surface: negative inside.

    A place that a photograph does not show is not carved by it; one that fewer than a share of LEAST_SHOWN of the
    photographs show is outside. stated: whether silhouettes are exact; if not, a share
    of ALLOWED of the photographs that show a place may miss it, as where it is in shadow.
    """
    nodes = lattice.nodes().reshape(-1, 3)
    largest = [np.full(len(nodes), -np.inf)] * (1 if stated else 1 + int(ALLOWED * len(photographs)))
    views = np.zeros(len(nodes), np.int32)
    for photograph, silhouette in zip(photographs, silhouettes, strict=True):
        own, shown = _distance_in(photograph.camera, silhouette, nodes)
        own, views = np.where(shown, own / lattice.voxel, -np.inf), views + shown
        for k, held in enumerate(largest):
            largest[k], own = np.maximum(held, own), np.minimum(held, own)
    distance = largest[-1].copy()
    distance[(views < LEAST_SHOWN * len(photographs)) | ~np.isfinite(distance)] = 1e3
    return distance.reshape(lattice.shape)


def check_all_show_it(
    photographs: Sequence[Photograph], silhouettes: Sequence[NDArray[np.bool_]], lattice: Lattice, hull: Array
) -> None:
    """`InputError` that names the photographs whose silhouettes hold nothing of the hull that the others make."""
    inside = lattice.nodes()[hull < 1.0]
    against = []
    for photograph, silhouette in zip(photographs, silhouettes, strict=True):
        own, shown = _distance_in(photograph.camera, silhouette, inside)
        if not (shown & (own < lattice.voxel)).any():
            against.append(photograph.name)
    if against:
        raise InputError(_said(against, len(photographs)))


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
    outer, inner = way_to(inside), way_to(~inside)
    far = np.where(inside, 0.5 - inner, outer - 0.5)
    share = np.clip(np.abs(far) / reach - 1.0, 0.0, 1.0)  # near the surface the old values stay
    near = np.clip(distance, -2.0 * reach, 2.0 * reach)
    return np.asarray(share * far + (1.0 - share) * near, np.float32)


def way_to(there: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each place to the nearest one that is `there`, in steps of the array."""
    return np.asarray(ndimage.distance_transform_edt(~there), np.float64)


def _first_cube(photographs: Sequence[Photograph], silhouettes: Sequence[NDArray[np.bool_]]) -> tuple[Array, float]:
    """The place that is nearest to the rays through the middles of all silhouettes, and half an edge that holds all."""
    places, ways, sizes = [], [], []
    for photograph, silhouette in zip(photographs, silhouettes, strict=True):
        rows, columns = np.nonzero(silhouette)
        if not rows.size:
            continue
        low, high = (np.array([f(columns), f(rows)], float) for f in (np.min, np.max))
        middle = 0.5 * (low + high) + 0.5
        places.append(photograph.camera.position)
        ways.append(photograph.camera.unproject(middle))
        sizes.append(0.5 * float((high - low + 1.0).max()) / min(photograph.camera.focal))
    if len(places) < 2:
        raise InputError("fewer than two photographs show the object: give masks that are white on it")
    origin, way = np.stack(places), np.stack(ways)
    across = np.eye(3) - way[:, :, None] * way[:, None, :]
    centre = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, origin), rcond=None)[0]
    depth = np.linalg.norm(centre - origin, axis=1)
    return centre, 1.3 * float(np.max(np.array(sizes) * depth))


def _distance_in(camera: Camera, silhouette: NDArray[np.bool_], points: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Signed distance [m] to the cone of a silhouette at points (n, 3), and where the photograph shows them."""
    outer, inner = way_to(silhouette), way_to(~silhouette)
    flat = np.where(silhouette, 0.5 - inner, outer - 0.5)  # px
    depth = (points - camera.position) @ camera.world_to_camera[2, :3]
    ahead = depth > 0.0
    with np.errstate(all="ignore"):
        image = camera.project(points)
    image = np.where(ahead[:, None] & np.isfinite(image), image, -1.0)
    height, width = silhouette.shape
    shown = (image[:, 0] >= 0.0) & (image[:, 0] < width) & (image[:, 1] >= 0.0) & (image[:, 1] < height)
    value = ndimage.map_coordinates(flat, [image[:, 1] - 0.5, image[:, 0] - 0.5], order=1, mode="nearest")
    return value * depth / min(camera.focal), shown


def _no_hull(photographs: Sequence[Photograph], silhouettes: Sequence[NDArray[np.bool_]], lattice: Lattice) -> str:
    """What is said where no place is in all silhouettes: the photographs that disagree with most."""
    nodes = lattice.nodes().reshape(-1, 3)
    inside = []
    for photograph, silhouette in zip(photographs, silhouettes, strict=True):
        own, shown = _distance_in(photograph.camera, silhouette, nodes)
        inside.append(shown & (own < lattice.voxel))
    votes = np.sum(inside, axis=0)
    best = votes == votes.max()
    against = [p.name for p, own in zip(photographs, inside, strict=True) if not own[best].any()]
    return _said(against, len(photographs))


def _said(against: Sequence[str], count: int) -> str:
    """The message that names photographs that disagree."""
    named = ", ".join(against[:NAMED]) + (f" and {len(against) - NAMED} more" if len(against) > NAMED else "")
    return (
        f"the masks of {count} photographs meet nowhere: {named or 'some'} disagree with the others; check their poses "
        "(units, axes) and masks"
    )
