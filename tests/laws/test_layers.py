"""Layers of a picture: what a ball and a box show, in channels that other programs read."""

import importlib.util
import json
import math

import numpy as np
import OpenEXR
import pytest

import hagoromo as hg
from hagoromo.image.picture.denoise import denoised
from hagoromo.image.picture.image import LAYERS

RED = hg.Spectrum([360, 560, 580, 830], [0.1, 0.1, 0.8, 0.8])
MATTE = hg.Reflectance(0.2, 0.3, 0.3, 1.5, RED, name="clay")
SIZE, AWAY, RADIUS = 41, 2.0, 0.3
NO_DENOISER = importlib.util.find_spec("pyoidn") is None


def ball_and_box():
    """A ball at the left, a dense box of spheres at the right, from the front."""
    focal = SIZE * 1.6
    camera = hg.Camera(SIZE, SIZE, (focal, focal), (SIZE / 2, SIZE / 2)).look_at((0, -AWAY, 0), (0, 0, 0))
    ball = hg.Surface.sphere((-0.31, 0, 0), RADIUS, MATTE, name="ball")
    axes = np.broadcast_to([0.0, 0.0, 1.0], (8, 8, 8, 3))
    grey = hg.Reflectance(0.25, 0.0, 0.3, 1.5, hg.Spectrum.constant(0.5), element="sphere", name="ash")
    box = hg.VolumeBox.from_arrays(
        np.ones((8, 8, 8)), axes, 0.5 / 8, 400.0, [grey], extinction="projected", name="cube"
    )
    pose = np.eye(4)
    pose[:3, 3] = 0.06, 0.0, -0.25
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.2, -1, 0.3)),), (box.with_pose(pose),), (ball,))


@pytest.fixture(scope="module")
def image():
    return hg.render(ball_and_box(), hg.Settings(samples=4), mode="path", layers=True)


def test_depth_normal_and_material_are_those_of_the_ball_and_the_box(image):
    """Of the ball by its equation, within what a pixel shows of it; of the box its front, within a mean free path."""
    layers, row = image.layers, SIZE // 2
    assert tuple(layers) == LAYERS
    column = round(SIZE / 2 - 0.31 / AWAY * SIZE * 1.6)
    x = (column + 0.5 - SIZE / 2) / (SIZE * 1.6)  # per unit of depth
    a, b, c = 1 + x * x, -2 * (AWAY - 0.31 * x), AWAY**2 + 0.31**2 - RADIUS**2
    depth = (-b - math.sqrt(b * b - 4 * a * c)) / (2 * a)
    assert layers["depth.Z"][row, column] == pytest.approx(depth, abs=0.01)
    normal = np.array([x * depth + 0.31, depth - AWAY, 0.0]) / RADIUS
    seen = np.array([layers[f"normal.{k}"][row, column] for k in "XYZ"])
    assert np.abs(seen - normal).max() < 0.05 and np.linalg.norm(seen) == pytest.approx(1.0, abs=1e-5)
    inside = layers["material.id"][5:-5, 26:34]
    assert image.metadata["materials"] == ["cube: ash", "ball: clay"] and set(np.unique(layers["material.id"])) == {
        0,
        1,
        2,
    }
    assert layers["material.id"][row, column] == 2 and (inside[10:20] == 1).all()
    assert layers["depth.Z"][row, 30] == pytest.approx(AWAY, abs=0.04)  # a voxel is 0.06 m
    red, green = (layers[f"albedo.{k}"][row, column] for k in "RG")
    assert red > 3 * green > 0 and layers["albedo.R"][row, 30] == pytest.approx(0.5 * 0.25 * math.pi, rel=0.02)
    empty = layers["material.id"] == 0
    assert empty.any() and all((layers[name][empty] == 0.0).all() for name in ("albedo.R", "normal.X"))


def test_layers_are_named_channels_that_another_reader_finds(image, tmp_path):
    """By OpenEXR's own library: parts of the light add up to R, G, B."""
    image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    for name in LAYERS:
        assert np.array_equal(channels[name], image.layers[name])
    for name in "RGB":
        largest = float(np.abs(channels[name]).max())
        assert channels[f"higher.{name}"].max() > 0.01 * largest
        assert channels[f"first.{name}"] + channels[f"higher.{name}"] == pytest.approx(
            channels[name], abs=1e-5 * largest
        )
        first = channels[f"body.{name}"] + channels[f"interface.{name}"]
        assert first == pytest.approx(channels[f"first.{name}"], abs=1e-5 * largest)
    assert json.loads(hg.read_exr(tmp_path / "a.exr")[1]["hagoromo"])["materials"] == ["cube: ash", "ball: clay"]
    again = hg.read_image(tmp_path / "a.exr")
    assert again.layers is not None and set(again.layers) == set(LAYERS)
    with pytest.raises(hg.InputError, match="part of the light is 'second': give one of first"):
        image.part("second")


