"""Good samples of pictures: EXR, PNG, JPEG, TIFF and DNG, as small as they can be while every branch is met."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.light.spectrum import Spectrum

COLOUR = np.random.default_rng(1).integers(0, 256, (13, 17, 3)).astype(np.uint8)
DEEP = COLOUR.astype(np.uint16) * 257
LAMPS = ("key", "fill")


def exr(path: Path) -> None:
    """Scan lines, with text among the attributes."""
    write_exr(path, {name: COLOUR[..., k] for k, name in enumerate("RGB")}, {"undistorted": "yes"})


def map_exr(path: Path) -> None:
    """An environment."""
    write_exr(path, {name: np.resize(COLOUR[..., k], (8, 16)) for k, name in enumerate("RGB")})


def map_hdr(path: Path) -> None:
    """An environment, its lines packed in runs and as they are."""
    lines = np.resize(COLOUR, (8, 16, 4))
    lines[..., 3] = 124 + lines[..., 3] % 8  # radiance about 1
    lines[:4] = lines[:4, :1]
    packed = b""
    for number, line in enumerate(lines):
        rows = (bytes([128 + 16, row[0]]) if number < 4 else bytes([16, *row]) for row in line.T)
        packed += b"\2\2\0\x10" + b"".join(rows)
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + packed)


def exr_tiles(path: Path) -> None:
    """Tiles of half floats."""
    import OpenEXR

    header = {
        "compression": OpenEXR.PIZ_COMPRESSION,
        "type": OpenEXR.tiledimage,
        "tiles": OpenEXR.TileDescription(),
    }
    pixels = {name: np.ascontiguousarray(COLOUR[..., k].astype(np.float16)) for k, name in enumerate("RGB")}
    with OpenEXR.File(header, pixels) as file:
        file.write(str(path))


def exr_parts(path: Path) -> None:
    """Two parts, the second of integers."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.scanlineimage}
    first = {name: np.ascontiguousarray(COLOUR[..., k].astype(np.float32)) for k, name in enumerate("RGB")}
    second = {"Z": np.ascontiguousarray(COLOUR[..., 0].astype(np.uint32))}
    parts = [OpenEXR.Part({**header, "name": name}, pixels) for name, pixels in (("a", first), ("b", second))]
    with OpenEXR.File(parts) as file:
        file.write(str(path))


def rendered(path: Path, palette: bytes | None = None, metadata: bytes | None = None) -> None:
    """An EXR of `render`, with the palette of its weights; palette, metadata: other texts in their place."""
    shape, flat = (5, 7), Spectrum.constant(1.0).record()
    names = [f"lamp{k}.{colour}" for k in range(2) for colour in ("body0", "interface0")]
    record = {"bodies": [flat], "interfaces": [flat], "lamps": [flat, flat]}
    record |= {"lamp_names": list(LAMPS), "lamp_groups": [0, 1]}
    scene = {"lamps": [{"name": name, "intensity": 1.0, "spectrum": flat} for name in LAMPS]}
    header = {
        "palette": (palette or json.dumps(record).encode()).decode("utf-8", "replace"),
        "hagoromo": (metadata or json.dumps({"version": "0.2.0", "scene": scene}).encode()).decode("utf-8", "replace"),
    }
    write_exr(path, {name: np.full(shape, 0.25, np.float32) for name in [*names, "A", "R", "G", "B"]}, header)


def png(path: Path) -> None:
    """8 bits, three channels."""
    write_png(path, COLOUR)


def png_profile(path: Path) -> None:
    """8 bits with the profile of another display."""
    from hagoromo.files.icc import DISPLAY_P3, icc_profile

    write_png(path, COLOUR, profile=icc_profile(DISPLAY_P3))


def icc(path: Path) -> None:
    """A profile by itself."""
    from hagoromo.files.icc import DISPLAY_P3, icc_profile

    path.write_bytes(icc_profile(DISPLAY_P3))


def png_kinds(path: Path) -> None:
    """A palette with transparency, text, colour profile and EXIF: chunks that libraries warn about."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    picture = Image.fromarray(COLOUR).quantize(16)
    text = PngInfo()
    text.add_text("Comment", "a text")
    exif = Image.Exif()
    exif[0x829A], exif[0x8827] = 0.01, 100
    picture.save(path, pnginfo=text, transparency=3, icc_profile=b"\0" * 132, exif=exif, gamma=0.45)


def png_deep(path: Path) -> None:
    """16 bits with alpha, interlaced."""
    import cv2

    alpha = np.full((*DEEP.shape[:2], 1), 65535, np.uint16)
    path.write_bytes(cv2.imencode(".png", np.concatenate([DEEP, alpha], axis=2))[1].tobytes())


def mask(path: Path) -> None:
    """Grey, white inside."""
    inside = np.zeros((13, 17), np.uint8)
    inside[3:9, 4:12] = 255
    write_png(path, inside)


def jpeg(path: Path) -> None:
    """Colour with EXIF, and a progressive scan."""
    from PIL import Image

    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Maker", "Maker One", 6
    exif.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 5.6, 0x8827: 100, 0x920A: 55.0, 0xA405: 82})
    Image.fromarray(COLOUR).save(path, "JPEG", exif=exif, progressive=True, quality=90)


def jpeg_grey(path: Path) -> None:
    """One channel, baseline."""
    from PIL import Image

    Image.fromarray(COLOUR[..., 0]).save(path, "JPEG", restart_marker_blocks=1)


def tiff(path: Path) -> None:
    """Plain strips of 16 bits."""
    import tifffile

    tifffile.imwrite(path, DEEP, rowsperstrip=4, resolution=(72, 72), software="a")


def tiff_packed(path: Path) -> None:
    """Deflate with a predictor, which OpenCV's libtiff decodes."""
    from PIL import Image

    Image.fromarray(COLOUR).save(path, "TIFF", compression="tiff_adobe_deflate", tiffinfo={317: 2})


