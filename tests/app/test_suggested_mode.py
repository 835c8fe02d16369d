"""`render` says in one line where mode march leaves much light out, and is silent elsewhere."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.image import suggested_mode
from hagoromo.image.suggested_mode import higher_share

SIZE = 40  # px


def cube(albedo: float, depth: float = 6.0) -> hg.Scene:
    """A cube of matte spheres, so many mean free paths wide, under a far lamp."""
    material = hg.Reflectance(albedo / math.pi, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    axes = np.broadcast_to((0.0, 0.0, 1.0), (17, 17, 17, 3))
    box = hg.VolumeBox.from_arrays(np.ones(axes.shape[:3]), axes, 1 / 17, 2 * depth, [material], extinction="projected")
    camera = hg.Camera(SIZE, SIZE, (1.6 * SIZE, 1.6 * SIZE), (SIZE / 2, SIZE / 2)).look_at(
        (1.7, -2, 1.6), (0.5, 0.5, 0.5)
    )
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.48, -0.6, 0.64)),), (box,))


@pytest.fixture(autouse=True)
def small_pictures_are_tested_too(monkeypatch):
    monkeypatch.setattr(suggested_mode, "FEWEST_PIXELS", 1)


def test_the_share_is_that_of_mode_path():
    """Of white matter, with 64 walks a pixel; within four standard errors of the test and of the picture."""
    scene = cube(0.8)
    image = hg.render(scene)
    found = higher_share(scene, image, hg.Settings())
    every = hg.render(scene, hg.Settings(samples=64), mode="path")
    y = every.xyz()[..., 1].astype(float)
    assert every.variance is not None and found is not None
    truth = 1.0 - image.xyz()[..., 1].astype(float).sum() / y.sum()
    noise = math.sqrt(float(every.variance.sum())) / y.sum()
    assert abs(found.share - truth) < 4.0 * (found.error + noise), (found, truth)
    assert found.is_much and found.error < 0.1


def test_dark_matter_has_little():
    scene = cube(0.05)
    found = higher_share(scene, hg.render(scene), hg.Settings())
    assert found is not None and found.is_little and not found.is_much


def test_nothing_is_said_where_it_is_not_asked_for_or_not_known(monkeypatch):
    """No walks, a cut, a quick look, and matter that walks refuse."""
    scene = cube(0.8)
    image = hg.render(scene)
    assert higher_share(scene, image, hg.Settings(walks=0)) is None
    assert higher_share(scene, image, hg.Settings(cut=(0.0, 0.0, 1.0, 0.0))) is None
    box = scene.boxes[0]
    fibres = hg.Reflectance(0.25, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="cylinder")
    isotropic = hg.VolumeBox(box.bricks, box.voxel_size, box.tau, (fibres,))
    other = hg.Scene(scene.camera, scene.lamps, (isotropic,))
    assert higher_share(other, hg.render(other), hg.Settings()) is None
    monkeypatch.setattr(suggested_mode, "FEWEST_PIXELS", SIZE * SIZE + 1)
    assert higher_share(scene, image, hg.Settings()) is None


def test_the_command_says_one_line_and_the_picture_has_the_same_bits(tmp_path, capsys):
    scene = cube(0.8)
    scene.boxes[0].save(tmp_path / "cube.zarr")
    camera = scene.camera
    (tmp_path / "a.toml").write_text(
        f"[camera]\nsize = [{SIZE}, {SIZE}]\nfocal = [{camera.focal[0]}, {camera.focal[1]}]\n"
        f"principal = [{SIZE / 2}, {SIZE / 2}]\neye = [1.7, -2, 1.6]\ntarget = [0.5, 0.5, 0.5]\n"
        '[[lamp]]\nto_lamp = [0.48, -0.6, 0.64]\n[[box]]\nfile = "cube.zarr"\n'
    )
    command = ["render", str(tmp_path / "a.toml"), "--out"]
    assert main([*command, str(tmp_path / "a.exr")]) == 0
    said = [line for line in capsys.readouterr().out.splitlines() if "scattered more than once" in line]
    assert len(said) == 1 and "--mode full" in said[0] and "--walks 0" in said[0]
    assert main([*command, str(tmp_path / "b.exr"), "--walks", "0"]) == 0
    assert "scattered" not in capsys.readouterr().out
    images = [hg.read_image(tmp_path / f"{name}.exr") for name in "ab"]
    assert np.array_equal(images[0].weights, images[1].weights)
