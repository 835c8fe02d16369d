"""The command `hagoromo convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, Written, say, verb, verbs, wrote


def converted(out: Path) -> Written:
    """What `convert` writes: a USD has the pictures of its surfaces beside it, but for an archive."""
    from hagoromo_formats.scenes.usd_stage import ARCHIVE, USD

    suffix = out.suffix.lower()
    return Written((out,), f"{out.stem}_" if suffix in USD and suffix != ARCHIVE else "")


@verb(verbs, writes=converted)
def convert(
    source: Positional[Path],
    out: Out,
    to: Literal["opencv", "colmap", "colmap-text", "nerfstudio", "middlebury", "spectral"] | None = None,
    images: Path | None = None,
    scale: float | None = None,
    window: tuple[float, float] | None = None,
    voxel_mm: float | None = None,
    mean_free_path_mm: float | None = None,
    axis: Path | None = None,
    material: Path | None = None,
    field: Literal["density", "axis", "colour"] = "density",
    peak: float | None = None,
    display: str | None = None,
    exr: tuple[Literal["half", "tiles", "parts"], ...] = (),
    lens: str | None = None,
    lensfun: Path | None = None,
    force: Force = False,
) -> None:
    """Cameras, lamps, volumes, pictures, scenes or meshes in the format of one program → that of another.

    Cameras with their images → a capture; lamps → an .lp; a volume (OpenVDB, NRRD, NIfTI, VTI, TIFF stack, …) → a
    volume box; a box → OpenVDB, NRRD, VTI, .vol; a picture → EXR, HDR, TIFF (16 bits), PNG; a photograph → its camera,
    by lensfun; a glTF, USD or Mitsuba scene (.xml) → a folder with scene.toml; a scene.toml → .glb, .usda, .usdc,
    .usdz, or without a suffix a folder for Mitsuba; a mesh → PLY, OBJ, STL, OFF, GLB, USD.

    Args:
        source: transforms.json, OpenCV's YAML or JSON, a folder of COLMAP's, a _par.txt; volume, box, or picture.
        to: format of cameras (default: by the suffix: .yml OpenCV, .json nerfstudio, .txt Middlebury, none COLMAP); or
            spectral, the spectra of a rendered EXR in the layout of Fichet et al.
        images: folder of the images; the result is then a capture.
        scale: density that a stored 1 stands for; volumes of whole numbers need it, or a window.
        window: stored numbers of density 0 and of density 1; what lies beyond is cut off.
        voxel_mm: edge of a voxel (default: the shortest that the file states, or 0.5 mm).
        mean_free_path_mm: mean free path of light where the density is 1 (default: 0.5).
        axis: volume of the axes of the micro-elements (default: they point down the slope of the density).
        material: TOML with a table [material], as recipes have (default: a matt grey).
        peak: linear value that a picture for the display shows white (default: 1).
        display: what a PNG or TIFF is made for: sRGB (default), Display P3, or a view of ACES, such as
            "ACES 2.0 - SDR 100 nits (Rec.709)".
        exr: EXR to EXR with all its channels: as half floats, in tiles, a part for each layer.
        lens: of a photograph that becomes a camera: name or a part of it, or "auto" for what its EXIF says.
        lensfun: file of lensfun's XML (default: the database of lensfunpy).
        field: which field of a box is written; OpenVDB and VTI hold all.
    """
    from hagoromo_formats.cameras.lensfun import LOST, LensCamera
    from hagoromo_formats.convert import ConvertOptions

    options = ConvertOptions(
        scale, window, voxel_mm, mean_free_path_mm, axis, material, field, peak, display, exr,
        "" if lens == "auto" else lens, lensfun,
    )  # fmt: skip
    found = "glTF" if source.suffix.lower() in (".glb", ".gltf") else ""
    with progress_bar("convert") as progress:
        result = hg.convert(source, out, to, images, force, options, progress)
    if isinstance(result, LensCamera):
        say(
            f"{result.lens}: fitted to {result.rms:.2g} px (root mean square), {result.largest:.2g} px at most",
            f"lost: {LOST}",
        )
    elif isinstance(result, list):
        what = "made up" if found == "glTF" and not out.suffix else "lost"
        say(*(each if each.startswith(("made up: ", "lost: ")) else f"{what}: {each}" for each in result))
    elif isinstance(result, dict):
        if result:
            print(f"{len(result)} {'camera' if len(result) == 1 else 'cameras'}")
    elif result is not None:
        print(f"a capture of {len(result.photographs)} photographs")
    elif out.suffix.lower() == ".zarr":
        from hagoromo.volume.store.box_store import look_at_box

        say(*str(look_at_box(out)).splitlines())
        if material is None:
            say("its material is a matt grey, as no --material was given")
    wrote(out)
