"""Film: a scene file that moves → its frames, a film file, a strip and a contact sheet.

Every frame is the picture of the scene's tables at its time, so that it has the bits of `render` wherever it is
rendered. Frames are kept as they are done: the same command goes on where another ended.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.cluster.cluster import here_or_on
from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.files.content import content_with_named
from hagoromo.files.film_file import check_film_name, frames_of, write_film
from hagoromo.files.png import png_bytes, read_png
from hagoromo.files.record import is_number, read_json_table, write_json, written_by
from hagoromo.files.resumable import resumable_folder
from hagoromo.files.whole import replaceable_file, tidied, whole_file, write_bytes
from hagoromo.image.film.shutter import moving_at
from hagoromo.image.picture.image import Image, auto_exposure
from hagoromo.image.picture.ocio_view import OWN
from hagoromo.image.picture.shown import DisplayTransform, DisplayView
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.render import picture_of_mode
from hagoromo.image.scene.modes import Mode
from hagoromo.image.scene.motion import Tables, read_motion, turned
from hagoromo.image.scene.motion_record import MOST_RATE
from hagoromo.image.scene.read_once import read_once
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import camera_and_settings, scene_from_tables
from hagoromo.image.scene.settings import Settings, check_mode
from hagoromo.progress import Progress, part_of, silent

MOST_FRAMES = 100_000
METERED_WALKS = 16  # through a pixel of such a frame
METERED_FRAMES, METERED_SIDE = 8, 64  # frames, and px of their longer side, by which a film is exposed
RECORD = "film.json"
STRIP_FRAMES, SHEET_FRAMES = 8, 24
SHEET_COLUMNS = 6
LONGEST_SIDE = 320  # px of a frame on them
GAP, PAPER = 4, 32  # px between frames, and their display value
ON_SRGB = DisplayView()
Frame = NDArray[np.uint8]


@dataclass(frozen=True)
class Turn:
    """A whole turn in `frames` frames about the vertical axis: of the camera, of the lamps, or of both together."""

    frames: int
    camera: bool
    lamps: bool


@dataclass(frozen=True)
class FilmOrder:
    """A film as a worker is to render it. digest: of the scene file and what it names. count: of its frames. mode: see
    `render`. look: through which its frames are shown.
    """

    path: str
    digest: str
    settings: Settings | None
    turn: Turn | None
    count: int
    rate: float
    mode: Mode = "march"
    look: DisplayView = ON_SRGB

    @property
    def fingerprint(self) -> str:
        """Of its frames: equal for two films whose frames are the same."""
        return hashlib.sha256(repr(replace(self, path="")).encode()).hexdigest()


@dataclass(frozen=True)
class Filmed:
    """frames: folder of the frames, with strip.png and sheet.png. film: the file, if one was asked for.

    rendered: how many frames were rendered now; the others were there. exposure: factor on linear values of all frames.
    """

    frames: Path
    film: Path | None
    count: int
    rendered: int
    exposure: float


def film(
    scene: str | Path,
    out: str | Path,
    settings: Settings | None = None,
    turn: Turn | None = None,
    *,
    mode: Mode = "march",
    rate: float | None = None,
    scheduler: str | int | None = None,
    force: bool = False,
    progress: Progress = silent,
    look: DisplayView = ON_SRGB,
) -> Filmed:
    """The film of the scene in a TOML file, which moves as its [motion] says, or as a `turn`.

    mode: see `render`; what light of higher orders needs is solved once while lamps and matter stand still.
    out: NAME.mp4, .webm or .gif, whose frames are kept in NAME_frames; or a folder for the frames alone. rate: frames a
    second (default: the scene's, or 24). scheduler: see `render`; each worker renders whole frames and keeps the scene
    from one to the next. All frames have one exposure, by which none of some of them is brighter than `Image.display`
    would show it, and which `look` changes. look: how they are shown; a film file states no profile of a display.

    `InputError` for `Settings.seconds`, as frames would differ from run to run, a scene that does not move, a film of
    more than 100 000 frames, and frames of another film in the folder, without `force`.
    """
    target, path = Path(out), Path(scene).absolute()
    film_file = target if target.suffix else None
    if film_file is not None:
        check_film_name(film_file)
        replaceable_file(film_file, force)
    order = _ordered(path, settings, turn, rate, mode, look)
    folder = target if film_file is None else frames_of(film_file)
    rendered = 0
    tidied(folder)  # as a process may have been killed after it put the frames there
    if film_file is None or not _is_film(folder, order):
        with resumable_folder(folder, order.fingerprint, force) as home:
            rendered = _fill(home, order, scheduler, part_of(progress, 0.0, 0.9 if film_file else 1.0))
    if film_file is not None:
        with whole_file(film_file, force) as partial:
            write_film(partial, film_file.suffix.lower(), _frames(folder, range(order.count)), order.rate)
    progress(1.0, "")
    return Filmed(folder, film_file, order.count, rendered, _exposure(folder))


def _ordered(
    path: Path,
    settings: Settings | None,
    turn: Turn | None,
    rate: float | None,
    mode: Mode = "march",
    look: DisplayView = ON_SRGB,
) -> FilmOrder:
    DisplayTransform(look)  # refuses what there is not before the work
    check_mode(settings or camera_and_settings(path)[1], mode)
    if settings is not None and settings.seconds is not None:
        raise InputError("a time for each picture gives other frames from run to run: give samples, or an error")
    motion = read_motion(path)
    rate = motion.rate if rate is None else rate
    if not 1.0 <= rate <= MOST_RATE:
        raise InputError(f"a film of {rate:g} frames a second: give 1 to {MOST_RATE:g}")
    count = turn.frames if turn is not None else round(motion.seconds * rate)
    if motion.shutter is not None and turn is not None:
        raise InputError(f"{path} has a shutter, and a turn shows single instants: leave shutter_close out")
    if motion.shutter is not None and mode != "path":
        raise InputError(f"{path} has a shutter, and mode {mode} shows single instants: film it by mode path")
    if turn is None and not motion.seconds:
        raise InputError(f"{path} does not move: give it a table [motion], or ask for a turn (--turntable 120)")
    if not 1 <= count <= MOST_FRAMES:
        raise InputError(f"a film of {count} frames: give 1 to {MOST_FRAMES}")
    if look.ocio is not None and not look.ocio.startswith(OWN):
        look = replace(look, ocio=str(Path(look.ocio).absolute()))
    return FilmOrder(str(path), content_with_named(path, quick=True), settings, turn, count, rate, mode, look)


def _is_film(folder: Path, order: FilmOrder) -> bool:
    """Whether `folder`, which appears when it is whole, holds the frames of a film."""
    record = folder / RECORD
    return record.is_file() and read_json_table(record).get("film") == order.fingerprint


def frame_name(number: int) -> str:
    """File name of a frame, from 0."""
    return f"frame_{number:05d}.png"


def _fill(home: Path, order: FilmOrder, scheduler: str | int | None, progress: Progress) -> int:
    """Render the frames that `home` lacks, the strip and the sheet; how many frames were rendered."""
    absent = [number for number in range(order.count) if not (home / frame_name(number)).is_file()]
    with here_or_on(scheduler) as workers:
        if not (home / RECORD).is_file():
            progress(0.0, "exposure")
            few = chosen(order.count, METERED_FRAMES)
            factors = [factor for _, factor in workers.results(frame_exposure, [(order, number) for number in few])]
            record = {"film": order.fingerprint, "frames": order.count, "frames_per_second": order.rate}
            write_json(home / RECORD, record | {"exposure": min(factors), "hagoromo": written_by()})
        exposure = _exposure(home)
        tasks = [(order, number, exposure) for number in absent]
        for done, (task, encoded) in enumerate(workers.results(frame_png, tasks), 1):
            write_bytes(home / frame_name(absent[task]), encoded)
            progress((order.count - len(absent) + done) / order.count, f"frame {done} of {len(absent)}")
    write_bytes(home / "strip.png", png_bytes(strip(list(_frames(home, chosen(order.count, STRIP_FRAMES))))))
    write_bytes(home / "sheet.png", png_bytes(sheet(list(_frames(home, chosen(order.count, SHEET_FRAMES))))))
    return len(absent)


def _exposure(home: Path) -> float:
    exposure: Any = read_json_table(home / RECORD).get("exposure")
    if not is_number(exposure):
        raise InputError(f"{home / RECORD} states no exposure of the film: remove the folder, and make the film anew")
    return float(exposure)


def _frames(home: Path, numbers: Any) -> Iterator[NDArray[np.uint8]]:
    for number in numbers:
        yield np.asarray(read_png(home / frame_name(number)), np.uint8)


def frame_exposure(order: FilmOrder, number: int) -> float:
    """On a worker: the factor by which `Image.display` would expose a frame, from a small picture of it."""
    scene, settings, cache = _frame(order, number)
    small = scene.with_camera(scene.camera.limited(METERED_SIDE))
    fewer: dict[str, Any] = {
        "march": {"samples": 1, "shadow_resolution": METERED_SIDE},
        # with the shadow maps of the frames, as the solved light is theirs
        "full": {"samples": 1, "walks": 0, "error": None},
        "path": {"samples": min(settings.samples, METERED_WALKS), "error": None},
    }[order.mode]
    image = picture_of_mode(order.mode, small, replace(settings, **fewer), cache)
    return auto_exposure(image.linear_srgb(), image.alpha)


def frame_png(order: FilmOrder, number: int, exposure: float) -> bytes:
    """On a worker: a frame as a PNG file."""
    image, shown = frame_image(order, number), DisplayTransform(order.look)
    return shown.png(shown.numbers(image.linear_srgb() * (exposure * order.look.factor)))


def frame_image(order: FilmOrder, number: int) -> Image:
    """The image of a frame, what `render` gives of its tables."""
    scene, settings, cache = _frame(order, number)
    return picture_of_mode(order.mode, scene, settings, cache)


def frame_tables(order: FilmOrder, number: int) -> Tables:
    """The tables of the scene of a frame, which may be written as a scene file."""
    reel = _reel(order)
    tables = reel.motion.at(number / order.rate)
    if order.turn is None:
        return tables
    scene, _ = scene_from_tables(tables, reel.folder, order.path, reel.read)
    angle = 2.0 * math.pi * number / order.turn.frames
    return turned(tables, scene, angle, order.turn.camera, order.turn.lamps)


def _frame(order: FilmOrder, number: int) -> tuple[Scene, Settings, SceneCache]:
    reel, tables = _reel(order), frame_tables(order, number)
    scene, stated = scene_from_tables(tables, reel.folder, order.path, reel.read)
    if order.turn is None:
        scene = replace(scene, moving=moving_at(reel.motion, number / order.rate, tables, scene))
    if order.mode == "full":
        as_first = _beside_camera(tables) == _beside_camera(frame_tables(order, 0))
        reel.cache.shared = cache() if as_first else None  # what serves this frame alone is not worth the disk
    return scene, order.settings or stated, reel.cache


def _beside_camera(tables: Tables) -> dict[str, Any]:
    """The tables of lamps and matter. Where they are those of the first frame, light that is solved serves others."""
    return {key: value for key, value in tables.items() if key != "camera"}


class _Reel:
    """What a worker keeps from one frame to the next."""

    def __init__(self, order: FilmOrder) -> None:
        path = Path(order.path)
        if content_with_named(path, quick=True) != order.digest:
            raise InputError(
                f"{path}, or a file that it names, is another one on a worker, or has changed: start again"
            )
        self.folder, self.read, self.cache = path.parent, read_once(), SceneCache()
        self.motion = read_motion(path)


_held: dict[FilmOrder, _Reel] = {}  # of the film that this worker renders


def _reel(order: FilmOrder) -> _Reel:
    if order not in _held:
        _held.clear()  # before another one takes memory
        _held[order] = _Reel(order)
    return _held[order]


def chosen(count: int, most: int) -> list[int]:
    """Numbers of at most `most` of `count` frames, evenly from the first on."""
    number = min(count, most)
    return [k * count // number for k in range(number)]


def strip(frames: Sequence[Frame]) -> Frame:
    """Frames of one size beside each other."""
    return sheet(frames, len(frames))


def sheet(frames: Sequence[Frame], columns: int = SHEET_COLUMNS) -> Frame:
    """Frames of one size in rows, reduced to LONGEST_SIDE."""
    import cv2

    height, width = frames[0].shape[:2]
    share = min(LONGEST_SIDE / max(height, width), 1.0)
    size = max(round(width * share), 1), max(round(height * share), 1)
    small = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in frames]
    columns = min(columns, len(small))
    rows = -(-len(small) // columns)
    paper = np.full((rows * (size[1] + GAP) + GAP, columns * (size[0] + GAP) + GAP, 3), PAPER, np.uint8)
    for k, frame in enumerate(small):
        top, left = (GAP + (k // columns) * (size[1] + GAP), GAP + (k % columns) * (size[0] + GAP))
        paper[top : top + size[1], left : left + size[0]] = frame
    return paper
