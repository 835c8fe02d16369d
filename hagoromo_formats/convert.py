"""Convert: a file of one program into the file of another: cameras, captures, lamps, and volumes in and out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hagoromo.camera.formats.camera_file import read_views, write_views
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.exif import read_exif
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.format import Format, Holds, format_of, formats_of, function_at, suffixes_read
from hagoromo.files.mesh import read_mesh
from hagoromo.files.picture import read_picture
from hagoromo.files.raw import RAW_SUFFIXES, read_raw
from hagoromo.files.record import read_toml
from hagoromo.files.stores import address
from hagoromo.files.tiff import read_tiff
from hagoromo.files.whole import replaceable_file
from hagoromo.image.picture.any_picture import convert_picture
from hagoromo.image.picture.image import read_image
from hagoromo.image.picture.spectral_exr import spectral_picture, write_spectral_exr
from hagoromo.image.scene.motion import read_motion
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.spectrum import OTHER_FILES
from hagoromo.matter.build import build_to
from hagoromo.photograph.gather import gather, size_of_images
from hagoromo.photograph.lamp_files import LP, load_lamps, write_lp
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.parameters import MATTE, losses
from hagoromo.volume.store.box_store import load_box
from hagoromo_formats.cameras.lensfun import LensCamera, camera_by_lensfun
from hagoromo_formats.volumes.volumes_out import Field

BOX, SPECTRAL = ".zarr", "spectral"
Target = Literal["opencv", "colmap", "colmap-text", "nerfstudio", "middlebury", "spectral"]
EXR_TILE = 64  # px
FILES_OF_SPECTRA = (".csv", *OTHER_FILES)
NEUTRAL = {"alpha": 0.25, **MATTE, "body_colour": 1.0, "name": "neutral"}


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
    to: Target | None = None,
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
    .vol; returned is what is lost of its materials. `options`: what is needed for that. `InputError` for an unknown
    format, one that `out` cannot hold, and contradictions.

    >>> from tempfile import mkdtemp
    >>> home = Path(mkdtemp())
    >>> np.save(home / "ball.npy", np.ones((4, 5, 6), np.float32))
    >>> hg.convert(home / "ball.npy", home / "ball.zarr")
    >>> hg.load_box(home / "ball.zarr").bricks.shape
    (4, 5, 6)
    """
    job = Job(source, Path(out), to, images, force, options or ConvertOptions(), progress)
    if job.suffix == LP:
        write_lp(job.out, load_lamps(source), force)
        return {}
    found = format_of(source)
    return CONVERSIONS.get(found.holds, _refused)(found, job)


@dataclass(frozen=True)
class Job:
    """What `convert` is asked for."""

    source: str | Path
    out: Path
    to: str | None
    images: str | Path | None
    force: bool
    options: ConvertOptions
    progress: Progress

    @property
    def suffix(self) -> str:
        """The suffix of `out`, in small letters."""
        return self.out.suffix.lower()

    def target(self, *holds: Holds, has: str = "writer") -> Format | None:
        """The format of one of `holds` that the suffix of `out` names; has: the field of its writer."""
        return next((form for form in formats_of(*holds) if getattr(form, has) and self.suffix in form.suffixes), None)


def _refused(found: Format, job: Job) -> Any:
    raise InputError(f"{job.source} is {found.name}, which is not converted: {suffixes_read('cameras', 'volume')} are")


def _mesh(found: Format, job: Job) -> None:
    """A mesh as another one, places alone."""
    form = job.target("surface", "scene", has="mesh_writer")
    if form is None:
        known = (form for form in formats_of("surface", "scene") if form.mesh_writer)
        written = ", ".join(suffix for form in known for suffix in form.suffixes if suffix != ".gltf")
        raise InputError(f"{job.source} is a mesh, which is written as {written}: given {job.out.name}")
    replaceable_file(job.out, job.force)
    mesh = read_mesh(job.source)
    function_at(form.mesh_writer)(mesh.vertices, mesh.faces, job.out, job.force)