def tiff_lzw(path: Path) -> None:
    """LZW, one channel of 8 bits."""
    from PIL import Image

    Image.fromarray(COLOUR[..., 0]).save(path, "TIFF", compression="tiff_lzw")


def tiff_bilevel(path: Path) -> None:
    """One bit a pixel."""
    from PIL import Image

    Image.fromarray(COLOUR[..., 0] > 99).save(path, "TIFF", compression="group4")


def tiff_float(path: Path) -> None:
    """Tiles of floats."""
    import tifffile

    tifffile.imwrite(path, DEEP.astype(np.float32), tile=(16, 16))


def dng(path: Path) -> None:
    """A raw photograph of a Bayer mosaic."""
    from tests.inverse.simulated_bracket import write_dng

    raw = np.random.default_rng(2).integers(500, 14_000, (62, 94)).astype(np.uint16)
    write_dng(path, raw)


def exif(path: Path) -> None:
    """A TIFF of one pixel with all tags of an exposure."""
    from tests.inverse.simulated_bracket import write_dng

    write_dng(path, np.full((2, 2), 600, np.uint16))


def exif_jpeg(path: Path) -> None:
    """A JPEG of one pixel: nearly all of its bytes are EXIF."""
    from PIL import Image

    held = Image.Exif()
    held[0x010F], held[0x0110] = "Maker", "Maker One"
    held.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 5.6, 0x8827: 100, 0x920A: 55.0, 0xA405: 82, 0xA20E: 4000.0})
    Image.fromarray(COLOUR[:1, :1]).save(path, "JPEG", exif=held)


def dng_packed(path: Path) -> None:
    """A raw photograph in lossless JPEG, as cameras pack it (ITU T.81, annex H)."""
    import tifffile

    raw = np.random.default_rng(2).integers(500, 3_000, (62, 94)).astype(np.uint16)
    dng(path)
    packed = lossless_jpeg(raw)
    with tifffile.TiffFile(path, mode="r+") as file:
        tags = file.pages.first.tags
        place = tags["StripOffsets"].value[0]
        for name, value in (("Compression", 7), ("StripByteCounts", len(packed))):
            tags[name].overwrite(value)
    path.write_bytes(path.read_bytes()[:place] + packed)


def lossless_jpeg(raw: np.ndarray) -> bytes:
    """One channel of 16 bits: every value less the one to its left, in a code of five bits for its size."""
    differences = np.diff(raw.astype(np.int64), axis=1, prepend=0)
    differences[:, 0] = np.diff(raw[:, 0].astype(np.int64), prepend=1 << 15)
    bits = "".join(_code(int(value)) for value in differences.ravel())
    bits += "1" * (-len(bits) % 8)
    body = int(bits, 2).to_bytes(len(bits) // 8, "big").replace(b"\xff", b"\xff\0")
    lengths = bytes([0] * 4 + [17] + [0] * 11)  # of codes: 17 of five bits
    table = b"\xff\xc4" + (3 + 16 + 17).to_bytes(2, "big") + b"\0" + lengths + bytes(range(17))
    height, width = (size.to_bytes(2, "big") for size in raw.shape)
    frame = b"\xff\xc3\0\x0b\x10" + height + width + b"\x01\0\x11\0"
    scan = b"\xff\xda\0\x08\x01\0\0\x01\0\0"
    return b"\xff\xd8" + table + frame + scan + body + b"\xff\xd9"


def _code(value: int) -> str:
    size = abs(value).bit_length()
    below = value if value >= 0 else value + (1 << size) - 1
    return f"{size:05b}" + (f"{below:0{size}b}" if size else "")


def development(path: Path) -> None:
    """An EXR of `develop`."""
    from hagoromo.photograph.development.develop import develop

    write_png(path.with_name("a.png"), DEEP)
    develop([path.with_name("a.png")], exposures_s=(0.1,), black=512.0).save(path)
    path.with_name("a.png").unlink()


def hdr(path: Path) -> None:
    """Radiance's HDR, packed."""
    from hagoromo.files.hdr import write_hdr

    write_hdr(path, np.random.default_rng(7).random((13, 17, 3)).astype(np.float32))


def spectral(path: Path) -> None:
    """Spectral EXR."""
    from hagoromo.image.picture.spectral_exr import SpectralPicture, write_spectral_exr

    values = np.random.default_rng(8).random((5, 7, 4)).astype(np.float32)
    write_spectral_exr(path, SpectralPicture(values, np.array([450.0, 500.0, 550.0, 600.0]), True))
