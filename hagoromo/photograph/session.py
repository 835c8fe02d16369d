"""Session: the photographs of one view and what belongs to them, checked before any of them is read in full.

Files may be developed (EXR of `develop`) or as the camera left them (RAW, TIFF, JPEG, PNG). They are read one at a
time: `Session.shots` gives each as it is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera, unplaced_camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import read_header
from hagoromo.files.picture import by_name
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.developing import AS_IN_THE_FILES, Developing
from hagoromo.photograph.development.undistort import Straightener
from hagoromo.photograph.lamp_files import faces_up, faults_of_lamps, lamp_of_each, load_lamps
from hagoromo.photograph.object_mask import AUTO, ObjectMask, Thumbnails, object_mask
from hagoromo.photograph.pixels import SUFFIXES, default_channels, read_mask
from hagoromo.photograph.session_exif import SessionExif, session_exif
from hagoromo.photograph.session_transfer import Shaded, estimated_transfer, needs_estimate
from hagoromo.photograph.shot import Shot, ShotReader

ORTHOGRAPHIC = "orthographic"
Masks = str | Path | Sequence[str | Path]


@dataclass(eq=False)
class Session:
    """The photographs of one view, with what is known about them before they are read.

    assumptions grows as they are read: what is taken for given, and from where. pictures: name → a PNG that is written
    beside transforms.json, for people.
    """

    paths: dict[str, Path]
    lamps: list[Lamp]
    exif: SessionExif
    camera: Camera | None
    orthographic: bool
    up: bool
    response: Response | None
    masks: list[Path]
    auto_mask: bool
    developing: Developing
    undistorted: bool
    assumptions: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    view: Camera | None = None
    excluded: NDArray[np.bool_] | None = None
    straightener: Straightener | None = None
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)

    def shots(self) -> Iterator[Shot]:
        """The photographs, one after the other, in the order of `paths`; `InputError` for one of another size."""
        reader = self._reader()
        for number, path in enumerate(self.paths.values()):
            shot = reader.read(number, (self.lamps[number],))
            height, width = shot.values.shape[:2]
            first = self.view is None
            camera = self._view(width, height) if self.view is None else self.view
            if (width, height) != (camera.width, camera.height):
                other = "its camera" if first else f"{next(iter(self.paths))}"
                raise InputError(
                    f"{path} is {width} × {height} px and {other} {camera.width} × {camera.height}: give photographs "
                    "of one size, with the camera of that size"
                )
            if first:
                self.view = camera
                _check_lamps(self.lamps, camera)
                self._check_masks((height, width))
            if self.straightener is not None and path.suffix.lower() != ".exr":
                shot = shot.straightened(self.straightener)
            yield shot._replace(camera=replace(camera, sensor=shot.camera.sensor) if shot.camera else camera)

    def _reader(self) -> ShotReader:
        """What reads the files, with the transfer curve found where it is to be estimated."""
        paths, developing, said = list(self.paths.values()), self.developing, ""
        if needs_estimate(developing.transfer):
            by_hand = None if self.auto_mask or len(self.masks) != 1 else self.masks[0]
            exposures = [time * iso for time, iso in zip(self.exif.seconds, self.exif.iso, strict=True)]
            shaded = Shaded(paths, self.lamps, exposures, by_hand, self.auto_mask, self.excluded)
            found = estimated_transfer(shaded, [Path(p) for p in developing.bracket], developing.bracket_exposures_s)
            said = found.said
            developing = replace(developing, transfer=found.transfer, bracket=(), bracket_exposures_s=())
        channels = self.response.channels if self.response else default_channels(3)
        return ShotReader(paths, self.exif, developing, channels, self.assumptions, said)

    def own_mask(self, number: int, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
        """The hand-made mask of a photograph; None where there is none, or one that only corrects the automatic one."""
        if self.auto_mask or not self.masks:
            return None if self.auto_mask or self.excluded is None else ~self.excluded
        own = read_mask(self.masks[number if len(self.masks) > 1 else 0], shape)
        return own if self.excluded is None else own & ~self.excluded

    def found_mask(self, seen: Thumbnails, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
        """The object's mask, found in the photographs and corrected by hand; None where it was not asked for."""
        if not self.auto_mask:
            return None
        found = object_mask(seen, shape, self.masks[0] if self.masks else None, self.excluded)
        self._remark_mask(found, "found in the photographs")
        return found.mask

    def _view(self, width: int, height: int) -> Camera:
        """The camera of all photographs, and what is assumed about it."""
        if self.camera is not None:
            lens, said = self.camera, "as given"
            if self.up:
                lens = lens.with_pose(unplaced_camera(width, height, lens.focal[0]).world_to_camera)
        else:
            focal = None if self.orthographic else self.exif.focal_of(width)
            lens = unplaced_camera(width, height, focal)
            said = "orthographic: neither a camera nor a focal length is known" if focal is None else (
                f"a pinhole of {focal:.6g} px, the focal length in the EXIF, without distortion"
            )  # fmt: skip
            said = "orthographic, as stated" if self.orthographic else said
            said += "; lengths are in units of the picture's longer side at the object"
        bent = not self.undistorted and any(lens.distortion)
        developed = [path.suffix.lower() == ".exr" for path in self.paths.values()]
        if bent and any(developed) and not all(developed):
            raise InputError("some photographs are developed with the distortion of their lens: develop all, or none")
        if bent and not all(developed):
            self.straightener = Straightener.of(lens)
            said += ", whose distortion is removed"
        if self.undistorted or self.straightener is not None:
            lens = replace(lens, distortion=(0.0,) * len(lens.distortion))
        self.assumptions["camera"] = said
        return replace(lens, response=self.response)

    def _check_masks(self, shape: tuple[int, int]) -> None:
        if self.excluded is not None and self.excluded.shape != shape:
            raise InputError(
                f"the mask of the ball has shape {self.excluded.shape} and the photographs {shape}: resize it"
            )
        for path in self.masks:
            mask = read_mask(path, shape)
            if not self.auto_mask:
                self._remark_mask(ObjectMask.by_hand(mask, path), f"by hand: {path.name}")
        if not self.masks and not self.auto_mask:
            self.assumptions["mask"] = "none: the object fills the picture"

    def _remark_mask(self, found: ObjectMask, how: str) -> None:
        self.assumptions["mask"] = f"{how}, {100.0 * found.mask.mean():.1f} % of the picture"
        for remark in found.remarks:
            if remark not in self.remarks:
                self.remarks.append(remark)


