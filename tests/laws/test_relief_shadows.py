"""Cast shadows of reliefs end where the geometry says: of a step and of a rounded ridge, in voxels of two sizes."""

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.relief.relief import Relief, relief_plan
from hagoromo.reflectance.reflectance import Reflectance

MATT = Reflectance(0.2, 0.0, 0.3, 1.5, Spectrum.constant(1.0))
WIDE, TALL, EDGE = 92, 7, 16.0  # px: of the picture, and where the step ends or the ridge has its top
HEIGHT = 0.002  # m
EYE = Response.load("cie1931")


def height_of(kind: str, x: np.ndarray, height: float) -> np.ndarray:
    """Height over the floor at `x` from the edge, in its unit: a step to the left, or a Gaussian ridge."""
    return np.where(x < 0.0, height, 0.0) if kind == "step" else height * np.exp(-0.5 * (x / (0.4 * height)) ** 2)


def end_by_geometry(kind: str, height: float, slope: float) -> float:
    """Where the last point in shadow lies, with a lamp to the left that stands `slope` over the floor."""
    x = np.arange(-50.0, 100.0, 0.01)
    lines = height_of(kind, x, height) + slope * x  # constant along a ray
    shaded = (np.maximum.accumulate(lines) > lines + 1e-6) & (x > 0.0)
    return float(x[shaded].max())


def end_in_picture(kind: str, focal: float, elevation: float) -> float:
    """Where half of the lamp's light is back, on a line of a picture from 1 m away [px]."""
    height, up = HEIGHT * focal, np.radians(elevation)
    camera = Camera(WIDE, TALL, (focal, focal), (WIDE / 2, TALL / 2), response=EYE)
    u, v = np.meshgrid(np.arange(WIDE) + 0.5 - WIDE / 2, np.arange(TALL) + 0.5 - TALL / 2)
    x = u + WIDE / 2 - EDGE
    depth = 1.0 - height_of(kind, x, height) / focal
    slope = np.zeros_like(x) if kind == "step" else -x / (0.4 * height) ** 2 * height_of(kind, x, height)
    normals = np.stack([-slope, np.zeros_like(x), -np.ones_like(x)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    points = np.stack([u / focal, v / focal, np.ones_like(u)], axis=2) * depth[..., None]
    relief = Relief(points, normals, np.full(points.shape, MATT.alpha), np.zeros(u.shape, int))
    to_lamp = np.array([-np.cos(up), 0.0, -np.sin(up)])
    lamp = Lamp(to_lamp=tuple(to_lamp), spectrum=Spectrum.named("E"))
    scene = Scene(camera, (lamp,), (relief_plan(relief, camera, [MATT]).box(),))
    shown = render(scene, Settings(samples=4, tolerance=0.01)).expose(EYE)[TALL // 2, :, 1]
    cosine = normals[TALL // 2] @ to_lamp
    share = np.where(cosine > 0.1, shown / np.maximum(cosine, 0.1), 0.0)
    share /= np.median(share[-10:])
    before = int(np.nonzero((share < 0.5) & (x[0] > 0.0))[0].max())
    return float(x[0, before] + (0.5 - share[before]) / (share[before + 1] - share[before]))


@pytest.mark.parametrize("kind", ["step", "ridge"])
@pytest.mark.parametrize("elevation", [15.0, 30.0, 45.0])
@pytest.mark.parametrize("focal", [4000.0, 8000.0])
def test_cast_shadows_end_within_three_quarters_of_a_voxel(kind, elevation, focal):
    """Of a height of 8 and of 16 voxels: the half level, beside what the geometry says. Before, a step's were 3.0, 2.1
    and 1.7 voxels too short under 15°, 30° and 45°, a ridge's 1.4 to 0.1. Most are within 0.45; of the high ridge
    at 45° the light stays near its half for a while, and rounding alone moves that place between 0.43 and 0.69.
    """
    true = end_by_geometry(kind, HEIGHT * focal, np.tan(np.radians(elevation)))
    assert end_in_picture(kind, focal, elevation) == pytest.approx(true, abs=0.75)
