"""The study of lamps on real photographs: agreement of independent calibrations of the same lamps.

    python -m studies.lamps ../shared/data/uw_psm --out lamps_study.json

Enters: the folder of the uw_psm set (see `uw_psm`). Leaves: angles between the chrome ball as we read it, the set's two
readings, the shading of its matte ball, and what each object tells by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.calibration.lamps import matte_ball, reference_strength
from hagoromo.calibration.lamps.outline import refined
from hagoromo.calibration.lamps.uncalibrated import self_calibrate
from hagoromo.calibration.lamps.uncalibrated.calibrate_from_object import refined_lamps
from studies.command import command
from studies.real import read_directions
from studies.uw_psm import LAMPS, OBJECT_LEVEL, OBJECTS, read_lamps

Array = NDArray[np.float64]
CLIPPED_LEVEL = 250  # of 255: clipped, or nearly


def lamp_study(folder: str | Path) -> dict[str, Any]:
    """The record of the study: `readings`, mean and largest angle [°] of each pair, and `objects`.

    Of each lamp of the chrome ball: `stated_deg`, its standard error, and `from_laboratory_deg`, by what our reading
    differs from the laboratory's [°].
    """
    home = Path(folder)
    ball, lamps = read_lamps(home)
    ours = np.array([lamp.to_lamp for lamp in lamps])
    readings = {
        "chrome ball": ours,
        "laboratory": read_directions(home / "lights_from_chrome_ball_by_lab.txt"),
        "author of the repository": read_directions(home / "lights_by_repo_author.txt"),
        "matte ball": _by_shading(home, ours),
    }
    pairs = {
        f"{one} – {other}": _angles(readings[one], readings[other])
        for i, one in enumerate(readings)
        for other in list(readings)[i + 1 :]
    }
    objects = {}
    for name in OBJECTS:
        light, mask = _light(home, name), _mask(home, name) >= OBJECT_LEVEL
        shading = self_calibrate(light, mask)
        objects[name] = _beside(refined_lamps(light, mask, None, shading), ours)
        objects[name]["by_shading_alone"] = _beside(shading, ours)
    stated = [lamp.standard_error_deg for lamp in lamps]
    apart = _each(ours, readings["laboratory"]).tolist()
    return {
        "ball": ball.record(), "readings": pairs, "stated_deg": stated, "from_laboratory_deg": apart, "objects": objects
    }  # fmt: skip


def _beside(calibration: hg.SelfCalibration, ours: Array) -> dict[str, Any]:
    within = _each(calibration.to_lamp, ours)
    return {
        **_angles(calibration.to_lamp, ours),
        "stated_deg": float(calibration.standard_error_deg.mean()),
        "within_two_errors": float(np.mean(within < 2.0 * calibration.standard_error_deg)),
        "convex": calibration.convex,
    }


def _by_shading(home: Path, ours: Array) -> Array:
    """Directions by Lambert's law on the matte ball; `ours` tell only which pixels are lit."""
    numbers = [hg.read_png(home / "gray" / f"gray.{k}.png") for k in range(LAMPS)]
    ball = refined(hg.find_ball(hg.read_png(home / "gray" / "gray.mask.png")), numbers)
    matte, light = matte_ball(ball, numbers[0].shape, 0.5), _light(home, "gray")
    readings = [reference_strength(light[str(k)], matte, ours[k]).shading for k in range(LAMPS)]
    return np.array([shading[0] for shading in readings if shading is not None])


def _light(home: Path, name: str) -> Mapping[str, Array]:
    numbers = {str(k): hg.read_png(home / name / f"{name}.{k}.png").astype(np.float64) for k in range(LAMPS)}
    return {k: np.where(n < CLIPPED_LEVEL, n / 255.0, np.nan) for k, n in numbers.items()}


def _mask(home: Path, name: str) -> NDArray:
    mask = hg.read_png(home / name / f"{name}.mask.png")
    return mask.reshape(*mask.shape[:2], -1)[..., :3].max(axis=2)


def _each(one: Array, other: Array) -> Array:
    """Angles between the directions of two readings [°]."""
    cosine = np.sum(one * other, axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _angles(one: Array, other: Array) -> dict[str, float]:
    angles = _each(one, other)
    return {"mean_deg": float(angles.mean()), "largest_deg": float(angles.max())}


def main(folder: Positional[Path], out: Path, force: bool = False) -> None:
    """Compare readings of the lamps of the set in FOLDER.

    Args:
        folder: uw_psm, with a folder per object.
        out: where to write the record, JSON.
        force: replace an existing result.
    """
    with hg.whole_file(out, force) as partial:
        record = lamp_study(folder)
        hg.write_json(partial, record)
    for what, figures in {**record["readings"], **record["objects"]}.items():
        stated = f", stated {figures['stated_deg']:.1f}°" if "stated_deg" in figures else ""
        if "by_shading_alone" in figures:
            stated += f" (by shading alone {figures['by_shading_alone']['mean_deg']:.2f}°)"
        print(f"{what}: {figures['mean_deg']:.2f}° in the mean, {figures['largest_deg']:.2f}° at most{stated}")
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