def session(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = None,
    response: Response | str | Path | None = None,
    masks: Masks = (),
    *,
    spectrum: Spectrum | str | Path | None = None,
    intensity: float | Sequence[float] | None = None,
    undistorted: bool = False,
    developing: Developing = AS_IN_THE_FILES,
    excluded: NDArray[np.bool_] | None = None,
) -> Session:
    """The photographs of one view and what belongs to them, checked before any is read in full; see `capture`.

    excluded: (height, width) true where there is something else than the object, such as a chrome ball.
    """
    paths = by_name([Path(path) for path in photographs])
    if not paths:
        raise InputError("no photograph is given: give one per lamp")
    files = list(paths.values())
    for path in files:
        check_readable(path)
    straight = _undistorted(paths, undistorted)
    listed = load_lamps(lamps) if isinstance(lamps, (str, Path)) else tuple(lamps)
    assigned, how = lamp_of_each(listed, files)
    lit = [as_stated(lamp, spectrum, intensity) for lamp in assigned]
    if response is not None and not isinstance(response, Response):
        response = Response.load(response)
    given = [masks] if isinstance(masks, (str, Path)) else list(masks)
    auto = bool(given) and str(given[0]) == AUTO
    shapes = [Path(path) for path in given[1 if auto else 0 :]]
    if len(shapes) not in ((0, 1) if auto else (0, 1, len(paths))):
        raise InputError(f"{len(shapes)} masks for {len(paths)} photographs: give one for all, or one each")
    exif = session_exif(files, developing.exposures_s, developing.iso)
    flat = str(camera) == ORTHOGRAPHIC if isinstance(camera, (str, Path)) else False
    lens = None if camera is None or flat else camera if isinstance(camera, Camera) else read_camera(camera)
    up = isinstance(lamps, (str, Path)) and faces_up(lamps)
    source = f"from {Path(lamps).name}" if isinstance(lamps, (str, Path)) else "as given"
    faults = faults_of_lamps(lamps) if isinstance(lamps, (str, Path)) else ""
    assumptions = {"lamps": f"{len(lit)} {source}, matched {how}{'; ' * bool(faults)}{faults}"}
    return Session(
        paths, lit, exif, lens, flat, up, response, shapes, auto, developing, straight, assumptions, excluded=excluded
    )


def as_stated(lamp: Lamp, spectrum: Spectrum | str | Path | None, intensity: float | Sequence[float] | None) -> Lamp:
    """The lamp with a spectrum and an intensity that are stated in place of its own."""
    if spectrum is not None:
        lamp = replace(lamp, spectrum=Spectrum.load(str(spectrum) if isinstance(spectrum, Path) else spectrum))
    return lamp if intensity is None else replace(lamp, intensity=np.squeeze(np.asarray(intensity, np.float64)))  # pyrefly: ignore[bad-argument-type]


def check_readable(path: Path) -> None:
    """`InputError` for a path that is no file of a format of photographs."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: give its photographs, such as {path / '*.jpg'}")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path} is not an image of a known format: give one of {', '.join(SUFFIXES)}")
    existing_file(path)


def _undistorted(paths: dict[str, Path], stated: bool) -> bool:
    """Whether the photographs have no lens distortion: `stated`, or written in the EXR files by `develop`."""
    exr = {name: path for name, path in paths.items() if path.suffix.lower() == ".exr"}
    marked = [name for name, path in exr.items() if "undistorted" in read_header(path)]
    if marked and len(marked) < len(paths) and not stated:
        other = next(name for name in paths if name not in marked)
        raise InputError(
            f"{marked[0]} is undistorted and {other} is not: develop all with undistort (--undistort), or none"
        )
    return stated or bool(marked)


def _check_lamps(lamps: Sequence[Lamp], camera: Camera) -> None:
    """Raise `InputError` if every lamp is far and none lights the side that the camera sees."""
    forward = camera.world_to_camera[2, :3]
    if all(lamp.to_lamp is not None and lamp.to_lamp @ forward >= 0.0 for lamp in lamps):
        raise InputError(
            "every lamp is behind the object as seen from this camera: give camera (--camera) if, and only if, it was "
            "given to `hagoromo calibrate lamps`"
        )
