"""`hagoromo calibrate lamps` end to end on simulated photographs, and what it refuses, in one line each."""

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.camera.camera import Camera
from hagoromo.files.png import write_png
from hagoromo.files.record import read_json, write_json
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.transforms import lamp_from_record
from tests.inverse.simulated_mirror import (
    degrees_between,
    mask_of,
    mirror_photograph,
    seen_from_afar,
    seen_through,
    unit,
)

LENS = {"w": 331, "h": 223, "fl_x": 450.0, "fl_y": 450.0, "cx": 165.0, "cy": 112.0, "k1": 0.0, "k2": 0.0, "p1": 0.0}
CAMERA = Camera(331, 223, (450.0, 450.0), (165.0, 112.0))
RADIUS, PLACES = 0.08, [np.array([-0.22, 0.02, 1.0]), np.array([0.24, -0.03, 1.1])]  # m, camera's axes
LAMPS = [np.array([0.3, -0.5, 0.1]), np.array([-0.6, -0.2, 0.0])]  # m


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """A folder with photographs of two balls, of each alone, of one from afar, and their masks."""
    folder = tmp_path_factory.mktemp("balls")
    balls = [seen_through(CAMERA, place, RADIUS) for place in PLACES]
    afar = seen_from_afar((223, 331), (160.4, 108.3), 83.2)
    for k, lamp in enumerate(LAMPS):
        write_png(folder / f"both{k}.png", mirror_photograph(balls, lamp, k, 0.06, position=True))
        for i, ball in enumerate(balls):
            write_png(folder / f"place{i}.{k}.png", mirror_photograph([ball], lamp, 5 + k, 0.06, position=True))
    for i, ball in enumerate(balls):
        write_png(folder / f"mask{i}.png", mask_of(ball))
    write_png(folder / "masks.png", np.maximum(mask_of(balls[0]), mask_of(balls[1])))
    write_png(folder / "afar.png", mask_of(afar))
    short = mirror_photograph([afar], (0.3, 0.4, 0.87), 9, 0.1, light=0.8, glow=0.0, white=65535)
    write_png(folder / "short.png", np.repeat(short[..., None], 3, axis=2) // np.array([1, 2, 4], np.uint16))
    write_png(folder / "long.png", mirror_photograph([afar], (0.3, 0.4, 0.87), 9, 0.1))
    write_png(folder / "blurred.png", mirror_photograph([afar], (0.3, 0.4, 0.87), 9, 0.1, blur=5.0))
    write_json(folder / "camera.json", {**LENS, "p2": 0.0})
    return folder


def calibrate(folder, out, photographs, masks, *options):
    arguments = [folder / name for name in photographs]
    for mask in masks:
        arguments += ["--mask", folder / mask]
    assert main(["calibrate", "lamps", *map(str, [*arguments, "--out", out, *options])]) == 0
    record = read_json(out)
    return record, [lamp_from_record(lamp, folder, "lamps.json") for lamp in record["lamps"]]


@pytest.mark.nightly
@pytest.mark.by_night("two balls")
@pytest.mark.parametrize("way", ["two balls", "a moved ball"])
def test_near_lamps_are_written_as_a_capture_lists_them(shot, tmp_path, capsys, way):
    """Lamps 1.1 m away, balls of 36 px: 2 cm is 0.4° of parallax."""
    both = way == "two balls"
    photographs = ["both0.png", "both1.png"] if both else [f"place{i}.{k}.png" for i in (0, 1) for k in (0, 1)]
    options = ["--radius", RADIUS, "--camera", shot / "camera.json", *([] if both else ["--moved"])]
    record, lamps = calibrate(shot, tmp_path / "lamps.json", photographs, ["mask0.png", "mask1.png"], *options)
    said = capsys.readouterr().out
    for k, (lamp, truth) in enumerate(zip(lamps, LAMPS, strict=True)):
        assert isinstance(lamp, Lamp) and lamp.position is not None
        assert np.linalg.norm(lamp.position - truth) < 0.02
        assert f"{photographs[k]}: position (" in said
    assert len(record["balls"]) == 2 and record["spread"] is None and "2 lamps do not determine normals" in said


def test_strength_and_colour_are_written(shot, tmp_path, capsys):
    """The channels' strengths stand as 4 : 2 : 1, to 1 %."""
    record, (lamp,) = calibrate(shot, tmp_path / "lamps.json", ["short.png"], ["afar.png"], "--mirror", "1")
    np.testing.assert_allclose(np.array(lamp.intensity) / np.max(lamp.intensity), [1, 0.5, 0.25], rtol=0.01)
    assert degrees_between(lamp.to_lamp, (0.3, 0.4, 0.87)) < 0.3
    assert record["readings"][0]["intensity_from"] == "highlight" and "by the highlight" in capsys.readouterr().out


def test_what_tells_no_lamp_is_refused_in_a_line(shot, refused, tmp_path):
    near = ("--camera", shot / "camera.json", "--radius", "0.08")
    two = ("--mask", shot / "mask0.png", "--mask", shot / "mask1.png")
    afar = ("--mask", shot / "afar.png")
    for photographs, options, said in [
        (["both0.png"], (), "no mask (--mask) of a chrome ball"),
        (["both0.png"], two, "give their radius (--radius) [m] and a calibrated camera (--camera)"),
        (
            ["both0.png"],
            ("--mask", shot / "masks.png"),
            "the mask shows 2 white parts: give one mask (--mask) per ball",
        ),
        (["both0.png"], ("--mask", shot / "mask0.png", "--mask", shot / "mask0.png", *near), "two masks show one ball"),
        (["both0.png", "both1.png", "place0.0.png"], (*two, *near, "--moved"), "given 2 masks and 3 photographs"),
        (["both0.png", "both0.png"], (*two, *near), "a photograph is given twice"),
        (["long.png"], (*afar, "--mirror", "0.6"), "8 bits, which are rarely linear"),
        (["long.png"], (*afar, "--mirror", "0.6", "--transfer", "linear"), "long.png: the highlight is clipped in"),
        (["short.png"], (*afar, "--mirror", "60"), "short.png: the ball's reflectance is"),
        (["blurred.png"], afar, "out of focus: its edge is blurred by"),
        (["long.png"], (*afar, "--reference", shot / "afar.png"), "--reflectance go together"),
        (["long.png", "both9.png"], afar, "does not exist"),
    ]:
        paths = [shot / name for name in photographs]
        assert said in refused("calibrate", "lamps", *paths, *options, "--out", tmp_path / "lamps.json"), said


def test_an_object_tells_its_lamps_without_a_ball(tmp_path, capsys, refused):
    """A matte ball under six lamps, 16 bits; 4° as it is small. What no ball needs is refused beside it."""
    row, column = np.mgrid[:101, :113] + 0.5
    x, y = (column - 56) / 47, -(row - 50) / 47
    normal = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    turn = np.arange(6) * np.pi / 3
    lamps = unit(np.stack([np.cos(turn) + 0.2, np.sin(turn) + 0.1, np.full(6, 1.3)], axis=-1))
    on, random = x**2 + y**2 < 0.97, np.random.default_rng(4)
    for k, lamp in enumerate(lamps):
        light = np.where(on, 0.7 * np.maximum(normal @ lamp, 0) + random.normal(0, 0.003, on.shape), 0)
        numbers = np.rint(65535 * np.clip(light, 0, 1)).astype(np.uint16)
        write_png(tmp_path / f"{k}.png", np.repeat(numbers[..., None], 3, axis=2))
    write_png(tmp_path / "object.png", np.where(on, 255, 0).astype(np.uint8))
    paths = [str(tmp_path / f"{k}.png") for k in range(6)]
    out, mask = str(tmp_path / "lamps.json"), str(tmp_path / "object.png")
    assert main(["calibrate", "lamps", *paths, "--object", mask, "--out", out]) == 0
    assert "assumed convex" in capsys.readouterr().out
    found = [lamp_from_record(lamp, tmp_path, "lamps.json") for lamp in read_json(out)["lamps"]]
    assert degrees_between([lamp.to_lamp for lamp in found], lamps).max() < 4
    again = ("--out", tmp_path / "b.json", "--object", mask)
    assert "--object replaces" in refused("calibrate", "lamps", *paths, *again, "--mask", mask)
    assert "3 photographs do not calibrate" in refused("calibrate", "lamps", *paths[:3], *again)
