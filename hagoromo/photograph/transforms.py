"""The records that a capture's `transforms.json` has beside nerfstudio's, each to its noun and back: sensor, lamp.

The cameras are read by `hagoromo.camera.formats.nerfstudio`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hagoromo.camera.response import Response
from hagoromo.camera.sensor import MOSAICS, Sensor
from hagoromo.errors import InputError
from hagoromo.files.record import anything, count, inside, number, numbers, one_of, positive, take, text
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum

SENSOR = {
    **dict.fromkeys(("exposure", "full_well", "gain", "white_level"), (positive, None)),
    **dict.fromkeys(("read_noise", "black_level"), (number, None)),
    "bits": (count, None),
    "mosaic": (one_of(*MOSAICS), ""),
    "response": (text, None),
}
LAMP = {
    "position": (numbers(3), None),
    "to_lamp": (numbers(3), None),
    "intensity": (lambda value: number(value) if not isinstance(value, list) else numbers()(value), 1.0),
    "spectrum": (anything, 1.0),
    "name": (text, ""),
    "axis": (numbers(3), None),
    "axis_power": (number, 1.0),
}
# What a sensor is taken for where its file does not say: both are usual for a consumer camera at ISO 100.
ASSUMED_FULL_WELL = 20_000.0  # electrons at white level
ASSUMED_READ_NOISE = 10.0  # electrons


def sensor_from_record(record: Mapping[str, Any], depth: int, exposure_s: float, iso: float, where: str) -> Sensor:
    """Sensor of a frame. `gain` [e⁻/DN] is that at ISO 100; `exposure` [e⁻ per unit of ρ] that of one second.

    depth: bits of the image file. Without `exposure` one unit of value is white level after 1 s at ISO 100; without
    `gain` and `read_noise` the sensor is taken for one of ASSUMED_FULL_WELL and ASSUMED_READ_NOISE.
    """
    k = take(record, SENSOR, f"{where}: sensor")
    bits, black = k["bits"] or depth, k["black_level"] or 0.0
    span = (k["white_level"] or 2.0**bits - 1.0) - black
    if span <= 0.0:
        raise InputError(f"{where}: the white level {span + black:g} is not above the black level {black:g}")
    gain = k["gain"] or ASSUMED_FULL_WELL / span
    return Sensor(
        exposure=(k["exposure"] or span * gain) * exposure_s,
        full_well=k["full_well"] or span * gain * 100.0 / iso,
        read_noise=ASSUMED_READ_NOISE if k["read_noise"] is None else k["read_noise"],
        gain=gain * 100.0 / iso,
        black_level=black,
        bits=bits,
        mosaic=k["mosaic"],
    )


def record_from_sensor(sensor: Sensor) -> dict[str, Any]:
    """The figures of a sensor, at ISO 100 and one second."""
    return {
        "exposure": sensor.exposure,
        "full_well": sensor.full_well,
        "read_noise": sensor.read_noise,
        "gain": sensor.gain,
        "black_level": sensor.black_level,
        "white_level": sensor.white_level,
        "bits": sensor.bits,
        "mosaic": sensor.mosaic,
    }


def response_from_record(record: Mapping[str, Any], folder: Path, where: str) -> Response | None:
    """The response that the sensor's record names: a CSV in `folder` or a known camera."""
    source = take(record, SENSOR, f"{where}: sensor")["response"]
    if source is None:
        return None
    return Response.load(inside(folder, source) if source.lower().endswith(".csv") else source)


def lamp_from_record(record: Any, folder: Path, where: str) -> Lamp:
    """Lamp of the top-level list; its spectrum as `Spectrum.load` takes it."""
    k = take(record, LAMP, where)
    try:
        spectrum = Spectrum.load(k["spectrum"], folder)
        place = k["position"], k["to_lamp"]
        return Lamp(*place, k["intensity"], spectrum, k["name"], k["axis"], k["axis_power"])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def record_from_lamp(lamp: Lamp) -> dict[str, Any]:
    """What `lamp_from_record` reads back."""
    place = {"to_lamp": lamp.to_lamp} if lamp.position is None else {"position": lamp.position}
    return {
        **{key: None if vector is None else vector.tolist() for key, vector in place.items()},
        "intensity": list(lamp.intensity) if isinstance(lamp.intensity, tuple) else lamp.intensity,
        "spectrum": lamp.spectrum.record(),
        "name": lamp.name,
        **({} if lamp.axis is None else {"axis": lamp.axis.tolist(), "axis_power": lamp.axis_power}),
    }


def lamps_of_frame(frame: Mapping[str, Any], lamps: Sequence[Lamp], where: str) -> tuple[Lamp, ...]:
    """The lamps that a frame names: `lamps`, indices into the list, and `pl_pos`, the position [m] of one more."""
    position = take(frame, {"pl_pos": (numbers(3), None)}, where, strict=False)["pl_pos"]
    indices = frame.get("lamps", [])
    if not isinstance(indices, list) or not all(type(i) is int and 0 <= i < len(lamps) for i in indices):
        raise InputError(f"{where}: lamps must be indices below {len(lamps)}, into the list of lamps: given {indices}")
    return (*(lamps[i] for i in indices), *([] if position is None else [Lamp(position)]))
