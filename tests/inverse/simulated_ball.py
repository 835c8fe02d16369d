"""Photographs of a ball, simulated with a transcription of Tanaka eq. (2)–(6) that shares no line with the product."""

from dataclasses import dataclass

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

RADIUS, DISTANCE = 0.05, 0.8  # m
# Phase angles of 35°, 80° and 130°: the highlights then span θ_Q from 17° to 65°, over which F grows 2 to 5 times.
LAMPS = ((35, 20), (80, -15), (130, 10))  # azimuth from the camera's side, elevation [°]
LAMP_DISTANCE = 0.6  # m
FULL_WELL, READ_NOISE = 45_000.0, 10.0  # electrons


@dataclass(frozen=True)
class BallMaterial:
    """Parameters of a material: alpha_body is α c_b per channel; interface_colour has mean 1.

    lobes: β and γ of further Gaussian lobes.
    """

    alpha_body: tuple
    beta: float
    gamma: float
    n: float
    nu: float = np.inf
    interface_colour: tuple = (1.0, 1.0, 1.0)
    lobes: tuple = ()

    @property
    def alpha(self):
        return float(np.mean(self.alpha_body))

    @property
    def body_colour(self):
        return np.array(self.alpha_body) / self.alpha


def reflected(normal, to_lamp, to_eye, truth):
    """Eq. (2)–(6) for arrays of unit vectors (..., 3): radiance per unit irradiance (..., channel)."""
    half = to_lamp + to_eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    cos_i, cos_r = (normal * to_lamp).sum(-1), (normal * to_eye).sum(-1)
    cos_q, phi = (to_eye * half).sum(-1), np.arccos(np.clip((normal * half).sum(-1), -1, 1))
    u = (phi / truth.gamma) ** 2
    nu = np.minimum(truth.nu, 1e9)
    d = truth.beta * np.where(np.isinf(truth.nu), 2.0**-u, (1 + (2 ** (1 / nu) - 1) * u) ** -nu)
    d = d + sum(beta * 2.0 ** -((phi / gamma) ** 2) for beta, gamma in truth.lobes)
    g = np.sqrt(truth.n**2 + cos_q**2 - 1)
    f = (g - cos_q) ** 2 / (g + cos_q) ** 2 / 2
    f = f * (1 + (cos_q * (g + cos_q) - 1) ** 2 / (cos_q * (g - cos_q) + 1) ** 2)
    masked = np.minimum(1, 2 * np.cos(phi) * np.minimum(cos_r, cos_i) / cos_q)
    seen = (cos_i > 0) & (cos_r > 0)
    interface = d * f * masked / np.where(seen, cos_r, 1)
    both = cos_i[..., None] * np.array(truth.alpha_body) + interface[..., None] * np.array(truth.interface_colour)
    return np.where(seen[..., None], both, 0)


def ball_camera(size):
    """A camera DISTANCE from the ball's centre, on its −y side, that fills 90 % of the picture with it."""
    focal = 0.45 * size * np.sqrt(DISTANCE**2 - RADIUS**2) / RADIUS
    return Camera(size, size, (focal, focal), (size / 2, size / 2)).look_at((0, -DISTANCE, 0), (0, 0, 0))


def ball_shape(camera):
    """Points and normals (h, w, 3) of the ball at the centres of the pixels, 0 beside it."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    ray = np.stack([(columns - camera.principal[0]) / camera.focal[0], np.ones_like(rows),
                    -(rows - camera.principal[1]) / camera.focal[1]], axis=-1)  # fmt: skip
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    eye = np.array([0.0, -DISTANCE, 0.0])
    along = -(ray @ eye)
    discriminant = along**2 - DISTANCE**2 + RADIUS**2
    points = eye + ray * (along - np.sqrt(np.maximum(discriminant, 0)))[..., None]
    points = np.where((discriminant > 0)[..., None], points, 0)
    return points, points / RADIUS


def lamp_positions(angles=LAMPS):
    """(lamp, 3) [m]."""
    azimuth, elevation = np.radians(np.array(angles, float)).T
    across = np.cos(elevation)
    return LAMP_DISTANCE * np.stack([np.sin(azimuth) * across, -np.cos(azimuth) * across, np.sin(elevation)], axis=-1)


def simulate(truths, seed, size=61, labels=None, angles=LAMPS, white=(1, 1, 1), full_well=FULL_WELL, metered=0.8):
    """Capture with one photograph per lamp, shot and read noise, exposed so that its brightest value fills `metered`.

    truths: a material each, chosen by labels (h, w) (one material without). white: colour of the lamps. The stated
    variance is what a sensor can know: that of the noisy electrons.
    """
    random = np.random.default_rng(seed)
    camera = ball_camera(size)
    points, normals = ball_shape(camera)
    on_ball = np.linalg.norm(normals, axis=-1) > 0.5
    labels = np.zeros((size, size), int) if labels is None else labels
    to_eye = camera.position - points
    to_eye = to_eye / np.linalg.norm(to_eye, axis=-1, keepdims=True)
    photographs = []
    for number, position in enumerate(lamp_positions(angles)):
        to_lamp = position - points
        distance = np.linalg.norm(to_lamp, axis=-1, keepdims=True)
        values = np.zeros((size, size, 3))
        for k, truth in enumerate(truths):
            light = reflected(normals, to_lamp / distance, to_eye, truth) * LAMP_DISTANCE**2 / distance**2
            values = np.where(((labels == k) & on_ball)[..., None], light * np.array(white), values)
        exposure = metered * full_well / values.max()
        counted = random.poisson(values * exposure)
        full = (counted >= full_well).any(axis=-1)
        electrons = np.minimum(counted, full_well) + random.normal(0, READ_NOISE, values.shape)
        variance = np.maximum(electrons, 0) + 1 + READ_NOISE**2
        lamp = Lamp(position=position, intensity=LAMP_DISTANCE**2)
        photographs.append(Photograph(electrons / exposure, variance / exposure**2, on_ball & ~full, camera, (lamp,),
                                      f"lamp {number}"))  # fmt: skip
    return Capture(tuple(photographs), "ball", points=points.astype(np.float32), normals=normals.astype(np.float32))
