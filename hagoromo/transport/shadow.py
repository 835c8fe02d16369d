"""Shadow: transmittance of the volume boxes from each lamp to a point, by marching or by deep shadow maps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Float, arrays, lookup
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_light import LampInTurn
from hagoromo.transport.frames import DEFAULT_TOLERANCE
from hagoromo.transport.lighting import Attenuation, WayToLamp
from hagoromo.transport.march import optical_depth
from hagoromo.transport.medium import Medium
from hagoromo.transport.shadow_map import ShadowMaps
from hagoromo.transport.texel_shadow import cone_of, optical_depth_on_way_out, way_out
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import BRICK

TEXELS_PER_VOXEL = 1.8  # texels of a shadow map per smallest voxel, at DEFAULT_TOLERANCE
FINER, COARSER = 0.25, 0.5  # powers of the tolerance by which they grow below it, and fall above it
COARSEST_TEXEL = 64.0  # [voxel] along a texel of the finest map that is still of use
MOST_TEXELS = 1024  # along a side of a shadow map: 96 MiB a lamp
# where the three map rays around a point differ by more, the way to the lamp is marched
LEAST_DIFFERENCE = 0.12  # of transmittance, at DEFAULT_TOLERANCE
DIFFERENCE_SHARE = 0.15  # of the transmittance itself, added to LEAST_DIFFERENCE
DENSE = 0.45  # extinction [1/voxel] beyond which the way is marched near the point, at DEFAULT_TOLERANCE
QUICK_MAP = 384  # texels a side, at DEFAULT_TOLERANCE, up to which maps are always made: boxes are small
MAP_RAYS_PER_RAY = 1.6  # rays of a map for each of the camera from which maps take longer than marches
MAP_RAYS_WITH_JOINED = 0.9  # the same where steps are joined: fewer samples look up shadows
DEEP_BRICK = 0.5  # optical depth of a mean stored brick from which shadow rays are short
LARGEST_SECANT = 4.0  # 1 / cosθ_i up to which the look-up in a map clears the surface's own shadow
HIDDEN_TRANSMITTANCE = 4e-3  # a marched shadow ray ends below this transmittance, at DEFAULT_TOLERANCE
BEHIND_END = 1.5  # optical depth of all matter before a hidden lamp, in that after which its shadow ray ended
MOST_HIDDEN = 0.03  # transmittance above which none does, at DEFAULT_TOLERANCE
ROUGH_FIGURES = 0.5, 3.0  # in rough matter: times TEXELS_PER_VOXEL; times DENSE, LEAST_DIFFERENCE, DIFFERENCE_SHARE
MARCHED_VOXELS = 3.0  # length of that march [voxel], at DEFAULT_TOLERANCE


def brute_attenuation(medium: Medium) -> Attenuation:
    """`Attenuation` by marching from every point to the lamp: slow, but the oracle of the maps."""
    marched = _marched(medium)

    return lambda lamp, way: marched(way, way.distance)


def mapped_attenuation(
    medium: Medium, lamps: Sequence[Lamp], resolution: int | None = None, tolerance: float = DEFAULT_TOLERANCE
) -> Attenuation:
    """`Attenuation` by one deep shadow map a lamp; `resolution` texels a side (default: `fitting_resolution`).

    In dense matter the first few voxels towards the lamp are marched, more where the map is coarser than they are, and
    the map is looked up behind them: else the surface's own shadow shows the texels as bands. Where the
    rays of the map around that place differ, at edges of shadows and under light that grazes, all of the way is
    marched. `tolerance` (see `Settings`) says where.

    From a sample in a texel its cloth is followed out, as if it went on flat to its hem; the map is looked up outside.
    """
    jit, finer, marched = arrays(), math.sqrt(tolerance / DEFAULT_TOLERANCE), _marched(medium)
    maps = ShadowMaps(medium, lamps, resolution or map_resolution(medium, tolerance))
    looser = finer**2 * (ROUGH_FIGURES[1] if medium.rough else 1.0)
    least, share = (dr.opaque(jit.Float, figure * looser) for figure in (LEAST_DIFFERENCE, DIFFERENCE_SHARE))
    length = coarseness(medium, maps.side, tolerance) * min(box.voxel_size for box in medium.boxes)
    near = dr.opaque(jit.Float, MARCHED_VOXELS / math.sqrt(finer) * length)
    dense = dr.opaque(jit.Float, DENSE * looser / length)
    sizes = np.array([box.voxel_size for box in medium.boxes])
    wider = lookup(jit.Float, (sizes / sizes.min()).astype(np.float32)) if np.ptp(sizes) > 0.0 else None

    def transmittance(lamp: int | LampInTurn, way: WayToLamp) -> Float:
        if way.texel_hit is None:  # no box has a texel, or the point is on a surface
            behind, reach = looked_up(lamp, way)
        else:
            behind, reach = dr.if_stmt(
                (way,), way.texel_hit.textured, lambda way: out_of_texel(lamp, way), lambda way: looked_up(lamp, way)
            )
        return behind * marched(way, reach)

    def out_of_texel(lamp: int | LampInTurn, way: WayToLamp) -> tuple[Float, Float]:
        texel_hit = way.texel_hit
        assert texel_hit is not None
        length = way_out(medium, texel_hit, way.to_lamp, way.distance)
        depth = optical_depth_on_way_out(medium, texel_hit, way.origin, way.to_lamp, length)
        slope = dr.abs(dr.dot(texel_hit.frame.normal, way.to_lamp))
        length += maps.ray_spacing(lamp, way.origin) * (1.0 + dr.fmin(dr.rcp(dr.fmax(slope, 1e-2)), LARGEST_SECANT))
        outside = dr.fma(way.to_lamp, dr.fmin(length, way.distance), way.origin)
        return dr.exp(-depth) * maps.transmittance(lamp, outside)[0], jit.Float(0)

    def looked_up(lamp: int | LampInTurn, way: WayToLamp) -> tuple[Float, Float]:
        extinction, reach = way.extinction, near
        if wider is not None and way.box is not None:  # a surface of matter is as soft as its voxels are large
            own = dr.gather(jit.Float, wider, way.box)
            extinction, reach = extinction * own, near * own
        reach = dr.fmin(dr.select(extinction > dense, reach, 0.0), way.distance)
        behind, difference = maps.transmittance(lamp, dr.fma(way.to_lamp, reach, way.origin))
        uneven = difference > dr.fma(share, behind, least)
        return dr.select(uneven, 1.0, behind), dr.select(uneven, way.distance, reach)

    return transmittance


def _marched(medium: Medium) -> Callable[[WayToLamp, Float], Float]:
    """Transmittance along the first part of a way to a lamp, of a length [m].

    The less of a point is seen, the sooner a ray from it ends: what is cut off is the same part of a pixel. A ray that
    ends is taken to have BEHIND_END times as much before it: rates of light are those of lamps that are hidden.
    """
    deepest, least = hidden_depth(medium), -dr.log(MOST_HIDDEN * medium.tolerance)

    def marched(way: WayToLamp, reach: Float) -> Float:
        cone = (0.0, 0.0) if way.texel_hit is None else cone_of(medium, way.texel_hit)
        enough = dr.fmax(deepest + dr.log(dr.fmax(way.seen, 1e-6)), least)
        depth = optical_depth(medium, way.origin, way.to_lamp, arrays().Float(0), reach, enough, cone)
        return dr.exp(-dr.select(depth >= enough, BEHIND_END * depth, depth))

    return marched


def hidden_depth(medium: Medium) -> Float:
    """Optical depth at which the march of a shadow ray ends: a lamp behind it is hidden."""
    return -dr.log(HIDDEN_TRANSMITTANCE * medium.tolerance)


def fitting_resolution(boxes: Sequence[VolumeBox], tolerance: float = DEFAULT_TOLERANCE) -> int:
    """Texels a side: `texels_per_voxel` over the extent of all matter, from 128 to MOST_TEXELS."""
    return int(np.clip(64 * round(texels_per_voxel(tolerance) * voxels_across(boxes) / 64), 128, MOST_TEXELS))


def texels_per_voxel(tolerance: float) -> float:
    """Texels of a map per smallest voxel: twice as many at a sixteenth of the usual tolerance, half at four times."""
    finer = DEFAULT_TOLERANCE / tolerance
    return TEXELS_PER_VOXEL * finer ** (FINER if finer > 1.0 else COARSER)


def coarseness(medium: Medium, resolution: int, tolerance: float = DEFAULT_TOLERANCE) -> float:
    """Width of a texel of maps of `resolution` over that which fits, at least 1: more where they would be too large."""
    fitting = texels_per_voxel(tolerance) * voxels_across(medium.boxes)
    return max((ROUGH_FIGURES[0] if medium.rough else 1.0) * fitting / resolution, 1.0)


def map_resolution(medium: Medium, tolerance: float = DEFAULT_TOLERANCE) -> int:
    """Texels a side of the maps of a medium: `fitting_resolution`, and fewer in rough matter, where the light of one
    place differs from that of its neighbours more than shadows do.
    """
    fitting = fitting_resolution(medium.boxes, tolerance)
    return max(32 * round(ROUGH_FIGURES[0] * fitting / 32), 128) if medium.rough else fitting


def marching_is_quicker(medium: Medium, resolution: int, rays: float) -> bool:
    """Whether so few camera `rays` look up shadows that marching their shadow rays takes less time than maps would.

    Of dense matter alone, where shadow rays are short, and of isotropic extinction, whose steps read no axes.
    resolution: of the maps.
    """
    small = fitting_resolution(medium.boxes) <= QUICK_MAP
    most = MAP_RAYS_WITH_JOINED if medium.joined else MAP_RAYS_PER_RAY
    if small or resolution**2 < most * rays or medium.textures or medium.flakes:
        return False
    deep = [BRICK * box.tau * box.voxel_size * box.bricks.character[0] for box in medium.boxes]
    return min(deep) > DEEP_BRICK


def too_wide_for_maps(medium: Medium) -> bool:
    """Whether the boxes stand so far apart that a texel of the finest map would miss whole boxes."""
    return voxels_across(medium.boxes) > COARSEST_TEXEL * MOST_TEXELS


def voxels_across(boxes: Sequence[VolumeBox]) -> float:
    """Extent of all matter together in the smallest voxel."""
    corners = np.concatenate([box.matter_corners() for box in boxes])
    return float(np.linalg.norm(np.ptp(corners, axis=0))) / min(box.voxel_size for box in boxes)
