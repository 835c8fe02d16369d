"""Relit: a photograph that was kept aside, and what the measured surface gives under its lamp and through its camera.

Two predictions: the volume boxes rendered, shadows and all; and the reflectance on the normals, pixel by pixel in the
picture, which knows no shadow and no other view: it tells what the boxes lose or win.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.display import srgb_from_camera
from hagoromo.app.relight.stage import Stage
from hagoromo.camera.response import camera_white, response_matrix
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import ForeignRecord, WrittenBy, about, written_by
from hagoromo.image.compare import compare
from hagoromo.image.render import render
from hagoromo.image.scene_file import load_scene
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.sight import sight
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.spectra.body_basis import body_basis

RELIEF_RIM_PX = 1  # px along the edge of the relief, whose skin a ray may miss there
PAGE_WHITE_PERCENTILE = 99.0  # of the photograph's brightest channel: white on the page and to `compare`
LEAST_COVERAGE = 0.99  # of a pixel by the boxes, to be compared
Array = NDArray[np.float64]
PREDICTIONS = {"boxes": "volume boxes, rendered", "normals": "reflectance on the normals, no shadows"}


class RelitRecord(ForeignRecord, frozen=True, kw_only=True):
    """One photograph of relit.json."""

    photograph: Annotated[str, about("name of the photograph that was kept aside")]
    white: Annotated[float, about("value of the photograph that is white on the page and in the comparison")]
    lamps: Annotated[list[str], about("its lamps, in words")]
    compared: Annotated[dict[str, dict[str, Any]], about("difference of each prediction from the photograph")]
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


@dataclass(frozen=True, eq=False)
class Relit:
    """Linear sRGB (h, w, 3), 1 being `white`; of the camera's values where its response is not known.

    predictions: of PREDICTIONS, those that there are. mask: what is compared. compared: `compare` of each prediction.
    lamps: of the photograph, in words. number: of its files.
    """

    name: str
    number: int
    photograph: Array
    predictions: Mapping[str, Array]
    mask: NDArray[np.bool_]
    compared: Mapping[str, Mapping[str, Any]]
    white: float
    lamps: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """Plain figures."""
        return {
            "photograph": self.name,
            "white": self.white,
            "lamps": list(self.lamps),
            "compared": dict(self.compared),
            "hagoromo": written_by(),
        }


def relit(stage: Stage, photograph: Photograph, number: int) -> Relit:
    """Predict `photograph`, and write scene, pictures and figures of its `number` to the stage's folder.

    `InputError` for a photograph without a lamp, or one that shows nothing of the surface.
    """
    from scipy.ndimage import binary_erosion

    if not photograph.lamps:
        raise InputError(f"photograph {photograph.name!r} has no lamp: it cannot be predicted")
    scene, settings = load_scene(stage.write_scene(photograph, number))
    image = render(scene, settings)
    response = scene.camera.response
    assert response is not None
    predictions = {"boxes": image.expose(response).astype(np.float64)}
    mask = photograph.mask & (image.alpha > LEAST_COVERAGE)
    camera, measured_camera = photograph.camera, stage.camera
    if mask.shape == stage.relief.labels.shape and np.allclose(camera.matrix, measured_camera.matrix, rtol=1e-6):
        predictions["normals"] = _on_normals(stage, photograph)
        mask &= stage.relief.known()
    mask = np.asarray(binary_erosion(mask, iterations=RELIEF_RIM_PX), np.bool_)
    if not mask.any():
        raise InputError(f"photograph {photograph.name!r} shows nothing of the measured surface: check its camera")
    matrix = np.eye(3)
    if camera.response is not None:
        matrix = srgb_from_camera(camera.response, photograph.lamps[0].spectrum)
    shown = photograph.values.astype(np.float64) @ matrix.T
    white_value = float(np.percentile(shown[mask].max(axis=1), PAGE_WHITE_PERCENTILE))
    if not white_value > 0.0:
        raise InputError(f"photograph {photograph.name!r} is black where the surface is: nothing can be compared")
    pictures = {"photograph": shown / white_value} | {
        key: value @ matrix.T / white_value for key, value in predictions.items()
    }
    for key, picture in pictures.items():
        stem = stage.home / f"{'predicted' if key == 'boxes' else key}_{number:02d}"
        layers = dict(zip("RGB", np.moveaxis(picture.astype(np.float32), 2, 0), strict=True))
        write_exr(
            stem.with_suffix(".exr"), layers, {"colour_space": f"linear sRGB, 1 is {white_value:g} of the photograph"}
        )
        write_png(stem.with_suffix(".png"), srgb_encode(picture))
    write_png(stage.home / f"mask_{number:02d}.png", mask.astype(np.uint8) * 255)
    compared = {key: compare(*_files(stage, key, number), peak=1.0).record() for key in predictions}
    shown = pictures.pop("photograph")
    lamps = tuple(_words(lamp) for lamp in photograph.lamps)
    return Relit(photograph.name, number, shown, pictures, mask, compared, white_value, lamps)


def _files(stage: Stage, key: str, number: int) -> tuple[Any, Any, Any]:
    """Prediction, photograph and mask."""
    name = "predicted" if key == "boxes" else key
    names = (f"{name}_{number:02d}.exr", f"photograph_{number:02d}.exr", f"mask_{number:02d}.png")
    first, second, third = (stage.home / file for file in names)
    return first, second, third


def _on_normals(stage: Stage, photograph: Photograph) -> Array:
    """(h, w, 3) values by the reflectance on the normals; 0 where the surface is not known."""
    relief, known = stage.relief, stage.relief.known()
    values, matrix = np.zeros(photograph.values.shape), np.eye(3)
    response, lamp = photograph.camera.response, photograph.lamps[0].spectrum
    if stage.spectrum is not None and response is not None:  # the body under this lamp, not those it was measured under
        basis = body_basis(stage.camera.response, stage.spectrum)
        matrix = response_matrix(basis, lamp, response) / camera_white(lamp, response)[:, None]
    for label, material in enumerate(stage.materials):
        pixels = known & (relief.labels == label)
        if not pixels.any():
            continue
        geometry = sight(
            photograph, relief.points[pixels].astype(np.float64), relief.normals[pixels].astype(np.float64)
        )
        width, index = np.array([np.log(material.gamma)]), np.array([np.log(material.n - 1.0)])
        facing = ((material.n - 1.0) / (material.n + 1.0)) ** 2
        values[pixels] = (
            geometry.body * (relief.body[pixels] @ matrix.T)
            + material.beta * facing * geometry.interface(width, index)[0][0]
        )
    return values


def _words(lamp: Any) -> str:
    where = lamp.position if lamp.position is not None else lamp.to_lamp
    kind = "at" if lamp.position is not None else "towards"
    unit = " m" if lamp.position is not None else ""
    return f"{lamp.name or 'lamp'} {kind} ({', '.join(f'{x:.3g}' for x in where)}){unit}"
