"""Textures of UsdPreviewSurface (UsdUVTexture) → files in the folder of a scene, and maps of a material.

Images are sRGB or raw as `sourceColorSpace` says; "auto" is sRGB where they have 8 bits and colours, but raw of
normals. UVs begin at the bottom left, as ours do. Files are those of the folder of the USD file; those by UDIM stay so,
and an image without tiles that a material has beside them becomes one for each tile.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.memory import require
from hagoromo.files.png import write_png
from hagoromo.files.udim import MARK, Tile, udim_number
from hagoromo.image.scene.tiled_image import Tiles, texture_files
from hagoromo.light.colour import srgb_decode
from hagoromo_formats.scenes.pbr import PbrMaterial
from hagoromo_formats.scenes.pbr_textures import BYTES_PER_PIXEL, channel_of, picture_of, written_image
from hagoromo_formats.scenes.usd_parts import NORMAL

LARGEST_IMAGE = 1 << 30  # [byte]
CHANNELS = "rgba"
BEYOND = 1e-3  # of UVs outside 0…1
READ = ("diffuseColor", "roughness", "metallic", "specularColor", NORMAL)
Table = Mapping[str, Any]


class UsdTextures:
    """Textures of a material of the USD file `path`, whose root lies in `home`.

    tiles: those that all of its images by UDIM have; None: no image is by UDIM.
    """

    def __init__(
        self, path: Path, home: Path, folder: Path, textures: Mapping[str, Table], who: str, name: str
    ) -> None:
        """Files in the folder begin with `name`; `who` names the material in lines. `InputError` without any tile."""
        self.path, self.home, self.folder, self.textures = path, home, folder, textures
        self.who, self.name, self.lost = who, name, list[str]()
        marked = {str(one["file"]) for key, one in textures.items() if key in READ and MARK in str(one["file"])}
        self.tiled = texture_files(home, sorted(marked)).tiled
        every = [(set(one.files), one.grid) for one in self.tiled.values()]
        common = tuple(sorted(set.intersection(*(files for files, _ in every)))) if every else ()
        self.tiles = Tiles(every[0][1], common) if every else None
        if every and not common:
            raise InputError(f"{path}: {who} has images by {MARK} with no tile in common: give the same tiles of each")

    def of(self, look: PbrMaterial, uv: NDArray[np.float64]) -> tuple[PbrMaterial, dict[str, Table]]:
        """A material with its maps, and the tables body_texture and normal_texture, if it has them."""
        tables = dict[str, Table]()
        for key, table in self.textures.items():
            if key not in READ:
                self.lost.append(f"{self.who}: the texture of its {key}")
                continue
            self.check(key, table, uv)
            if key == "diffuseColor":
                file, largest = self.body(table)
                tables["body_texture"], look = {"file": file}, look._replace(base=largest, textured=True)
            elif key == NORMAL:
                tables["normal_texture"] = {"file": self.normals(table)}
            elif key == "roughness":
                look = look._replace(roughness=1.0, roughness_map=self.channel(table), tiles=self.tiles)
            elif key == "metallic":
                values = self.channel(table)
                if np.ptp(values) > 0.0:
                    self.lost.append(f"{self.who}: its metal by place, of which the mean stands")
                look = look._replace(metallic=float(values.mean()))
        return look, tables

    def check(self, key: str, table: Table, uv: NDArray[np.float64]) -> None:
        """Say what is lost of how a texture lies on the UVs."""
        if table["moved"]:
            self.lost.append(f"{self.who}: the transform of the texture of its {key}")
        wraps = {table["wrapS"], table["wrapT"]} - {"repeat"}
        if wraps and not self.tiles and not (-BEYOND <= uv.min() and uv.max() <= 1.0 + BEYOND):
            self.lost.append(
                f"{self.who}: how the texture of its {key} ends ({', '.join(sorted(wraps))}): here it repeats"
            )

    def body(self, table: Table) -> tuple[str, NDArray[np.float64]]:
        """The file of its base colour, which is written, and the largest colour."""
        if any(table["bias"][:3]) or max(table["scale"][:3]) > 1.0:
            self.lost.append(f"{self.who}: the bias of the texture of its diffuseColor, or its scale above 1")
        factor = np.clip(np.array(table["scale"], float)[:3], 0.0, 1.0)
        written = dict[Tile | None, tuple[str, NDArray[np.float64]]]()
        for tile in self.tiles.numbers if self.tiles else (None,):
            data, name = self.data(table, tile), self.name if tile is None else f"{self.name}.{udim_number(tile)}"
            srgb = _encoded(table, picture_of(data, self.folder, name, self.path))
            written[tile] = written_image(data, factor, self.folder, name, self.path, srgb)
        files = {Path(file).suffix for file, _ in written.values()}
        if len(files) > 1:
            raise InputError(f"{self.path}: tiles of {table['file']} are {' and '.join(sorted(files))}: give one kind")
        mark = f".{MARK}" if self.tiles else ""
        return f"{self.name}{mark}{files.pop()}", np.max([largest for _, largest in written.values()], axis=0)

    def normals(self, table: Table) -> str:
        """The file of its normals, which is written: (normal + 1) / 2 in 16 bits."""
        bands = [self.channel({**table, "output": each}, normals=True) for each in CHANNELS[:3]]
        image = np.round(65535.0 * np.stack(bands, axis=-1)).astype(np.uint16)
        file = f"{self.name}_normal.{MARK}.png" if self.tiles else f"{self.name}_normal.png"
        for name, part in (self.tiles.cuts(image, file) if self.tiles else {file: image}).items():
            write_png(self.folder / name, part)
        return file

    def colours(self, table: Table) -> NDArray[np.float64]:
        """Linear R, G, B (h, w, 3), 0…1, with scale and bias."""
        return np.stack([self.channel({**table, "output": each}) for each in CHANNELS[:3]], axis=-1)

    def channel(self, table: Table, normals: bool = False) -> NDArray[np.float64]:
        """The values (h, w), 0…1, that an output gives, with scale and bias; of normals, (value + 1) / 2."""
        picture = self.picture(table)
        number = CHANNELS.find(str(table["output"])[:1])
        values = channel_of(picture, number).astype(np.float64)
        if number < 3 and (table["sourceColorSpace"] == "sRGB" if normals else _encoded(table, picture)):
            values = srgb_decode(255.0 * values)
        values = values * float(table["scale"][number]) + float(table["bias"][number])
        return np.clip(0.5 + 0.5 * values if normals else values, 0.0, 1.0)

    def picture(self, table: Table) -> NDArray[Any]:
        """The pixels of an image, of all tiles side by side where the material has some."""
        file = str(table["file"])
        if file in self.tiled:

            def read(path: Path) -> tuple[NDArray[Any], str]:
                stored = picture_of(_bytes(path), self.folder, self.name, self.path)
                return stored.reshape(*stored.shape[:2], -1), stored.dtype.name

            return self.tiled[file].read(read)[0]
        picture = picture_of(self.data(table, None), self.folder, self.name, self.path)
        if not self.tiles:
            return picture
        across, up = self.tiles.grid
        require(BYTES_PER_PIXEL * picture.shape[0] * picture.shape[1] * across * up, str(self.path))
        return np.tile(picture, (up, across, *[1] * (picture.ndim - 2)))

    def data(self, table: Table, tile: Tile | None) -> bytes:
        """The bytes of its file, of a tile where it has tiles."""
        file = str(table["file"])
        if file in self.tiled and tile is not None:
            return _bytes(self.tiled[file].files[tile])
        return _bytes(inside(self.home, file))


def _bytes(path: Path) -> bytes:
    return read_bytes(sized_file(path, LARGEST_IMAGE, "a texture"))


def _encoded(table: Table, picture: NDArray[Any]) -> bool:
    """Whether colours of a picture are encoded as sRGB."""
    automatic = picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] >= 3
    return {"sRGB": True, "raw": False}.get(str(table["sourceColorSpace"]), automatic)
