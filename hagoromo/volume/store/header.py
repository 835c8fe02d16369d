"""Header: all of a volume box but its voxels, and the same as a record of plain values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hagoromo.camera.camera import rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.record import anything, count, list_of, number, numbers, positive, table, take, text
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance, reflectance_from_record
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import Bricks
from hagoromo.volume.texel import Texel

FORMAT = 1


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

    def box(self, bricks: Bricks) -> VolumeBox:
        """The volume box of this header and `bricks`."""
        return VolumeBox(bricks, **vars(self))

    def record(self) -> dict[str, Any]:
        """Plain values, as the attribute `hagoromo` of a box on disk has them."""
        chart = {"texel": self.texel.record(), "band": list(self.band)} if self.texel else {}
        shadow_bias = {"shadow_bias": self.shadow_bias} if self.shadow_bias else {}
        return chart | shadow_bias | {
            "format": FORMAT, "voxel_size": self.voxel_size, "tau": self.tau, "name": self.name,
            "pose": self.pose.ravel().tolist(), "materials": [m.record() for m in self.materials],
            "basis": [s.record() for s in self.basis], "provenance": self.provenance,
        }  # fmt: skip


def header_of(box: VolumeBox) -> BoxHeader:
    """The header of a volume box."""
    return BoxHeader(**{name: value for name, value in vars(box).items() if name in BoxHeader.__dataclass_fields__})


def header_from_record(record: Any, where: str) -> BoxHeader:
    """The header of a record that came from `where`, without its texel; `InputError` where it is none."""
    if record is None:
        raise InputError(f"{where} is a Zarr group without the attribute 'hagoromo': it is no volume box")
    spec = {
        "format": count, "voxel_size": positive, "tau": positive, "name": (text, ""), "pose": numbers(16),
        "materials": list_of(anything), "basis": (list_of(anything), []), "provenance": (table, {}),
        "texel": (table, None), "band": (numbers(2), (0.0, 1.0)), "shadow_bias": (number, 0.0),
    }  # fmt: skip
    if isinstance(record, dict) and "lift" in record:  # the name of shadow_bias until version 0.1
        record = {"shadow_bias" if key == "lift" else key: value for key, value in record.items()}
    taken = take(record, spec, where)
    taken.pop("texel")  # its numbers; what they say of arrays is read with these
    if taken.pop("format") != FORMAT:
        raise InputError(f"{where} has format {record['format']}: this version reads {FORMAT}, update Hagoromo")
    materials = [reflectance_from_record(m, f"{where}: material {k}") for k, m in enumerate(taken.pop("materials"))]
    basis, pose = [Spectrum.load(s) for s in taken.pop("basis")], np.reshape(taken.pop("pose"), (4, 4))
    pose = rigid_pose(pose, f"the pose of {where}")
    return BoxHeader(materials=tuple(materials), basis=tuple(basis), pose=pose, **taken)
