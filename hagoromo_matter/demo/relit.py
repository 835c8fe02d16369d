"""Relit view: the samples rendered with the measured reflectances under a held-out lamp, and their photograph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import camera_white, srgb_from_camera
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.image.picture.compare import compare
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.colour import srgb_encode
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_page.report.display import exposure

RIM_PX = 3  # pixels


@dataclass(frozen=True, eq=False)
class Relit:
    """Linear sRGB (height, width, 3) of prediction and photograph, 1 being a white diffuser that faces the lamp.

    mask: pixels that are compared. measured, ideal: differences from the photograph, of the prediction and of a
    rendering with the true reflectances; the latter come from noise, demosaicing and the RGB approximation of spectra.
    """

    predicted: NDArray[np.float64]
    photograph: NDArray[np.float64]
    mask: NDArray[np.bool_]
    measured: Mapping[str, Any]
    ideal: Mapping[str, Any]

    def pictures(self) -> dict[str, NDArray[np.uint8]]:
        """photograph, predicted, and their difference: grey is none, ten times enlarged."""
        scale = exposure(self.photograph, self.mask)
        shift = np.where(self.mask[..., None], 10.0 * scale * (self.predicted - self.photograph), 0.0)
        return {
            "photograph": srgb_encode(self.photograph * scale),
            "predicted": srgb_encode(self.predicted * scale),
            "difference": np.rint(255.0 * np.clip(0.5 + 0.5 * shift, 0.0, 1.0)).astype(np.uint8),
        }

    def write(self, folder: Path) -> None:
        """predicted.exr, photograph.exr, mask.png (for `hagoromo compare`) and the pictures as PNG."""
        folder.mkdir()
        for name in ("predicted", "photograph"):
            channels = dict(zip(("R", "G", "B"), np.moveaxis(getattr(self, name), 2, 0), strict=True))
            scale = "linear sRGB, 1 is a white diffuser that faces the lamp"
            write_exr(folder / f"{name}.exr", channels, {"colour_space": scale})
        write_png(folder / "mask.png", self.mask.astype(np.uint8) * 255)
        for name, picture in self.pictures().items():
            write_png(folder / f"{name}.png", picture)


def relit(
    scene: Scene,
    reflectances: Mapping[str, Reflectance],
    photograph: Photograph,
    mask: NDArray[np.bool_],
    settings: Settings,
) -> Relit:
    """Prediction of `photograph` of the `scene` from `reflectances`, which have the names of its surfaces.

    mask: (height, width), true on the samples; RIM_PX pixels along its edge are not compared, because they contain both
    sample and background.
    """
    from scipy.ndimage import binary_erosion

    response, lamps = scene.camera.response, photograph.lamps
    assert response is not None
    mask = np.asarray(binary_erosion(mask, iterations=RIM_PX), np.bool_) & photograph.mask
    measured = [replace(surface, reflectance=reflectances[surface.name]) for surface in scene.surfaces]
    alone = scene.with_lamps(*lamps)
    # ρ of a white diffuser (f = 1/π) that faces the lamp from the middle of the samples
    _, irradiance = lamps[0].direction_and_irradiance(np.mean([s.pose[:3, 3] for s in scene.surfaces], axis=0))
    diffuser = float(irradiance) * camera_white(lamps[0].spectrum, response) / np.pi
    matrix = srgb_from_camera(response, lamps[0].spectrum)
    matrix = matrix / (matrix @ diffuser)[:, None]
    views = [
        render(alone_scene, settings).expose(response) @ matrix.T
        for alone_scene in (replace(alone, surfaces=tuple(measured)), alone)
    ]
    taken = photograph.values.astype(np.float64) @ matrix.T
    compared = [compare(view, taken, mask, peak=1.0).record() for view in views]
    return Relit(views[0], taken, mask, *compared)
