"""Photographs of mirror balls, traced ray by ray: lamps of finite size, a dim room, clipping, noise, rounding."""

from dataclasses import dataclass

import numpy as np

from hagoromo.camera.camera import Camera

FINE = 4  # rays a pixel along each axis
LAMP_LIGHT = 8.0  # of white: its image is clipped
ROOM, BEHIND = 0.02, 0.06  # of white: light of the room in the mirror, and of what is behind the ball
BLUR = 0.45  # px: standard deviation of the point spread of a good lens


def unit(vectors):
    return np.asarray(vectors, float) / np.linalg.norm(vectors, axis=-1, keepdims=True)


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip(np.sum(unit(a) * unit(b), axis=-1), -1, 1)))


def pixels(fine):
    """Means over the rays of each pixel."""
    height, width = (n // FINE for n in fine.shape)
    return fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))


@dataclass(frozen=True)
class MirrorRays:
    """Rays that see one ball: on (h, w) bool, normal, place [m or px], to_eye (h, w, 3), all of fine rays."""

    on: np.ndarray
    normal: np.ndarray
    place: np.ndarray
    to_eye: np.ndarray

    @property
    def mirrored(self):
        return 2 * np.sum(self.normal * self.to_eye, axis=-1, keepdims=True) * self.normal - self.to_eye


def fine_grid(height, width):
    """Image points (x, y) of FINE × FINE rays a pixel."""
    row, column = np.mgrid[: height * FINE, : width * FINE]
    return np.stack([(column + 0.5) / FINE, (row + 0.5) / FINE], axis=-1)


def seen_from_afar(shape, centre, radius):
    """A ball at `centre` (x, y) [px]: x right, y up, z to the camera."""
    x, y = np.moveaxis((fine_grid(*shape) - centre) / radius, -1, 0)
    normal = np.stack([x, -y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    return MirrorRays(x**2 + y**2 < 1, normal, radius * normal, np.array([0.0, 0.0, 1.0]))


def seen_through(camera: Camera, centre, radius):
    """A ball at `centre` of `radius` [m], world."""
    ray, eye = camera.unproject(fine_grid(camera.height, camera.width)), camera.position
    along = ray @ (centre - eye)
    root = along**2 - np.sum((centre - eye) ** 2) + radius**2
    place = eye + ray * (along - np.sqrt(np.maximum(root, 0)))[..., None]
    return MirrorRays(root > 0, unit(place - centre), place, -ray)


def mirror_photograph(
    balls, lamp, seed, half_width=0.05, position=False, white=255, light=LAMP_LIGHT, glow=0.1, blur=BLUR
):
    """Numbers (h, w) of a photograph of mirror balls under one lamp.

    lamp: direction, or place [m] where `position`. half_width [rad] of a far lamp, or radius [m] of a near one.
    """
    from scipy.ndimage import gaussian_filter

    random = np.random.default_rng(seed)
    fine = np.full(balls[0].on.shape, BEHIND)
    for ball in balls:
        towards = np.asarray(lamp) - ball.place if position else np.broadcast_to(lamp, ball.place.shape)
        distance = np.linalg.norm(towards, axis=-1)
        angle = np.arccos(np.clip(np.sum(ball.mirrored * towards, axis=-1) / distance, -1, 1))
        wide = np.arcsin(half_width / distance) if position else half_width
        around = glow * np.exp(-((angle / 0.2) ** 2))
        fine = np.where(ball.on, ROOM + around + light * (angle < wide), fine)
    mean = pixels(gaussian_filter(fine, blur * FINE))
    noisy = white * (mean + random.normal(0, 1, mean.shape) * np.hypot(0.003, 0.01 * np.sqrt(mean)))
    return np.clip(np.rint(noisy), 0, white).astype(np.uint8 if white == 255 else np.uint16)


def room_photographs(ball, lamps, seed, half_width=0.05):
    """8-bit photographs of a ball in a room of lit patches, before a wall that ends behind it."""
    from scipy.ndimage import gaussian_filter

    random = np.random.default_rng(seed)
    room = np.full(ball.on.shape, ROOM)
    for _ in range(8):
        off = np.arccos(np.clip(ball.mirrored @ unit(random.normal(size=3)), -1, 1))
        room += random.uniform(0, 0.2) * (off < random.uniform(0.05, 0.5))
    height = np.linspace(0, 1, len(room))[:, None]
    wall = random.uniform(0, 0.2) * (height < random.uniform(0.3, 1.5)) + 0.005
    shown = {}
    for number, lamp in enumerate(lamps):
        off = np.arccos(np.clip(ball.mirrored @ lamp, -1, 1))
        mean = pixels(gaussian_filter(np.where(ball.on, room + LAMP_LIGHT * (off < half_width), wall), BLUR * FINE))
        noisy = 255 * (mean + random.normal(0, 1, mean.shape) * np.hypot(0.003, 0.01 * np.sqrt(mean)))
        shown[str(number)] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return shown


def mask_of(ball, kind="smooth"):
    """Of one ball: smooth edges, or pixels that it touches ("wide"), fills ("tight") or half fills ("half")."""
    share = pixels(ball.on.astype(float))
    if kind == "smooth":
        return np.rint(255 * share).astype(np.uint8)
    return np.where({"wide": share > 0, "half": share >= 0.5, "tight": share >= 1}[kind], 255, 0).astype(np.uint8)
