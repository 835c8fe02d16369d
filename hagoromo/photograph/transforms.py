"""Records of a capture's `transforms.json` (sensors, lamps, frames), and their conversion to objects and back.

`hagoromo.camera.formats.nerfstudio` reads the cameras.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from hagoromo.camera.formats.nerfstudio import ViewRecord
from hagoromo.camera.response import Response
from hagoromo.camera.sensor import MOSAICS, Sensor
from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.record import Positive, Record, Vector, WrittenBy, about, decode, from_to, like, one_of
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_profile import PROFILE, LampProfile
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.photograph.variance_model import VarianceRecord

# Assumed where a file does not describe the sensor: typical of a consumer camera at ISO 100.
ASSUMED_FULL_WELL = 20_000.0  # electrons at white level
ASSUMED_READ_NOISE = 10.0  # electrons
LAMP_INDICES = Meta(extra_json_schema={"type": "array", "items": {"type": "integer", "minimum": 0}})


class SensorRecord(Record, frozen=True, kw_only=True):
    """A sensor at ISO 100 and an exposure of one second."""

    exposure: Annotated[Positive | None, about("electrons per unit of value, after 1 s [e⁻]")] = None
    full_well: Annotated[Positive | None, about("electrons that a pixel holds [e⁻]")] = None
    gain: Annotated[Positive | None, about("electrons per digital number [e⁻/DN]")] = None
    read_noise: Annotated[float | None, about("standard deviation of the read noise [e⁻]")] = None
    black_level: Annotated[float | None, about("digital number of no light [DN]")] = None
    white_level: Annotated[Positive | None, about("digital number of saturation [DN]")] = None
    bits: Annotated[
        Annotated[int, from_to(1, 16)] | None,
        about("bits of a digital number, 1 to 16; default: those of the image file"),
    ] = None
    mosaic: Annotated[str, one_of(*MOSAICS), about("colours of the first 2 × 2 pixels by rows; empty: no mosaic")] = ""
    response: Annotated[str | None, about("spectral response: a CSV file in the capture, or a known camera")] = None


class LampRecord(Record, frozen=True, kw_only=True):
    """A lamp: either near (`position`) or far (`to_lamp`)."""

    position: Annotated[Vector | None, about("position of a near lamp, world axes [m]")] = None
    to_lamp: Annotated[Vector | None, about("direction from the scene towards a far lamp, world axes")] = None
    intensity: Annotated[
        float | tuple[float, ...],
        about(
            "one number, or one per sensor channel; near: irradiance × m² [W/sr times the unit of the spectrum]; "
            "far: irradiance on a plane that faces the lamp"
        ),
    ] = 1.0
    spectrum: Annotated[
        Any, SOURCE, about("relative spectrum: a name such as D65, a CSV file, a number or a table")
    ] = 1.0
    name: Annotated[str, about("name of the lamp")] = ""
    axis: Annotated[
        Vector | None,
        about("direction in which a near lamp is brightest, or of γ = 0 of its profile (default: down), world axes"),
    ] = None
    axis_power: Annotated[float, about("exponent μ of the fall-off cosᵘ from the axis; 1: a bare LED")] = 1.0
    profile: Annotated[
        Any, PROFILE, about("intensity of a near lamp over the direction: an IES file in the folder, or a table")
    ] = None
    roll_deg: Annotated[float, about("angle by which C = 0 of the profile is turned about the axis [°]")] = 0.0
    candela_from_profile: Annotated[
        bool,
        about("whether the intensity is a factor on the candela of the profile; else that of its brightest direction"),
    ] = False


class ImageSettings(ViewRecord, frozen=True, kw_only=True):
    """Settings of the image of a frame, and nerfstudio's keys of its camera."""

    sensor: Annotated[dict[str, Any], like(SensorRecord), about("the sensor; a frame's keys over the file's")] = {}
    transfer: Annotated[str, one_of("linear", "srgb"), about("curve of PNG, TIFF and JPEG values")] = "linear"
    exposure_s: Annotated[Positive | None, about("exposure time [s]; default: as a RAW file says, else 1")] = None
    iso: Annotated[Positive | None, about("sensitivity, ISO; default: as a RAW file says, else 100")] = None
    mask_path: Annotated[str | None, about("PNG in the capture that is black where a pixel is invalid")] = None
    variance_model: Annotated[
        dict[str, Any] | None,
        like(VarianceRecord),
        about("variance of the values of an EXR as a curve over the value, in place of its channels of variance"),
    ] = None


class FrameRecord(ImageSettings, frozen=True, kw_only=True):
    """One photograph of a capture; keys that all frames share may stand at the top of the file."""

    file_path: Annotated[str, about("image file in the capture; NeRF's files leave its suffix out")]
    name: Annotated[str | None, about("name of the photograph; default: that of its file")] = None
    lamps: Annotated[
        Any, LAMP_INDICES, about("the lamps that were on: indices into the file's list of lamps, from 0")
    ] = ()
    pl_pos: Annotated[Vector | None, about("position of one more lamp, world axes [m]")] = None


