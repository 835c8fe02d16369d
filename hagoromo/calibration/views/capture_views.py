"""Capture of many views: photographs taken all around an object → a capture folder with the camera of each.

Beside the folder OUT lies OUT.views, COLMAP's model of the cameras. A second call on the same photographs with the same
settings reads it, and goes on with one that was cut off. In the folder, views.json has the residuals, and points.ply
the points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.calibration.camera.board import Board
from hagoromo.calibration.views.known_length import FoundScale, KnownBall, KnownLength, scale_of
from hagoromo.calibration.views.reconstruct import StatedLens, ViewsSettings, colmap, read_structure, reconstruct
from hagoromo.calibration.views.structure import Structure
from hagoromo.calibration.views.view_light import ViewLight
from hagoromo.calibration.views.view_photographs import ViewPhotographs, view_photographs
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.content import content, digest
from hagoromo.files.memory import require
from hagoromo.files.record import write_json, written_by
from hagoromo.files.resumable import resumable_folder
from hagoromo.files.whole import replaceable_folder, whole_folder, write_text
from hagoromo.photograph.capture_folder import BYTES_PER_VALUE, IMAGES, MASKS, write_frame, write_frames
from hagoromo.photograph.developing import AS_IN_THE_FILES, ESTIMATE, Developing
from hagoromo.photograph.one_exposure import read_frame
from hagoromo.photograph.pixels import default_channels
from hagoromo.photograph.session import Masks
from hagoromo.photograph.shot import ShotReader
from hagoromo.progress import Progress, part_of, silent
from hagoromo.version import __version__

WORK = ".views"  # what is added to the name of the capture, for the folder of COLMAP's model
KEY = "hagoromo_key"  # file of that folder: what it was made of
RESIDUALS, POINTS = "views.json", "points.ply"
FEW = 0.2  # of the median number of points of a photograph, below which it is remarked
FOUND_SHARE = 0.8  # of the progress
NO_SCALE = (
    "none: the unit of length is the mean distance from the cameras to the object, not a metre; give a length between "
    "two points (--length), a calibration board (--board) or a ball (--ball) for metres"
)


@dataclass(frozen=True, eq=False)
class CapturedViews:
    """What `capture_views` wrote. work: folder of COLMAP's model. structure: in the axes of the capture. scale: None
    where nothing of known size was given. assumptions: what is taken for given. remarks: what a person should look at.
    """

    folder: Path
    work: Path
    structure: Structure
    scale: FoundScale | None
    assumptions: dict[str, str]
    remarks: tuple[str, ...]

    def lines(self) -> list[str]:
        """What is said of it: a line for each photograph, then what is taken for given."""
        structure = self.structure
        frames = [
            f"{name}: {len(structure.sightings[name].point)} points, {structure.rms(name):.3f} px"
            for name in structure.views
        ]
        left = [f"{name}: left out, {why}" for name, why in structure.left_out.items()]
        return [*frames, *left, *(f"{what}: {said}" for what, said in self.assumptions.items())]


def capture_views(
    photographs: Sequence[str | Path],
    out: str | Path,
    light: ViewLight | None = None,
    masks: Masks = (),
    scale: KnownLength | KnownBall | Board | None = None,
    camera: Camera | str | Path | None = None,
    response: Response | str | Path | None = None,
    *,
    settings: ViewsSettings | None = None,
    developing: Developing = AS_IN_THE_FILES,
    force: bool = False,
    progress: Progress = silent,
) -> CapturedViews:
    """Write a capture of photographs taken all around an object by one camera: poses, lens and points by COLMAP.

    light: see `ViewLight`; None: fixed and unknown. masks: a folder, one each, or "auto"; without them transparency
    counts. scale: something of known size. camera: a calibrated lens, kept as it is; its pose does not count.
    World axes: z up, the object at the origin, metres if scale is given. `InputError` for fewer than three photographs,
    several cameras or sizes, photographs that share too few points, and where `hagoromo capture` refuses, too.
    """
    settings, light = settings or ViewsSettings(), light or ViewLight()
    colmap()
    out = replaceable_folder(out, force)
    if light.needs_scale and scale is None:
        raise InputError(
            "the lamps are stated in metres, and nothing gives the photographs a scale: add a length (--length), a "
            "board (--board) or a ball (--ball)"
        )
    given = _given(photographs, masks, developing)
    if response is not None and not isinstance(response, Response):
        response = Response.load(response)
    lens = _lens(given, read_camera(camera) if isinstance(camera, (str, Path)) else camera)
    work = out.with_name(out.name + WORK)
    found = _structure(given, lens, settings, work, force, part_of(progress, 0.0, FOUND_SHARE, ""))
    found, size = _sized(found.upright(), scale, given)
    twins = {name: f"it is a copy of {other}" for name, other in given.twins.items()}
    found = replace(found, left_out={**twins, **found.left_out})
    assumptions = {"camera": _said_of_lens(found, lens), "scale": NO_SCALE if size is None else _said_of_scale(size)}
    lit, assumptions["lamps"] = light.of(found.views)
    channels = response.channels if response else default_channels(3)
    reader = ShotReader(list(given.paths.values()), given.exif, developing, channels, assumptions)
    own = part_of(progress, FOUND_SHARE, 1.0 - FOUND_SHARE, "")
    with whole_folder(out, force) as home:
        frames, lamps, masked = _write_frames(found, lit, given, reader, response, home, own)
        assumptions["mask"] = _said_of_masks(given, masked, len(frames))
        frames = [given.exif.without_unstated(frame) for frame in frames]
        write_frames(home, frames, lamps, {"assumptions": assumptions}, response)
        write_json(home / RESIDUALS, _record(found, size, settings))
        _write_points(found, home / POINTS)
    return CapturedViews(out, work, found, size, assumptions, _remarks(found))


def _given(photographs: Sequence[str | Path], masks: Masks, developing: Developing) -> ViewPhotographs:
    """The photographs; what cannot be developed is refused before the long search."""
    if developing.transfer == ESTIMATE:
        raise InputError("the transfer curve of many views is not estimated: state linear, srgb or a CSV (--transfer)")
    given = view_photographs(photographs, masks, developing.exposures_s, developing.iso)
    first = given.paths[given.names[0]]
    if first.suffix.lower() != ".exr":
        read_frame(first, developing.stated)
    return given


def _lens(given: ViewPhotographs, camera: Camera | None) -> StatedLens:
    """What is known of the lens; `InputError` for a camera of another size."""
    size = given.size()
    if camera is not None and (camera.width, camera.height) != size:
        raise InputError(
            f"{given.names[0]} is {size[0]} × {size[1]} px and the camera {camera.width} × {camera.height}: give the "
            "camera of that size"
        )
    return StatedLens(size, None if camera is not None else given.exif.focal_of(size[0]), camera)


def _structure(
    given: ViewPhotographs, lens: StatedLens, settings: ViewsSettings, work: Path, force: bool, progress: Progress
) -> Structure:
    """The structure of the photographs: what lies in `work`, if it is of these, or else found anew."""
    if settings.turntable and not (given.masks or given.auto) and given.mask(
        given.names[0], given.picture(given.names[0])
    ) is None:  # fmt: skip
        raise InputError(
            "an object on a turntable (--turntable) needs masks (--mask), as what is around it does not turn with it"
        )
    camera = lens.camera
    known = None if camera is None else [*camera.focal, *camera.principal, *camera.distortion]
    masks = {name: content(path) for name, path in given.masks.items()} if settings.turntable else {}
    files = {name: [given.contents[name], masks.get(name)] for name in given.names}
    made_of = {
        "version": __version__,
        "files": files,
        "settings": asdict(settings),
        "lens": known,
        "auto": settings.turntable and given.auto,
    }
    key = digest(made_of)
    if not force and (work / KEY).is_file() and existing_file(work / KEY).read_text(encoding="utf-8") == key:
        return read_structure(work, given.names, lens)
    if not force and work.is_dir() and any(work.iterdir()):
        raise InputError(f"{work} is of other photographs or settings: add force (--force), or remove it")

    def pictures(number: int) -> Any:
        grey, mask = given.grey(given.names[number], lens.size, settings.largest)
        return grey, mask if settings.turntable else None

    with resumable_folder(work, key, force) as partial:
        reconstruct(pictures, given.names, lens, settings, partial, progress)
        write_text(partial / KEY, key)
    return read_structure(work, given.names, lens)


def _sized(
    found: Structure, scale: KnownLength | KnownBall | Board | None, given: ViewPhotographs
) -> tuple[Structure, FoundScale | None]:
    """The structure in metres, where something of known size is given."""
    if scale is None:
        return found, None
    size = scale_of(scale, found, given.picture)
    return found.moved(np.eye(3), np.zeros(3), size.metres), size


def _write_frames(
    found: Structure,
    lit: Mapping[str, Any],
    given: ViewPhotographs,
    reader: ShotReader,
    response: Response | None,
    home: Path,
    progress: Progress,
) -> tuple[list[dict[str, Any]], dict[str, int], int]:
    """Write images and masks; the frames, the lamps (JSON text → index), and how many have a mask."""
    for folder in (IMAGES, MASKS):
        (home / folder).mkdir()
    frames: list[dict[str, Any]] = []
    lamps: dict[str, int] = {}
    for done, (name, camera) in enumerate(found.views.items()):
        progress(done / len(found.views), name)
        number = given.names.index(name)
        shot = reader.read(number, lit[name])
        require(BYTES_PER_VALUE * shot.values.size, str(shot.path))
        shot = shot._replace(camera=replace(camera, response=response, sensor=shot.camera.sensor))
        frames.append(write_frame(shot, given.mask(name, given.picture(name)), number, home, lamps))
    masked = sum("mask_path" in frame for frame in frames)
    if not masked:
        (home / MASKS).rmdir()
    return frames, lamps, masked


def _write_points(found: Structure, path: Path) -> None:
    """The points of the structure as PLY."""
    import trimesh

    data = trimesh.PointCloud(found.points).export(file_type="ply")
    assert isinstance(data, bytes)
    path.write_bytes(data)


def _record(found: Structure, size: FoundScale | None, settings: ViewsSettings) -> dict[str, Any]:
    """views.json: the lens, the residuals of each photograph, those left out, and the scale."""
    camera = next(iter(found.views.values()))
    stated = asdict(settings)
    seed = stated.pop("seed")
    return {
        "hagoromo": written_by(stated, seed),
        "lens": {
            **dict(zip(("fl_x", "fl_y", "cx", "cy"), (*camera.focal, *camera.principal), strict=True)),
            **dict(zip(COEFFICIENTS, camera.distortion, strict=True)),
            "standard_error": dict(found.lens_error),
        },
        "points": len(found.points),
        "rms_px": found.rms_of_all,
        "photographs": {
            name: {"points": len(found.sightings[name].point), "rms_px": found.rms(name)} for name in found.views
        },
        "left_out": dict(found.left_out),
        "scale": None if size is None else size._asdict(),
    }


def _said_of_lens(found: Structure, lens: StatedLens) -> str:
    """Focal length and distortion with their standard errors, how many photographs are placed, and how well."""
    camera = next(iter(found.views.values()))
    count = len(found.views) + len(found.left_out)
    how = "as given, " if lens.camera is not None else ""
    figures = {"focal length": camera.focal[0], **dict(zip(COEFFICIENTS[:2], camera.distortion, strict=False))}
    errors = [found.lens_error.get("fl_x"), *(found.lens_error.get(key) for key in COEFFICIENTS[:2])]
    lens_said = ", ".join(
        f"{what} {figure:.5g}"
        + ("" if error is None else f" ± {error:.2g}")
        + (" px" if what == "focal length" else "")
        for (what, figure), error in zip(figures.items(), errors, strict=True)
    )
    return (
        f"{how}{lens_said}; {len(found.views)} of {count} "
        f"photographs placed by {len(found.points)} points, residuals {found.rms_of_all:.3f} px (root mean square)"
    )


def _said_of_scale(size: FoundScale) -> str:
    return (
        f"by {size.source} in {len(size.photographs)} photographs, ± {100.0 * size.error:.2g} % (standard error), "
        f"residuals {size.rms:.2g} px"
    )


def _said_of_masks(given: ViewPhotographs, masked: int, count: int) -> str:
    if not masked:
        return "none: `hagoromo recover` takes what is brighter than a dark background"
    how = "as given" if given.masks else "found in each photograph: look at them" if given.auto else "by transparency"
    return f"{how}, of {masked} of {count} photographs"


def _remarks(found: Structure) -> tuple[str, ...]:
    """One line on photographs that show few points."""
    counts = {name: len(found.sightings[name].point) for name in found.views}
    few = [name for name, count in counts.items() if count < FEW * np.median(list(counts.values()))]
    if not few:
        return ()
    return (
        f"{', '.join(few[:5])}{' and more' if len(few) > 5 else ''}: placed by few points, perhaps blurred: look at "
        "them, and leave them out if they are",
    )
