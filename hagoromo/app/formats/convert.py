"""Convert: a file of one program into the file of another: cameras, captures, lamps, and volumes in and out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

from hagoromo.app.formats.find import format_of
from hagoromo.app.formats.gltf_scene import gltf_from_scene, scene_from_gltf
from hagoromo.app.formats.surfaces_out import WRITTEN, write_surface
from hagoromo.app.formats.table import FORMATS, MITSUBA, suffixes
from hagoromo.app.formats.usd_out import usd_from_scene
from hagoromo.app.formats.usd_scene import scene_from_usd
from hagoromo.app.formats.volumes_out import Field
from hagoromo.camera.formats.camera_file import Format as CameraFormat
from hagoromo.camera.formats.camera_file import read_views, write_views
from hagoromo.camera.formats.lensfun import LensCamera, camera_by_lensfun
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.exif import read_exif
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.raw import RAW_SUFFIXES, read_raw
from hagoromo.files.record import read_toml
from hagoromo.files.stores import address
from hagoromo.files.tiff import read_tiff
from hagoromo.files.usd_stage import USD
from hagoromo.files.whole import replaceable_file
from hagoromo.image.any_picture import convert_picture
from hagoromo.image.image import read_image
from hagoromo.image.scene_file import load_scene
from hagoromo.image.spectral_exr import spectral_picture, write_spectral_exr
from hagoromo.light.spectrum import OTHER_FILES
from hagoromo.mitsuba.read import scene_from_mitsuba
from hagoromo.mitsuba.write import write_mitsuba
from hagoromo.photograph.gather import gather, size_of_images
from hagoromo.photograph.lamp_files import LP, load_lamps, write_lp
from hagoromo.progress import Progress, silent

BOX, SPECTRAL = ".zarr", "spectral"
EXR_TILE = 64  # px
FILES_OF_SPECTRA = (".csv", *OTHER_FILES)
NEUTRAL = {"alpha": 0.25, "beta": 0.0, "gamma": 0.2, "n": 1.5, "body_colour": 1.0, "name": "neutral"}


@dataclass(frozen=True)
class ConvertOptions:
    """What files do not say. Of volumes: what a box needs, as recipes of kind volume have it; field: of a box, which
    one is written. Of pictures: how they are written, and by which lens they were taken.

    peak: of a picture that becomes one for the display, the linear value that is white. display: which one, see
    `Image.save`. exr: how all channels of an EXR are laid out in another, of half, tiles and parts. lens: name or part
    of the name of the lens that took a photograph, "" for its EXIF's: its camera is written. lensfun: a file of
    lensfun's XML in place of its database.
    material: TOML with the table [material] of recipes; None: a matt grey that sends back π/4 of the light.
    """

    scale: float | None = None
    window: tuple[float, float] | None = None
    voxel_mm: float | None = None
    mean_free_path_mm: float | None = None
    axis: Path | None = None
    material: Path | None = None
    field: Field = "density"
    peak: float | None = None
    display: str | None = None
    exr: tuple[Literal["half", "tiles", "parts"], ...] = ()
    lens: str | None = None
    lensfun: Path | None = None


def convert(
    source: str | Path,
    out: str | Path,
    to: CameraFormat | Literal["spectral"] | None = None,
    images: str | Path | None = None,
    force: bool = False,
    options: ConvertOptions | None = None,
    progress: Progress = silent,
) -> Any:
    """Write what is in the file (or folder) `source` to `out`, in the format of its suffix.

    Cameras: returns the views, image file → camera; to: format (None: by the suffix of `out`); images: folder of the
    images, a capture is then written and returned instead. An `out` that ends in .lp gets the far lamps of lamps.json.
    A photograph with `options.lens` becomes the camera that took it, by lensfun; returned is how well it fits.
    A glTF, USD or scene of Mitsuba becomes a folder with scene.toml, a scene.toml a .glb, .usda, .usdc or .usdz, or,
    where `out` is a name without suffix, a folder for Mitsuba; returned is what was made up or lost.
    A mesh or picture is written as another; to = "spectral" writes the spectral radiance of a rendered image.
    An `out` that ends in .zarr gets the volume box of a volume file; a box is written as OpenVDB, NRRD, VTI or
    .vol. `options`: what is needed for that. `InputError` for an unknown format, one that `out` cannot hold, and
    contradictions.

    >>> from tempfile import mkdtemp
    >>> home = Path(mkdtemp())
    >>> np.save(home / "ball.npy", np.ones((4, 5, 6), np.float32))
    >>> hg.convert(home / "ball.npy", home / "ball.zarr")
    >>> hg.load_box(home / "ball.zarr").bricks.shape
    (4, 5, 6)
    """
    out, suffix = Path(out), Path(out).suffix.lower()
    if suffix == LP:
        write_lp(out, load_lamps(source), force)
        return {}
    found = format_of(source)
    if found.holds == "volume" or (suffix == BOX and found.holds != "box"):
        return _volume_in(source, out, options or ConvertOptions(), force, progress)
    if found.holds == "box":
        return _volume_out(source, out, options or ConvertOptions(), force)
    if found.holds == "surface" or (found.name in ("glTF", "USD") and suffix in WRITTEN):
        return write_surface(source, out, force)
    if found.name == "glTF":
        return scene_from_gltf(source, out, force)
    if found.name == "USD":
        return scene_from_usd(source, out, force)
    if found.name == MITSUBA:
        return scene_from_mitsuba(source, out, force)
    if found.holds == "matter" and suffix == "":
        return write_mitsuba(load_scene(source, progress)[0], out, force)
    if found.holds == "matter" and suffix == ".glb":
        return gltf_from_scene(load_scene(source, progress)[0], out, force)
    if found.holds == "matter" and suffix in USD:
        return usd_from_scene(load_scene(source, progress)[0], out, force)
    if found.holds == "picture" and options is not None and options.lens is not None:
        return _camera_of(Path(source), out, to, options, force)
    if found.holds == "picture":
        return _picture(source, out, to, options or ConvertOptions(), force)
    if found.holds not in ("cameras", "result"):
        raise InputError(f"{source} is {found.name}, which is not converted: {suffixes('cameras', 'volume')} are")
    if images is None:
        views = read_views(source)
        if to == SPECTRAL:
            raise InputError(f"{source} holds cameras: spectral is for a rendered image (EXR)")
        write_views(out, views, to, force)
        return views
    if to is not None:
        raise InputError(
            f"to (--to) {to} and images (--images) contradict each other: with images the result is a capture"
        )
    capture = gather(read_views(source, size_of_images(images)), images)
    capture.save(out, force)
    return capture


def _picture(source: str | Path, out: Path, to: str | None, options: ConvertOptions, force: bool) -> None:
    """A picture as another, or the spectral radiance of a rendered image."""
    if options.exr and to is None:
        _lay_out(source, out, options, force)
        return
    if to != SPECTRAL:
        convert_picture(source, out, options.peak, force, options.display)
        return
    if out.suffix.lower() != ".exr":
        raise InputError(f"a spectral picture is an EXR: give --out NAME.exr, given {out.name}")
    replaceable_file(out, force)
    write_spectral_exr(out, spectral_picture(read_image(source)))


def _camera_of(source: Path, out: Path, to: str | None, options: ConvertOptions, force: bool) -> LensCamera:
    """The camera of a photograph by lensfun, as a file of cameras with one view."""
    if to == SPECTRAL:
        raise InputError("a lens (--lens) makes a camera of a photograph: leave --to spectral out")
    replaceable_file(out, force)
    shape = read_raw(source).numbers.shape if source.suffix.lower() in RAW_SUFFIXES else _shape(source)
    found = camera_by_lensfun((shape[1], shape[0]), read_exif(source), options.lens or "", options.lensfun)
    write_views(out, {source.name: found.camera}, cast(Any, to), force)
    return found


def _shape(source: Path) -> tuple[int, ...]:
    return (read_tiff(source) if source.suffix.lower() in (".tif", ".tiff") else read_picture(source)).shape


def _lay_out(source: str | Path, out: Path, options: ConvertOptions, force: bool) -> None:
    """All channels of an EXR as half floats, in tiles, or a part for each layer."""
    if Path(source).suffix.lower() != ".exr" or out.suffix.lower() != ".exr":
        raise InputError(f"--exr is for an EXR that becomes an EXR: given {Path(source).name} and {out.name}")
    if options.peak is not None or options.display is not None:
        raise InputError("an EXR is linear, without a peak (--peak) and a display (--display): leave them out")
    replaceable_file(out, force)
    channels, texts = read_exr(source)
    tile = EXR_TILE if "tiles" in options.exr else 0
    write_exr(out, channels, texts, "half" in options.exr, tile, "parts" in options.exr)


def _volume_in(source: str | Path, out: Path, options: ConvertOptions, force: bool, progress: Progress) -> None:
    """The volume box of a volume file: as the recipe of kind volume that the options make."""
    from hagoromo.matter.build import build_to

    if out.suffix.lower() != BOX:
        raise InputError(f"{source} is a volume, which becomes a volume box: give --out NAME{BOX}")
    stated = {
        "axis": None if options.axis is None else str(options.axis),
        "scale": options.scale,
        "window": None if options.window is None else list(options.window),
        "voxel_mm": options.voxel_mm,
        "mean_free_path_mm": options.mean_free_path_mm,
    }
    recipe: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    material = NEUTRAL if options.material is None else _material(options.material)
    name = Path(source).name.partition(".")[0]
    build_to(
        {"kind": "volume", "density": str(source), "name": name, "material": material, **recipe}, out, force, progress
    )


def _material(path: Path) -> dict[str, Any]:
    """The table [material] of a TOML file; files that it names lie in its folder."""
    record = read_toml(path)
    material = record.get("material", record)
    if not isinstance(material, dict):
        raise InputError(f"{path} has no table [material]: give one as recipes have")
    named = {
        key: str(inside(path.parent, value))
        for key, value in material.items()
        if isinstance(value, str) and (key == "file" or value.lower().endswith(FILES_OF_SPECTRA))
    }
    return material | named


def _volume_out(source: str | Path, out: Path, options: ConvertOptions, force: bool) -> None:
    from hagoromo.volume.store.box_store import load_box

    written = {suffix: each for each in FORMATS if each.holds == "volume" and each.writer for suffix in each.suffixes}
    form = written.get(out.suffix.lower())
    if form is None:
        raise InputError(f"{source} is a volume box, which is written as {', '.join(written)}: given {out.name}")
    replaceable_file(out, force)
    form.write(load_box(source if address(source) else Path(source)), out, options.field)