class CaptureRecord(ImageSettings, frozen=True, kw_only=True):
    """transforms.json: the photographs of a capture, readable by nerfstudio and instant-ngp."""

    version_key = "hagoromo.format_version"

    frames: Annotated[list[Annotated[dict[str, Any], like(FrameRecord)]], about("the photographs")]
    name: Annotated[str | None, about("name of the capture; default: that of its folder")] = None
    lamps: Annotated[list[Annotated[dict[str, Any], like(LampRecord)]], about("the lamps that frames name")] = []
    truth: Annotated[dict[str, Any] | None, about("what a simulation knows: its scene")] = None
    assumptions: Annotated[
        dict[str, str], about("what the capture takes for given (transfer, camera, mask, lamps, …), and from where")
    ] = {}
    points_path: Annotated[str | None, about("EXR with channels P.X P.Y P.Z: world point of each pixel [m]")] = None
    normals_path: Annotated[str | None, about("EXR with channels N.X N.Y N.Z: unit normal, world axes, 0: none")] = None
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


def sensor_from_record(record: Mapping[str, Any], depth: int, exposure_s: float, iso: float, where: str) -> Sensor:
    """Sensor of a frame; in the record, `gain` [e⁻/DN] is at ISO 100 and `exposure` [e⁻ per unit of ρ] at one second.

    depth: bits of the image file. Without `exposure`, the value 1 is the white level after 1 s at ISO 100; without
    `gain` and `read_noise`, ASSUMED_FULL_WELL and ASSUMED_READ_NOISE are used.
    """
    stated = decode(record, SensorRecord, f"{where}: sensor")
    bits, black = stated.bits or depth, stated.black_level or 0.0
    span = (stated.white_level or 2.0**bits - 1.0) - black
    if span <= 0.0:
        raise InputError(f"{where}: the white level {span + black:g} is not above the black level {black:g}")
    gain = stated.gain or ASSUMED_FULL_WELL / span
    return Sensor(
        exposure=(stated.exposure or span * gain) * exposure_s,
        full_well=stated.full_well or span * gain * 100.0 / iso,
        read_noise=ASSUMED_READ_NOISE if stated.read_noise is None else stated.read_noise,
        gain=gain * 100.0 / iso,
        black_level=black,
        bits=bits,
        mosaic=stated.mosaic,
    )


def record_from_sensor(sensor: Sensor) -> dict[str, Any]:
    """Parameters of a sensor, at ISO 100 and one second."""
    names = ("exposure", "full_well", "read_noise", "gain", "black_level", "white_level", "bits", "mosaic")
    return {name: getattr(sensor, name) for name in names}


def response_from_record(record: Mapping[str, Any], folder: Path, where: str) -> Response | None:
    """The response that a sensor's record names: a CSV in `folder` or a known camera."""
    source = decode(record, SensorRecord, f"{where}: sensor").response
    if source is None:
        return None
    return Response.load(inside(folder, source) if source.lower().endswith(".csv") else source)


def lamp_from_record(record: Any, folder: Path, where: str) -> Lamp:
    """Lamp of the top-level list; its spectrum is any source that `Spectrum.load` reads."""
    lamp = decode(record, LampRecord, where)
    with described(where):
        spectrum = Spectrum.load(lamp.spectrum, folder)
        profile = None if lamp.profile is None else LampProfile.load(lamp.profile, folder)
        intensity = lamp.intensity
        if lamp.candela_from_profile:
            if profile is None or isinstance(intensity, tuple):
                raise InputError("candela_from_profile needs a profile, and one number as intensity")
            intensity *= profile.intensity_of(spectrum)
        turn = math.radians(lamp.roll_deg)
        return Lamp(
            lamp.position, lamp.to_lamp, intensity, spectrum, lamp.name, lamp.axis, lamp.axis_power, profile, turn
        )


def record_from_lamp(lamp: Lamp) -> dict[str, Any]:
    """Record of a lamp, the inverse of `lamp_from_record`."""
    return {
        lamp.place_key: lamp.place.tolist(),
        "intensity": list(lamp.intensity) if isinstance(lamp.intensity, tuple) else lamp.intensity,
        "spectrum": lamp.spectrum.record(),
        "name": lamp.name,
        **lamp.beam.record(),
    }


def lamps_of_frame(frame: FrameRecord, lamps: Sequence[Lamp], where: str) -> tuple[Lamp, ...]:
    """The lamps that a frame names: `lamps`, indices into the list, and `pl_pos`, the position [m] of one more."""
    indices = frame.lamps
    if not isinstance(indices, (list, tuple)) or not all(type(i) is int and 0 <= i < len(lamps) for i in indices):
        raise InputError(f"{where}: lamps must be indices below {len(lamps)}, into the list of lamps: given {indices}")
    return (*(lamps[i] for i in indices), *([] if frame.pl_pos is None else [Lamp(frame.pl_pos)]))
