"""VolumeBox: the paper's volume box, a subspace of the world filled with density, axis, material and body colour."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.backend import arrays
from hagoromo.camera.camera import rigid_pose
from hagoromo.errors import InputError
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import EXTINCTIONS, BoxHeader
from hagoromo.volume.bricks import MATERIALS, Bricks
from hagoromo.volume.texel import ALL_PARTS

Field = Callable[[Any], tuple[Any, ...]]


@dataclass(frozen=True, eq=False)
class _Bricks:
    """The first field of a volume box."""

    bricks: Bricks


@dataclass(frozen=True, eq=False)
class VolumeBox(BoxHeader, _Bricks):
    """A volume box: `bricks` of edge-to-edge voxels [m], in its own axes from 0 to shape · voxel_size.

    pose: box to world, (4, 4), rigid. tau: extinction per unit of density [1/m]. materials: one Reflectance
    per material number. basis: spectra that the per-voxel body colours are coefficients of (empty: a material's own).
    texel: micro-structure that the box's chart maps onto a surface; `bricks` then hold shares 0…1 of the `band` of
    heights [m] instead of densities, and normals instead of axes (see `chart`). shadow_bias: offset of the
    origin of shadow rays along the normal [m], and twice as far towards the lamp; above 0 for an opaque skin of plane
    elements that stands for a surface and must not shade itself. extinction: "isotropic", σ = τ ρ in all directions, as
    in the paper; or "projected", σ(ω) = τ ρ A(ω) with the projected area A of the elements (see `projected_area`), by
    which scattered light keeps its energy and is reciprocal.

    >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
    >>> density, axis = np.ones((3, 5, 7)), np.zeros((3, 5, 7, 3))  # (z, y, x)
    >>> axis[..., 2] = 1.0
    >>> box = hg.VolumeBox.from_arrays(density, axis, voxel_size=0.01, tau=200.0, materials=[matte])
    >>> np.round(box.size, 6).tolist()  # (x, y, z) [m]
    [0.07, 0.05, 0.03]
    """

    def __post_init__(self) -> None:
        for key in ("voxel_size", "tau"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"volume box {self.name!r}: {key} is {value}: give a finite number above 0")
        if not (np.isfinite(self.shadow_bias) and self.shadow_bias >= 0 and not (self.shadow_bias and self.texel)):
            raise InputError(
                f"volume box {self.name!r}: shadow_bias is {self.shadow_bias}: give 0 or more [m]; with a texel give 0"
            )
        if self.extinction not in EXTINCTIONS:
            raise InputError(
                f"volume box {self.name!r}: extinction is {self.extinction!r}: give one of {', '.join(EXTINCTIONS)}"
            )
        if not self.materials:
            raise InputError(f"volume box {self.name!r} has no material: give at least one Reflectance")
        if len(self.materials) > MATERIALS:
            raise InputError(f"volume box {self.name!r} has {len(self.materials)} materials: give at most {MATERIALS}")
        if (self.texel is None) != (self.bricks.chart is None):
            raise InputError(f"volume box {self.name!r} has a chart or a texel: give both or none")
        if self.texel and len(self.texel.levels) > 1 and any(m.transmits for m in self.materials):
            if self.texel.parts != ALL_PARTS:
                raise InputError(
                    f"volume box {self.name!r} has materials that transmit light, and its texel was matched without "
                    "transmission: build it again from its recipe"
                )
        if self.texel and len(self.materials) != self.texel.populations:
            raise InputError(
                f"volume box {self.name!r} has {len(self.materials)} materials: give one per population of its texel, "
                f"{self.texel.populations}"
            )
        if len(self.basis) > 4:
            raise InputError(f"volume box {self.name!r}: basis has {len(self.basis)} spectra: give at most 4")
        self._check_colours()
        object.__setattr__(self, "pose", rigid_pose(self.pose, f"the pose of volume box {self.name!r}"))

    def _check_colours(self) -> None:
        """`InputError` where a law of the body would have to change the colour of each voxel."""
        for made in self.materials if self.basis else ():
            if made.shown_body_colour is not made.body_colour:
                law = ", ".join(made.body_departures)
                raise InputError(
                    f"volume box {self.name!r}: its voxels have colours of their own, and {law} of material"
                    f" {made.name!r} would change them: leave that out, or give the box no basis"
                )

    def __repr__(self) -> str:
        """The name, the voxels and the materials."""
        voxels = " × ".join(map(str, self.bricks.shape[::-1]))
        names = ", ".join(material.name or "without a name" for material in self.materials)
        return f"VolumeBox({self.name!r}, {voxels} voxels of {1e3 * self.voxel_size:.4g} mm, materials: {names})"

    def _repr_html_(self) -> str:
        """A table of figures, in a notebook."""
        facts = {
            "voxels (x, y, z)": " × ".join(map(str, self.bricks.shape[::-1])),
            "voxel size": f"{1e3 * self.voxel_size:.4g} mm",
            "size (x, y, z)": " × ".join(f"{1e3 * n * self.voxel_size:.4g}" for n in self.bricks.shape[::-1]) + " mm",
            "bricks that hold matter": str(self.bricks.kept),
            "extinction τ": f"{self.tau:.4g} per metre at density 1, {self.extinction}",
            "materials": ", ".join(material.name or "without a name" for material in self.materials),
        }
        rows = "".join(f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in facts.items())
        return f"<table><caption>Volume box {escape(self.name)}</caption>{rows}</table>"

    @classmethod
    def from_arrays(
        cls,
        density: np.ndarray,
        axis: np.ndarray,
        voxel_size: float,
        tau: float,
        materials: Sequence[Reflectance],
        material: np.ndarray | None = None,
        body_colour: np.ndarray | None = None,
        **record: Any,
    ) -> VolumeBox:
        """From dense arrays (nz, ny, nx): density, axis (…, 3), material numbers, body_colour (…, j) on `basis`.

        `InputError` where shapes or numbers do not fit, or all densities are below 6.1e-5, which counts as empty; a
        warning where many are.
        """
        if axis.shape != (*density.shape, 3):
            raise InputError(f"axis is {axis.shape}: density {density.shape} needs {(*density.shape, 3)}")
        if material is not None and material.size and material.max() >= len(materials):
            raise InputError(f"material number {material.max()} of {len(materials)} materials: numbers start at 0")
        from hagoromo.volume.store.brick_writer import check_thin
        from hagoromo.volume.store.fill_bricks import bricks_from_arrays
        from hagoromo.volume.voxels import SMALLEST_DENSITY

        bricks = bricks_from_arrays(density, axis, body_colour, material)
        check_thin(float(density.max(initial=0.0)), bool(((density > 0.0) & (density < SMALLEST_DENSITY)).any()))
        return cls(bricks, float(voxel_size), float(tau), tuple(materials), **record)

    @classmethod
    def from_field(
        cls,
        field: Field,
        shape: tuple[int, int, int],
        voxel_size: float,
        tau: float,
        materials: Sequence[Reflectance],
        occupied: Callable[[Any, float], Any] | None = None,
        **record: Any,
    ) -> VolumeBox:
        """From a function of position, evaluated brick by brick; shape is (nx, ny, nz) voxels.

        field(p): p Array3f, voxel centres in box axes [m] → (density, axis[, material UInt[, colour list]]).
        occupied(centre, radius): optional, False promises that the ball [m] around `centre` (Array3f) is empty; asked
        of large cubes first, then of the parts of those that may hold matter.
        """
        jit, (nx, ny, nz) = arrays(), shape
        if not np.isfinite(voxel_size) or voxel_size <= 0:
            raise InputError(f"voxel_size is {voxel_size}: give a finite number above 0 [m]")

        def voxels(x: Any, y: Any, z: Any) -> dict[str, Any]:
            position = (jit.Array3f(x, y, z) + 0.5) * float(voxel_size)
            return dict(zip(("density", "axis", "material", "colour"), field(position), strict=False))

        def may(middle: Any, radius: float) -> Any:
            assert occupied is not None
            return occupied((middle + 0.5) * float(voxel_size), radius * float(voxel_size))

        from hagoromo.volume.store.fill_bricks import bricks_from_field

        bricks = bricks_from_field(voxels, (nz, ny, nx), may if occupied else None)
        return cls(bricks, float(voxel_size), float(tau), tuple(materials), **record)

    @classmethod
    def of(cls, header: BoxHeader, bricks: Bricks) -> VolumeBox:
        """The volume box of a header and `bricks`."""
        return cls(bricks, **vars(header))

    @property
    def header(self) -> BoxHeader:
        """All of it but its bricks."""
        return BoxHeader(**{field.name: getattr(self, field.name) for field in fields(BoxHeader)})

    @property
    def size(self) -> np.ndarray:
        """Edge lengths (x, y, z) [m]."""
        return np.array(self.bricks.shape[::-1]) * self.voxel_size

    @property
    def finest(self) -> float:
        """Length of the finest detail: a voxel [m]."""
        return self.voxel_size

    @cached_property
    def lattice_from_world(self) -> np.ndarray:
        """World point [m] → lattice coordinates, whole at voxel centres: (4, 4)."""
        lattice = np.diag([*[1 / self.voxel_size] * 3, 1.0])
        lattice[:3, 3] = -0.5
        return lattice @ np.linalg.inv(self.pose)

    def corners(self) -> np.ndarray:
        """The eight corners in the world [m]: (8, 3)."""
        return self._corners(np.zeros(3), self.size)

    def matter_corners(self) -> np.ndarray:
        """The eight corners, in the world [m], of the part that `matter_bounds` gives: (8, 3)."""
        return self._corners(*((bound + 0.5) * self.voxel_size for bound in self.matter_bounds))

    @property
    def matter_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lattice coordinates (x, y, z) [voxel] between which all matter lies: low, high. With a texel those of the
        lattice, since steps in a texel are counted from there.
        """
        if self.texel:
            return np.full(3, -0.5), np.array(self.bricks.shape[::-1]) - 0.5
        return self.bricks.bounds

    def _corners(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Corners in the world of the part between `low` and `high` (x, y, z) [m] of the box."""
        unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        return (low + unit * (high - low)) @ self.pose[:3, :3].T + self.pose[:3, 3]

    def contains(self, point: np.ndarray) -> bool:
        """Whether a world point [m] is inside the box."""
        inside = np.linalg.inv(self.pose)[:3] @ np.append(point, 1.0)
        return bool((inside > 0).all() and (inside < self.size).all())

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the box as a Zarr v3 group, whole or not at all; loaded again it has the same bits.

        `InputError` where `path` exists without `force`.
        """
        from hagoromo.volume.store.box_store import save_box

        save_box(self, path, force)
        return Path(path)

    @staticmethod
    def load(path: str | Path) -> VolumeBox:
        """The volume box at `path`, as `save` and `hagoromo build` write it; `load_box` is the same.

        `InputError` when it is missing, damaged, of another program or too large for the memory.
        """
        from hagoromo.volume.store.box_store import load_box

        return load_box(path)

    def with_pose(self, pose: np.ndarray) -> VolumeBox:
        """The same box elsewhere."""
        return replace(self, pose=np.asarray(pose, float))

    def with_materials(self, materials: Sequence[Reflectance]) -> VolumeBox:
        """The same matter with other reflectances, one per material number."""
        if len(materials) != len(self.materials):
            raise InputError(f"volume box {self.name!r} needs {len(self.materials)} materials, {len(materials)} given")
        return replace(self, materials=tuple(materials))
