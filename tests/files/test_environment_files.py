"""Environment maps are read as other programs wrote them, and what is no map of light is refused in one line."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.hdr import write_hdr
from hagoromo.image.scene.scene_file import load_scene
from tests.ball_scene import KEY, ball_scene

SKY = np.random.default_rng(1).random((16, 32, 3)).astype(np.float32) ** 8 * 40.0


def written(path):
    write_hdr(path, SKY)
    return path


def test_an_environment_is_the_same_from_both_formats(tmp_path):
    hdr = hg.Environment.from_file(written(tmp_path / "sky.hdr"))
    hg.write_exr(tmp_path / "sky.exr", {name: hdr.values[..., k] for k, name in enumerate("RGB")})
    exr = hg.Environment.from_file(tmp_path / "sky.exr", scale=3.0, visible=True)
    np.testing.assert_array_equal(exr.values, hdr.values)
    assert exr.name == "sky" and exr.scale == 3.0 and exr.visible and len(exr.parts) == 4
    hg.write_exr(tmp_path / "grey.exr", {"Y": SKY[..., 0]})
    assert len(hg.Environment.from_file(tmp_path / "grey.exr").parts) == 1


TABLES = """
[environment]
file = "sky.hdr"
scale = 2.0
spectrum = "D65"
rotation_deg = [0.0, 0.0, 90.0]
visible = true

[[area_lamp]]
name = "window"
position = [0.0, -1.0, 2.0]
edges = [[0.0, 0.5, 0.0], [0.8, 0.0, 0.0]]
radiance = 4.0

[[area_lamp]]
position = [2.0, 0.0, 2.0]
radius = 0.1
"""


@pytest.fixture
def scene(tmp_path):
    written(tmp_path / "sky.hdr")

    def path(old="", new="", lamps=(KEY,)):
        text = ball_scene((9, 7), 15.0, lamps, "cie1931") + TABLES
        assert old in text
        (tmp_path / "scene.toml").write_text(text.replace(old, new))
        return tmp_path / "scene.toml"

    return path


def test_a_scene_file_has_environment_and_area_lamps(scene):
    loaded, _ = load_scene(scene())
    sky, window, ball = loaded.environment, *loaded.area_lamps
    assert sky is not None and sky.scale == 2.0 and sky.visible and sky.values.shape == (16, 32, 3)
    np.testing.assert_allclose(sky.directions(8.0, 16.0), (0.0, 1.0, 0.0), atol=1e-12)
    assert window.name == "window" and window.normal.tolist() == [0.0, 0.0, -1.0] and ball.radius == 0.1
    record = loaded.record()
    assert record["environment"]["size"] == [32, 16] and record["area_lamps"][0]["radiance"] == 4.0
    image = hg.render(loaded, hg.Settings(samples=2, separate_lamps=True), mode="path")
    names = ("key", "window", "lamp 3", *(f"sky {c}" for c in ("white", "red", "green", "blue")))
    assert image.lamp_names == names and len(image.palette.lamps) == 7
    dark = image.with_lamps(strength=dict.fromkeys(names, 0.0) | {"sky white": 1.0})
    assert 0.0 < dark.weights.sum() < image.weights.sum()


def test_an_environment_alone_lights_a_scene(scene):
    image = hg.render(scene('spectrum = "D65"\nrotation_deg', "rotation_deg", lamps=()), mode="march")
    assert image.weights.max() > 0.0 and image.metadata["light_points"][-1]["name"] == "sky"


def test_photographs_of_a_capture_have_no_environment(scene):
    with pytest.raises(InputError, match="under one lamp each"):
        hg.simulate(scene())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sky.hdr", "none.hdr", "does not exist"),
        ("sky.hdr", "../sky.hdr", "points outside"),
        ("scale = 2.0", "scale = -1.0", "scale is -1.0"),
        ("scale = 2.0", "scale = 1e30", "make scale smaller"),
        ("radius = 0.1", "radius = 0.0", "radius"),
        ("radius = 0.1", "", "either radius"),
        ("[0.8, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "two sides with a length"),
        ("[0.8, 0.0, 0.0]", "[0.8, 0.1, 0.0]", "right angles"),
        ("radiance = 4.0", "radiance = 0.0", "radiance is 0.0"),
        ("visible = true", "visable = true", "unknown key 'visable'"),
    ],
)
def test_bad_lights_of_a_scene_are_refused(scene, old, new, said):
    with pytest.raises(InputError, match=said) as refused:
        load_scene(scene(old, new))
    assert "\n" not in str(refused.value) and "scene.toml" in str(refused.value)


def spoilt(change):
    values = SKY.copy()
    change(values)
    return values


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.ones((8, 8)), "twice as wide as high"),
        (np.ones((4, 8, 4)), "twice as wide as high"),
        (np.zeros((4, 8, 3)), "no light"),
        (spoilt(lambda v: v.__setitem__((3, 5, 1), np.nan)), "not finite in 1 values, first in row 3, column 5"),
        (spoilt(lambda v: v.__setitem__((3, 5, 1), np.inf)), "not finite"),
        (spoilt(lambda v: v.__setitem__((0, 0, 0), -1.0)), "below 0"),
        (np.broadcast_to(np.float32(1.0), (1 << 22, 1 << 23)), "GiB of memory"),
        ([["a"]], "twice as wide"),
    ],
)
def test_what_is_no_map_of_light_is_refused(values, said):
    with pytest.raises(InputError, match=said) as refused:
        hg.Environment(values)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda data: data[:-20], "cut off or damaged"),
        (lambda data: data[:40], "no picture of Radiance"),
        (lambda data: data.replace(b"-Y 16 +X 32", b"-Y 999999 +X 999999"), "too few for them"),
        (lambda data: data.replace(b"-Y 16 +X 32", b"+X 32 -Y 16"), "no picture of Radiance"),
        (lambda data: b"BM" + data, "not an EXR"),
    ],
)
def test_broken_radiance_pictures_are_refused(tmp_path, spoil, said):
    path = written(tmp_path / "sky.hdr")
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(InputError, match=said) as refused:
        hg.Environment.from_file(path)
    assert "\n" not in str(refused.value) and "sky.hdr" in str(refused.value)
