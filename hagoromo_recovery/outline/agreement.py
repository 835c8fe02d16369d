"""Agreement: photographs whose masks contradict the others, as of another object, or of one that moved.

An object lies in the hull of its silhouettes, so the hull covers each silhouette. Where it does not, a silhouette lacks
a part of the object, or a pose is wrong: that holds for any object and any number of views. The photographs to name are
those without which the hull of the others covers theirs.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError, listed
from hagoromo_recovery.outline.hull import ALLOWED, COARSE, LEAST_SHOWN, Outline, box_of, first_cube, way_to
from hagoromo_recovery.outline.lattice import Lattice

FREE = 2.0  # px that outlines may be wrong by
UNCOVERED = 0.05  # share of a silhouette up to which the hull may leave it uncovered
SHADED = 0.5  # share of the photographs at most whose silhouettes miss a place in its shadow
HELD = 1.0  # [voxel] outside the hull that count as in it: thin parts between nodes


class Shadow:
    """What a photograph says of the nodes of a lattice. distance: (nodes,) to its cone [voxel], −inf where it does not
    show them.
    """

    def __init__(self, outline: Outline, lattice: Lattice) -> None:
        nodes, camera = lattice.nodes().reshape(-1, 3), outline.camera
        own, shown = outline.seen_at(nodes)
        self.distance = np.where(shown, own / lattice.voxel, -np.inf)
        covers = lattice.voxel * min(camera.focal) / float(np.linalg.norm(camera.position - lattice.middle))  # px
        step = max(1, int(0.5 * covers))  # pixels that are joined
        self.inner = outline.distance[step // 2 :: step, step // 2 :: step] < -FREE
        self.reach = covers / step
        with np.errstate(all="ignore"):
            image = np.where(shown[:, None], camera.project(nodes), 0.0) / step
        column, row = (np.clip(image[:, k].astype(int), 0, self.inner.shape[1 - k] - 1) for k in (0, 1))
        self.pixel = np.where(shown, row * self.inner.shape[1] + column, -1)

    def uncovered(self, hull: NDArray[np.bool_]) -> float:
        """Share of its silhouette that nodes of a hull do not cover."""
        if not self.inner.any():
            return 0.0
        pixel = self.pixel[hull]
        there = np.zeros(self.inner.size, np.bool_)
        there[pixel[pixel >= 0]] = True
        if not there.any():
            return 1.0
        return float((way_to(there.reshape(self.inner.shape))[self.inner] > self.reach).mean())


def misses_of(outlines: Sequence[Outline]) -> int:
    """How many photographs may miss a place of the object, where silhouettes are what is bright in them.

    What lies in shadow is missing from a silhouette. The hull covers all that photographs show: it is the smallest that
    does, but for a share of ALLOWED of them, which some background may spoil; where none does, the one that leaves
    least.
    """
    count, (centre, size) = len(outlines), first_cube(outlines)
    lattice = Lattice.around(centre - size, centre + size, COARSE)
    shadows = [Shadow(outline, lattice) for outline in outlines]
    distance = np.sort(np.stack([shadow.distance for shadow in shadows]), axis=0)[::-1]
    shown = np.isfinite(distance).sum(axis=0) >= LEAST_SHOWN * count
    left: dict[int, float] = {}
    for misses in range(int(ALLOWED * count), max(int(SHADED * count), 1) + 1):
        each = [shadow.uncovered((distance[misses] < HELD) & shown) for shadow in shadows]
        left[misses] = float(np.quantile(each, 1.0 - ALLOWED))
        if left[misses] <= UNCOVERED:
            return misses
    return min(left, key=lambda misses: left[misses])


def check_agree(outlines: Sequence[Outline]) -> None:
    """`InputError` that names a few photographs whose masks contradict all others; a warning where many do."""
    low, high = box_of(outlines)
    lattice = Lattice.around(low, high, COARSE)
    shadows = {number: Shadow(outline, lattice) for number, outline in enumerate(outlines)}
    worst, against = max(_left(shadows).values()), []
    if worst <= UNCOVERED:
        return
    while len(against) < int(max(ALLOWED * len(outlines), 1.0)):
        without = {k: _left({j: s for j, s in shadows.items() if j != k}) for k in shadows}
        odd = min(without, key=lambda k: sum(without[k].values()))
        against.append(odd)
        del shadows[odd]
        if max(without[odd].values()) <= UNCOVERED:
            named = listed([outlines[k].name for k in sorted(against)])
            raise InputError(
                f"the masks of {len(against)} of {len(outlines)} photographs contradict all others: {named}; "
                f"{100.0 * worst:.0f} % of a mask is outside the object that the others allow. Leave them out, or mend "
                "their masks or poses: do they show the same object, and did it stand still?"
            )
    warnings.warn(
        f"masks of photographs contradict one another: up to {100.0 * worst:.0f} % of a mask is outside the object "
        "that the others allow, and is cut off. Check poses and masks; --refine cameras mends poses that are a little "
        "wrong",
        stacklevel=3,
    )


def _left(shadows: dict[int, Shadow]) -> dict[int, float]:
    """Of each photograph the share of its silhouette that the hull of all does not cover."""
    distance = np.stack([shadow.distance for shadow in shadows.values()])
    shown = np.isfinite(distance).sum(axis=0) >= LEAST_SHOWN * len(distance)
    hull = (distance.max(axis=0) < HELD) & shown
    return {number: shadow.uncovered(hull) for number, shadow in shadows.items()}
