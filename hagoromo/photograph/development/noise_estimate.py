"""Noise estimate: gain and read noise of one sensor from all its frames together.

Frames of one scene in one light, a bracket or flats, are compared in pairs, each with the next longer one; darks with
each other. Where no two frames show one scene, each is taken by itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

from hagoromo.errors import InputError
from hagoromo.photograph.development.bloom import without_bloom
from hagoromo.photograph.development.exposure import Exposure
from hagoromo.photograph.development.frame_pairs import one_scene, pair_rows
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.photon_transfer import Row, noise_of_rows
from hagoromo.photograph.development.single_frames import frame_rows
from hagoromo.photograph.transforms import ASSUMED_FULL_WELL, ASSUMED_READ_NOISE

LIT = 5.0  # least signal of samples that have light [standard deviations]
PAIRS, SINGLE = "pairs of frames", "single frames (strong texture adds to it)"


def usual_noise(exposure: Exposure) -> Noise:
    """The noise of a typical sensor."""
    return Noise(ASSUMED_FULL_WELL / exposure.white, ASSUMED_READ_NOISE, source="a usual sensor: assumed")


def estimated_noise(
    scenes: Sequence[Sequence[Exposure]], others: Sequence[Exposure] = (), darks: Sequence[Exposure] = ()
) -> tuple[Noise, str]:
    """Noise of the camera of all frames, and why it is not known, where it is not, else "".

    scenes: frames that show one scene in one light each, such as a bracket, or flats. others: frames of any scenes;
    which of them show one is looked for. What a typical sensor has takes part where frames say little, or is all.
    """
    others = [without_bloom(frame, across=True) for frame in others]
    lit = [pair for scene in scenes for pair in successive(scene)] + pairs_of(others)
    dark = [(one, other) for one, other in successive(darks) if one.seconds == other.seconds]
    frames = [frame for scene in (*scenes, others) for frame in scene]
    try:
        found = noise_from_pairs([*lit, *dark]) if lit else noise_from_frames(frames)
    except InputError as error:
        return usual_noise(frames[0]), f"{error}; the noise of a typical sensor is assumed"
    if found.determined:
        return found, ""
    low, high = found.gain_interval
    why = (
        f"the frames hardly determine the noise of the sensor (gain {low:.3g} to {high:.3g} e⁻/DN): state gain and "
        "read_noise (--gain, --read-noise), or give further frames of this camera (--noise-from)"
    )
    return replace(found, source=f"{found.source}, and what is usual of sensors"), why


def noise_from_pairs(pairs: Sequence[tuple[Exposure, Exposure]]) -> Noise:
    """Gain and read noise from pairs of frames of one scene, of equal or rising exposure: flats, darks, a bracket.

    Together with what is usual of sensors where the pairs say little: see `Noise.determined`. `InputError` if they
    share no light.
    """
    rows = [row for number, (one, other) in enumerate(pairs) for row in pair_rows(one, other, number)]
    if not any(_lit(row) for row in rows):
        raise InputError("two exposures share no signal above black: state gain and read_noise (--gain, --read-noise)")
    frames = len({id(frame) for pair in pairs for frame in pair})
    return noise_of_rows(rows, usual_noise(pairs[0][0]), PAIRS if frames == 2 else f"{PAIRS}, {frames} of them")


def noise_from_frames(frames: Sequence[Exposure]) -> Noise:
    """Gain and read noise from single frames; `InputError` if they do not determine the gain."""
    found = noise_of_rows(frame_rows(frames), usual_noise(frames[0]), SINGLE)
    if not found.determined:
        raise InputError(
            "the frames' noise does not grow with their signal: state gain and read_noise (--gain, --read-noise)"
        )
    return found


def scenes_of(frames: Iterable[Exposure]) -> list[list[Exposure]]:
    """The frames by the scene and light that they show; one that shows none of the others' is alone."""
    scenes: list[list[Exposure]] = []
    for frame in frames:
        same = next((scene for scene in reversed(scenes) if _shows(scene, frame)), None)
        if same is None:
            scenes.append([frame])
        else:
            same.append(frame)
    return scenes


def pairs_of(frames: Iterable[Exposure]) -> list[tuple[Exposure, Exposure]]:
    """Pairs of `frames` that show one scene in one light, each frame with the next brighter one."""
    return [pair for scene in scenes_of(frames) for pair in successive(scene)]


def successive(scene: Sequence[Exposure]) -> list[tuple[Exposure, Exposure]]:
    """Each frame of one scene with the next brighter one."""
    return list(pairwise(sorted(scene, key=_brightness)))


def _shows(scene: Sequence[Exposure], frame: Exposure) -> bool:
    """Whether `frame` shows the scene of the last frame of `scene`, or of the first."""
    return any(
        one_scene(*_by_light(other, frame)) for other in {id(one): one for one in (scene[-1], scene[0])}.values()
    )


def _by_light(one: Exposure, other: Exposure) -> tuple[Exposure, Exposure]:
    """Both, the darker one first."""
    return (one, other) if _brightness(one) <= _brightness(other) else (other, one)


def _brightness(frame: Exposure) -> float:
    """What frames are sorted by: the exposure time, or the light where that is not stated."""
    return frame.seconds if frame.exif.exposure_s is not None else float(frame.signal.mean())


def _lit(row: Row) -> bool:
    """Whether a row has light: more signal than the means of eight neighbours have by noise, by which it is chosen."""
    return row.shot > LIT * (row.variance / 8.0) ** 0.5
