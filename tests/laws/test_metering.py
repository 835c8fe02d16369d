"""Metering: the sensor is exposed for what is lit, however little of the picture that is."""

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.camera.sensor import Sensor
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.surface import Surface
from hagoromo.image.simulate import simulate
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance

SENSOR = Sensor(1.0, 40_000.0, 5.0, 10.0, 0.0, 12)
MATTE = Reflectance(0.2, 0.1, 0.3, 1.5, Spectrum.constant(1.0))


@pytest.mark.parametrize("focal", [40.0, 90.0, 300.0])
def test_a_small_object_is_exposed_as_a_large_one_is(focal):
    """A ball on 0.2, 1 and 10 % of the picture: nothing of it is lost, its brightest parts fill most of the range."""
    camera = Camera(201, 151, (focal, focal), (100.0, 75.0), response=Response.load("cie1931"), sensor=SENSOR)
    ball = Surface.sphere((0.0, 0.0, 0.0), 0.1, MATTE, "ball")
    lamp = Lamp(position=(0.3, -1.0, 0.5), spectrum=Spectrum.named("E"))
    scene = Scene(camera.look_at((0.0, -0.95, 0.0), (0.0, 0.0, 0.0)), (lamp,), surfaces=(ball,))
    (photograph,) = simulate(scene).photographs
    lit = photograph.values[photograph.values > 0.1 * photograph.values.max()]
    brightest = np.percentile(lit, 90.0)
    assert 0.5 < photograph.values.max() / brightest < 2.0
    noise = np.sqrt(photograph.variance[photograph.values >= brightest].max()) / brightest
    assert noise < 2.0 / np.sqrt(0.8 * 40_000.0)  # shot noise of four fifths of the well
    assert np.isfinite(photograph.values[photograph.mask]).all()
    assert photograph.mask.mean() > 0.99
