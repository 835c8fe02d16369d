"""Shell: a surface that carries micro-structure → the plan of a box with a chart and a texel. Lengths in mm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import clip
from hagoromo.matter.fill import MM, blocks_in
from hagoromo.matter.shape import Shape
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.chart import chart_words
from hagoromo.volume.box_header import BoxHeader, Extinction
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.texel import Texel
from hagoromo_matter.texel.texel_match import matched

AROUND = 1.75  # voxels beyond the texel's heights in which the chart is stored: the diagonal of a voxel
ENCODED_BAND = 4.0  # voxels beyond them over which heights are encoded
LOWEST = 1e-3  # code of every height below the band: 0 would mean an empty voxel


class Chart(NamedTuple):
    """Coordinates of points on a surface.

    height: signed distance [mm]. normal: unit, towards greater heights. u, v: arc length on the surface [mm], the one
    growing along the unit tangent `along_u`, the other along normal × along_u; they may jump by whole periods of the
    texel. presence: 1 where there is matter, falling linearly to 0 over a few voxels across a hem, which lies at ½.
    """

    height: Any
    normal: Any
    u: Any
    v: Any
    along_u: Any
    presence: Any = 1.0


def shell(
    chart: Callable[[Any], Chart],
    bound: Shape,
    extent: tuple[Sequence[float], Sequence[float]],
    voxel_mm: float,
    texel: Texel,
    mean_free_path_mm: float,
    materials: Sequence[Reflectance],
    extinction: Extinction = "isotropic",
    **record: Any,
) -> BoxPlan:
    """The box whose `chart`, a function of the point [mm], lays the texel on a surface.

    bound: a Shape [mm], a lower bound of the distance to the surface (height 0). extent: low and high corner
    [mm]. voxel_mm: edge of the voxels of the chart; the curvature of the surface decides it. mean_free_path_mm: of
    light where the density is 1. materials: one per population of the texel. extinction: see `VolumeBox`. record:
    name and provenance.
    """
    bottom, top = texel.bottom / MM, texel.top / MM
    low, high = bottom - ENCODED_BAND * voxel_mm, top + ENCODED_BAND * voxel_mm
    scale = 1.0 / (high - low)

    def field(point: Any) -> dict[str, Any]:
        here = chart(point)
        outside = dr.fmax(bottom - here.height, here.height - top)
        u, v = here.u * (MM / texel.period[0]), here.v * (MM / texel.period[1])
        return {
            "density": clip((here.height - low) * scale, LOWEST, 1.0),
            "axis": here.normal,
            "chart": chart_words(u, v, here.along_u, here.presence),
            "kept": dr.select((outside < AROUND * voxel_mm) & (here.presence > 0.0), 1.0, 0.0 * here.height),
        }

    tau = 1.0 / (mean_free_path_mm * MM)
    texel = matched(texel, tau, materials, extinction)
    reach = max(abs(bottom), abs(top)) + AROUND * voxel_mm
    blocks, pose = blocks_in(field, lambda p: bound(p) - reach, extent, voxel_mm)
    header = BoxHeader(
        voxel_mm * MM, tau, tuple(materials), pose, texel=texel, band=(low * MM, high * MM), extinction=extinction,
        **record,
    )  # fmt: skip
    return BoxPlan(header, blocks)
