"""Brick writer: voxels of bricks, checked and packed into memory that is taken once."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from hagoromo.backend import aligned, arrays
from hagoromo.errors import InputError
from hagoromo.volume.bricks import Bricks, Grid, Shape, check_bricks, check_shape, table_shape
from hagoromo.volume.table import in_table_order
from hagoromo.volume.voxels import PAIRS, SMALLEST_DENSITY, VOXELS, packed_axis, packed_density

THIN_SHARE = 1e-3  # of the largest density: thinner matter may be lost without a word
DENSEST = 6e4  # density that fits a half


class BrickWriter:
    """Bricks written one after the other into memory taken once: `places` are sorted into table order first."""

    def __init__(
        self, shape: Shape, places: np.ndarray, colour: bool = False, material: bool = False, chart: bool = False
    ) -> None:
        import drjit as dr

        check_shape(shape)
        jit, self.shape = arrays(), shape
        self.places = in_table_order(places, table_shape(shape))
        count = max(len(self.places), 1)  # without matter, one empty brick that is never read
        check_bricks(count, f"{count} bricks of a lattice of {shape[::-1]} voxels", colour, material, chart)
        wanted = {
            "density": (jit.UInt, PAIRS), "axis": (jit.Int, VOXELS),
            "colour": (jit.Float16, VOXELS * 4) if colour else None,
            "material": (jit.UInt8, VOXELS) if material else None,
            "chart": (jit.UInt, VOXELS * 4) if chart else None,
        }  # fmt: skip
        self.grids: dict[str, Any] = {
            name: Grid(dr.zeros(kind[0], count * kind[1]), kind[1], count) for name, kind in wanted.items() if kind
        }
        dr.eval([grid.values for grid in self.grids.values()])

    def write(
        self, first: int, density: Any, axis: Any, colour: Any = None, material: Any = None, chart: Any = None
    ) -> None:
        """Write bricks from number `first` on: density (k · 729), axis (k · 729 · 3), colour (… · 4), material (…),
        chart (… · 4).

        NumPy arrays, flat or shaped, or Dr.Jit arrays (axis an Array3f, colour an Array4f, chart an Array4u, numbers
        for all voxels may have width 1). Checked: finite, 0 ≤ density < 6e4.
        """
        import drjit as dr

        UInt = arrays().UInt
        bricks, values = packed_voxels(density, axis, colour, material, chart)
        for name, grid in self.grids.items():
            index = dr.arange(UInt, bricks * grid.each) + dr.opaque(UInt, first * grid.each)
            dr.scatter(grid.values, values[name], index)
        dr.eval([grid.values for grid in self.grids.values()])

    def bricks(self) -> Bricks:
        """What has been written."""
        return Bricks(self.shape, self.places, **self.grids)


def packed_voxels(
    density: Any, axis: Any, colour: Any = None, material: Any = None, chart: Any = None
) -> tuple[int, dict[str, Any]]:
    """Number of bricks, and what grids keep of their voxels, by name; arguments and checks: see `BrickWriter.write`."""
    import drjit as dr

    jit = arrays()
    density = _flat(density, jit.Float)
    check_density(density)
    axis = _flat(axis, jit.Array3f)
    matter = density >= SMALLEST_DENSITY
    if chart is None:
        axis = dr.select(matter, axis, 0)
    if not bool(np.array(dr.all(dr.isfinite(dr.squared_norm(axis)))).ravel()[0]):
        raise InputError("the axis of a voxel with matter is not finite: give unit vectors or zeros")
    values = {"density": packed_density(density), "axis": packed_axis(axis)}
    if colour is not None:
        colour = jit.Array4f16(_flat(colour, jit.Array4f))
        if not bool(np.array(dr.all(dr.all(dr.isfinite(dr.select(matter, colour, 0))))).ravel()[0]):
            raise InputError("the body colour of a voxel with matter is not finite: give numbers that fit a half")
        values["colour"] = dr.ravel(dr.select(dr.isfinite(colour), colour, 0))
    if material is not None:
        values["material"] = jit.UInt8(_flat(material, jit.UInt))
    if chart is not None:
        values["chart"] = dr.ravel(_flat(chart, jit.Array4u))
    return dr.width(density) // VOXELS, values


def check_density(density: Any) -> None:
    """Raises `InputError` unless all densities (NumPy or Dr.Jit array) are finite and from 0 to DENSEST."""
    import drjit as dr

    reduced = (density.min(), density.max()) if isinstance(density, np.ndarray) else (dr.min(density), dr.max(density))
    low, high = (float(np.array(value).ravel()[0]) for value in reduced) if len(density) else (0.0, 0.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError("density has NaN or infinite values: give finite numbers of 0 or more")
    if low < 0:
        raise InputError(f"density goes down to {low:.3g}: give numbers of 0 or more")
    if high > DENSEST:
        raise InputError(f"density goes up to {high:.3g}: keep it below 6e4 (it is stored in halves) and raise tau")


def check_thin(densest: float, lost: bool, where: str = "") -> None:
    """`InputError` where all matter is too thin to be kept; a warning where it is lost up to THIN_SHARE of the densest.

    densest: the largest density. lost: whether there is some above 0 and below SMALLEST_DENSITY, which counts as empty.
    """
    said = (
        f"{where}density is {densest:.3g} at most, and what is below {SMALLEST_DENSITY:.2g} counts as empty: give it "
        f"in a smaller unit (scale) and divide tau by the same factor"
    )
    if 0.0 < densest < SMALLEST_DENSITY:
        raise InputError(said)
    if lost and SMALLEST_DENSITY > THIN_SHARE * densest:
        warnings.warn(said, stacklevel=4)


def _flat(values: Any, kind: Any) -> Any:
    """Values, NumPy or Dr.Jit, as a Dr.Jit array of `kind`; NumPy's are moved to aligned memory, see `lookup`."""
    import drjit as dr

    if not isinstance(values, np.ndarray):
        return kind(values)
    whole = kind in (arrays().UInt, arrays().Array4u)
    memory = aligned(values.size, np.uint32 if whole else np.float32)
    memory.reshape(values.shape)[...] = values
    if kind in (arrays().UInt, arrays().Float):
        return kind(memory)
    return dr.unravel(kind, (arrays().UInt if whole else arrays().Float)(memory))
