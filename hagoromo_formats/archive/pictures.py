"""Pictures: those of results as people look at them, each with its colour profile (ICC) and who made it (XMP).

Enters: the pictures among archived files, and the maps of a measurement. Leaves: PNG in sRGB, 8 bits, in a folder of
the archive, see also `iiif`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.icc import SRGB, icc_profile
from hagoromo.files.png import write_png
from hagoromo.image.picture.any_picture import read_any_picture
from hagoromo.image.picture.shown import srgb_values
from hagoromo.version import __version__
from hagoromo_formats.archive.measured_maps import BODY, map_pictures
from hagoromo_formats.archive.metadata import ArchivedObject, licence_address
from hagoromo_formats.archive.profile import ArchiveProfile

PICTURES = "pictures/"  # folder of the payload
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
NORMALS = "normals.exr"  # of a measurement
NO_PICTURES = re.compile(r"(labels|residual_\d+)\.png")  # numbers of materials, and what a fit leaves
WHITE_AT = 99.5  # per cent of body colours that are darker than the white of their picture, at least
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
SPACES = {
    "rdf": RDF, "x": "adobe:ns:meta/", "dc": "http://purl.org/dc/elements/1.1/",
    "xmp": "http://ns.adobe.com/xap/1.0/", "xmpRights": "http://ns.adobe.com/xap/1.0/rights/",
}  # fmt: skip
IDENTIFIER = "W5M0MpCehiHzreSzNTczkc9d"  # of the packets of XMP, the same in all files


def pictures_of(names: list[str], payload: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Pictures among files of an archive, (height, width, 1 or 3) in sRGB, each with its name without suffix.

    What is called a picture and cannot be read as one is left out: an archive keeps it as it is.
    """
    taken: set[str] = set()
    for name in names:
        suffix = (payload / name).suffix
        try:
            for added, pixels in _in_file(payload / name):
                called = name.removesuffix(suffix) + added
                called = f"{called}_{suffix[1:]}" if called in taken else called  # of another file of that name
                taken.add(called)
                yield called, pixels
        except InputError:
            continue


def write_picture(path: Path, pixels: NDArray[np.uint8], xmp: str) -> None:
    """Write a PNG with the profile of sRGB, where it has colours, and a packet of XMP."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if pixels.shape[2] == 1:
        write_png(path, pixels[..., 0], xmp=xmp)
    else:
        write_png(path, pixels, profile=icc_profile(SRGB), xmp=xmp)


def xmp_packet(name: str, thing: ArchivedObject, profile: ArchiveProfile) -> str:
    """Who made a picture, of what, under which licence (ISO 16684-1)."""
    for prefix, space in SPACES.items():
        ElementTree.register_namespace(prefix, space)
    root = ElementTree.Element(_tag("x", "xmpmeta"))
    about = ElementTree.SubElement(
        ElementTree.SubElement(root, _tag("rdf", "RDF")), _tag("rdf", "Description"), {_tag("rdf", "about"): ""}
    )
    for key, text, kind in (
        ("title", f"{thing.title}: {name}", "Alt"),
        ("description", thing.description, "Alt"),
        ("creator", profile.creator, "Seq"),
        ("rights", f"{profile.institution}, {profile.licence}", "Alt"),
    ):
        listed = ElementTree.SubElement(ElementTree.SubElement(about, _tag("dc", key)), _tag("rdf", kind))
        attributes = {"{http://www.w3.org/XML/1998/namespace}lang": "x-default"} if kind == "Alt" else {}
        ElementTree.SubElement(listed, _tag("rdf", "li"), attributes).text = text
    ElementTree.SubElement(about, _tag("dc", "identifier")).text = thing.inventory
    ElementTree.SubElement(about, _tag("xmpRights", "WebStatement")).text = licence_address(profile.licence)
    ElementTree.SubElement(about, _tag("xmp", "CreatorTool")).text = f"Hagoromo {__version__}"
    packet = ElementTree.tostring(root, encoding="unicode")
    return f'<?xpacket begin="\ufeff" id="{IDENTIFIER}"?>{packet}<?xpacket end="r"?>'


def _in_file(path: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """The picture that a file is, and the maps in it, each with what is added to the name of the file."""
    shown = _shown(path)
    if shown is not None:
        yield "", np.round(255.0 * np.clip(shown, 0.0, 1.0)).astype(np.uint8)
    yield from ((f"_{added}", pixels) for added, pixels in map_pictures(path))


def _shown(path: Path) -> NDArray[np.floating] | None:
    """A picture (height, width, 1 or 3), 0…1 in sRGB; None of a file that is none."""
    if path.name == NORMALS:
        return _normals(path)
    if path.name == BODY:
        return _body(path)
    if path.suffix.lower() in SUFFIXES and not NO_PICTURES.fullmatch(path.name):
        picture = read_any_picture(path)
        return picture.values if picture.displayed else srgb_values(picture.values)
    return None


def _tag(prefix: str, name: str) -> str:
    return f"{{{SPACES[prefix]}}}{name}"


def _normals(path: Path) -> NDArray[np.float64] | None:
    """Normals as colours, (n + 1) / 2; black where they are unknown."""
    layers, _ = read_exr(path)
    if not {"N.X", "N.Y", "N.Z"} <= set(layers):
        return None
    normals = np.stack([layers[f"N.{axis}"] for axis in "XYZ"], axis=2).astype(np.float64)
    known = np.isfinite(normals).all(axis=2, keepdims=True) & (np.abs(normals).sum(axis=2, keepdims=True) > 0.0)
    return np.where(known, 0.5 * normals + 0.5, 0.0)


def _body(path: Path) -> NDArray[np.float64] | None:
    """Albedo π α c_b, in sRGB; where lamps of unknown strength make it brighter than white, darker by one factor."""
    layers, _ = read_exr(path)
    names = list("RGB") if set("RGB") <= set(layers) else [name for name in layers if not name.startswith("error.")]
    if len(names) not in (1, 3):
        return None
    albedo = np.pi * np.nan_to_num(np.stack([layers[name] for name in names], axis=2).astype(np.float64))
    known = albedo[(albedo > 0.0).any(axis=2)]
    white = np.percentile(known, WHITE_AT) if known.size else 1.0
    return srgb_values(albedo / max(white, 1.0))
