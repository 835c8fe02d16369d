"""Deep shadow maps: transmittance from every lamp through all volume boxes (Lokovic & Veach 2000).

Each ray of a square grid of rays from a lamp keeps up to KNOTS knots (distance, optical depth). Between them optical
depth is linear, to a stated error of the transmittance; between three rays transmittance is. A ray is GROUPS packets of
four knots, the last of one being the first of the next, after a packet with the distances where they part: a look-up
reads two packets a ray, whatever the matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, check_entries, clip, recorded_once
from hagoromo.files.memory import require
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_light import LampInTurn
from hagoromo.transport.crossing import Cone, MarchInterval
from hagoromo.transport.film import TILE, tile_place
from hagoromo.transport.intervals import depth_at, in_slot, nothing_open, opened, put
from hagoromo.transport.lamp_view import LampViews
from hagoromo.transport.medium import Limit, Medium
from hagoromo.transport.textures import HIDDEN_OPTICAL_DEPTH

GROUPS = 5
KNOTS = 3 * GROUPS + 1
WORDS = 4 * (GROUPS + 1)  # of 32 bits, of a ray
KNOT_TOLERANCE = (
    0.003  # error of the transmittance between knots at DEFAULT_TOLERANCE; doubles with each knot after STRICT_KNOTS
)
STRICT_KNOTS = 10  # knots that keep KNOT_TOLERANCE
LARGEST_KNOT_ERROR = 2.0  # error of the optical depth between knots, at most
MOST_PARTS = 8.0  # of a step, so that knots follow the bend of its optical depth
GAP_DEPTH = 1.0 / 512.0  # a gap in matter gets knots where the optical depth since the last knot exceeds this
DEPTH_UNITS = 4096.0  # units per optical depth of 1: 16 bits reach 16
UNUSED = 0xFFFF  # tick of an unused knot, behind all others
LAST_TICK = float(UNUSED - 1)


@dataclass
class Fan:
    """The straight lines from the last knot of a ray that pass all points since, to within `spare`."""

    knots: UInt  # written so far
    at: Float  # distance of the last knot [m]
    depth: Float  # optical depth there
    low: Float  # least slope of the lines [1/m]
    high: Float  # and the largest
    spare: Float  # error of the optical depth that is allowed
    rises: Float  # ∫ x y dx over the points (x, y) as seen from the knot
    runs: Float  # ∫ x² dx: the best slope is rises / runs

    def narrowed(self, distance: Float, depth: Float) -> tuple[Float, Float]:
        """Least and largest slope of the lines that pass one more point, too; no line does where least > largest."""
        inverse = dr.rcp(dr.fmax(distance - self.at, 1e-9))  # parts of overlapping boxes may end at one distance
        rise = depth - self.depth
        return dr.fmax((rise - self.spare) * inverse, self.low), dr.fmin((rise + self.spare) * inverse, self.high)

    def parts(self, tolerance: Float) -> Limit:
        """Parts of a step whose optical depth is near enough to a straight line each."""
        allowed = tolerance * dr.exp(self.depth)

        def parts(step: MarchInterval) -> Float:
            bend = 0.25 * step.depth * dr.abs(step.growth)
            return dr.ceil(dr.fmin(dr.sqrt(bend / allowed), MOST_PARTS))

        return parts

    def depth_at(self, distance: Float) -> Float:
        """Optical depth at `distance` [m] on the line of least squares through the points."""
        slope = clip(self.rises / dr.fmax(self.runs, 1e-30), self.low, self.high)
        return dr.fma(slope, distance - self.at, self.depth)


class ShadowMaps:
    """Transmittance from the lamps through all boxes, each on a square of `resolution` rays a side."""

    def __init__(self, medium: Medium, lamps: Sequence[Lamp], resolution: int) -> None:
        jit, side = arrays(), max(TILE)
        resolution = -(-resolution // side) * side  # whole tiles
        what = f"{len(lamps)} shadow maps of {resolution}² texels"
        check_entries(len(lamps) * resolution**2 * WORDS, what)
        require(4 * WORDS * len(lamps) * resolution**2, what)
        corners = np.concatenate([box.matter_corners() for box in medium.boxes])
        self.views = LampViews(lamps, corners)
        first, *others = self.views.each
        self.side, self.size = resolution, dr.opaque(jit.UInt, resolution)
        self.first_rows = [dr.opaque(jit.UInt, number * resolution) for number in range(len(lamps))]
        self.words = dr.full(jit.UInt, UNUSED, len(lamps) * resolution**2 * WORDS)
        lane, each = dr.arange(jit.UInt, len(lamps) * resolution**2), self.size * self.size
        lamp, lane = lane // each, lane % each
        column, row = tile_place(lane, self.size)
        a, b = ((jit.Float(place) + 0.5) / jit.Float(self.size) for place in (column, row))
        tolerance = KNOT_TOLERANCE * dr.fmax(
            dr.sqrt(dr.sqrt(medium.tolerance)), medium.tolerance
        )  # finer ones would use up the knots
        writer = KnotWriter(self.words, lamp * each + row * self.size + column, first.ticks(), tolerance)
        origin, direction = first.ray(a, b)
        cone = first.cone(self.size)
        for number, view in enumerate(others, 1):
            here = lamp == number
            origin, direction = (
                dr.select(here, n, o) for n, o in zip(view.ray(a, b), (origin, direction), strict=True)
            )
            writer.near, writer.scale = (
                dr.select(here, n, o) for n, o in zip(view.ticks(), (writer.near, writer.scale), strict=True)
            )
            cone = tuple(dr.select(here, n, o) for n, o in zip(view.cone(self.size), cone, strict=True))
        with recorded_once():
            write_knots(medium, origin, direction, writer, cone)
        dr.eval(self.words)

    def transmittance(self, lamp: int | LampInTurn, point: Array3f) -> tuple[Float, Float]:
        """Transmittance from a lamp to `point` (world), interpolated between the three map rays around it, and the
        difference between their largest and least.
        """
        jit, size, view = arrays(), arrays().Float(self.size), self.views.of(lamp)
        a, b, distance = view.place(point)
        near, scale = view.ticks()
        tick = clip((distance - near) * scale, 0.0, LAST_TICK)
        a, b = (clip(x * size - 0.5, 0.0, size - 1.001) for x in (a, b))
        column, row = jit.UInt(a), jit.UInt(b)
        a, b = a - jit.Float(column), b - jit.Float(row)
        first_row = self.first_rows[lamp] if isinstance(lamp, int) else lamp.number * self.size
        begin = (first_row + row) * self.size + column
        side = dr.select(a > b, 1, self.size)  # the triangle of the square that the point is in
        first, second, last = (dr.exp(-self._depth(ray, tick)) for ray in (begin, begin + side, begin + self.size + 1))
        passed = dr.fma(dr.fmin(a, b), last - second, dr.fma(dr.fmax(a, b), second - first, first))
        most, least = dr.fmax(dr.fmax(first, second), last), dr.fmin(dr.fmin(first, second), last)
        return passed, most - least

    def ray_spacing(self, lamp: int | LampInTurn, point: Array3f) -> Float:
        """Distance between neighbouring map rays at `point` [m]."""
        view = self.views.of(lamp)
        width, spread = view.cone(self.size)
        return dr.fma(spread, view.place(point)[2], width)

    def _depth(self, ray: UInt, tick: UInt) -> Float:
        """Optical depth of one ray at a distance [ticks]."""
        jit = arrays()
        packet, parting = ray * (GROUPS + 1), jit.UInt(tick)
        header = dr.gather(jit.Array4u, self.words, packet)
        for k in range(GROUPS - 1):
            packet += dr.select(parting >= header[k], jit.UInt(1), 0)
        first, second, third, last = dr.gather(jit.Array4u, self.words, packet + 1)
        beyond, far_beyond = parting >= (second & UNUSED), parting >= (third & UNUSED)
        begin = dr.select(far_beyond, third, dr.select(beyond, second, first))
        end = dr.select(far_beyond, last, dr.select(beyond, third, second))
        before, begin = jit.Float(begin >> 16), jit.Float(begin & UNUSED)
        after, end = jit.Float(end >> 16), jit.Float(end & UNUSED)
        part = clip((tick - begin) / dr.fmax(end - begin, 1.0), 0.0, 1.0)
        part = dr.select(end == float(UNUSED), 0.0, part)
        return dr.fma(part, after - before, before) * (1.0 / DEPTH_UNITS)


class KnotWriter:
    """Writes the knots of rays into the map. A plain object, so that loops do not take the map into their state."""

    def __init__(self, words: UInt, ray: UInt, ticks: tuple[Float, Float], tolerance: Float) -> None:
        """`ticks`: see `LampView`; `tolerance`: error of the transmittance between knots."""
        self.words, self.ray, (self.near, self.scale), self.tolerance = words, ray, ticks, tolerance

    def write(self, knot: UInt, distance: Float, depth: Float) -> None:
        """Write knot number `knot` of every ray."""
        jit = arrays()
        tick = jit.UInt(clip((distance - self.near) * self.scale + 0.5, 0.0, LAST_TICK))
        word = tick | (jit.UInt(dr.fmin(depth * DEPTH_UNITS + 0.5, float(UNUSED))) << 16)
        group, place = knot // 3, knot % 3
        start = self.ray * WORDS + 4 * group
        dr.scatter(self.words, word, start + 4 + place, group < GROUPS)
        shared = (place == 0) & (knot > 0)  # it ends one group and begins the next
        dr.scatter(self.words, word, start + 3, shared)
        dr.scatter(self.words, tick, self.ray * WORDS + group - 1, shared & (group < GROUPS))


@dr.syntax
def write_knots(medium: Medium, origin: Array3f, direction: Array3f, writer: KnotWriter, cone: Cone) -> None:
    """March every ray once through the boxes and write its knots."""
    jit, count = arrays(), dr.width(writer.ray)
    crossing = medium.cross(origin, direction, jit.Float(0), jit.Float(dr.inf), cone=cone)
    state = crossing.start()
    nothing = dr.zeros(jit.Float, count)
    depth, covered = nothing, nothing - 1.0  # optical depth so far, and end of the last matter [m]
    fan = Fan(dr.zeros(jit.UInt, count), nothing, nothing, nothing, nothing + dr.inf, nothing, nothing, nothing)
    intervals = [nothing_open(count) for _ in state.ends]
    while crossing.unfinished(state) & (depth < HIDDEN_OPTICAL_DEPTH):
        step = medium.next(crossing, state)
        interval, before = in_slot(intervals, step.slot), depth
        depth = depth_at(crossing, state, intervals, step)
        if interval.depth > medium.negligible:
            far_end, own = step.ray.near + step.begin, step.begin - in_slot(state.begins, step.slot)
            begin, end = dr.fmax(far_end - own, covered), dr.fmax(far_end, covered)
            if begin > dr.fma(0.5, own, covered):  # the first matter, or a gap
                far_side = (before > fan.depth + GAP_DEPTH) & (fan.knots < KNOTS - 3)
                if far_side:
                    writer.write(fan.knots, covered, before)
                if far_side | (covered < 0.0):
                    number = dr.select(far_side, fan.knots + 1, fan.knots)
                    writer.write(number, begin, before)
                    fan = fan_from(number + 1, begin, before, writer.tolerance)
            low, high = fan.narrowed(end, depth)
            if low > high:  # no line passes all points: the knot is where the last one did
                knot = fan.depth_at(covered)
                writer.write(fan.knots, covered, knot)
                fan = fan_from(fan.knots + 1, covered, knot, writer.tolerance)
                low, high = fan.narrowed(end, depth)
            x, y = dr.fma(0.5, end + begin, -fan.at), dr.fma(0.5, before + depth, -fan.depth)
            fan.rises, fan.runs = dr.fma(x * y, end - begin, fan.rises), dr.fma(x * x, end - begin, fan.runs)
            fan.low, fan.high, covered = low, high, end
        step = medium.extinction(step, direction, fan.parts(writer.tolerance))
        intervals = put(intervals, step.slot, opened(step, interval, depth))
        state = crossing.open(step, state, step.begin)
        state = crossing.enter_next_box(state)
        # here, not after the loop: to write once more what a loop has written would run the loop twice
        if (covered >= 0.0) & ~(crossing.unfinished(state) & (depth < HIDDEN_OPTICAL_DEPTH)):
            writer.write(fan.knots, covered, fan.depth_at(covered))


def fan_from(knots: UInt, at: Float, depth: Float, tolerance: Float) -> Fan:
    """All lines from a knot: the last one of `knots`."""
    jit = arrays()
    many = jit.Float(1 << (dr.maximum(knots, STRICT_KNOTS) - STRICT_KNOTS))
    spare = dr.select(knots < KNOTS - 1, dr.fmin(tolerance * many * dr.exp(depth), LARGEST_KNOT_ERROR), dr.inf)
    return Fan(knots, at, depth, jit.Float(0), jit.Float(dr.inf), spare, jit.Float(0), jit.Float(0))
