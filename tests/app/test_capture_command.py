"""hagoromo capture: photographs, lamps, camera, response and masks go together, or are refused in one line."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.camera.camera import ORTHOGRAPHIC_FOCAL
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json

HEIGHT, WIDTH = 7, 11
TO_LAMP = ((0.0, 0.3, -1.0), (0.4, -0.2, -1.0), (-0.3, 0.1, -1.0))


@pytest.fixture
def laboratory(tmp_path):
    """Three developed photographs, lamps.json in another order, camera.json of a lens with distortion, a mask."""
    random = np.random.default_rng(2)
    for name in "abc":
        values = random.uniform(0.1, 0.9, (HEIGHT, WIDTH, 3)).astype(np.float32)
        layers = {key: values[..., k] for k, key in enumerate("RGB")}
        write_exr(tmp_path / f"{name}.exr", layers, {"undistorted": "true"})
    lamps = [{"name": f"{n}.png", "to_lamp": list(to)} for n, to in zip("cab", TO_LAMP, strict=True)]
    write_json(tmp_path / "lamps.json", {"lamps": lamps})
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 40.0, "fl_y": 40.0, "cx": 5.5, "cy": 3.5}
    write_json(tmp_path / "camera.json", {**lens, "k1": -0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0})
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[2:5, 3:8] = 255
    write_png(tmp_path / "mask.png", mask)
    return tmp_path


def shots(folder, names="abc"):
    return [folder / f"{name}.exr" for name in names]


def test_a_capture_has_the_lamp_of_each_name_and_an_undistorted_lens(laboratory, capsys):
    out = laboratory / "capture"
    arguments = [
        "capture", *map(str, shots(laboratory)), "--lamps", str(laboratory / "lamps.json"),
        "--camera", str(laboratory / "camera.json"), "--response", "canon_eos_300d", "--spectrum", "A",
        "--mask", str(laboratory / "mask.png"), "--intensity", "2", "--out", str(out),
    ]  # fmt: skip
    assert main(arguments) == 0
    assert "a: lamp a.png" in capsys.readouterr().out
    capture = hg.load_capture(out)
    assert (capture.name, [one.name for one in capture.photographs]) == ("capture", ["a", "b", "c"])
    for one, number in zip(capture.photographs, (1, 2, 0), strict=True):
        (lamp,) = one.lamps
        unit = np.array(TO_LAMP[number]) / np.linalg.norm(TO_LAMP[number])
        assert lamp.to_lamp is not None
        np.testing.assert_allclose(lamp.to_lamp, unit, rtol=1e-12)
        assert lamp.intensity == 2.0 and lamp.spectrum.at(650.0) > lamp.spectrum.at(450.0)
        assert one.mask.sum() == 15 and not any(one.camera.distortion)
        assert one.camera.response is not None


def test_lamps_of_other_names_belong_to_the_photographs_in_order(laboratory):
    lamps = [hg.Lamp(to_lamp=to, name=f"place {k}") for k, to in enumerate(TO_LAMP)]
    capture = hg.capture(shots(laboratory, "bca"), lamps, laboratory / "camera.json")
    assert [(one.name, one.lamps[0].name) for one in capture.photographs] == [
        ("b", "place 0"), ("c", "place 1"), ("a", "place 2"),
    ]  # fmt: skip


def test_without_a_camera_the_view_is_orthographic_and_z_points_to_the_eye(laboratory):
    lamps = [hg.Lamp(to_lamp=(x, y, -z)) for x, y, z in TO_LAMP]
    camera = hg.capture(shots(laboratory), lamps).photographs[0].camera
    np.testing.assert_allclose(
        camera.world_to_camera[2], (0.0, 0.0, -1.0, ORTHOGRAPHIC_FOCAL)
    )  # the object at the origin
    assert camera.focal[0] == ORTHOGRAPHIC_FOCAL * WIDTH and camera.orthographic


def test_what_does_not_go_together_is_refused(laboratory):
    lamps, camera = laboratory / "lamps.json", laboratory / "camera.json"
    write_exr(laboratory / "d.exr", {key: np.ones((HEIGHT, WIDTH), np.float32) for key in "RGB"})
    write_png(laboratory / "c.png", np.full((HEIGHT, WIDTH, 3), 99, np.uint8))
    write_json(laboratory / "other.json", {"w": 12, "h": 7, "fl_x": 9, "fl_y": 9, "cx": 6, "cy": 3, **ZERO})
    mask, abc = laboratory / "mask.png", shots(laboratory)
    for said, photographs, arguments, keys in [
        ("2 photographs and 3 lamps", abc[:2], (lamps, camera), {}),
        ("2 masks for 3 photographs", abc, (lamps, camera), {"masks": [mask, mask]}),
        ("is undistorted and", [*abc[:2], laboratory / "d.exr"], (lamps, camera), {}),
        ("8 bits, which are rarely linear", [*abc[:2], laboratory / "c.png"], (lamps, camera), {"undistorted": True}),
        ("11 × 7 px and its camera 12 × 7", abc, (lamps, laboratory / "other.json"), {}),
        ("every lamp is behind the object", abc, (lamps,), {}),
        ("lacks the key 'lamps'", abc, (camera, camera), {}),
    ]:
        with pytest.raises(hg.InputError, match=said):
            hg.capture(photographs, *arguments, **keys)  # pyrefly: ignore[no-matching-overload]


ZERO = dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)


def test_a_development_is_read_back_as_it_was_saved(tmp_path):
    random = np.random.default_rng(7)
    numbers = random.integers(300, 3000, (40, 52)).astype(np.uint16)
    write_png(tmp_path / "shot.png", numbers)
    developed = hg.develop(
        tmp_path / "shot.png",
        mosaic="RGGB",
        black=128,
        white=4000,
        exposures_s=[0.1],
        iso=100,
        gain=2.0,
        read_noise=3.0,
    )
    developed.save(tmp_path / "shot.exr")
    again = hg.Development.load(tmp_path / "shot.exr")
    for key in ("values", "variance", "valid", "native"):
        np.testing.assert_array_equal(getattr(again, key), getattr(developed, key))
    assert again.record() == developed.record()
    with pytest.raises(hg.InputError, match="exists"):
        developed.save(tmp_path / "shot.exr")
    with pytest.raises(hg.InputError, match="not a developed photograph"):
        write_exr(tmp_path / "other.exr", {"R": np.ones((5, 7), np.float32)})
        hg.Development.load(tmp_path / "other.exr")


def test_a_calibrated_camera_is_read_back_without_its_corners(tmp_path):
    camera = hg.Camera(WIDTH, HEIGHT, (40.0, 41.0), (5.5, 3.4), (-0.1, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0))
    found = hg.CameraCalibration(camera, {"fl_x": 0.2}, 0.07, {"a.png": 0.06}, ("b.png",), (), {}, {})
    again = hg.CameraCalibration.load(found.save(tmp_path / "camera.json"))
    assert again.record() == found.record() and "rms 0.070 px" in repr(again)


def test_a_folder_stands_for_its_photographs_and_the_list_of_lamps_in_it(laboratory, capsys):
    """Files of another format, and camera.json, are no photographs; two lists of lamps are refused."""
    given = ["capture", str(laboratory), "--camera", str(laboratory / "camera.json")]
    assert main([*given, "--out", str(laboratory / "capture")]) == 0
    assert "a: lamp a.png" in capsys.readouterr().out
    assert [one.name for one in hg.load_capture(laboratory / "capture").photographs] == ["a", "b", "c"]
    (laboratory / "dome.lp").touch()
    assert main([*given, "--out", str(laboratory / "other")]) == 2
    assert "dome.lp and lamps.json: say which" in capsys.readouterr().err
