"""Header as a record of plain values: all of a volume box but its voxels."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from hagoromo.camera.camera import rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.record import Count, Matrix, Pair, Positive, Record, about, decode, like
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.reflectance_record import ReflectanceRecord, reflectance_from_record
from hagoromo.volume.box_header import BoxHeader, Extinction

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


def header_record(header: BoxHeader) -> dict[str, Any]:
    """Plain values, as the attribute `hagoromo` of a box on disk has them."""
    chart = {"texel": header.texel.record(), "band": list(header.band)} if header.texel else {}
    shadow_bias = {"shadow_bias": header.shadow_bias} if header.shadow_bias else {}
    extinction = {"extinction": header.extinction} if header.extinction != "isotropic" else {}
    return chart | shadow_bias | extinction | {
        "format": FORMAT, "voxel_size": header.voxel_size, "tau": header.tau, "name": header.name,
        "pose": header.pose.ravel().tolist(), "materials": [m.record() for m in header.materials],
        "basis": [s.record() for s in header.basis], "provenance": header.provenance,
    }  # fmt: skip


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
