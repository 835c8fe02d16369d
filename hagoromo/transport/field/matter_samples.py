"""Samples of the matter in cells: how much there is, along which axis, of which colour; and the light of the lamps.

Each cell is asked at `side`³ places. Those with matter are kept, cell after cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, clip, lookup, opaque_vector, vectors
from hagoromo.errors import InputError
from hagoromo.files.memory import return_unused
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.transport.crossing import LATTICE_MARGIN, MarchInterval
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cell_size import densest
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.film import scrambled
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.volume.box import VolumeBox

SAMPLES_AT_ONCE = 1 << 21
RANDOM_KEYS = 0x68E31DA4, 0xB5297A4D, 0x1B56C4E9  # of the three coordinates of a place


@dataclass
class MatterSample:
    """One sample of matter. share: what it adds to the surface density τρ of its cell [1/m], see `MatterSamples`.

    colours: of body, interface and what is transmitted in every band. light: irradiance from every lamp, with shadows.
    """

    material: UInt
    share: Float
    axis: Array3f
    point: Array3f
    colours: list[Float]
    light: list[Float]


class MatterSamples:
    """Samples of all cells: σ(ω) = Σ share · A(a·ω). Those of cell k are numbered first[k] … first[k + 1] − 1.

    The columns of a sample: material, share, axis and place, its light, then its colours, but where `by_material` has
    those of every material. A plain object: loops do not take its arrays into their state.
    """

    def __init__(
        self, first: UInt, columns: list[Float], colours: int, materials: Materials, by_material: Float | None
    ) -> None:
        self.first, self.columns, self.colours, self.materials = first, columns, colours, materials
        self.by_material = by_material

    @property
    def count(self) -> int:
        """How many there are."""
        return dr.width(self.columns[0])

    def of_cell(self, cell: UInt) -> tuple[UInt, UInt]:
        """The first sample of a cell, and the one behind its last."""
        first, end = (dr.gather(arrays().UInt, self.first, cell + j) for j in (0, 1))
        return first, end

    def at(self, number: UInt) -> MatterSample:
        """Sample of a number."""
        jit = arrays()
        material, share, *rest = (dr.gather(type(column), column, number) for column in self.columns)
        if self.by_material is None:
            light, colours = rest[6 : -self.colours], rest[-self.colours :]
        else:
            light, row = rest[6:], material * self.colours
            colours = [dr.gather(jit.Float, self.by_material, row + k) for k in range(self.colours)]
        return MatterSample(material, share, jit.Array3f(*rest[:3]), jit.Array3f(*rest[3:6]), colours, light)

    def point(self, number: UInt) -> Array3f:
        """Place of a sample, in the coordinates of the boxes."""
        return arrays().Array3f(*(dr.gather(type(c), c, number) for c in self.columns[5:8]))

    def extinction(self, number: UInt, way: Array3f) -> Float:
        """What a sample adds to σ along a direction [1/m]."""
        material, share, x, y, z = (dr.gather(type(c), c, number) for c in self.columns[:5])
        return share * self.area(material, arrays().Array3f(x, y, z), way)

    def area(self, material: UInt, axis: Array3f, way: Array3f) -> Float:
        """Projected area of the element of a material."""
        cosine, area = dr.dot(axis, way), arrays().Float(0)
        element = self.materials.read(material, "element")
        for name in self.materials.elements:
            area = dr.select(element == ELEMENTS.index(name), projected_area(name, cosine), area)
        return area


def sampled(
    medium: Medium, lighting: Lighting, low: NDArray, size: float, touched: NDArray, side: int, bands: BandColours
) -> tuple[Cells, MatterSamples]:
    """The cells that hold matter among those that may, `touched` (nz, ny, nx), and their samples, `side`³ each."""
    jit = arrays()
    candidates = np.argwhere(touched)[:, ::-1]
    each = max(SAMPLES_AT_ONCE // side**3, 1)
    parts: list[list[NDArray]] = []
    for begin in range(0, len(candidates), each):
        for number, box in enumerate(medium.boxes):
            spread = _spread(box, size / side)
            point = _points(low, size, candidates, range(begin, min(begin + each, len(candidates))), side, spread)
            step, density = matter_at(medium, number, point)
            kept = dr.compress(density > 0.0)
            if dr.width(kept) > 0:
                twice = 1.0 if box.extinction == "projected" else 2.0  # for the area ½ of a sphere
                some = _kept(medium, lighting, bands, kept, (number, step, density * (twice / side**3), point))
                parts += [[begin + place // side**3, *columns] for place, *columns in map(_with_share, some)]
    if not any(len(owner) for owner, *_ in parts):
        raise InputError("no volume box holds matter: render in mode march")
    owner = np.concatenate([part.pop(0) for part in parts])
    order = np.argsort(owner, kind="stable")
    columns = [_joined(parts, order) for _ in range(len(parts[0]))]
    held, counts = np.unique(owner[order], return_counts=True)
    filled = np.zeros(touched.shape, bool)
    filled[tuple(candidates[held].T[::-1])] = True
    starts = np.concatenate([[0], np.cumsum(counts)])
    first, weight = lookup(jit.UInt, starts.astype(np.uint32)), np.array(columns[1], np.float64)
    moments = [np.add.reduceat(weight * np.array(column), starts[:-1]) for column in columns[5:8]]
    centroids = np.stack(moments, axis=1) / np.add.reduceat(weight, starts[:-1])[:, None]
    by_material = None if lighting.voxel_bases else colours_by_material(bands, lighting.materials)
    samples = MatterSamples(first, columns, bands.columns, lighting.materials, by_material)
    return_unused()
    return Cells(low, size, filled, centroids), samples


def _joined(parts: list[list[NDArray]], order: NDArray[np.intp]) -> Float:
    """The first column that all parts have, in another order. It leaves the parts: no two columns stand twice."""
    column = np.concatenate([part.pop(0) for part in parts])
    return lookup(arrays().UInt if column.dtype == np.uint32 else arrays().Float, column[order])


def colours_by_material(bands: BandColours, materials: Materials) -> Float:
    """Colours in every band of each material, row after row."""
    jit = arrays()
    columns = bands.of(materials.coefficients(dr.arange(jit.UInt, materials.count)))
    return lookup(jit.Float, np.stack([np.broadcast_to(np.array(c), materials.count) for c in columns], axis=1))


def held_share(medium: Medium, low: NDArray, size: float, touched: NDArray) -> float:
    """How much of the space of the cells that are `touched` (nz, ny, nx) holds matter, by one place in each."""
    cells, found, boxes = np.argwhere(touched)[:, ::-1], 0, range(len(medium.boxes))
    for begin in range(0, len(cells), SAMPLES_AT_ONCE):
        point = _points(low, size, cells, range(begin, min(begin + SAMPLES_AT_ONCE, len(cells))), 1, 1.0)
        found += sum(int(dr.count(matter_at(medium, number, point)[1] > 0.0)[0]) for number in boxes)
    return found / max(len(cells), 1)


def sample_bytes(bands: BandColours, lighting: Lighting) -> float:
    """Memory of one sample [byte]: material, share, axis, place and light, and colours where voxels have their own."""
    return 4.0 * (8 + len(lighting.lamps) + bands.columns * bool(lighting.voxel_bases))


def matter_at(medium: Medium, number: int, point: Array3f) -> tuple[MarchInterval, Float]:
    """A place in box `number` as a step without length, and τρ there [1/m]; 0 outside."""
    jit, texel = arrays(), medium.boxes[number].texel
    number = dr.opaque(jit.UInt, number)
    frame = medium.frames.frame(number)
    (x, y, z), (low, high) = frame.columns, frame.bounds
    place = point.x * x + point.y * y + point.z * z + frame.shift
    inside = dr.all((place >= low) & (place <= high))
    place = jit.Array3f(*(clip(place[k], 0.0, frame.last[k] - LATTICE_MARGIN) for k in range(3)))
    brick = medium.brick_at(frame, place)
    step = medium.at(number, place, brick)

    def density(step: MarchInterval) -> Float:
        return medium.texel_extinction(step)[0] if texel else medium.cell_extinction(step)

    return step, dr.if_stmt((step,), inside & (brick >= 0), density, lambda step: jit.Float(0))


def _kept(medium: Medium, lighting: Lighting, bands: BandColours, kept: UInt, where: tuple) -> list[list[NDArray]]:
    """Of every element, which of those at `where` are `kept`, and the columns of these samples.

    where: number of the box, step, density share and point.
    """
    number, step, density, point = where
    place, point, share = (dr.gather(type(each), each, kept) for each in (step.place, point, density))
    brick = dr.gather(arrays().Int, step.brick, kept)
    step = medium.at(dr.full(arrays().UInt, number, dr.width(kept)), place, brick)
    elements, texel_hit = medium.elements(step, None)
    biased = elements[0].shadow_bias is not None  # then each element has shadow rays of its own
    lights = [lighting.irradiances(each, point, 0.5 * share, texel_hit) for each in elements[: None if biased else 1]]
    parts, count = [], dr.width(kept)
    for k, element in enumerate(elements):
        coefficients = lighting.materials.coefficients(element.material)
        if lighting.voxel_bases and k == 0:
            coefficients = lighting.with_voxel_colour(coefficients, step.ray.box, medium.colour(step))
        colours = bands.of(coefficients) if lighting.voxel_bases else []
        columns = [share * element.share, *element.axis, *point, *lights[k if biased else 0], *colours]
        material = element.material + dr.zeros(arrays().UInt, count)
        parts.append([kept, material, *(c + dr.zeros(arrays().Float, count) for c in columns)])
    dr.eval(parts)
    return [[np.array(column) for column in columns] for columns in parts]


def _with_share(columns: list[NDArray]) -> list[NDArray]:
    """Of columns of `_kept` those with a share in their cell: a cell of none holds nothing."""
    holds = columns[2] > 0.0
    return [column[holds] for column in columns]


def _points(low: NDArray, size: float, cells: NDArray, some: range, side: int, spread: float) -> Array3f:
    """A place in each of `side`³ equal parts of `some` cells, cell after cell, at random within `spread` of its edge.

    The faces of matter may lie anywhere in cells: with places in the middles alone, all cells along a face would hold
    too much of it, or too little.
    """
    jit, along, corners = arrays(), dr.opaque(arrays().UInt, side), cells[some.start : some.stop].astype(np.float32)
    lane = dr.arange(jit.UInt, len(some) * side**3)
    each = dr.opaque(jit.UInt, side**3)
    cell, part = dr.gather(jit.Array3f, vectors(corners), lane // each), lane % each
    middle = jit.Array3f(part // along**2, part // along % along, part % along) + 0.5
    drawn = scrambled(lane + dr.opaque(jit.UInt, some.start * side**3))
    random = [scrambled(drawn + key) * 2.0**-32 - 0.5 for key in RANDOM_KEYS]
    place = cell + dr.fma(jit.Array3f(*random), dr.opaque(jit.Float, spread), middle) * dr.opaque(jit.Float, 1.0 / side)
    return dr.fma(place, dr.opaque(jit.Float, size), opaque_vector(low))


def _spread(box: VolumeBox, part: float) -> float:
    """Of the places of samples over the edge `part` of what each stands for [m]: a mean free path, at most all of it.

    Deeper within matter the light of the lamps falls off between the places, and few at its face would stand for all.
    """
    return min(1.0 / max(part * box.tau * densest(box), 1e-30), 1.0)
