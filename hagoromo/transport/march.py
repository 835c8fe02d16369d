"""March: light from volume boxes along rays, one scattering event (MODEL §3, Tanaka eq. 11), and optical depth.

A step lies within one cell between eight voxel centres, where its optical depth is exact. It is lit at one sample, at
the centroid of exp(−D) over it. Along it the light that arrives is taken to be an exponential of the optical depth D to
the eye, as it is behind a flat face of homogeneous matter under any lamp; the rate of that exponential comes from the
samples before and behind. Where this rate is large, steps are shorter. A ray ends at END_TRANSMITTANCE: its last sample
then stands for all matter behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, clip
from hagoromo.transport.crossing import Cone, Crossing, MarchInterval, MarchState, selected
from hagoromo.transport.intervals import Interval, boxes_at, depth_at, in_slot, nothing_open, opened, put
from hagoromo.transport.joined_steps import JoinedSteps, joined_with, none_joined
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.medium import Limit, Medium
from hagoromo.transport.step_elements import PLACES, elements_along, elements_of_parts, mean_of_decay

END_TRANSMITTANCE = 1e-2  # a ray ends below this transmittance, at DEFAULT_TOLERANCE
OPAQUE_OPTICAL_DEPTH = 16.0  # a shadow ray ends beyond this optical depth: exp(−16) = 1e-7
LEAST_TRANSMITTANCE = 1e-7  # of lamps: less counts as this where the rate of light is computed
UNKNOWN_RATE = 1e30  # stands for the rate of light at the first sample
OWN_SIDE = 0.75  # share of the rate to the nearer sample in half a step: a parabola through equal steps
STEEPER = 4.0  # largest rate within a step, over the lesser one to its neighbours
FIRST_RATE = 3.0  # rate of light that steps are made for behind the first sample, where none is known yet
FIRST_STEP = 0.5  # of the deepest step: the first one in matter
LARGEST_RATE = 30.0  # of light that steps are made for: that of a lamp 2° above a face
MOST_JOINED = 0.3  # of the deepest step: steps of more have a sample, however little of their light reaches the eye
SLOW_RATE = 0.4  # a step may be 1 / (SLOW_RATE (1 + rate)) of the deepest one


@dataclass
class LitSample:
    """A lit sample of a step. `rates`: −d ln(transmittance from the lamps) / d(optical depth to the eye).

    Lists have an entry for every lamp, `light` one for every lamp and colour.
    """

    box: UInt
    depth: Float  # optical depth of the step in its own box
    total: Float  # in all boxes
    before: Float  # in front of the step, in all boxes
    share: Float  # of the step's optical depth in front of the sample
    log_lamps: list[Float]  # ln of the transmittance from the lamps
    rates: list[Float]  # since the sample before; UNKNOWN_RATE for the first
    light: list[Float]  # its radiance
    smooth: list[Float]  # that of higher orders, see `Lighting.field`

    @property
    def place(self) -> Float:
        """Optical depth in front of the sample, in all boxes."""
        return dr.fma(self.share, self.total, self.before)

    def lit(self, box: UInt) -> Bool:
        """Whether there is a sample, in box number `box`."""
        return (self.depth > 0.0) & (self.box == box)

    def rates_to(self, box: UInt, log_lamps: list[Float], place: Float) -> list[Float]:
        """Rates between this sample and one in a box at the optical depth `place`; unknown between two boxes."""
        inverse, known = dr.rcp(dr.fmax(place - self.place, 1e-6)), self.lit(box)
        return [
            dr.select(known, (here - there) * inverse, UNKNOWN_RATE)
            for here, there in zip(self.log_lamps, log_lamps, strict=True)
        ]

    def gains(self, behind: list[Float]) -> list[Float]:
        """∫ σ exp(−D) · (light / light of the sample) over the step, with the rates to the sample behind it."""
        front, back = self.share * self.total, (1.0 - self.share) * self.total  # depths of the parts of the step
        to_eye, known = self.depth * dr.exp(-self.place), self.depth > 0.0  # exp(−D) at the sample: more in front of it
        shares = [
            dr.fma(1.0 - self.share, mean_of_decay(dr.fma(behind, back, back)),
                   self.share * mean_of_decay(-dr.fma(ahead, front, front)))
            for ahead, behind in self._rates(behind)
        ]  # fmt: skip
        return [dr.select(known, to_eye * share, 0.0) for share in shares]

    def rest(self) -> list[Float]:
        """As `gains`, over the step and all behind it as if it went on, and for all boxes."""
        rates = [front for front, _ in self._rates([arrays().Float(UNKNOWN_RATE)] * len(self.rates))]
        return [
            dr.exp(dr.fma(rate * self.total, self.share, -self.before)) / (1.0 + dr.fmax(rate, 0.0)) for rate in rates
        ]

    def smooth_gain(self) -> Float:
        """∫ σ exp(−D) over the step: of light that hardly changes along it."""
        return dr.select(self.depth > 0.0, dr.exp(-self.before) * self.depth * mean_of_decay(self.total), 0.0)

    def mean_rate(self) -> Float:
        """Mean of the absolute rates of all lamps, whatever their strength; FIRST_RATE where they are not known."""
        mean = sum(dr.abs(rate) for rate in self.rates) / len(self.rates)
        return dr.select(self.rates[0] == UNKNOWN_RATE, FIRST_RATE, mean)

    def _rates(self, behind: list[Float]) -> list[tuple[Float, Float]]:
        return [self._rates_within(*each) for each in zip(self.rates, behind, self.log_lamps, strict=True)]

    def _rates_within(self, before: Float, behind: Float, log_lamps: Float) -> tuple[Float, Float]:
        """Rates of light in the step in front of its sample and behind it, from those to the samples `before` and
        `behind`, which hold for the middles of the ways to them. Where these differ in sign they are noise, and rates
        are 0; by no rate is light at either end of the step more than without shadow.
        """
        before = dr.select(before == UNKNOWN_RATE, behind, before)
        behind = dr.select(behind == UNKNOWN_RATE, before, behind)
        before, behind = (dr.select(each == UNKNOWN_RATE, 0.0, each) for each in (before, behind))
        largest = STEEPER * dr.fmin(dr.abs(before), dr.abs(behind))
        largest = dr.select(before * behind > 0.0, largest, 0.0)
        inverse = dr.rcp(dr.fmax(self.total, 1e-12))
        low = dr.fmax(-largest, log_lamps * inverse / (1.0 - self.share))
        high = dr.fmin(largest, -log_lamps * inverse / self.share)
        pairs = (before, behind), (behind, before)
        front, back = (clip(dr.fma(OWN_SIDE, own - other, other), low, high) for own, other in pairs)
        return front, back


@dr.syntax
def march(
    medium: Medium,
    lighting: Lighting,
    origin: Array3f,
    direction: Array3f,
    near: Float,
    far: Float,
    phase: Float = 0.0,
    cone: Cone = (0.0, 0.0),
) -> tuple[list[Float], Float]:
    """Weights of the radiance towards the ray's origin (list of Float, one per channel) and the transmittance left.

    origin, direction (unit): Array3f, world. near, far: Float [m]. phase, cone: see `Medium.cross`.
    """
    jit, count = arrays(), dr.width(direction)
    crossing = medium.cross(origin, direction, near, far, phase, cone)
    state = crossing.start()
    channels = [dr.zeros(jit.Float, count) for _ in range(lighting.channels)]
    intervals = [nothing_open(count) for _ in state.ends]
    samples = [no_sample(count, lighting) for _ in state.ends]
    depth = dr.zeros(jit.Float, count)
    deepest = last_depth(medium)
    # Dr.Jit does not differentiate loops within loops
    together = not (medium.differentiable or lighting.tracked or dr.grad_enabled(origin, direction))
    joined = none_joined(count) if together and medium.joined else None
    while dr.hint(crossing.unfinished(state) & (depth < deepest), exclude=[deepest]):
        step, depth, steps, onwards, joined = closed(medium, crossing, state, intervals, samples, joined)
        if dr.hint(together, mode="scalar"):  # all lanes of a packet go on to matter, so that none waits for others
            while dr.hint(onwards & crossing.unfinished(state) & (depth < deepest), exclude=[deepest]):
                step, intervals, state = onward(medium, crossing, direction, state, intervals, samples, step, depth)
                step, depth, steps, onwards, joined = closed(medium, crossing, state, intervals, samples, joined)
        if ~onwards:
            sample = in_slot(samples, step.slot)
            total = dr.fmax(depth - steps.front, steps.own)
            share, front, distance = steps.place(total)
            begin, end = steps.begin, steps.end
            place = step.ray.inside(step.ray.at(begin + crossing.probe(step.ray, begin)))
            lit = MarchInterval(step.slot, step.ray, begin, end, place, steps.brick, steps.depth, steps.growth)
            point = dr.fma(direction, distance + step.ray.near, origin)
            coloured = medium.sample(lit, dr.fma(share, end - begin, begin))
            seen = dr.exp(-steps.front)
            light, lamps, smooth = radiance_from_sample(
                medium, lighting, medium.sample(lit, distance), coloured, point, direction, seen
            )
            log_lamps = logarithms(lamps)
            rates = sample.rates_to(step.ray.box, log_lamps, dr.fma(front, total, steps.front))
            new = LitSample(step.ray.box, steps.own, total, steps.front, front, log_lamps, rates, light, smooth)
            complete, new, rates = in_order(medium, sample, new, rates)
            channels = accumulated(lighting, channels, complete.gains(rates), complete.light)
            channels = with_smooth(lighting, channels, complete.smooth_gain(), complete.smooth)
            samples = put(samples, step.slot, new)
        step, intervals, state = onward(medium, crossing, direction, state, intervals, samples, step, depth)
    ended = depth >= deepest
    return finished(lighting, channels, samples, depth, ended), dr.select(ended, 0.0, dr.exp(-depth))


def closed(
    medium: Medium,
    crossing: Crossing,
    state: MarchState,
    intervals: list[Interval],
    samples: list[LitSample],
    joined: JoinedSteps | None,
) -> tuple[MarchInterval, Float, JoinedSteps, Bool, JoinedSteps | None]:
    """The next step, where the open interval of its slot is closed; the optical depth there; that interval with the
    steps that waited for it; whether these need no sample yet; and the steps that wait now.

    They need none where there is no matter in them, or so little that they are lit with the next step.
    """
    step = medium.next(crossing, state)
    interval = in_slot(intervals, step.slot)
    depth = depth_at(crossing, state, intervals, step)
    steps = joined_with(joined, interval, in_slot(state.begins, step.slot), step.begin, depth)
    onwards = steps.own <= medium.negligible
    if joined is None or medium.joined is None:
        return step, depth, steps, onwards, None
    (least, longest), sample = medium.joined, samples[0]
    deep = (depth - steps.front) * faster_light(sample) / crossing.frames.deepest
    if medium.rough or medium.patchy:  # light differs from step to step, however little of it reaches the eye
        waiting = deep < least
    else:
        waiting = (deep * dr.exp(-steps.front) < least) & (deep < MOST_JOINED)
    waiting &= (step.begin - steps.since < dr.fmin(step.ray.longest, longest)) & (depth < last_depth(medium))
    waiting &= ~onwards & (step.brick >= 0) & (step.begin < step.ray.far)
    return step, depth, steps, onwards | waiting, replace(steps, waiting=waiting)


def onward(
    medium: Medium,
    crossing: Crossing,
    direction: Array3f,
    state: MarchState,
    intervals: list[Interval],
    samples: list[LitSample],
    step: MarchInterval,
    depth: Float,
) -> tuple[MarchInterval, list[Interval], MarchState]:
    """One interval on: the step with its extinction, and intervals and state with it as the open one; depth: the
    optical depth in front of it.
    """
    parts = limit(crossing, step, in_slot(samples, step.slot), boxes_at(crossing, state, step))
    step = medium.extinction(step, direction, parts)
    intervals = put(intervals, step.slot, opened(step, in_slot(intervals, step.slot), depth))
    return step, intervals, crossing.enter_next_box(crossing.open(step, state, step.begin))


def last_depth(medium: Medium) -> Float:
    """Optical depth at which rays end."""
    cut = END_TRANSMITTANCE * medium.tolerance
    return arrays().Float(OPAQUE_OPTICAL_DEPTH) if medium.differentiable else -dr.log(cut)


def in_order(
    medium: Medium, last: LitSample, new: LitSample, rates: list[Float]
) -> tuple[LitSample, LitSample, list[Float]]:
    """The sample whose light is complete, the one that waits for the next sample, and the rates behind the former.

    A new sample in a cell without matter, which only a medium for derivatives has, says nothing of the light around it
    and is complete at once.
    """
    if not medium.differentiable:
        return last, new, rates
    empty = medium.without_matter(new.depth)
    rates = [dr.select(empty, UNKNOWN_RATE, rate) for rate in rates]
    return selected(empty, new, last), selected(empty, last, new), rates


def limit(crossing: Crossing, step: MarchInterval, sample: LitSample, boxes: Float) -> Limit:
    """Parts of the step behind a sample: more of them where the light that arrives changes faster than the eye's."""
    lit = sample.lit(step.ray.box)
    faster = dr.select(lit, faster_light(sample), 1.0 / FIRST_STEP)
    # what is too deep is the step in all boxes together; of those behind the first sample the share is known
    faster *= dr.select(lit, clip(sample.total / dr.fmax(sample.depth, 1e-12), 1.0, dr.fmax(boxes, 1.0)), boxes)
    faster = dr.detach(faster)

    def parts(step: MarchInterval) -> Float:
        return dr.ceil(
            dr.fmax(step.depth * faster / crossing.frames.deepest, (step.end - step.begin) / step.ray.longest)
        )

    return parts


