"""Gallery view: how a box is shown: whole before a sweep, near by before a card, and lit from eight sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

SIZE, STRIP = 360, 140  # px a side of a picture, and of one of the strip
WHOLE_SAMPLES, NEAR_SAMPLES, STRIP_SAMPLES = 4, 2, 1  # rays a pixel
LIGHTS = 8  # places of the lamp that moves around
AWAY = 25.0  # fields of view from the middle to the camera
TOWARDS, STRAIGHT = (0.25, -1.0, 0.2), (0.1, -1.0, 0.1)  # from the matter to the camera: whole, near by
ELEVATION = 35.0  # ° of the lamp that moves around
WHITE_SPECTRUM = hg.Spectrum.named("D65")
KEY_VALUE = 0.9  # of the brightest part of a picture, as `Image.display` has it
CARD = hg.Reflectance(0.012, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), name="card")  # nearly black
KEY, FILL, RIM = ((-0.75, -0.8, 1.0), 1.0), ((0.9, -1.0, 0.2), 0.15), ((0.5, 0.9, 1.3), 0.6)


def whole(box: hg.VolumeBox, stops: float = 0.0) -> NDArray[np.uint8]:
    """All of it, standing on a floor that bends up into a wall. stops: of exposure, see `Item`."""
    return _shown(whole_scene(box, SIZE), WHOLE_SAMPLES, stops)


def whole_scene(box: hg.VolumeBox, pixels: int) -> hg.Scene:
    """The scene of `whole`. pixels: a side of the picture."""
    low, high = _extent(box)
    field = 1.12 * float(np.linalg.norm((high - low)[[0, 2]]) / np.sqrt(2.0))
    field = max(field, 1.12 * float(max(high[0] - low[0], high[2] - low[2])))
    floor = float(max(low[2], 0.0))
    # so low that light from behind passes over it
    wall = float(high[1]) + 2.0 * field, float(high[2]) + 0.3 * field
    background = hg.sweep(CARD, (-9.0 * field, floor - 1e-6), wall, 0.5 * field, 3.0 * field)
    return hg.Scene(_camera(box, field, TOWARDS, pixels), _lamps(), (box,), (background,))


def near(box: hg.VolumeBox, field_mm: float) -> NDArray[np.uint8]:
    """A field of view of `field_mm` around its middle, before a card so far behind that its shadow falls beside it."""
    field = 1e-3 * field_mm
    low, high = _extent(box)
    turned = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    middle = 0.5 * (low + high)
    turned[:3, 3] = middle[0], float(high[1]) + 4.0 * field, middle[2]
    card = hg.Surface(CARD, "rectangle", pose=turned @ np.diag([2.0 * field, 2.0 * field, 1.0, 1.0]), name="card")
    return _shown(hg.Scene(_camera(box, field, STRAIGHT, SIZE), _lamps(), (box,), (card,)), NEAR_SAMPLES)


def around(box: hg.VolumeBox, stops: float = 0.0) -> NDArray[np.uint8]:
    """Eight pictures side by side, all exposed alike, under a lamp that moves around it from the front to its right.

    stops: of exposure, see `Item`.
    """
    low, high = _extent(box)
    camera = _camera(box, 1.05 * float(max(high[0] - low[0], high[2] - low[2])), TOWARDS, STRIP)
    up, pictures = np.radians(ELEVATION), []
    for turn in 2.0 * np.pi * np.arange(LIGHTS) / LIGHTS:
        to_lamp = np.cos(up) * np.sin(turn), -np.cos(up) * np.cos(turn), np.sin(up)
        image = hg.render(
            hg.Scene(camera, (hg.Lamp(to_lamp=to_lamp, spectrum=WHITE_SPECTRUM),), (box,)), hg.Settings(STRIP_SAMPLES)
        )
        pictures.append(hg.srgb_from_xyz(image.xyz()))
    brightest = np.percentile(np.max(pictures, axis=-1)[np.max(pictures, axis=-1) > 0], 99.0)
    return np.hstack([hg.srgb_encode(picture * (0.8 * 2.0**stops / brightest)) for picture in pictures])


def _camera(box: hg.VolumeBox, field: float, towards: Sequence[float], pixels: int) -> hg.Camera:
    """A square picture, `field` [m] wide at the middle of the box."""
    low, high = _extent(box)
    middle = 0.5 * (low + high)
    focal = pixels * AWAY
    camera = hg.Camera(pixels, pixels, (focal, focal), (0.5 * pixels, 0.5 * pixels))
    return camera.look_at(middle + AWAY * field * np.asarray(towards) / np.linalg.norm(towards), middle)


def _lamps() -> tuple[hg.Lamp, ...]:
    """Key from high on the left, weak fill from the right, rim from high behind; far away all three."""
    return tuple(hg.Lamp(to_lamp=place, intensity=share, spectrum=WHITE_SPECTRUM) for place, share in (KEY, FILL, RIM))


def _shown(scene: hg.Scene, samples: int, stops: float = 0.0) -> NDArray[np.uint8]:
    image = hg.render(scene, hg.Settings(samples))
    if not stops:
        return image.display()
    rgb = image.linear_srgb()
    brightest = np.percentile(np.max(rgb, axis=-1)[image.alpha > 0.5], 99.5)
    return hg.srgb_encode(rgb * (2.0**stops * KEY_VALUE / brightest))


def _extent(box: hg.VolumeBox) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of the bricks that hold matter [m]."""
    low, high = box.bricks.places.min(axis=0), box.bricks.places.max(axis=0) + 1
    edge = 8 * box.voxel_size
    return box.pose[:3, 3] + low[::-1] * edge, box.pose[:3, 3] + high[::-1] * edge
