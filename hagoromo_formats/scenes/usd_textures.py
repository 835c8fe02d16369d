"""Textures of UsdPreviewSurface (UsdUVTexture) → files in the folder of a scene, and maps of a material.

Images are sRGB or raw as `sourceColorSpace` says; "auto" is sRGB where they have 8 bits and colours. UVs begin at the
bottom left, as ours do. Files are those of the folder of the USD file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.light.colour import srgb_decode
from hagoromo_formats.scenes.pbr import PbrMaterial
from hagoromo_formats.scenes.pbr_textures import channel_of, picture_of, written_image

LARGEST_IMAGE = 1 << 30  # [byte]
CHANNELS = "rgba"
BEYOND = 1e-3  # of UVs outside 0…1
READ = ("diffuseColor", "roughness", "metallic", "specularColor")
Table = Mapping[str, Any]


class UsdTextures:
    """Pictures of the USD file `path`, whose root lies in `home`. `lost` grows by a line for each loss."""

    def __init__(self, path: Path, home: Path, folder: Path, lost: list[str]) -> None:
        self.path, self.home, self.folder, self.lost = path, home, folder, lost

    def of(
        self, look: PbrMaterial, textures: Mapping[str, Table], uv: NDArray[np.float64], who: str, name: str
    ) -> tuple[PbrMaterial, Table | None]:
        """A material with its maps, and the table body_texture, None without one; files begin with `name`."""
        body = None
        for key, table in textures.items():
            if key not in READ or "<UDIM>" in str(table["file"]):
                self.lost.append(f"{who}: the texture of its {key}")
                continue
            if table["moved"]:
                self.lost.append(f"{who}: the transform of the texture of its {key}")
            wraps = {table["wrapS"], table["wrapT"]} - {"repeat"}
            if wraps and not (-BEYOND <= uv.min() and uv.max() <= 1.0 + BEYOND):
                self.lost.append(
                    f"{who}: how the texture of its {key} ends ({', '.join(sorted(wraps))}): here it repeats"
                )
            if key == "diffuseColor":
                if any(table["bias"][:3]) or max(table["scale"][:3]) > 1.0:
                    self.lost.append(f"{who}: the bias of the texture of its {key}, or its scale above 1")
                data, factor = self.data(table), np.clip(np.array(table["scale"], float)[:3], 0.0, 1.0)
                srgb = _encoded(table, picture_of(data, self.folder, name, self.path))
                file, largest = written_image(data, factor, self.folder, name, self.path, srgb)
                body, look = {"file": file}, look._replace(base=largest, textured=True)
            elif key == "roughness":
                look = look._replace(roughness=1.0, roughness_map=self.channel(table, name))
            elif key == "metallic":
                values = self.channel(table, name)
                if np.ptp(values) > 0.0:
                    self.lost.append(f"{who}: its metal by place, of which the mean stands")
                look = look._replace(metallic=float(values.mean()))
        return look, body

    def colours(self, table: Table, name: str) -> NDArray[np.float64]:
        """Linear R, G, B (h, w, 3), 0…1, with scale and bias."""
        return np.stack([self.channel({**table, "output": each}, name) for each in CHANNELS[:3]], axis=-1)

    def channel(self, table: Table, name: str) -> NDArray[np.float64]:
        """The values (h, w), 0…1, that an output gives, with scale and bias."""
        picture = picture_of(self.data(table), self.folder, name, self.path)
        number = CHANNELS.find(str(table["output"])[:1])
        values = channel_of(picture, number).astype(np.float64)
        if number < 3 and _encoded(table, picture):
            values = srgb_decode(255.0 * values)
        return np.clip(values * float(table["scale"][number]) + float(table["bias"][number]), 0.0, 1.0)

    def data(self, table: Table) -> bytes:
        """The bytes of its file."""
        return read_bytes(sized_file(inside(self.home, str(table["file"])), LARGEST_IMAGE, "a texture"))


def _encoded(table: Table, picture: NDArray[Any]) -> bool:
    """Whether colours of a picture are encoded as sRGB."""
    automatic = picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] >= 3
    return {"sRGB": True, "raw": False}.get(str(table["sourceColorSpace"]), automatic)
