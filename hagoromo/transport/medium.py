"""Medium: the volume boxes of a scene on the device, and their samples along rays.

Each box has intervals of its own, each within one cell between eight voxel centres, where the optical depth is exact.
Where boxes overlap, their extinctions add. The optical depth along rays:

    crossing = medium.cross(origin, direction, near, far)
    state = crossing.start()
    while crossing.unfinished(state):
        step = medium.next(crossing, state)                # the next interval, and its brick
        step = medium.extinction(step, direction)
        depth += step.depth
        state = crossing.advance(step, state)
        state = crossing.enter_next_box(state)             # where the ray has left a box

Grids are fields of a plain object, so that Dr.Jit's loops do not take them into their state.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Array4f, Bool, Float, Int, UInt, arrays, clip, lookup
from hagoromo.transport.chart import SurfacePoint, surface_frame, surface_point_at
from hagoromo.transport.crossing import LAST_IN_CELL, Cone, Crossing, MarchInterval, MarchState, Ray, share_at_depth
from hagoromo.transport.element_kinds import Kinds
from hagoromo.transport.flakes import flakes_of
from hagoromo.transport.frames import DEFAULT_TOLERANCE, BoxFrame, Frames, Poses
from hagoromo.transport.sample import Element, TexelHit
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import Bricks, Grid, in_one_pool
from hagoromo.volume.table import BLOCK, BRICKS
from hagoromo.volume.voxels import (
    BRICK,
    CORNERS,
    InCell,
    PackedVoxels,
    Voxels,
    corner,
    packets_around,
    shares,
    trilinear,
)

NEGLIGIBLE_OPTICAL_DEPTH = 1e-6  # a step of less optical depth counts as empty, but see `negligible_depth`
NEGLIGIBLE_SHARE = 1e-3  # of the optical depth of a box's thickest voxel: a step of more never counts as empty
LEAST_DEPTH = 1e-30  # that single precision computes with
CLEARANCE_SHARE = 0.8  # share of a clearance that one step may skip: it is interpolated, not exact
ROUGH = 0.1  # roughness of axes, see `Bricks.character`, from which a step is shaded at several places
TURNING = 2.0  # optical depth of a step without its projected area, over the deepest, from which that is of two places
JOINED = 0.1  # of the deepest step: steps of less are lit with the next one, at tolerances far above the usual one
ROUGH_JOINED, PATCHY_JOINED = 0.5, 0.3  # of that in rough matter, and where materials lie side by side
LONGEST_JOINED = 0.01  # of the extent of a box's matter
MOST_PARTS_IN_TEXEL = 64.0  # of a step in a texel
GAUSS_NODE = 1.0 / math.sqrt(3.0)  # of two, from the middle of an interval, in halves of it
Limit = Callable[[MarchInterval], Float]  # into how many parts of equal optical depth a step is cut
NO_GRID = -(2**31)  # stands for the shift of a box without such a grid


class Medium:
    """The boxes of a scene on the device; `tolerance` sets the steps of the march."""

    differentiable = False  # see `DifferentiableMedium`

    def __init__(
        self, boxes: Sequence[VolumeBox], tolerance: float = DEFAULT_TOLERANCE, poses: Poses | None = None
    ) -> None:
        """poses: of boxes that move, see `Frames`."""
        jit, self.boxes = arrays(), tuple(boxes)
        for name in ("density", "axis", "colour", "material", "chart"):
            in_one_pool([grid for box in self.boxes if (grid := getattr(box.bricks, name)) is not None])
        bricks = list({id(box.bricks): box.bricks for box in self.boxes}.values())
        coarse, fine, first = _tables(bricks)
        self.coarse, self.fine = lookup(jit.Int, coarse), lookup(jit.Int, fine)
        self.voxels: Voxels = PackedVoxels(bricks[0].density.values, bricks[0].axis.values)
        self.colours, self.colour_shift = self._optional("colour")
        self.charts, self.chart_shift = self._optional("chart")
        self.materials, self.material_shift = self._optional("material")
        counts = np.cumsum([0, *(len(box.materials) for box in self.boxes)])
        self.first_material = lookup(jit.UInt, counts[:-1].astype(np.uint32))
        self.kinds = Kinds(self.boxes)
        starts = [first[bricks.index(box.bricks)] for box in self.boxes]
        self.frames = Frames(self.boxes, starts, tolerance, poses)
        self.textures, self.flakes = self.frames.textures, flakes_of(boxes)
        shadow_biases = np.array([box.shadow_bias for box in self.boxes], np.float32)
        self.shadow_biases = lookup(jit.Float, shadow_biases) if shadow_biases.any() else None
        self.rough, self.two_areas = self._is_rough(), tolerance < DEFAULT_TOLERANCE or self.differentiable
        self.patchy = self._is_patchy()
        self.tolerance = dr.opaque(jit.Float, tolerance / DEFAULT_TOLERANCE)  # in units of the usual one
        self.negligible = dr.opaque(jit.Float, negligible_depth(self.boxes))
        self.joined = self._joined(tolerance)
        dr.eval(self.coarse, self.fine)

    def _is_rough(self) -> bool:
        """Whether matter differs so much from voxel to voxel that a step is shaded at several places: axes do, or
        elements of several kinds lie side by side.

        Axes of cylinders are not counted, where there are any: their light differs less with the axis, and takes ten
        nodes a place. Spheres have none.
        """
        if self.differentiable or self.textures or self.shadow_biases is not None:
            return False
        if self.kinds.mixed or self.kinds.tangents:
            return self.kinds.mixed
        planes = [box for box in self.boxes if any(each.element == "plane" for each in box.materials)]
        return any(box.bricks.character[1] > ROUGH for box in planes)

    def _is_patchy(self) -> bool:
        """Whether materials lie side by side, so that a step may have two of them."""
        if self.differentiable or self.textures:
            return False
        return any(len(box.materials) > 1 and box.bricks.material is not None for box in self.boxes)

    def _joined(self, tolerance: float) -> tuple[Float, Float] | None:
        """Least depth of steps that have a sample of their own, over the deepest one, and the length up to which others
        are joined [m], see `JoinedSteps`; None where every step has one: at the usual tolerance and finer ones.
        """
        if tolerance <= DEFAULT_TOLERANCE or self.differentiable or self.textures or self.frames.slots > 1:
            return None
        matter = ROUGH_JOINED if self.rough else PATCHY_JOINED if self.patchy else 1.0
        extents = [np.linalg.norm(np.ptp(box.matter_corners(), axis=0)) for box in self.boxes]
        numbers = JOINED * matter * (1.0 - DEFAULT_TOLERANCE / tolerance), LONGEST_JOINED * float(min(extents))
        return dr.opaque(arrays().Float, numbers[0]), dr.opaque(arrays().Float, numbers[1])

    def cross(
        self,
        origin: Array3f,
        direction: Array3f,
        near: Float,
        far: Float,
        phase: Float = 0.0,
        cone: Cone = (0.0, 0.0),
    ) -> Crossing:
        """Rays (world, unit direction) through all boxes, between the distances `near` and `far` [m].

        phase: share of a step, 0…1, by which the first step in a texel is shortened; images averaged over it show no
        rings. In cells of voxels nothing depends on it.
        cone: footprint of rays, which selects the levels of texels.
        """
        return Crossing(self.frames, (origin, direction, near, far), phase, cone)

    def next(self, crossing: Crossing, state: MarchState) -> MarchInterval:
        """The next interval of the slot whose open interval ends first; its extinction is not looked up yet."""
        return self.interval(crossing, *crossing.nearest(state))

    def interval(self, crossing: Crossing, slot: UInt, begin: Float, ray: Ray) -> MarchInterval:
        """The interval of a ray behind `begin`, from its entry [m], without its extinction."""
        place = ray.at(begin + crossing.probe(ray, begin))
        inside = ray.inside(place)
        brick = self.brick_at(ray, inside)
        end = crossing.interval_end(ray, begin, place, brick)
        return MarchInterval(slot, ray, begin, end, inside, brick, arrays().Float(0), arrays().Float(0))

    def at(self, box: UInt, place: Array3f, brick: Int) -> MarchInterval:
        """A place in a stored brick of a box, as a step without length; in a texel at its finest level."""
        nowhere = Crossing(self.frames, (place, place, arrays().Float(0), arrays().Float(0)), 0.0, (0.0, 0.0))
        zero = arrays().Float(0)
        return MarchInterval(arrays().UInt(0), nowhere.ray(box), zero, zero, place, brick, zero, zero)

    def brick_at(self, ray: Ray | BoxFrame, inside: Array3f) -> Int:
        """The brick at lattice coordinates inside [0, n − 1): see `MarchInterval`."""
        jit = arrays()
        cell = jit.Array3i(inside) >> 3
        block, inner = cell >> 3, cell & (BLOCK - 1)
        outer = dr.gather(jit.Int, self.coarse, jit.UInt(ray.first + block.z * ray.layer + block.y * ray.row + block.x))
        place_in_block = (inner.z * BLOCK + inner.y) * BLOCK + inner.x
        held = outer >= 0
        brick = dr.gather(jit.Int, self.fine, jit.UInt(outer * BRICKS + place_in_block), held)
        return dr.select(held, brick, outer)

    def extinction(self, step: MarchInterval, direction: Array3f, limit: Limit | None = None) -> MarchInterval:
        """The step with the extinction σ along it, for light along the unit `direction` (world); none in empty bricks.

        τ ρ, in boxes of projected extinction times the projected area of the elements along `direction`. In a cell two
        Gauss points integrate it: exactly a trilinear density, which along a ray is a cubic, and to the fourth order in
        the length of the step where the elements turn along it; to the second in most steps at the usual tolerance
        and above, where their area is that of the middle. In a texel it is that of the middle of the step.
        limit: number of parts that the step is cut into, of which the first is taken; None for the whole step.
        """
        return self.branch(
            (step, direction), step.brick >= 0,
            lambda step, direction: self._in_stored_brick(step, direction, limit), lambda step, direction: step,
        )  # fmt: skip

    def branch(self, arguments: tuple, condition: Bool, yes: Callable, no: Callable) -> Any:
        """What `yes` gives of the arguments where the condition holds, elsewhere `no`."""
        return dr.if_stmt(arguments, condition, yes, no)

    def without_matter(self, depth: Float) -> Bool:
        """Whether an interval of this optical depth, with a sample, has no matter: see `DifferentiableMedium`."""
        return arrays().Bool(False)

    def _in_stored_brick(self, step: MarchInterval, direction: Array3f, limit: Limit | None) -> MarchInterval:
        textures = self.textures
        if textures is None:
            return self._in_cell(step, direction, limit)
        return dr.if_stmt(
            (step, direction), textures.textured(step.ray.box),
            lambda step, direction: self._in_texel(step, direction, limit),
            lambda step, direction: self._in_cell(step, direction, limit),
        )  # fmt: skip

    def _areas(self, step: MarchInterval, direction: Array3f, distances: list[Float], within: Bool) -> list[Float]:
        """Projected areas along `direction` of the elements at `distances` of a step; 1 in boxes of isotropic
        extinction, and where there is no matter `within` the step.
        """
        flakes = self.flakes
        assert flakes is not None
        if self.differentiable:  # a derivative by densities needs the area where there is none, too
            return self.projected_areas(step, direction, distances)
        return dr.if_stmt(
            (step, direction, distances), flakes.in_box(step.ray.box) & within,
            self.projected_areas, lambda step, direction, distances: [arrays().Float(1) for _ in distances],
        )  # fmt: skip

    def _areas_in_cell(
        self, step: MarchInterval, direction: Array3f, places: list[Float], full: Float, least: Float | None
    ) -> list[Float]:
        """`_areas` at two places of a step in a cell: at fine tolerances each its own, and where the depth `full` is
        more than `least`; elsewhere, and without it, both that in the middle between them.
        """
        if self.two_areas:
            return self._areas(step, direction, places, full > 0.0)
        middle = 0.5 * (places[0] + places[1])
        if least is None:
            return 2 * self._areas(step, direction, [middle], full > 0.0)
        two = full > least
        first = self._areas(step, direction, [dr.select(two, places[0], middle)], full > 0.0)[0]
        second = dr.if_stmt(
            (step, direction, places[1], first), two,
            lambda step, direction, place, _: self._areas(step, direction, [place], arrays().Bool(True))[0],
            lambda step, direction, place, first: arrays().Float(first),
        )  # fmt: skip
        return [first, second]

    def projected_areas(self, step: MarchInterval, direction: Array3f, distances: list[Float]) -> list[Float]:
        """Projected area along `direction` of the elements at distances from the entry of the ray [m], within the cell
        of a step in a stored brick: means over the elements, 0…1.
        """
        return [self._area(self.sample(step, distance), direction) for distance in distances]

    def _area(self, step: MarchInterval, direction: Array3f) -> Float:
        """Projected area along `direction` of the elements at the place of a step: mean over them, 0…1."""
        flakes = self.flakes
        assert flakes is not None
        elements, _ = self._elements(step)
        return sum(e.share * flakes.area(e.material, e.axis, direction) for e in elements)

    def sample(self, step: MarchInterval, distance: Float) -> MarchInterval:
        """The step with its place at a distance from the entry of the ray [m], within its cell; in a texel as it is."""
        place = step.ray.at(distance)
        if not (self.textures or self.differentiable):
            cell = InCell.of(step.place).cell
            part = place - arrays().Array3f(cell)
            part = type(part)(*(clip(part[k], 0.0, LAST_IN_CELL) for k in range(3)))
            return replace(step, place=InCell(cell, part))
        cell = dr.floor(step.place)
        place = type(place)(*(clip(place[k], cell[k], cell[k] + LAST_IN_CELL) for k in range(3)))
        if textures := self.textures:
            place = dr.select(textures.textured(step.ray.box), step.place, place)
        return replace(step, place=place)

    def _in_cell(self, step: MarchInterval, direction: Array3f, limit: Limit | None) -> MarchInterval:
        """Extinction of a step within the cell of eight voxels."""
        jit, ray = arrays(), step.ray
        around, first = self.voxels.densities_around(jit.UInt(step.brick), step.place), dr.floor(step.place)
        tau = dr.fmin(ray.tau, ray.densest / dr.detach(functools.reduce(dr.fmax, around)))

        def extinction(distance: Float) -> Float:
            part = ray.at(distance) - first
            return tau * trilinear(around, jit.Array3f(*(clip(part[k], 0.0, 1.0) for k in range(3))))

        def integrated(step: MarchInterval, least: Float | None = None) -> tuple[MarchInterval, Float]:
            """The step with its extinction, and the optical depth that it would have with areas of 1; least: see
            `_areas_in_cell`.
            """
            middle, half = 0.5 * (step.begin + step.end), 0.5 * (step.end - step.begin)
            places = [dr.fma(half, node, middle) for node in (-GAUSS_NODE, GAUSS_NODE)]
            low, high = (extinction(place) for place in places)
            full = (low + high) * half
            if self.flakes is not None:
                areas = self._areas_in_cell(step, direction, places, full, least)
                low, high = low * areas[0], high * areas[1]
            total = low + high
            growth = clip((high - low) / (GAUSS_NODE * dr.fmax(total, 1e-30)), -1.0, 1.0)
            return replace(step, depth=total * half, growth=growth), full

        step, full = integrated(step)
        if limit is None:
            return step
        parts = dr.detach(dr.fmax(limit(step), 1.0))
        again, least = parts > 1.0, None
        if self.flakes is not None and not self.two_areas:  # or few parts by an area that is small in the middle alone
            least = TURNING * self.frames.deepest
            again |= full > least

        def cut(step: MarchInterval, parts: Float) -> MarchInterval:
            share = share_at_depth(dr.rcp(parts), dr.detach(step.growth))
            end = dr.fma(step.end - step.begin, share, step.begin)
            end = dr.fmin(dr.fmax(end, step.begin + ray.probe), step.end)  # a nudge at least: rays go on
            return integrated(replace(step, end=dr.select(parts > 1.0, end, step.end)), least)[0]

        return self.branch((step, parts), again, cut, lambda step, parts: step)

    def _in_texel(self, step: MarchInterval, direction: Array3f, limit: Limit | None) -> MarchInterval:
        """Extinction of a step in a texel, that of its middle; the end behind matter-free space around it."""
        jit, ray = arrays(), step.ray
        density, clearance = self._texel_density(step)
        step.depth = ray.tau * density * (step.end - step.begin)
        if self.flakes is not None:
            step.depth *= self._areas(step, direction, [0.5 * (step.begin + step.end)], step.depth > 0.0)[0]
        step.growth = jit.Float(0)
        if limit is not None:
            part = dr.rcp(clip(limit(step), 1.0, MOST_PARTS_IN_TEXEL))
            step.depth, step.end = step.depth * part, dr.fma(step.end - step.begin, part, step.begin)
        whole = 2.0 * ray.probe
        step.end += dr.fmax(dr.floor(CLEARANCE_SHARE * clearance / whole) - 1.0, 0.0) * whole
        return step

    def _texel_density(self, step: MarchInterval) -> tuple[Float, Float]:
        """Density of a texel at a sample, and the least distance from matter there, see `Textures.clearance` [m]."""
        textures, jit = self.textures, arrays()
        assert textures is not None
        share = self.voxels.density(jit.UInt(step.brick), step.place)
        clearance = textures.clearance(step.ray.box, share)
        density = dr.if_stmt(
            (step,), clearance > 0.0,
            lambda step: jit.Float(0),
            lambda step: textures.density(textures.lattice(step.ray.box, step.ray.level), self._charted(step)[0]),
        )  # fmt: skip
        return density, clearance

    def extinction_at(self, step: MarchInterval, direction: Array3f, least: Float = 0.0) -> tuple[Float, Float]:
        """σ at the place of a step in a stored brick [1/m], and how far from there light meets no matter [m].

        Of σ up to `least` only that it is no more is known.
        """
        free = arrays().Float(0)
        if (textures := self.textures) is None:
            sigma = self.cell_extinction(step)
        else:
            sigma, free = dr.if_stmt(
                (step,), textures.textured(step.ray.box),
                self.texel_extinction, lambda step: (self.cell_extinction(step), arrays().Float(0)),
            )  # fmt: skip
        if self.flakes is None:
            return sigma, free
        area = dr.if_stmt(  # which is 1 at most
            (step, direction), sigma > least, self._area, lambda step, direction: arrays().Float(1)
        )
        return sigma * area, free

    def cell_extinction(self, step: MarchInterval) -> Float:
        """τρ in a cell of eight voxels [1/m]."""
        around = self.voxels.densities_around(arrays().UInt(step.brick), step.place)
        tau = dr.fmin(step.ray.tau, step.ray.densest / dr.fmax(functools.reduce(dr.fmax, around), 1e-30))
        return tau * trilinear(around, step.place - dr.floor(step.place))

    def texel_extinction(self, step: MarchInterval) -> tuple[Float, Float]:
        """τρ in a texel [1/m], and how far from there light meets no matter [m]."""
        density, clearance = self._texel_density(step)
        return step.ray.tau * density, CLEARANCE_SHARE * clearance

    def elements(self, step: MarchInterval, direction: Array3f | None) -> tuple[list[Element], TexelHit | None]:
        """Elements of a sample in a stored brick as a ray along `direction` sees them: shares are those of extinction;
        without a direction those of density.

        With them its place in a texel (None: no box has one).
        """
        elements, texel_hit = self._elements(step)
        if direction is None or self.flakes is None or len(elements) == 1:
            return elements, texel_hit
        shares = [e.share * self.flakes.area(e.material, e.axis, direction) for e in elements]
        scale = dr.rcp(dr.fmax(sum(shares), 1e-9))
        return [replace(e, share=share * scale) for e, share in zip(elements, shares, strict=True)], texel_hit

    def _elements(self, step: MarchInterval) -> tuple[list[Element], TexelHit | None]:
        """Elements of a sample in a stored brick, shares being those of density; and its place in a texel."""
        shadow_bias = (
            None if self.shadow_biases is None else dr.gather(arrays().Float, self.shadow_biases, step.ray.box)
        )
        material = self.material(step)
        if shadow_bias is not None and self.kinds.tangents:  # a tangent has no outside
            shadow_bias = dr.select(self.kinds.tangent(material), 0.0, shadow_bias)
        plain = Element(self.axis(step, material), material, shadow_bias=shadow_bias)
        textures = self.textures
        if textures is None:
            return [plain], None
        textured = textures.textured(step.ray.box)
        here, along_u, normal = self._charted(step)
        frame = surface_frame(self._in_world(step.ray.box, along_u), self._in_world(step.ray.box, normal))
        lattice = textures.lattice(step.ray.box, step.ray.level)
        elements, each = [], textures.densities(lattice, here)
        scale = dr.rcp(dr.fmax(sum(each), 1e-9))
        scales = textures.scales(step.ray.level)
        tangents = [self.kinds.population(material, k) for k in range(len(each))]
        for k, axis in enumerate(textures.axes(lattice, here, tangents)):
            axis = dr.normalize(dr.select(textured, frame.outwards(axis), plain.axis) + 1e-9)
            share = dr.select(textured, each[k] * scale, float(k == 0))
            number = material + dr.select(textured & (lattice.populations > k), k, arrays().UInt(0))
            elements.append(Element(axis, number, share, scales[k], shadow_bias))
        return elements, TexelHit(textured, step.ray.box, step.ray.level, step.ray.tau, here, frame)

    def _charted(self, step: MarchInterval) -> tuple[SurfacePoint, Array3f, Array3f]:
        """Where a sample in a stored brick of a box with a chart is on its surface, tangent along u and normal."""
        assert self.textures is not None and isinstance(self.voxels, PackedVoxels)
        bricks = self._brick_in(self.chart_shift, step), arrays().UInt(step.brick)
        return surface_point_at(self.charts, self.voxels, bricks, step.place, self.textures.chart_scale(step.ray.box))

    def axis(self, step: MarchInterval, material: UInt | None = None) -> Array3f:
        """Unit axis, in the world, at a sample in a stored brick; `material`: that of the sample, where it is known."""
        if material is None:
            material = self.material(step)
        tangent, same = self.kinds.tangent(material), self._of_its_kind(step, material)
        axis = self.voxels.axis(arrays().UInt(step.brick), step.place, tangent, same)
        return dr.normalize(self._in_world(step.ray.box, axis) + 1e-9)

    def colour(self, step: MarchInterval) -> Array4f:
        """Coefficients of the body colour at a sample in a stored brick of a box that has them, weighed by density."""
        assert self.colours is not None
        colours = packets_around(self.colours, self._brick_in(self.colour_shift, step), step.place)
        each = shares(self.voxels, arrays().UInt(step.brick), step.place)
        mean = sum((colour * share for colour, share in zip(colours, each, strict=True)), arrays().Array4f(0.0))
        return mean / dr.fmax(sum(each), 1e-30)

    def material(self, step: MarchInterval) -> UInt:
        """Number of the sample's material in the row of all boxes' materials: of the voxel that adds most matter."""
        UInt = arrays().UInt
        first = dr.gather(UInt, self.first_material, step.ray.box)
        if self.materials is None:
            return first
        each = shares(self.voxels, UInt(step.brick), step.place)
        offset, most = UInt(CORNERS[0]), each[0]
        for there, share in zip(CORNERS[1:], each[1:], strict=True):
            offset, most = dr.select(share > most, there, offset), dr.fmax(share, most)
        start, _ = corner(self._brick_in(self.material_shift, step), step.place)
        return first + self._material_of_voxel(step, start + offset)

    def _material_of_voxel(self, step: MarchInterval, voxel: UInt) -> UInt:
        """Number of a voxel's material in its box."""
        has = dr.gather(arrays().Int, self.material_shift, step.ray.box) != NO_GRID
        return arrays().UInt(dr.gather(arrays().UInt8, self.materials, voxel, has))

    def _of_its_kind(self, step: MarchInterval, material: UInt) -> list[Bool] | None:
        """Which of the eight voxels around a sample have the element of its `material`; None: all."""
        if not self.kinds.mixed or self.materials is None:
            return None
        start, _ = corner(self._brick_in(self.material_shift, step), step.place)
        first, kind = dr.gather(arrays().UInt, self.first_material, step.ray.box), self.kinds.of(material)
        return [self.kinds.of(first + self._material_of_voxel(step, start + offset)) == kind for offset in CORNERS]

    def _in_world(self, box: UInt, vector: Array3f) -> Array3f:
        """A vector in box axes as one in the world."""
        x, y, z = self.frames.rotation(box)
        return vector.x * x + vector.y * y + vector.z * z

    def _brick_in(self, shift: Int, step: MarchInterval) -> UInt:
        """Number of the sample's brick in a grid that not every box has; 0 where it has none."""
        return _shifted(shift, step.ray.box, step.brick)

    def brick_with_chart(self, box: UInt, brick: Int) -> UInt:
        """Number of a brick of a box in the grid of charts; 0 where the box has none, or the brick is not stored."""
        return dr.select(brick >= 0, _shifted(self.chart_shift, box, brick), 0)

    def _optional(self, name: str) -> tuple[Any, Any]:
        """A grid that some boxes have (None: no box), and per box how its brick numbers differ there."""
        grids: list[Grid | None] = [getattr(box.bricks, name) for box in self.boxes]
        values = next((grid.values for grid in grids if grid is not None), None)
        shifts = [
            NO_GRID if grid is None else grid.first - box.bricks.density.first
            for grid, box in zip(grids, self.boxes, strict=True)
        ]
        return values, lookup(arrays().Int, np.array(shifts, np.int32))