def _foreign_scene(found: Format, job: Job) -> Any:
    """A scene of another program as a mesh, or as a folder with scene.toml; then what was lost."""
    if found.growth and job.target("surface", "scene", has="mesh_writer") is not None:
        return _mesh(found, job)
    return function_at(found.as_scene)(job.source, job.out, job.force)


def _scene(found: Format, job: Job) -> Any:
    """A scene.toml in the format of another program; what was lost."""
    form = job.target("scene")
    if form is None:
        return _refused(found, job)
    scene, motion = load_scene(Path(job.source), job.progress)[0], read_motion(Path(job.source))
    if form.moves:
        return form.write(scene, job.out, job.force, motion=motion if motion.key_times else None)
    lost = form.write(scene, job.out, job.force)
    return [*lost, "motion"] if motion.key_times else lost


def _cameras(found: Format, job: Job) -> Any:
    """Cameras in another format: the views; with their images, a capture."""
    if job.suffix == BOX:
        return _volume_in(found, job)
    if job.images is None:
        views = read_views(job.source)
        if job.to == SPECTRAL:
            raise InputError(f"{job.source} holds cameras: spectral is for a rendered image (EXR)")
        write_views(job.out, views, job.to, job.force)
        return views
    if job.to is not None:
        raise InputError(
            f"to (--to) {job.to} and images (--images) contradict each other: with images the result is a capture"
        )
    capture = gather(read_views(job.source, size_of_images(job.images)), job.images)
    capture.save(job.out, job.force)
    return capture


def _picture(found: Format, job: Job) -> Any:
    """A picture as another, the spectral radiance of a rendered image, or the camera that took a photograph."""
    source, out, to, options, force = job.source, job.out, job.to, job.options, job.force
    if job.suffix == BOX:
        return _volume_in(found, job)
    if options.lens is not None:
        return _camera_of(Path(source), out, to, options, force)
    if options.exr and to is None:
        return _lay_out(source, out, options, force)
    if to != SPECTRAL:
        return convert_picture(source, out, options.peak, force, options.display)
    if out.suffix.lower() != ".exr":
        raise InputError(f"a spectral picture is an EXR: give --out NAME.exr, given {out.name}")
    replaceable_file(out, force)
    return write_spectral_exr(out, spectral_picture(read_image(source)))


def _camera_of(source: Path, out: Path, to: str | None, options: ConvertOptions, force: bool) -> LensCamera:
    """The camera of a photograph by lensfun, as a file of cameras with one view."""
    if to == SPECTRAL:
        raise InputError("a lens (--lens) makes a camera of a photograph: leave --to spectral out")
    replaceable_file(out, force)
    shape = read_raw(source).numbers.shape if source.suffix.lower() in RAW_SUFFIXES else _shape(source)
    found = camera_by_lensfun((shape[1], shape[0]), read_exif(source), options.lens or "", options.lensfun)
    write_views(out, {source.name: found.camera}, to, force)
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


def _volume_in(found: Format, job: Job) -> None:
    """The volume box of a volume file: as the recipe of kind volume that the options make."""
    source, out, options = job.source, job.out, job.options
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
    table = {"kind": "volume", "density": str(source), "name": name, "material": material, **recipe}
    build_to(table, out, job.force, job.progress)


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


def _box(found: Format, job: Job) -> list[str]:
    """A volume box as a volume of another program; what is lost of its materials, a line each."""
    form = job.target("volume")
    if form is None:
        written = [suffix for form in formats_of("volume") if form.writer for suffix in form.suffixes]
        raise InputError(
            f"{job.source} is a volume box, which is written as {', '.join(written)}: given {job.out.name}"
        )
    replaceable_file(job.out, job.force)
    source = job.source if address(job.source) else Path(job.source)
    box = load_box(source)
    form.write(box, job.out, job.options.field)
    colours = job.options.field == "colour"  # a file of colours holds as much of a material as a .vti
    return losses("vti" if colours else form.suffixes[0][1:], box.materials)


CONVERSIONS: dict[Holds, Callable[[Format, Job], Any]] = {
    "volume": _volume_in, "box": _box, "surface": _mesh, "scene": _foreign_scene, "matter": _scene,
    "picture": _picture, "cameras": _cameras, "result": _cameras,
}  # fmt: skip
