"""The samples of the demo: four materials on smooth balls, and the bench on which they are photographed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import camera_response, camera_white
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance

PRESET, FOCAL_MM, ISO = "canon_eos_kiss_digital", 55.0, 400.0
LAMP_SPECTRUM = "D65"  # spectrum of the white point lamps
RADIUS = 0.030  # [m] of a ball
BALL_SPACING = 0.066  # [m] between the centres of two balls
ROW_DISTANCE = 0.70  # [m] from the camera to the row of balls
SPECTRUM_KNOTS_NM = (380.0, 420.0, 450.0, 480.0, 510.0, 542.0, 560.0, 576.0, 600.0, 630.0, 660.0, 700.0, 730.0)  # [nm]

# Diffuse reflectance at SPECTRUM_KNOTS_NM, drawn by hand for this demo. Skin: after the mean of 100 forearms in
# Cooksey, Allen & Tsai (2017), "Reference data set of human skin reflectance", with the dips of oxygenated haemoglobin
# at 420, 542 and 576 nm. Cloth: an indigo dye, which absorbs around 610 nm and lets blue and deep red pass. Feather:
# white keratin, slightly yellow. Dielectric: a dark slate-grey glaze.
SPECTRA = {
    "skin": (0.16, 0.17, 0.25, 0.30, 0.35, 0.31, 0.34, 0.32, 0.47, 0.56, 0.60, 0.63, 0.64),
    "cloth": (0.22, 0.32, 0.40, 0.40, 0.31, 0.20, 0.15, 0.12, 0.10, 0.09, 0.11, 0.24, 0.36),
    "feather": (0.40, 0.49, 0.55, 0.60, 0.63, 0.66, 0.67, 0.68, 0.69, 0.70, 0.71, 0.72, 0.72),
    "dielectric": (0.052, 0.057, 0.060, 0.061, 0.060, 0.058, 0.057, 0.055, 0.053, 0.050, 0.048, 0.048, 0.048),
}
# β [1/sr], γ [rad], n. β is near ln2 / 4πγ², which a normalised distribution of facets would give, or the less that
# energy conservation leaves beside the body. n, rounded: outer layer of skin 1.40 (Ding et al. 2006), cellulose 1.54,
# keratin 1.56, soda-lime glaze 1.50.
INTERFACE = {
    "skin": (0.55, 0.30, 1.40),
    "cloth": (0.40, 0.37, 1.54),
    "feather": (0.60, 0.22, 1.56),
    "dielectric": (1.90, 0.17, 1.50),
}


def bench_camera(binning: int) -> Camera:
    """The paper's camera and lens at an ISO speed; full well and electrons per DN are scaled by 100 / ISO."""
    camera = Camera.preset(PRESET, FOCAL_MM, binning)
    assert camera.sensor is not None
    share = 100.0 / ISO
    sensor = replace(camera.sensor, full_well=camera.sensor.full_well * share, gain=camera.sensor.gain * share)
    return replace(camera, sensor=sensor)


def true_reflectances(camera: Camera) -> dict[str, Reflectance]:
    """The materials by name; body colours have a mean of 1 over the channels of `camera` under LAMP_SPECTRUM."""
    response, lamp = camera.response, Spectrum.named(LAMP_SPECTRUM)
    assert response is not None
    reflectances = {}
    for name, (beta, gamma, n) in INTERFACE.items():
        albedo = Spectrum(SPECTRUM_KNOTS_NM, SPECTRA[name])
        mean = float(np.mean(camera_response(albedo, lamp, response) / camera_white(lamp, response)))
        reflectances[name] = Reflectance(mean / np.pi, beta, gamma, n, albedo.scaled(1.0 / mean), name=name)
    return reflectances


def bench(reflectances: dict[str, Reflectance], camera: Camera) -> Scene:
    """A row of balls before the camera, and four white point lamps, of which one is on at a time.

    The first three lamps make the capture: beside the camera, high, and low from behind, with phase angles θ_Q = 10°,
    35° and 60°, so that the Fresnel factor determines n. The fourth is held out for the relit view. All are on or near
    the symmetry plane of the row, so that no ball casts a shadow on another.
    """
    row = BALL_SPACING * (np.arange(len(reflectances)) - (len(reflectances) - 1) / 2)
    balls = [
        Surface.sphere((x, 0.0, 0.0), RADIUS, reflectance, name)
        for x, (name, reflectance) in zip(row, reflectances.items(), strict=True)
    ]
    return Scene(camera.look_at((0.0, -ROW_DISTANCE, 0.0), (0.0, 0.0, 0.0)), BENCH_LAMPS, surfaces=tuple(balls))


def _lamp(name: str, turn: float, aside: float = 0.0, distance: float = 0.9) -> Lamp:
    """A lamp `turn`° above the line of sight seen from the balls (180: behind), shifted `aside` [m] along the row."""
    angle = np.radians(turn)
    place = (aside, -distance * np.cos(angle), distance * np.sin(angle))
    return Lamp(position=place, intensity=distance**2, spectrum=Spectrum.named(LAMP_SPECTRUM), name=name)


BENCH_LAMPS = (
    _lamp("beside the camera", -25.0),
    _lamp("above", 70.0),
    _lamp("below, behind", -120.0),
    _lamp("kept aside", 45.0, 0.2),
)