def _shifted(shift: Int, box: UInt, brick: Int) -> UInt:
    """Number of a brick of a box in a grid whose numbers differ by `shift`; 0 where the box has no such grid."""
    jit = arrays()
    shift = dr.gather(jit.Int, shift, box)
    return jit.UInt(dr.select(shift == NO_GRID, 0, brick + shift))


def negligible_depth(boxes: Sequence[VolumeBox]) -> float:
    """Optical depth of a step below which it counts as empty: so little that no box loses matter by it that it shows.

    NEGLIGIBLE_OPTICAL_DEPTH, or less where a box is so thin that the thickest of its voxels has not a thousand times
    as much: what is taken for empty is then thinner than a thousandth of that voxel.
    """
    thickest = [box.tau * box.voxel_size * box.bricks.densest for box in boxes if box.bricks.kept and not box.texel]
    return min([NEGLIGIBLE_OPTICAL_DEPTH, *(max(NEGLIGIBLE_SHARE * depth, LEAST_DEPTH) for depth in thickest)])


def _tables(bricks: list[Bricks]) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Tables of several lattices as one, brick numbers counted in their common pool; where each coarse one starts."""
    coarse, fine, first, blocks = [], [], [0], 0
    for part in bricks:
        table = part.table
        coarse.append(np.where(table.coarse >= 0, table.coarse + blocks, table.coarse).ravel())
        fine.append(np.where(table.fine >= 0, table.fine + part.density.first, table.fine).ravel())
        blocks += len(table.fine)
        first.append(first[-1] + table.coarse.size)
    fine.append(np.full(1, -BRICK, np.int32))  # a table without blocks is never read, but must not be empty
    return np.concatenate(coarse), np.concatenate(fine), first[:-1]
