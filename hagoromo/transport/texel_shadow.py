"""Texel shadows: the way of light from a sample in a texel out of the cloth that it is in, towards a lamp.

Light of a coarse level was matched with shadows of that level within the cloth, which the finest one would not repeat:
so the way is looked up at the level of the sample, by whoever follows it.
"""

from __future__ import annotations

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, arrays, clip
from hagoromo.transport.chart import presence_at
from hagoromo.transport.crossing import LATTICE_MARGIN, Cone
from hagoromo.transport.medium import Medium
from hagoromo.transport.sample import TexelHit
from hagoromo.transport.textures import SeenAlong

ON_CLOTH = 0.999  # presence below which a place is at a hem


def cone_of(medium: Medium, texel_hit: TexelHit) -> Cone:
    """Footprint of rays that read the texel of a sample at its level; the finest one where the sample is in none."""
    assert medium.textures is not None
    width = medium.textures.footprint(texel_hit.box, texel_hit.level)
    return dr.select(texel_hit.textured, width, 0.0), arrays().Float(0)


def way_out(medium: Medium, texel_hit: TexelHit, to_lamp: Array3f, stop: Float) -> Float:
    """Length of the way from a sample out of the texel, or to `stop` [m]."""
    assert medium.textures is not None
    return medium.textures.way_out(texel_hit.box, texel_hit.here.height, texel_hit.frame.inwards(to_lamp).z, stop)


def stays_on_cloth(medium: Medium, texel_hit: TexelHit, place: Array3f) -> Bool:
    """Whether there is cloth without a hem at a sample and at a `place` (world) where its light leaves the texel."""
    return dr.fmin(presence(medium, texel_hit, place), texel_hit.here.presence) > ON_CLOTH


def presence(medium: Medium, texel_hit: TexelHit, place: Array3f) -> Float:
    """Of the cloth of a sample, over or under a `place` (world), see `SurfacePoint`; 0 where its box ends."""
    jit, frame = arrays(), medium.frames.frame(texel_hit.box)
    x, y, z = frame.columns
    there = place.x * x + place.y * y + place.z * z + frame.shift
    low, high = frame.bounds
    inside = jit.Array3f(*(clip(there[k], 0.0, frame.last[k] - LATTICE_MARGIN) for k in range(3)))
    brick = medium.brick_at(frame, inside)
    charted = presence_at(medium.charts, medium.brick_with_chart(texel_hit.box, brick), inside)
    return dr.select(dr.all((there > low) & (there < high)) & (brick >= 0), charted, 0.0)


def optical_depth_on_way_out(
    medium: Medium, texel_hit: TexelHit, point: Array3f, to_lamp: Array3f, length: Float
) -> Float:
    """Optical depth of the cloth of a sample at `point` along the first `length` [m] to the lamp, as if flat."""
    assert medium.textures is not None
    way, seen = texel_hit.frame.inwards(to_lamp), None
    if (flakes := medium.flakes) is not None:
        first = dr.gather(arrays().UInt, medium.first_material, texel_hit.box)
        tangents = [medium.kinds.population(first, k) for k in range(medium.textures.populations)]
        seen = SeenAlong(lambda population, axis: flakes.area(first + population, axis, way), tangents)

    def depth(point: Array3f, to_lamp: Array3f, length: Float, texel_hit: TexelHit, at_hem: bool) -> Float:
        def there(on: Float) -> Float:
            return presence(medium, texel_hit, dr.fma(to_lamp, on, point))

        hit, textures = texel_hit, medium.textures
        assert textures is not None
        return textures.optical_depth(
            hit.box, hit.level, hit.here, way, length, hit.tau, seen, presence=there if at_hem else None
        )

    return dr.if_stmt(
        (point, to_lamp, length, texel_hit), stays_on_cloth(medium, texel_hit, dr.fma(to_lamp, length, point)),
        lambda *some: depth(*some, at_hem=False), lambda *some: depth(*some, at_hem=True),
    )  # fmt: skip
