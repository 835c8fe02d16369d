"""Records of [motion] in a scene file: keyframes of what moves in a film."""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import NotNegative, Positive, Record, Vector, about, like, one_of, up_to
from hagoromo.light.spectrum import SOURCE

MOST_KEYS = 10_000
RATE, MOST_RATE = 24.0, 240.0  # frames a second


class CameraKey(Record, frozen=True, kw_only=True):
    """The camera at a time; what a keyframe leaves out moves on as the others say."""

    time: Annotated[NotNegative, about("from the beginning of the film [s]")]
    eye: Annotated[Vector | None, about("position of the camera, world axes [m]")] = None
    target: Annotated[Vector | None, about("point that the camera looks at, world axes [m]")] = None
    up: Annotated[Vector | None, about("direction that is up in the image, world axes")] = None


class LampKey(Record, frozen=True, kw_only=True):
    """A lamp at a time."""

    lamp: Annotated[str | int, about("name of the lamp, or its number from 0")]
    time: Annotated[NotNegative, about("from the beginning of the film [s]")]
    position: Annotated[Vector | None, about("position of a near lamp, world axes [m]")] = None
    to_lamp: Annotated[Vector | None, about("direction towards a far lamp, world axes")] = None
    intensity: Annotated[NotNegative | None, about("as that of the lamp")] = None
    spectrum: Annotated[Any, SOURCE, about("relative spectrum; between two times a mixture of both")] = None


class BoxKey(Record, frozen=True, kw_only=True):
    """A volume box at a time."""

    box: Annotated[str | int, about("name of the box in the scene, or its number from 0")]
    time: Annotated[NotNegative, about("from the beginning of the film [s]")]
    position: Annotated[Vector | None, about("shift, world axes [m]")] = None
    rotation_deg: Annotated[Vector | None, about("turns about x, then y, then z [°], any number of times")] = None


class SurfaceKey(Record, frozen=True, kw_only=True):
    """A surface at a time."""

    surface: Annotated[str | int, about("name of the surface in the scene, or its number from 0")]
    time: Annotated[NotNegative, about("from the beginning of the film [s]")]
    position: Annotated[Vector | None, about("shift, world axes [m]")] = None
    rotation_deg: Annotated[Vector | None, about("turns about x, then y, then z [°], any number of times")] = None


class MotionRecord(Record, frozen=True, kw_only=True):
    """How a scene moves: a film of so many seconds, and the keyframes of what moves in it."""

    seconds: Annotated[Positive | None, about("length of the film [s]; default: to the last keyframe")] = None
    frames_per_second: Annotated[float, about(f"frames a second, 1…{MOST_RATE:g}")] = RATE
    shutter_open: Annotated[
        float, about("when the shutter opens, from the time of a picture [s]; 0 of a picture that is no film's")
    ] = 0.0
    shutter_close: Annotated[
        float | None, about("when it closes [s]; default: at once. What moves meanwhile is blurred, in mode path")
    ] = None
    between: Annotated[
        str, one_of("smooth", "linear"), about("how values go from one keyframe to the next, never beyond both")
    ] = "smooth"
    camera: Annotated[list[Annotated[dict[str, Any], like(CameraKey)]], up_to(MOST_KEYS), about("of the camera")] = []
    lamp: Annotated[list[Annotated[dict[str, Any], like(LampKey)]], up_to(MOST_KEYS), about("of lamps")] = []
    box: Annotated[list[Annotated[dict[str, Any], like(BoxKey)]], up_to(MOST_KEYS), about("of volume boxes")] = []
    surface: Annotated[list[Annotated[dict[str, Any], like(SurfaceKey)]], up_to(MOST_KEYS), about("of surfaces")] = []
