"""Remarks: what the user of a recovery should know, of its object and of its photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hagoromo.errors import listed
from hagoromo_recovery.descent.light_between import WHITEST as WHITEST_SENT
from hagoromo_recovery.descent.light_between import share_between
from hagoromo_recovery.explained import said_of
from hagoromo_recovery.field.near_surface import THICK
from hagoromo_recovery.outline.lattice import LARGEST_SIDE

if TYPE_CHECKING:
    from hagoromo_recovery.recovered import Recovered

UNLIT = 0.1  # share of the surface that no photograph shows lit, from which that is said
BEYOND = 0.15  # voxels of outlines outside those of masks, from which that is said
BETWEEN, WHITEST = 0.1, 90  # share of light from other parts that is said; percentile of places that have it
THIN = 0.02  # share of the surface of matter that is too thin for the lattice, from which that is said


def remarks_on(recovered: Recovered) -> list[str]:
    """All that is said of a recovery."""
    said = [_of_brightness(recovered)] if recovered.brightest > 1.0 else []
    if recovered.never_shown > UNLIT:
        said.append(
            f"{100.0 * recovered.never_shown:.0f} % of the surface is lit in no photograph: its body colours are not "
            "known, and it is closed smoothly"
        )
    if recovered.matter == "surface" and recovered.near_surface.nodes.any():
        said += [*_of_thin_matter(recovered), *_of_sharp_edges(recovered)]
        said += _of_light_between(recovered) if recovered.lit and recovered.orders == "first" else []
    if recovered.dark:
        said.append(
            f"{len(recovered.dark)} photographs show no light above their noise, or clipped pixels alone, and were "
            f"left out: {listed(list(recovered.dark))}; did their lamps flash?"
        )
    said += [] if recovered.masks is None else [recovered.masks.said]
    return said + said_of(recovered.explained, recovered.stated)


def _of_brightness(recovered: Recovered) -> str:
    what, why = "light that is sent out", "the unit of the photographs is no share of all light"
    if recovered.lit:
        what = "body colours"
        why = "lamps are stated too weak or too far for the values of the photographs"
        if recovered.orders == "first":
            why += ", or parts of a white object light each other"
    said = (
        f"{what} reach {recovered.brightest:.3g}, and 1 is all light: {why}. Only their ratios are known; box and mesh "
        f"are dimmed by {recovered.dim:.3g}"
    )
    if recovered.orders == "all":
        said += f"; light between parts was computed with body colours of {WHITEST_SENT:g} at most"
    return said


def _of_thin_matter(recovered: Recovered) -> list[str]:
    thickness = recovered.near_surface.thickness
    thin = np.isfinite(thickness)
    if thin.mean() < THIN:
        return []
    usual, nodes = float(np.median(thickness[thin])), max(recovered.lattice.shape)
    more = f"give more nodes (--side {2 * nodes})" if 2 * nodes <= LARGEST_SIDE else "photograph it by itself"
    return [
        f"matter behind {100.0 * thin.mean():.0f} % of the surface is thinner than {THICK:g} voxels: {nodes} nodes do "
        f"not hold it. It looks {1e3 * recovered.lattice.voxel * usual:.2g} mm thick in the median, and may be much "
        f"thinner; no errors are stated there; {more}"
    ]


def _of_sharp_edges(recovered: Recovered) -> list[str]:
    beyond = recovered.beyond
    if beyond < BEYOND * recovered.lattice.voxel:
        return []
    return [
        f"outlines of the object stand {1e3 * beyond:.2g} mm outside its masks on the mean, as where edges are sharper "
        "than a voxel: faces between them stand out, too, and errors of positions hold that; give more nodes (--side)"
    ]


def _of_light_between(recovered: Recovered) -> list[str]:
    """By form and body colours that were found, under the lamps of the photographs."""
    most = float(np.percentile(share_between(recovered), WHITEST))
    if most < BETWEEN:
        return []
    return [
        f"a tenth of the surface has {100.0 * most:.0f} % of its light, or more, from other parts of the object, which "
        "is taken for light of lamps: body colours are too bright there, and hollows look too flat; give --orders all"
    ]
