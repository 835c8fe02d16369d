"""A figure as a scene file shows what the figure's scene shows, at any size of its picture."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo_matter.demo.figure_scene import camera_of, resized_scene, write_figure_scene
from hagoromo_matter.demo.figures import PAPER_FIGURES, Cast

MATERIAL = hg.Reflectance(0.2, 0.2, 0.3, 1.5, hg.Spectrum.constant(0.5))
MEASURED = dict.fromkeys(("skin", "cloth", "feather", "dielectric"), MATERIAL)


class SmallCast(Cast):
    """Each part of it is one small box, at a height of its own."""

    def box(self, who: str, part: str) -> hg.VolumeBox:
        axes = np.zeros((3, 4, 5, 3))
        axes[..., 0] = 1.0
        pose = np.eye(4)
        pose[:3, 3] = 0.0, 0.0, 0.01 * len(who + part)
        return hg.VolumeBox.from_arrays(np.ones((3, 4, 5)), axes, 0.01, 100.0, [MATERIAL], pose=pose)


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "seconds"), [("figure_7_skin", 0.0), ("figure_8_whole", 2.0)])
def test_a_figure_as_a_file_is_its_scene(tmp_path, name, seconds):
    cast, camera = SmallCast(MEASURED, 0.5, 1), camera_of(90)
    path = write_figure_scene(cast, name, camera, tmp_path / "home", seconds=seconds)
    if seconds:  # a scene that moves: at its beginning
        assert len(hg.read_toml(path)["motion"]["box"]) == 2 * len(cast.parts(name))
    else:
        scene = cast.scene(name, camera, hg.silent)
        loaded, _ = hg.load_scene(path)
        assert (loaded.camera.width, loaded.camera.height) == ((60, 90) if PAPER_FIGURES[name].upright else (90, 60))
        assert np.allclose(loaded.camera.matrix, scene.camera.matrix)
        assert np.allclose(loaded.camera.world_to_camera, scene.camera.world_to_camera)
        assert all(np.allclose(a.pose, b.pose) for a, b in zip(loaded.boxes, scene.boxes, strict=True))
        assert [lamp.intensity for lamp in loaded.lamps] == pytest.approx([lamp.intensity for lamp in scene.lamps])


def test_another_size_is_the_same_view(tmp_path):
    cast = SmallCast(MEASURED, 0.5, 1)
    path = write_figure_scene(cast, "figure_7_skin", camera_of(90), tmp_path / "home")
    small, large = hg.load_scene(path)[0].camera, hg.load_scene(resized_scene(path, 3840))[0].camera
    assert (large.width, large.height) == (2560, 3840)
    point = (0.003, -0.01, 0.245)
    assert np.allclose(large.project(point), np.array(small.project(point)) * (3840 / 90), atol=1e-6)
