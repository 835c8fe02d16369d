"""Capture of photographs: one view under one lamp each, with their camera, response and masks → Capture.

Files may be developed (EXR of `develop`) or as the camera left them (RAW, TIFF, JPEG, PNG). They are read one at a
time: `Session.shots` gives each as it is needed, `capture` keeps all in memory, `capture_to` writes each to a folder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.response import Response
from hagoromo.camera.unplaced import unplaced_camera
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import read_header
from hagoromo.files.memory import require
from hagoromo.files.picture import by_name
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import BYTES_PER_VALUE, Capture
from hagoromo.photograph.development.exposure import StatedExposure
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.transfer import Transfer
from hagoromo.photograph.lamp_files import faces_up, lamp_of_each, load_lamps
from hagoromo.photograph.object_mask import AUTO, ObjectMask, Thumbnails, object_mask
from hagoromo.photograph.one_exposure import light_of, noise_of, read_frame
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import SUFFIXES, default_channels, read_mask, read_pixels
from hagoromo.photograph.session_exif import SessionExif, session_exif
from hagoromo.photograph.straighten import Straightener
from hagoromo.photograph.transforms import ImageSettings
from hagoromo.photograph.variance_model import VarianceModel

ORTHOGRAPHIC = "orthographic"
NOISE_FRAMES = 3  # photographs whose middles estimate the noise, of each ISO
Masks = str | Path | Sequence[str | Path]


@dataclass(frozen=True, eq=False)
class Developing:
    """How undeveloped files are read; None: as the file states.

    black, white: levels [DN]. mosaic: of files with one channel, such as "RGGB". transfer: of 8-bit files: "linear",
    "srgb", a CSV or a curve. gain [e⁻/DN] and read_noise [e⁻] of the sensor: both or neither, by default estimated from
    the photographs. exposures_s: one for all, or one each [s]. iso: of all.
    """

    black: float | None = None
    white: float | None = None
    mosaic: str | None = None
    transfer: str | Path | Transfer | None = None
    gain: float | None = None
    read_noise: float | None = None
    exposures_s: Sequence[float] = ()
    iso: float | None = None

    def __post_init__(self) -> None:
        """Check what goes together."""
        if (self.gain is None) != (self.read_noise is None):
            raise InputError("gain and read_noise (--gain, --read-noise) go together: give both or none")

    @property
    def stated(self) -> StatedExposure:
        """The levels and the transfer."""
        return StatedExposure(self.black, self.white, self.mosaic, self.transfer, None, self.iso)

    @property
    def noise(self) -> Noise | None:
        """The noise, where it is stated."""
        return None if self.gain is None or self.read_noise is None else Noise(self.gain, self.read_noise)


AS_IN_THE_FILES = Developing()


class Shot(NamedTuple):
    """One photograph of a session as it was read: stored values, what they are divided by, and their noise.

    values: (height, width, C) float32. scale: seconds times ISO/100, by which values are divided. valid: (height,
    width) without the mask. variance: of the values, or its model.
    """

    name: str
    path: Path
    values: NDArray[np.float32]
    scale: tuple[float, float]
    valid: NDArray[np.bool_]
    native: NDArray[np.bool_] | None
    variance: NDArray[np.float32] | VarianceModel
    camera: Camera
    lamp: Lamp

    def photograph(self, valid: NDArray[np.bool_]) -> Photograph:
        """The photograph, light per second at ISO 100."""
        over = np.float32(self.scale[0] * self.scale[1] / 100.0)
        variance, native = self.variance, self.native
        if isinstance(variance, VarianceModel):
            native = variance.native(*self.values.shape[:2]) if native is None else native
            variance = variance.of(self.values)
        return Photograph(self.values / over, variance / over**2, valid, self.camera, (self.lamp,), self.name, native)


@dataclass(eq=False)
class Session:
    """The photographs of one view, with what is known about them before they are read.

    assumptions grows as they are read: what is taken for given, and from where.
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

    def shots(self) -> Iterator[Shot]:
        """The photographs, one after the other, in the order of `paths`; `InputError` for one of another size."""
        noises: dict[float, Noise] = {}
        for number, path in enumerate(self.paths.values()):
            shot = self._developed(number, path) if path.suffix.lower() == ".exr" else self._read(number, path, noises)
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
                shot = _straightened(shot, self.straightener)
            yield shot._replace(camera=replace(camera, sensor=shot.camera.sensor) if shot.camera else camera)

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

    def _developed(self, number: int, path: Path) -> Shot:
        """A developed EXR."""
        channels = self.response.channels if self.response else default_channels(3)
        pixels = read_pixels(path, ImageSettings(), channels, "bilinear", path.name)
        self.assumptions.setdefault("values", "developed EXR files, linear in light")
        lamp = self.lamps[number]
        return Shot(
            path.stem, path, pixels.values, (1.0, 100.0), pixels.valid, pixels.native, pixels.variance, NO_CAMERA, lamp
        )

    def _read(self, number: int, path: Path, noises: dict[float, Noise]) -> Shot:
        """A file as the camera left it."""
        seconds, iso = self.exif.seconds[number], self.exif.iso[number]
        if iso not in noises:
            noises[iso] = self.developing.noise or self._estimated_noise(iso)
            self._note_noise(noises)
        frame = read_frame(path, self.developing.stated)
        if not self.exif.stated and frame.exposure.exif.exposure_s is not None:  # RAW that is no TIFF states its own
            seconds, iso = frame.exposure.exif.exposure_s, frame.exposure.exif.iso or iso
        light = light_of(frame, noises[self.exif.iso[number]])
        self._note_transfer(path)
        if not light.valid.any():
            raise InputError(f"{path} is clipped everywhere: expose it less")
        shot = light.values, (seconds, iso), light.valid, None, light.variance
        return Shot(path.stem, path, *shot, NO_CAMERA, self.lamps[number])

    def _estimated_noise(self, iso: float) -> Noise:
        same = [
            p
            for p, i in zip(self.paths.values(), self.exif.iso, strict=True)
            if i == iso and p.suffix.lower() != ".exr"
        ]
        chosen = same[:: max(len(same) // NOISE_FRAMES, 1)][:NOISE_FRAMES]
        return noise_of([read_frame(path, self.developing.stated, middle=True).exposure for path in chosen])

    def _note_noise(self, noises: Mapping[float, Noise]) -> None:
        self.assumptions["noise"] = "; ".join(
            f"ISO {iso:g}: gain {noise.gain:.4g} e⁻/DN, read noise {noise.read_noise:.3g} e⁻, from {noise.source}"
            for iso, noise in noises.items()
        )

    def _note_transfer(self, path: Path) -> None:
        if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".tif", ".tiff"):
            stated = self.developing.transfer
            name = "a curve" if isinstance(stated, Transfer) else f"{stated}"
            said = "linear: assumed of 16 bits and floats" if stated is None else f"{name}, as stated"
            self.assumptions["transfer"] = said
        else:
            self.assumptions.setdefault("transfer", "linear: camera RAW")
        times = sorted(set(self.exif.seconds))
        if not self.exif.stated:
            self.assumptions["exposure"] = "the same for all: no file states its exposure time"
        elif len(times) > 1:
            self.assumptions["exposure"] = f"{times[0]:g} to {times[-1]:g} s, as stated: values are per second"
        else:
            self.assumptions["exposure"] = f"{times[0]:g} s, as stated"


def _straightened(shot: Shot, by: Straightener) -> Shot:
    """The shot without lens distortion; its variance is that of a measured sample everywhere, an upper bound."""
    model, native = shot.variance, shot.native
    if isinstance(model, VarianceModel):
        native, model = model.native(*shot.valid.shape), replace(model, mosaic="")
    return shot._replace(
        values=by.values(shot.values),
        valid=by.valid(shot.valid),
        native=None if native is None else by.native(native),
        variance=model,
    )


NO_CAMERA = Camera(1, 1, (1.0, 1.0), (0.5, 0.5))  # of a shot until the size of the photographs is known


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
        _check_readable(path)
    straight = _undistorted(paths, undistorted)
    listed = load_lamps(lamps) if isinstance(lamps, (str, Path)) else tuple(lamps)
    assigned, how = lamp_of_each(listed, files)
    lit = [_as_stated(lamp, spectrum, intensity) for lamp in assigned]
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
    assumptions = {"lamps": f"{len(lit)} {source}, matched {how}"}
    return Session(
        paths, lit, exif, lens, flat, up, response, shapes, auto, developing, straight, assumptions, excluded=excluded
    )


def capture(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = None,
    response: Response | str | Path | None = None,
    masks: Masks = (),
    *,
    spectrum: Spectrum | str | Path | None = None,
    intensity: float | Sequence[float] | None = None,
    undistorted: bool = False,
    transfer: str | Path | Transfer | None = None,
    name: str = "",
    developing: Developing = AS_IN_THE_FILES,
) -> Capture:
    """The capture of photographs that one camera took from one place, with one lamp on in each.

    photographs: RAW, TIFF, JPEG or PNG as the camera left them, or EXR files of `develop`. lamps: lamps.json, an .lp,
    or `Lamp`s. A photograph is assigned the lamp with the name of its file (without suffix); if no name matches, lamps
    are assigned in order. camera: a `Camera` or its file; world axes are then the camera's (x right, y down, z forward;
    with an .lp those of the .lp). Without it the focal length of the EXIF is used, or else, or for "orthographic", an
    orthographic view; world axes are then x right, y up, z to the camera, and the object is at the world's origin.
    response: a `Response`, its name or CSV. masks: PNG files, white on the object, one for all photographs or one each;
    "auto": found in the photographs, corrected by a PNG after it that is white where there is object, black where there
    is none and grey where it says nothing. spectrum: of all lamps (a name or CSV), if lamps.json has none. intensity:
    of all lamps, instead of that in lamps.json: one number, or one per channel. undistorted: the photographs have no
    lens distortion although their files do not state it. transfer: of 8-bit files; see `Developing`, as developing.

    `InputError` if the numbers or names of photographs, lamps and masks differ, sizes differ from the camera's, the
    EXIF of the files contradict each other, only some of the photographs are undistorted, or the lamps are behind the
    object.
    """
    if transfer is not None:
        developing = replace(developing, transfer=transfer)
    asked = session(
        photographs, lamps, camera, response, masks, spectrum=spectrum, intensity=intensity, undistorted=undistorted,
        developing=developing,
    )  # fmt: skip
    taken, seen = [], Thumbnails()
    for number, shot in enumerate(asked.shots()):
        if not taken:
            require(float(BYTES_PER_VALUE) * shot.values.size * len(asked.paths), "the photographs")
        seen.add(shot.values, shot.valid)
        own = asked.own_mask(number, shot.valid.shape)
        taken.append(shot.photograph(shot.valid if own is None else shot.valid & own))
    found = asked.found_mask(seen, taken[0].mask.shape)
    if found is not None:
        taken = [replace(photograph, mask=photograph.mask & found) for photograph in taken]
    return Capture(tuple(taken), name, assumptions=asked.assumptions)


def _as_stated(lamp: Lamp, spectrum: Spectrum | str | Path | None, intensity: float | Sequence[float] | None) -> Lamp:
    if spectrum is not None:
        lamp = replace(lamp, spectrum=Spectrum.load(str(spectrum) if isinstance(spectrum, Path) else spectrum))
    return lamp if intensity is None else replace(lamp, intensity=np.squeeze(np.asarray(intensity, np.float64)))


def _check_readable(path: Path) -> None:
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
