"""Wing: the pair of feathered wings of the standing figure, behind its shoulder blades. All in mm.

Every feather is a curved layer of its own, with shaft, barbs and splits; a point evaluates the few that are near.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo.matter.fill import Fineness
from hagoromo.matter.shape import capsule, coverage, unit
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.feather.barb import Barbs
from hagoromo_matter.feather.barbule import Barbules
from hagoromo_matter.feather.down import Down
from hagoromo_matter.feather.feather import plan_of
from hagoromo_matter.feather.plume import Plume, Spot, rolled
from hagoromo_matter.feather.vane import Feather, feather_at
from hagoromo_matter.feather.wing_bones import Ground, arm, ground
from hagoromo_matter.feather.wing_grid import FeatherGrid, cell_at, grid_of
from hagoromo_matter.feather.wing_rows import ARM_HALF_THICKNESS, AT, FEATHER_FIELDS, feathers, height_of
from hagoromo_matter.noise import gradient_noise

EXTENT = (-136.0, 14.0, 52.0), (136.0, 82.0, 308.0)
WING_FINENESS = Fineness(0.2, 0.1)
JOINTS = 28  # joints of the arm
LEAN = 0.6  # share of the arm's thickness that the arm fills; coverts fill the rest
FUR = 0.6  # width of the frayed edge of the arm
# coarse enough for a lattice that holds both wings
WING_FEATHER = Feather(
    barbs=Barbs(1.1, 36.0, 46.0, 12.0, 1.6, 0.2, 0.26, 0.12, 1.6, 0.5, 0.0),
    barbules=Barbules(6.0, 5.0, 48.0, 40.0, 0.8, 0.8, 0.03, 0.08, 0.03, 0, 0.03),
    down=Down(share=0.0),
)


def wing_of(material: Reflectance | Sequence[Reflectance], resolution: float = 1.0, seed: int = 1) -> BoxPlan:
    """Both wings in one box. material: one; or two, the second for the flight feathers; or three, for the shafts.

    resolution: voxels per mm, as a multiple of those of WING_FINENESS.
    """
    if not resolution > 0:
        raise InputError(f"resolution is {resolution:g}: give a number above 0")
    fineness = WING_FINENESS.finer(resolution)
    wing = Wing(seed, fineness)
    return plan_of(wing.field, wing.bound, EXTENT, fineness, material, "wings")


class Wing:
    """The feathers of both wings, on the device."""

    def __init__(self, seed: int, fineness: Fineness) -> None:
        jit, self.fineness = arrays(), fineness
        self.seed = dr.opaque(jit.UInt, seed)
        middle, _ = arm(np.linspace(0.0, 1.0, JOINTS))
        _, direction = arm(np.linspace(0.0, 1.0, JOINTS))
        thick = np.interp(np.linspace(0.0, 1.0, JOINTS), AT, ARM_HALF_THICKNESS)
        self.thick = LEAN * thick
        inward = np.stack([direction[:, 1], -direction[:, 0]], axis=1)
        self.bone = middle + inward * thick[:, None]
        around = np.array([(*p, h) for p, r in zip(self.bone, self.thick, strict=True) for h in np.linspace(-r, r, 9)])
        grown = [around + np.array([x, z, 0.0]) for x in np.linspace(-6, 6, 7) for z in np.linspace(-8, 8, 9)]
        grid: FeatherGrid = grid_of(feathers(seed), np.concatenate(grown))
        self.starts, self.members = jit.UInt(grid.starts), jit.UInt(grid.members)
        self.table, self.clear = jit.Float(grid.table), jit.Float(grid.clear)
        self.cells = len(grid.clear)

    def bound(self, point: Any) -> Any:
        """A bound of the distance to the wings."""
        place = ground(point)
        return dr.gather(arrays().Float, self.clear, cell_at(place.x, place.z, place.height))

    def field(self, point: Any) -> tuple[Any, Any, Any]:
        """Density, tangent and colour of all feathers near points."""
        jit, place = arrays(), ground(point)
        cell = cell_at(place.x, place.z, place.height) + place.side * self.cells
        now, end = (dr.gather(jit.UInt, self.starts, cell + k) for k in range(2))
        density, tangent = self._arm(place)
        strongest, colour = density + 0.0, jit.UInt(0) * now
        state = (now, density, strongest, tangent, colour)

        def some_left(now: Any, *_: Any) -> Any:
            return now < end

        def add_one(now: Any, density: Any, strongest: Any, tangent: Any, colour: Any) -> tuple[Any, ...]:
            here, way, tint = self.feather(place, dr.gather(jit.UInt, self.members, now))
            more = here > strongest
            return (
                now + 1,
                dr.fmin(density + here, 1.0),
                dr.fmax(strongest, here),
                dr.select(more, way, tangent),
                dr.select(more, tint, colour),
            )

        _, density, _, tangent, colour = dr.while_loop(state, some_left, add_one)
        return density, tangent, colour

    def feather(self, place: Ground, number: Any) -> tuple[Any, Any, Any]:
        """Density, tangent and colour of one feather."""
        jit, first = arrays(), number * len(FEATHER_FIELDS)
        own = {name: dr.gather(jit.Float, self.table, first + k) for k, name in enumerate(FEATHER_FIELDS)}
        x, z = place.x - own["x"], place.z - own["z"]
        off = -x * own["cosine"] - z * own["sine"]
        ahead = x * own["sine"] - z * own["cosine"]
        across, along, sine, cosine = rolled(off, ahead, -own["bow"])
        share = clip(along / own["length_mm"], 0.0, 1.0)
        height = (place.height - height_of(across, share, own)) * own["face"]
        right = place.outwards * (-own["cosine"]) - place.upwards * own["sine"]
        down = place.outwards * own["sine"] - place.upwards * own["cosine"]
        right, down = right * cosine + down * sine, down * cosine - right * sine
        wide = 0.5 * (own["outer_mm"] + own["inner_mm"])
        slope = own["tilt"] - 2.0 * own["hollow"] * across / dr.square(wide)
        rise = 3.0 * own["curl"] * share * share / own["length_mm"]
        right, down = unit(right + place.forwards * slope), unit(down + place.forwards * rise)
        spot = Spot(across, along, height, right, down, place.forwards * own["face"])
        plume = Plume(
            **{name: own[name] for name in ("length_mm", "outer_mm", "inner_mm", "rachis_mm", "quill", "tip")}
        )
        made = WING_FEATHER._replace(plume=plume)
        density, tangent, colour = feather_at(spot, made, self.fineness, self.seed + jit.UInt(own["seed"]))
        return density, tangent, dr.select((colour == 0) & (own["flight"] > 0.5), 1, colour)

    def _arm(self, place: Ground) -> tuple[Any, Any]:
        """Density and tangent of the arm: a frayed body under the smallest coverts."""
        jit = arrays()
        there, distance = jit.Array3f(place.x, place.z, place.height), jit.Float(1e3)
        for k in range(JOINTS - 1):
            start, end = ((float(x), float(z), 0.0) for x, z in self.bone[k : k + 2])
            piece = capsule(there, start, end, float(self.thick[k]), float(self.thick[k + 1]))
            distance = dr.fmin(distance, piece)
        fray = gradient_noise(there * jit.Array3f(0.9, 0.35, 0.9), self.seed)
        density = coverage(distance + FUR * (0.2 + fray), self.fineness.softness + FUR)
        return density, unit(place.outwards * (0.4 * fray) - place.upwards)
