"""What goes wrong in a laboratory is said in one line: boards, lamps, a bent response, a tripod that was pushed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.files.png import write_png
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.capture import Capture, save_capture
from tests.inverse.simulated_bracket import FULL, SENSOR, numbers, scene, write_dng
from tests.inverse.test_calibrate_camera import BOARD, TRUE, photographs_of
from tests.inverse.test_stillness import CAMERA, moved_by, photograph, relief

BY = (3.0, -2.0)  # px


def lamp(k: int, tilt: float = math.pi / 4) -> Lamp:
    """The lamp of `relief(k)`, 45° from the line of sight, in the camera's axes; other tilts stand elsewhere."""
    angle = 2 * math.pi * k / 7
    away = math.sin(tilt)
    return Lamp(to_lamp=(-away * math.cos(angle), -away * math.sin(angle), -math.cos(tilt)), intensity=1.0, name=f"{k}")


def capture_of(*photographs) -> Capture:
    return Capture(tuple(replace(one, camera=CAMERA) for one in photographs), "relief")


def lit(k: int):
    return replace(photograph(relief(k), k), lamps=(lamp(k),))


def test_boards_that_tell_no_camera_are_refused(refused, tmp_path):
    flat = photographs_of(TRUE, BOARD, [(0, 0, -0.25), (0.002, 0, -0.22), (0, 0.002, -0.28)])
    for name, picture in flat.items():
        write_png(tmp_path / f"{name}.png", picture)
    write_png(tmp_path / "blank.png", np.full((TRUE.height, TRUE.width), 200, np.uint8))
    paths, out = sorted(tmp_path.glob("?.png")), ("--out", tmp_path / "camera.json", "--square", "0.02")
    assert "tilt the board more" in refused("calibrate", "camera", *paths, *out, "--board", "7x5")
    said = refused("calibrate", "camera", *paths, tmp_path / "blank.png", *out, "--board", "8x6")
    assert "a board of 8x6 inner corners was found in 0 of 4 photographs" in said and "check board" in said
    said = refused("calibrate", "camera", *paths[:2], tmp_path / "blank.png", *out, "--board", "7x5")
    assert "was found in 2 of 3 photographs and 3 are needed" in said


def test_a_bracket_through_a_bent_response_is_refused(refused, tmp_path):
    """The power is told: raw numbers that went through a display's curve."""
    light, paths = scene(1), []
    for k, seconds in enumerate((0.05, 0.2)):
        raw, black = numbers(light, seconds, k).astype(float), SENSOR.black_level
        share = np.clip((raw - black) / (FULL - black), 0.0, 1.0)
        paths.append(tmp_path / f"{k}.dng")
        write_dng(paths[-1], np.rint(black + (FULL - black) * share**0.45).astype(np.uint16), seconds)
    said = refused("develop", *paths, "--out", tmp_path / "o.exr")
    assert "the response is not linear" in said and "power 0.4" in said and "--transfer" in said


@pytest.mark.parametrize("verb", ["measure", "relight"])
def test_too_few_lamps_are_refused(refused, tmp_path, verb):
    """Three; of four with one kept aside three are left."""
    count = 3 if verb == "measure" else 4
    save_capture(capture_of(*(lit(k) for k in range(count))), tmp_path / "capture")
    said = refused(verb, tmp_path / "capture", "--out", tmp_path / "out", "--distance", "1")
    assert "3 photographs do not determine normals: give 4 lamps or more" in said


def test_lamps_in_one_plane_with_the_scene_are_refused(refused, tmp_path):
    row = [replace(lit(k), lamps=(lamp(0, 0.2 * k - 0.4),)) for k in range(5)]
    save_capture(capture_of(*row), tmp_path / "capture")
    said = refused("measure", tmp_path / "capture", "--out", tmp_path / "out", "--distance", "1")
    assert "lie in one plane with the scene: move one out of it" in said


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")  # it is shown, not raised
def test_a_photograph_that_moved_is_told_by_how_much(tmp_path, capsys):
    """The measurement goes on, as the others may do; to 0.5 px."""
    shots = [lit(k) for k in range(6)]
    save_capture(capture_of(*shots[:5], moved_by(shots[5], *BY)), tmp_path / "capture")
    assert main(["measure", str(tmp_path / "capture"), "--out", str(tmp_path / "out"), "--distance", "1"]) == 0
    (said,) = [line for line in capsys.readouterr().err.splitlines() if "is shifted by" in line]
    assert said.startswith("hagoromo: warning: 5 is shifted by (")
    x, y = (float(number) for number in said.split("(")[1].split(")")[0].split(","))
    assert abs(x - BY[0]) < 0.5 and abs(y - BY[1]) < 0.5
