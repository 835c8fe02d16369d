"""Weight stack: a scene as one camera sees it under far lamps, one at a time, as geometric weights of its colours.

f = w_d c_b(λ) + w_s e: with the weights of each colour kept apart, spectra of lamps and cameras may be chosen later
(MODEL §5). Axes of a page: x right, y up, z to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.files.memory import require
from hagoromo.image.layers import layers_of
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.nearest import nearest_known
from hagoromo.progress import Progress, silent
from hagoromo_page.publication.surface_maps import FLIP

COPIES = 5  # of the weights that are in memory at once
SKETCH_SIDE = 96  # px of the picture that shows where there is matter


@dataclass(frozen=True, eq=False, repr=False)
class WeightStack:
    """weights: (h, w, N, P) float32, radiance per unit of lamp spectrum and of colour, under a lamp of irradiance 1.

    alpha: (h, w) coverage 0…1. directions: (N, 3) unit, to the lamps, page's axes. colours: P spectra.
    camera: that sees it, and depth: (h, w) of what it sees, along its axis [m]; None where lengths are not known.
    """

    weights: NDArray[np.float32]
    alpha: NDArray[np.float32]
    directions: NDArray[np.float64]
    colours: tuple[Spectrum, ...]
    camera: Camera | None = None
    depth: NDArray[np.float32] | None = None

    def __repr__(self) -> str:
        height, width, lamps, colours = self.weights.shape
        return f"WeightStack({width} × {height} px, {lamps} lamps, {colours} colours)"

    @property
    def known(self) -> NDArray[np.bool_]:
        """(h, w) pixels with matter in them."""
        return self.alpha > 0.0

    def reduced(self, factor: float) -> WeightStack:
        """With pixels `factor` times as wide: means of those of the stack, as light adds."""
        import cv2

        height, width, lamps, colours = self.weights.shape
        size = max(round(width / factor), 1), max(round(height / factor), 1)
        small = np.empty((size[1], size[0], lamps, colours), np.float32)
        for lamp in range(lamps):
            for colour in range(colours):
                plane = np.ascontiguousarray(self.weights[:, :, lamp, colour])
                small[:, :, lamp, colour] = cv2.resize(plane, size, interpolation=cv2.INTER_AREA)
        alpha = cv2.resize(self.alpha, size, interpolation=cv2.INTER_AREA)
        depth = None if self.depth is None else cv2.resize(self.depth, size, interpolation=cv2.INTER_NEAREST)
        camera = self.camera and self.camera.resampled(*size, (width / size[0], height / size[1]))
        return replace(self, weights=small, alpha=alpha.astype(np.float32), camera=camera, depth=depth)


def weight_stack(
    scene: Scene,
    directions: NDArray[np.float64],
    settings: Settings,
    progress: Progress = silent,
    stored: WeightStack | None = None,
) -> WeightStack:
    """`scene` under far lamps in place of its own, at `directions` (N, 3), unit, page's axes; after those of `stored`.

    `InputError` for a stack larger than the memory.
    """
    lamps = len(directions) + (0 if stored is None else len(stored.directions))
    colours = sum(len(box.materials) + len(box.basis) for box in scene.boxes) + 2 * len(scene.surfaces)
    size = 4.0 * COPIES * scene.camera.width * scene.camera.height * lamps * max(colours, 2)
    require(size, f"a picture of {scene.camera.width} × {scene.camera.height} px under {lamps} lamps")
    turn = scene.camera.world_to_camera[:3, :3].T @ FLIP
    lit = scene.with_lamps(*(Lamp(to_lamp=turn @ one, name=f"{k}") for k, one in enumerate(directions)))
    image = render(lit, replace(settings, separate_lamps=True), progress)
    height, width, _ = image.weights.shape
    weights = image.weights.reshape(height, width, len(directions), -1)[:, :, list(image.palette.lamp_groups)]
    weights = np.maximum(weights, 0.0)
    if stored is not None:
        together = np.concatenate([stored.weights, weights], axis=2)
        return replace(stored, weights=together, directions=np.concatenate([stored.directions, directions]))
    seen = tuple(image.palette.colours)
    depth = _depth(scene, settings, image.alpha > 0.0)
    return WeightStack(weights, image.alpha, directions, seen, scene.camera, depth)


def _depth(scene: Scene, settings: Settings, known: NDArray[np.bool_]) -> NDArray[np.float32] | None:
    """Depth (h, w) of what rays hit first, mean over a pixel [m]; where they hit nothing, that of the nearest pixel."""
    depth = layers_of(scene, settings)["depth.Z"]
    hit = known & (depth > 0.0)
    if not hit.any():
        return None
    return depth[nearest_known(hit)]


def framed(scene: Scene, pixels: int) -> Camera:
    """The camera of `scene`, its picture cut to what has matter in it, `pixels` px along the longer side."""
    small = scene.camera.limited(SKETCH_SIDE)
    seen = render(scene.with_camera(small), Settings(shadows="none")).alpha > 0.0
    if not seen.any():
        return scene.camera.limited(pixels)
    (top, bottom), (left, right) = (
        (int(np.flatnonzero(side)[0]) - 1, int(np.flatnonzero(side)[-1]) + 2) for side in (seen.any(1), seen.any(0))
    )
    times = pixels / max(bottom - top, right - left)
    width, height = round((right - left) * times), round((bottom - top) * times)
    return small.resampled(width, height, (1.0 / times, 1.0 / times), (left, top))
