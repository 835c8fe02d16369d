"""Header: all of a volume box but its voxels, and the same as a record of plain values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from hagoromo.camera.camera import rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.record import Count, Matrix, Pair, Positive, Record, about, decode, like
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.reflectance import Reflectance, ReflectanceRecord, reflectance_from_record
from hagoromo.volume.box import Extinction, VolumeBox
from hagoromo.volume.bricks import Bricks
from hagoromo.volume.texel import Texel

FORMAT = 1
MOST_LEVELS = 32  # of a texel
EXTINCTION = about("isotropic: tau times density; projected: that times the projected area of the elements")


class TexelRecord(Record, frozen=True, kw_only=True):
    """The numbers of a texel: a periodic volume that is laid on a surface; its arrays lie beside."""

    period: Annotated[Pair, about("length of one repeat along both directions of the surface [m]")]
    bottom: Annotated[float, about("lowest height above the surface [m]")]
    top: Annotated[float, about("greatest height above the surface [m]")]
    variants: Annotated[int, Meta(ge=1, le=2**32 - 1), about("number of variants of the repeat")]
    levels: Annotated[int, Meta(ge=1, le=MOST_LEVELS), about("number of levels of detail")]


class BoxRecord(Record, frozen=True, kw_only=True):
    """The attribute `hagoromo` of a volume box, a Zarr v3 group: all but its voxels."""

    version_key = "format"
    newest_version = FORMAT
    old_names = {"lift": "shadow_bias"}  # until version 0.1

    format: Annotated[Count, about("version of the format")]
    voxel_size: Annotated[Positive, about("edge of a voxel [m]")]
    tau: Annotated[Positive, about("extinction coefficient where the density is 1 [1/m]")]
    name: Annotated[str, about("name of the box")] = ""
    pose: Annotated[Matrix, about("box to world, 4 × 4 by rows, rigid [m]")]
    materials: Annotated[
        tuple[Annotated[Any, like(ReflectanceRecord)], ...], about("the materials that voxels name by their index")
    ]
    basis: Annotated[
        tuple[Annotated[Any, SOURCE], ...], about("spectra that the body colours of voxels are weights of")
    ] = ()
    provenance: Annotated[dict[str, Any], about("what the box was made from: its recipe")] = {}
    texel: Annotated[TexelRecord | None, about("the micro-structure of a shell")] = None
    band: Annotated[Pair, about("heights of a shell above its surface [m]")] = (0.0, 1.0)
    shadow_bias: Annotated[float, about("offset of the origin of shadow rays along the normal [m]")] = 0.0
    extinction: Annotated[Extinction, EXTINCTION] = "isotropic"


@dataclass(frozen=True, eq=False)
class BoxHeader:
    """The fields of a `VolumeBox` but `bricks`."""

    voxel_size: float
    tau: float
    materials: tuple[Reflectance, ...]
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    basis: tuple[Spectrum, ...] = ()
    name: str = ""
    provenance: dict[str, Any] = field(default_factory=dict)
    texel: Texel | None = None
    band: tuple[float, float] = (0.0, 1.0)
    shadow_bias: float = 0.0
    extinction: Extinction = "isotropic"

    def box(self, bricks: Bricks) -> VolumeBox:
        """The volume box of this header and `bricks`."""
        return VolumeBox(bricks, **vars(self))

    def record(self) -> dict[str, Any]:
        """Plain values, as the attribute `hagoromo` of a box on disk has them."""
        chart = {"texel": self.texel.record(), "band": list(self.band)} if self.texel else {}
        shadow_bias = {"shadow_bias": self.shadow_bias} if self.shadow_bias else {}
        extinction = {"extinction": self.extinction} if self.extinction != "isotropic" else {}
        return chart | shadow_bias | extinction | {
            "format": FORMAT, "voxel_size": self.voxel_size, "tau": self.tau, "name": self.name,
            "pose": self.pose.ravel().tolist(), "materials": [m.record() for m in self.materials],
            "basis": [s.record() for s in self.basis], "provenance": self.provenance,
        }  # fmt: skip


def header_of(box: VolumeBox) -> BoxHeader:
    """The header of a volume box."""
    return BoxHeader(**{name: value for name, value in vars(box).items() if name in BoxHeader.__dataclass_fields__})


def header_from_record(record: Any, where: str) -> BoxHeader:
    """The header of a record that came from the folder `where`, without its texel; `InputError` where it is none.

    A spectrum that it names by its file lies in that folder.
    """
    if record is None:
        raise InputError(f"{where} is a Zarr group without the attribute 'hagoromo': it is no volume box")
    given = decode(record, BoxRecord, where)
    return BoxHeader(
        given.voxel_size,
        given.tau,
        tuple(reflectance_from_record(m, f"{where}: material {k}", where) for k, m in enumerate(given.materials)),
        rigid_pose(np.reshape(given.pose, (4, 4)), f"the pose of {where}"),
        tuple(Spectrum.load(spectrum, where) for spectrum in given.basis),
        given.name,
        given.provenance,
        band=given.band,
        shadow_bias=given.shadow_bias,
        extinction=given.extinction,
    )