@pytest.mark.parametrize("mode", ["march", pytest.param("full", marks=pytest.mark.slow), "path"])
def test_light_through_fibres_and_of_every_lamp_has_layers(mode, tmp_path):
    """In every mode: body, interface and what comes through add up to the first order, lamps to all light; the lamp
    behind is seen through the fibres.
    """
    fibre = hg.Reflectance(
        0.1, 0.2, 0.3, 1.5, hg.Spectrum.constant(0.6), element="cylinder", transmission=0.5, clearness=0.4
    )
    axes = np.broadcast_to([1.0, 0.0, 0.0], (4, 4, 4, 3))
    box = hg.VolumeBox.from_arrays(np.ones((4, 4, 4)), axes, 0.05, 20.0, [fibre], extinction="projected")
    camera = hg.Camera(9, 9, (18.0, 18.0), (4.5, 4.5)).look_at((0.1, -0.6, 0.1), (0.1, 0.1, 0.1))
    lamps = hg.Lamp(to_lamp=(0.0, -1.0, 0.3), name="key"), hg.Lamp(to_lamp=(0.1, 1.0, 0.2), name="behind")
    settings = hg.Settings(samples=4, separate_lamps=True, walks=0)
    image = hg.render(hg.Scene(camera, lamps, (box,)), settings, mode=mode, layers=True)
    image.save(tmp_path / "a.exr")
    channels = hg.read_exr(tmp_path / "a.exr")[0]
    assert image.lamp_names == ("key", "behind") and set(LAYERS) <= set(channels)
    for name in "RGB":
        largest = float(channels[name].max())
        parts = sum(channels[f"{part}.{name}"] for part in ("body", "interface", "through"))
        assert parts == pytest.approx(channels[f"first.{name}"], abs=1e-5 * largest)
        lamps_together = channels[f"lamp0.{name}"] + channels[f"lamp1.{name}"]
        assert lamps_together == pytest.approx(channels[name], abs=1e-5 * largest)
        assert channels[f"through.{name}"].max() > 0.3 * channels[f"lamp1.{name}"].max() > 0.0
        assert (f"higher.{name}" in channels) == (mode != "march")


def test_layers_of_a_march_are_the_same(image):
    marched = hg.render(ball_and_box(), layers=True)
    assert marched.layers is not None
    assert all(np.array_equal(marched.layers[name], image.layers[name]) for name in LAYERS)


@pytest.mark.skipif(NO_DENOISER, reason="Open Image Denoise is not installed (pip install 'hagoromo[denoise]')")
def test_a_denoised_picture_is_nearer_to_the_truth_and_marked(image, tmp_path):
    truth = hg.render(ball_and_box(), hg.Settings(samples=600, seed=9), mode="path").linear_srgb()
    clean = denoised(image.layers, image.linear_srgb())
    off = [np.sqrt(np.mean((values - truth) ** 2)) for values in (clean, image.linear_srgb())]
    assert off[0] < 0.6 * off[1]
    image.save(tmp_path / "a.exr", denoise=True)
    channels, header = hg.read_exr(tmp_path / "a.exr")
    assert header["denoised"].startswith("R, G, B by Open Image Denoise") and np.array_equal(
        channels["R"], clean[..., 0]
    )
    assert np.array_equal(hg.read_image(tmp_path / "a.exr").weights, image.weights)
    with pytest.raises(hg.InputError, match=r"a\.exr was denoised"):
        hg.compare(tmp_path / "a.exr", tmp_path / "a.exr")
    with pytest.raises(hg.InputError, match="no layers of albedo and normal"):
        denoised(hg.render(ball_and_box()).layers, clean)


@pytest.mark.skipif(NO_DENOISER, reason="Open Image Denoise is not installed (pip install 'hagoromo[denoise]')")
def test_the_edge_of_a_denoised_picture_is_as_smooth_as_its_middle():
    """A grey picture with noise of 10 %: its two outermost pixels are off like the middle in the mean over draws, where
    they were 2.5 times as far; in one draw 1.3 times (2.8), as their reflection is no other noise.
    """
    size = (96, 96)
    layers = {f"albedo.{name}": np.full(size, 0.5) for name in "RGB"}
    layers |= {f"normal.{name}": np.full(size, float(name == "Z")) for name in "XYZ"}
    noise = np.random.default_rng(0).standard_normal((8, *size, 3))
    off = np.array([denoised(layers, 0.5 * (1.0 + 0.1 * each)) - 0.5 for each in noise])
    edge, middle = np.ones(size, bool), np.zeros(size, bool)
    edge[2:-2, 2:-2], middle[16:-16, 16:-16] = False, True
    for values, most in ((np.abs(off.mean(axis=(0, 3))), 1.5), (np.abs(off).mean(axis=(0, 3)), 1.6)):
        assert values[edge].mean() < most * values[middle].mean()
