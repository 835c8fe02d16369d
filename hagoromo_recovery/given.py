"""Given: what a capture must hold for a recovery; each fault is one line that says what to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError, listed
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView

LEAST_VIEWS = 3
MOST_CUT = 0.5  # share of the photographs that may cut the object at their edge
LEAST_ANGLE = 2.0  # ° between the directions of two lamps at least
LIGHT, LIT_SHARE = 5.0, 1e-3  # standard deviations of noise above which a pixel has light; of the valid ones at least
DEEP = -2.0  # [voxel] of the hull: a lamp that is deeper stands in the object


def checked(capture: Capture) -> tuple[Photograph, ...]:
    """The photographs of a capture that can be recovered from; `InputError` for what cannot."""
    photographs = capture.photographs
    places = {p.camera.world_to_camera.tobytes() for p in photographs}
    if len(places) < LEAST_VIEWS:
        raise InputError(
            f"capture {capture.name!r} has {len(places)} view(s): recover needs photographs from {LEAST_VIEWS} places "
            "at least; `measure` takes one view under many lamps"
        )
    channels = {p.values.shape[2] for p in photographs} - {1, COLOURS}
    if channels:
        raise InputError(f"photographs have {channels.pop()} channels: recover takes one or three")
    lit = [bool(p.lamps) for p in photographs]
    if any(lit) and not all(lit):
        dark = [p.name for p in photographs if not p.lamps]
        raise InputError(
            f"{len(dark)} of {len(lit)} photographs have no lamp ({dark[0]}): give lamps to all or to none"
        )
    return photographs


def with_light(photographs: Sequence[Photograph]) -> tuple[tuple[Photograph, ...], tuple[str, ...]]:
    """The photographs that show light above their noise, and the names of the others: a lamp that did not flash would
    make what it should light black. `InputError` where too few are left.
    """
    bright = [_has_light(p) for p in photographs]
    dark = tuple(p.name for p, lit in zip(photographs, bright, strict=True) if not lit)
    if len(dark) == len(photographs):
        raise InputError("the photographs hold only darkness or clipped pixels: nothing can be recovered")
    left = tuple(p for p, lit in zip(photographs, bright, strict=True) if lit)
    if len({p.camera.world_to_camera.tobytes() for p in left}) < LEAST_VIEWS:
        raise InputError(
            f"{len(dark)} of {len(photographs)} photographs show no light above their noise, or clipped pixels alone: "
            f"{listed(list(dark))}; too few are left: did their lamps flash?"
        )
    return left, dark


def _has_light(photograph: Photograph) -> bool:
    """Whether valid pixels of a photograph are brighter than its noise."""
    if not photograph.mask.any():
        return False
    values, variance = (each[photograph.mask].mean(axis=1) for each in (photograph.values, photograph.variance))
    noise = np.sqrt(variance / photograph.values.shape[2])
    return bool((values > LIGHT * noise).mean() > LIT_SHARE)


def kept_aside(count: int, keep: int) -> list[bool]:
    """Whether each photograph is kept aside: every `keep`-th, if enough are left."""
    aside = [keep > 0 and k % keep == keep - 1 for k in range(count)]
    return aside if count - sum(aside) >= LEAST_VIEWS else [False] * count


def check_not_cut(views: Sequence[ObjectView]) -> None:
    """`InputError` where most photographs show a part of the object only."""
    edges = [(view.silhouette[[0, -1]].any() or view.silhouette[:, [0, -1]].any()) for view in views]
    cut = [view.photograph.name for view, is_cut in zip(views, edges, strict=True) if is_cut]
    if len(cut) > MOST_CUT * len(views):
        raise InputError(
            f"{len(cut)} of {len(views)} photographs cut the object at their edge ({cut[0]}, …): recover needs "
            "the whole object in most of them, with background around it"
        )


def check_lamps(photographs: Sequence[Photograph], lattice: Lattice, hull: NDArray[np.floating]) -> None:
    """`InputError` for a lamp in the object, and where all lamps stand in one direction. hull: see `hull_distance`."""
    directions = []
    for photograph in photographs:
        for lamp in photograph.lamps:
            offset = lamp.place - lattice.middle if lamp.near else lamp.place
            directions.append(offset / max(float(np.linalg.norm(offset)), 1e-12))
            if lamp.near and _inside(lamp.place, lattice, hull):
                where = ", ".join(f"{x:.4g}" for x in lamp.place)
                raise InputError(
                    f"the lamp of photograph {photograph.name!r} at ({where}) m stands in the object: check its "
                    "position and its units [m]"
                )
    if directions and (np.stack(directions) @ directions[0]).min() > np.cos(np.radians(LEAST_ANGLE)):
        raise InputError(
            f"all {len(directions)} lamps stand in one direction, within {LEAST_ANGLE:g}°: give lamps from other "
            "sides, or leave all lamps out to recover the object under fixed light"
        )


def _inside(place: NDArray[np.floating], lattice: Lattice, hull: NDArray[np.floating]) -> bool:
    at = np.rint(lattice.from_world(place)).astype(int)[::-1]
    if (at < 0).any() or (at >= np.array(lattice.shape)).any():
        return False
    return bool(hull[tuple(at)] < DEEP)