def faster_light(sample: LitSample) -> Float:
    """How many times shorter steps are behind a sample, as light that arrives changes faster than the eye's."""
    faster = dr.fmax(SLOW_RATE * (1.0 + dr.fmin(sample.mean_rate(), LARGEST_RATE)), 1.0)
    return dr.select(sample.depth > 0.0, faster, 1.0 / FIRST_STEP)


def no_sample(count: int, lighting: Lighting) -> LitSample:
    """The sample before the first."""
    box, nothing, lamps = dr.zeros(arrays().UInt, count), dr.zeros(arrays().Float, count), len(lighting.lamps)
    each, light = [nothing] * lamps, [nothing] * (lamps * len(lighting.materials.palette.colours))
    smooth = [nothing] * (lighting.channels - lighting.materials.palette.channels)
    return LitSample(box, nothing, nothing, nothing, nothing, each, each, light, smooth)


def finished(
    lighting: Lighting, channels: list[Float], samples: list[LitSample], depth: Float, ended: Bool
) -> list[Float]:
    """The channels with the last sample of every slot. Those in which the ray `ended` share all matter behind."""
    last = [ended & (sample.before + sample.total > depth - 1e-3) & (sample.depth > 0.0) for sample in samples]
    parts = [dr.select(here, s.depth / dr.fmax(s.total, 1e-12), 0.0) for here, s in zip(last, samples, strict=True)]
    unknown = [arrays().Float(UNKNOWN_RATE)] * len(lighting.lamps)
    for sample, here, part in zip(samples, last, parts, strict=True):
        share = part / dr.fmax(sum(parts), 1e-12)
        each = zip(sample.rest(), sample.gains(unknown), strict=True)
        gains = [dr.select(here, rest * share, gain) for rest, gain in each]
        channels = accumulated(lighting, channels, gains, sample.light)
        gain = dr.select(here, dr.exp(-sample.before) * share, sample.smooth_gain())
        channels = with_smooth(lighting, channels, gain, sample.smooth)
    return channels


