"""Horizon: how high a lamp stands over a surface, against closed forms."""

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.measurement.surface.horizon import height_over_horizon

DEPTH = 1.0  # m, of a floor across the line of sight


def wall(focal: float, height_px: float) -> tuple[Camera, np.ndarray, float]:
    """A floor whose left part, up to 10 px, stands `height_px` nearer; the place of the edge on the floor [px]."""
    camera = Camera(71, 13, (focal, focal), (35.5, 6.5))
    u, v = np.meshgrid(np.arange(71) + 0.5 - 35.5, np.arange(13) + 0.5 - 6.5)
    depth = np.where(u < -25.0, DEPTH - height_px / focal, DEPTH)
    points = np.stack([u / focal, v / focal, np.ones_like(u)], axis=2) * depth[..., None]
    return camera, points, float(points[6, 9, 0] * focal + 35.0)


@pytest.mark.parametrize("focal", [1e5, 150.0])
@pytest.mark.parametrize(("height_px", "elevation"), [(12.0, 60.0), (9.0, 30.0), (4.0, 12.0)])
def test_a_shadow_of_a_wall_ends_where_it_should(focal, height_px, elevation):
    """The length of the shadow is the wall's height over the tangent of the lamp's elevation, to a pixel: the place of
    the edge is known to one. In perspective too, where the wall hides a part of the floor.
    """
    camera, points, edge = wall(focal, height_px)
    up = np.radians(elevation)
    to_lamp = np.broadcast_to((-np.cos(up), 0.0, -np.sin(up)), (71, 3))
    columns = np.arange(71)
    height = height_over_horizon(points, camera, (np.full(71, 6), columns), to_lamp)
    floor = columns > 10
    end = columns[floor & (height < 0.0)].max(initial=10) + 0.5
    assert end - edge == pytest.approx(height_px / np.tan(up), abs=1.01)


def test_a_lamp_stands_as_high_as_its_angle_over_the_wall():
    """Beside a wall of height H, x px away, it is its elevation less arctan(H / x), to half a pixel in x."""
    camera, points, edge = wall(1e5, 9.0)
    columns = np.array([16, 24, 40, 60])
    up = np.radians(50.0)
    to_lamp = np.broadcast_to((-np.cos(up), 0.0, -np.sin(up)), (4, 3))
    height = height_over_horizon(points, camera, (np.full(4, 6), columns), to_lamp)
    away = columns - edge
    low, high = (up - np.arctan2(9.0, away + off) for off in (-1.0, 1.0))
    assert (height > low).all() and (height < high).all()


def test_nothing_stands_beside_the_outermost_pixel():
    camera, points, _ = wall(1e5, 9.0)
    (height,) = height_over_horizon(points, camera, (np.array([6]), np.array([70])), np.array([[0.8, 0.0, -0.6]]))
    assert height == np.pi


def test_a_point_in_place_of_the_surface_is_shaded_as_it_stands():
    """A pixel 4 px from the wall is in its shadow, and not where it is put as near to the eye as the wall's top."""
    camera, points, _ = wall(1e5, 9.0)
    pixels, to_lamp = (np.array([6]), np.array([14])), np.array([[-np.cos(0.5), 0.0, -np.sin(0.5)]])
    (dark,), (same,), (lit,) = (
        height_over_horizon(points, camera, pixels, to_lamp, shaded)
        for shaded in (None, points[pixels], points[pixels] * (1.0 - 9.5 / 1e5))
    )
    assert dark == same < 0.0 < lit
