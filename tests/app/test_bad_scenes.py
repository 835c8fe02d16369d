"""Scenes that cannot be rendered are refused, and the message says why."""

import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.transport.lighting import MOST_LAMPS


def test_unknown_keys_are_named_with_the_known_ones(refused, scene, tmp_path):
    for old, new in (("intensity = 3.0", "intensty = 3.0"), ("eye =", "zoom = 2\neye =")):
        said = refused("render", scene(old, new), "--out", tmp_path / "a.exr")
        assert "unknown key" in said and "known are" in said and "scene.toml" in said


def test_a_tolerance_beyond_reason_is_refused(refused, scene, tmp_path):
    assert "tolerance is 7" in refused("render", scene(), "--out", tmp_path / "a.exr", "--tolerance", 7)


def test_a_reflectance_that_breaks_energy_conservation_is_refused(refused, scene, tmp_path):
    assert "energy conservation" in refused("render", scene("alpha = 0.2", "alpha = 0.9"), "--out", tmp_path / "a.exr")


def test_a_camera_that_looks_at_nothing_is_refused(refused, scene, tmp_path):
    away = scene("eye = [0.0, -1.0, 0.0]", "eye = [0.0, -1.0, 0.0]\ntarget = [0.0, -2.0, 0.0]")
    assert "looks at nothing" in refused("render", away, "--out", tmp_path / "a.exr")


def test_a_lamp_inside_a_box_is_refused(refused, scene, box, tmp_path):
    inside = scene(more='[[box]]\nfile = "slab.zarr"\nposition = [0.47, -2.02, 0.95]\n')
    assert "lamp key stands inside the volume box 'slab'" in refused("render", inside, "--out", tmp_path / "a.exr")


def test_an_image_that_does_not_fit_memory_is_refused_before_allocation(refused, scene, tmp_path):
    vast = scene("size = [61, 47]", "size = [4000000, 3000000]")
    assert "GiB of memory" in refused("render", vast, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[[lamp]]", "[render]\nsamples = 1000000000\n[[lamp]]"),
        ("[[lamp]]", "[render]\nshadow_resolution = 1000000\n[[lamp]]"),
        ("size = [61, 47]", "size = [1e300, 1e300]"),
        ("size = [61, 47]", "size = [61, 47]\nbinning = 1000000000"),
        ("bits = 12", "bits = 1000000000"),
    ],
)
def test_numbers_that_decide_the_size_have_a_bound(refused, scene, tmp_path, old, new):
    said = refused("render", scene(old, new), "--out", tmp_path / "a.exr")
    assert "scene.toml" in said and "GiB" not in said


def test_a_picture_that_no_number_holds_the_bytes_of_is_refused():
    with pytest.raises(InputError, match="needs inf GiB"):
        require(10**400, "the picture")


def test_very_many_lamps_boxes_or_surfaces_are_refused(refused, scene, tmp_path):
    lamp = "[[lamp]]\nto_lamp = [0.0, -1.0, 0.0]\n"
    out = "--out", tmp_path / "a.exr"
    many, _ = hg.load_scene(scene(more=lamp * (MOST_LAMPS - 1)))
    with pytest.raises(InputError, match=f"{MOST_LAMPS + 1} lamps: light along single rays"):
        hg.march(many, [[0.0, -1.0, 0.0]], [[0.0, 1.0, 0.0]])
    for table in (lamp, '[[box]]\nfile = "a.zarr"\n', '[[surface]]\nmesh = "a.ply"\n'):
        assert "a list of at most 10000 tables" in refused("render", scene(more=table * 10_001), *out)


@pytest.mark.parametrize("intensity", ["1e37", "1e38", "1e300"])
def test_light_beyond_single_precision_is_not_written(refused, scene, tmp_path, intensity):
    strong = scene("intensity = 3.0", f"intensity = {intensity}")
    if intensity != "1e37":  # the picture of that can be held, its variance cannot
        assert "not finite in" in refused("render", strong, "--out", tmp_path / "a.exr")
    said = refused("simulate", strong, "--out", tmp_path / "photographs")
    assert any(words in said for words in ("not finite in", "beyond single precision", "sensor's exposure is"))
    assert {path.name for path in tmp_path.iterdir()} == {"scene.toml"}


def test_a_mode_that_there_is_not_is_refused_with_the_known_ones(scene):
    with pytest.raises(InputError, match=r"mode is 'ray': give one of .*march"):
        hg.render(scene(), mode="ray")  # type: ignore[arg-type]