def accumulated(lighting: Lighting, channels: list[Float], gains: list[Float], light: list[Float]) -> list[Float]:
    """channels + gain · light, with a gain for every lamp (`dr.syntax` takes no comprehension over pairs)."""
    colours = len(lighting.materials.palette.colours)
    added = lighting.in_groups([gains[k // colours] * each for k, each in enumerate(light)])
    added += [arrays().Float(0)] * (len(channels) - len(added))
    return [channel + new for channel, new in zip(channels, added, strict=True)]


def with_smooth(lighting: Lighting, channels: list[Float], gain: Float, smooth: list[Float]) -> list[Float]:
    """channels + gain · smooth light, whose channels are the last."""
    if lighting.field:
        lighting.field.taken(gain, smooth)
    first = len(channels) - len(smooth)
    return channels[:first] + [dr.fma(gain, new, old) for old, new in zip(channels[first:], smooth, strict=True)]


def logarithms(transmittances: list[Float]) -> list[Float]:
    """ln of each, bounded from below."""
    return [dr.log(dr.fmax(each, LEAST_TRANSMITTANCE)) for each in transmittances]


def radiance_from_sample(
    medium: Medium,
    lighting: Lighting,
    step: MarchInterval,
    coloured: MarchInterval,
    point: Array3f,
    direction: Array3f,
    seen: Float = 1.0,
) -> tuple[list[Float], list[Float], list[Float]]:
    """Radiance that the matter at `point` sends back along the ray: its weights, of every lamp and colour; the
    transmittance from every lamp; and the radiance of higher orders, where there is a field of them.

    coloured: the step at the place of its colour. Density times colour is interpolated, so that the middle of the step,
    without regard to where more of the matter is, stands for both together. seen: share of its light that reaches the
    eye, at most.
    """
    places, texel_hit = 1, None
    if medium.rough:
        places, elements = len(PLACES), elements_along(medium, step, direction)
    elif medium.patchy:
        places, elements = 2, elements_of_parts(medium, step, direction)
    else:
        elements, texel_hit = medium.elements(step, direction)
    coefficients = [lighting.materials.coefficients(element.material) for element in elements]
    if lighting.voxel_bases:
        colour, first = medium.colour(coloured), len(coefficients) // places
        coefficients[::first] = [lighting.with_voxel_colour(c, step.ray.box, colour) for c in coefficients[::first]]
    extinction = step.depth / (step.end - step.begin)
    light, lamps = lighting.reflected_radiance(
        point, -direction, elements, coefficients, texel_hit, extinction, seen, step.ray.box
    )
    smooth = lighting.field.scattered(point, -direction, elements, coefficients) if lighting.field else []
    return light, lamps, smooth


@dr.syntax
def optical_depth(
    medium: Medium,
    origin: Array3f,
    direction: Array3f,
    near: Float,
    far: Float,
    deepest: Float = OPAQUE_OPTICAL_DEPTH,
    cone: Cone = (0.0, 0.0),
) -> Float:
    """∫ σ du along rays from `near` to `far` [m], exact where densities are trilinear; it ends beyond `deepest`.

    cone: see `Medium.cross`.
    """
    crossing = medium.cross(origin, direction, near, far, cone=cone)
    state = crossing.start()
    depth = dr.zeros(arrays().Float, dr.width(direction))
    while dr.hint(crossing.unfinished(state) & (depth < deepest), exclude=[deepest]):
        step = medium.next(crossing, state)
        step = medium.extinction(step, direction)
        depth += step.depth
        state = crossing.advance(step, state)
        state = crossing.enter_next_box(state)
    return depth
