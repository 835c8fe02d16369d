"""Joint: light of all orders between surfaces, and between them and boxes, in the same sweeps as that of the cells.

The unknowns are the incident light of the filled cells, then that of both sides of all patches; a sweep brings what all
of them send to all of them. Without boxes there are no cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, arrays
from hagoromo.errors import InputError
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.links import Links, LitSurfaces, SmoothMatter, dark
from hagoromo.transport.field.patches import SIDES, CornerLight
from hagoromo.transport.field.sent_light import Numbers, added, nothing
from hagoromo.transport.field.solve import FieldSolution, Solver, accelerated, warn_if_unsettled
from hagoromo.transport.field.sweep import Ways, balanced, sweep
from hagoromo.transport.sample import Element

PATCH_WAYS, LAST_WAYS = 96, 256  # rays of a patch, to both sides: of a sweep, and of the light that the camera sees
CELL_LANES = 1 << 19  # rays of all cells to the surfaces, about
FEWEST_WAYS, MOST_WAYS = 12, 64  # of one cell


@dataclass(frozen=True, eq=False)
class StoredSurfaceLight:
    """What a `SurfaceLight` is made of again."""

    at_corners: NDArray[np.float32]
    residual: float
    sweeps: int


class SurfaceLight:
    """Light of orders ≥ 1 that arrives at surfaces, and its look-up where a ray of the camera meets one.

    residual, sweeps: of the solution, see `FieldSolution`.
    """

    def __init__(self, lit: LitSurfaces, stored: StoredSurfaceLight) -> None:
        """`InputError` where the light is not that of these surfaces."""
        self.lit, self.channels, self.light = lit, lit.channels, CornerLight(lit.patches, stored.at_corners)
        self.residual, self.sweeps = stored.residual, stored.sweeps
        if self.light.channels != self.channels:
            raise InputError(f"light at surfaces has {self.light.channels} channels, and the scene {self.channels}")

    @classmethod
    def solved(cls, lit: LitSurfaces, light: Numbers, residual: float = 0.0, sweeps: int = 0) -> SurfaceLight:
        """Of the light at all sides of patches."""
        return cls(lit, StoredSurfaceLight(lit.patches.at_corners(light), residual, sweeps))

    def stored(self) -> StoredSurfaceLight:
        """What it is made of again."""
        return StoredSurfaceLight(self.light.at_corners(), self.residual, self.sweeps)

    @property
    def bytes(self) -> int:
        """Memory of the light [byte]."""
        return self.light.bytes

    def radiance(
        self, point: Array3f, element: Element, coefficients: list[Float], to_eye: Array3f, there: Bool
    ) -> list[Float]:
        """Radiance of every channel that the surface sends to the eye; 0 where it is not `there`."""
        normal = element.axis if element.ground is None else element.ground
        patch = self.lit.patches.at(point, normal, there)
        light = self.lit.again(element, coefficients, to_eye, patch, self.light)
        return [dr.select(patch.there, each, 0.0) for each in light]


class Joint:
    """Sweeps over the cells of a `solver`, None without boxes, and the patches of surfaces."""

    def __init__(self, solver: Solver | None, lit: LitSurfaces, seed: int) -> None:
        self.solver, self.lit, self.sides = solver, lit, SIDES * lit.patches.count
        self.random = np.random.default_rng((seed, 1))
        self.cells = solver.cells.filled if solver else 0
        self.matter: SmoothMatter | None = None
        if solver:
            self.ways = Ways(solver.samples, solver.cells, self.random)
            self.sigma = self.ways.smooth
            self.matter = SmoothMatter(solver.cells, self.sigma, [])
            self.single = SmoothMatter(solver.cells, self.sigma, solver.single)
            self.cell_links = self._cell_links(solver.cells)
        self.patch_links = self._patch_links(PATCH_WAYS)

    def sight(self, cells: Cells, place: Array3f, towards: Array3f) -> Float:
        """How far places on a grid see along directions [cell]."""
        point = dr.fma(place, cells.edge, cells.corner)
        return self.lit.surfaces.hit(point, towards).distance * cells.per_metre

    def solved(self, orders: int | None) -> tuple[FieldSolution | None, SurfaceLight]:
        """The light of orders 1 … `orders` − 1 (None: of all) in the stored cells, and at the surfaces."""
        lit, residual, sweeps = self.lit, 0.0, 0
        if orders == 1:
            cells = nothing(lit.channels, self.solver.stored.count) if self.solver else None
            return FieldSolution(cells, 0.0, 0) if cells else None, SurfaceLight.solved(lit, dark(lit))
        light: Numbers | None = None
        if orders is None:
            light, residual, sweeps = self._accelerated()
        elif orders > 2:
            once = light = self._once()
            for _ in range(orders - 3):
                light, sweeps = added(once, self._swept(light)), sweeps + 1
        warn_if_unsettled(residual, sweeps)
        incident, arriving = self._parts(light) if light else (None, None)
        at_patches = self._at_patches(self._patch_links(LAST_WAYS), incident, arriving)
        surface = SurfaceLight.solved(lit, at_patches, residual, sweeps)
        if self.solver is None:
            return None, surface
        return self.solver.kept(incident or self._in_cells(), residual, sweeps + 1), surface

    def _once(self) -> Numbers:
        """Light that was scattered once before it arrives."""
        return self._together(self._in_cells() if self.solver else None, self._at_patches(self.patch_links, None, None))

    def _in_cells(self) -> Numbers:
        """Light in the cells that was scattered once."""
        assert self.solver
        once, self.own = sweep(self.ways, self.solver.single, self.sight)
        return added(once, self.cell_links.direct())

    def _swept(self, light: Numbers) -> Numbers:
        """What all send on of the light that arrives at all."""
        incident, arriving = self._parts(light)
        cells, patches = None, self.patch_links.again(arriving)
        if self.solver and incident:
            sent = self.solver.again(incident)
            cells = added(balanced(self.ways, sent, self.sight), self.cell_links.again(arriving))
            patches = added(patches, self.patch_links.from_matter(SmoothMatter(self.solver.cells, self.sigma, sent)))
        return self._together(cells, patches)

    def _at_patches(self, links: Links, incident: Numbers | None, arriving: Numbers | None) -> Numbers:
        """Light at the patches: of the lamps, sent on once, and of smooth light, sent on again."""
        total = links.direct()
        if arriving:
            total = added(total, links.again(arriving))
        if self.solver:
            total = added(total, links.from_matter(self.single))
            if incident:
                matter = SmoothMatter(self.solver.cells, self.sigma, self.solver.again(incident))
                total = added(total, links.from_matter(matter))
        return total

    def _accelerated(self) -> tuple[Numbers, float, int]:
        """Incident light of all orders, its residual, and the number of sweeps."""
        once = self._once()
        return accelerated(once, self._swept(once), self._gain(), self._swept)

    def _gain(self) -> list[Float]:
        """See `Solver.own_gain`; 1 of patches, which see nothing of themselves."""
        ones = dr.full(arrays().Float, 1.0, self.sides)
        if self.solver is None:
            return [ones] * self.lit.channels
        return [dr.concat([gain, ones]) for gain in self.solver.own_gain(self.own, self.ways)]

    def _together(self, cells: Numbers | None, patches: Numbers) -> Numbers:
        if cells is None:
            return patches
        joint = [[dr.concat([a, b]) for a, b in zip(*each, strict=True)] for each in zip(cells, patches, strict=True)]
        dr.eval(joint)
        return joint

    def _parts(self, light: Numbers) -> tuple[Numbers | None, Numbers]:
        """Of the cells, and of the patches."""
        kind, index = arrays().Float, arrays().UInt
        first, second = dr.arange(index, self.cells or 1), dr.arange(index, self.sides) + dr.opaque(index, self.cells)
        parts = [[[dr.gather(kind, n, which) for n in numbers] for numbers in light] for which in (first, second)]
        dr.eval(parts)
        return parts[0] if self.solver else None, parts[1]

    def _patch_links(self, ways: int) -> Links:
        patches = self.lit.patches
        return Links(self.lit, patches.centres, patches.normals, ways, self.random, self.matter)

    def _cell_links(self, cells: Cells) -> Links:
        """Of the filled cells of a grid, from the centroids of their matter."""
        ways = int(np.clip(CELL_LANES // cells.filled, FEWEST_WAYS, MOST_WAYS))
        assert cells.centroids is not None
        return Links(self.lit, cells.centroids, None, ways, self.random, self.matter)
