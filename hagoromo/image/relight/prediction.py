"""Prediction: a photograph that was held out, and what the measured surface gives under its lamp in its camera.

There are five predictions: the volume boxes, rendered with their shadows; the reflectance on the normals, computed for
each pixel without shadows and for the measured view only, which shows what the boxes gain or lose; where the shape was
solved, both with what the photographs that were measured teach of shadows and misfit (`learnt`), and least-squares
Lambert on them, a yardstick. With a rig all are times its field, and Lambert is given without it and with it.

In the measured view every pixel of the object is compared, also where the boxes miss it; in another view those that the
boxes cover, but for their rim. Where the photograph is clipped, it and the predictions are cut off at its white.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import camera_white, response_matrix, srgb_from_camera
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import ForeignRecord, WrittenBy, about, written_by
from hagoromo.image.picture.compare import Comparison, compare
from hagoromo.image.relight.forecast import ShownLight
from hagoromo.image.relight.learnt import Learnt
from hagoromo.image.relight.stage import Stage
from hagoromo.image.render import render
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import srgb_encode
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.material.material_objective import interface_of
from hagoromo.measurement.normals.views import DARK, Views
from hagoromo.measurement.sight import light_of, sight_of
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.spectra.body_basis import body_basis

RELIEF_RIM_PX = 1  # [px] ignored along the edge of the boxes in another view than the measured one
PAGE_WHITE_PERCENTILE = 99.0  # percentile of the photograph's brightest channel that is the white of the pictures
LEAST_COVERAGE = 0.99  # least coverage of a pixel by the boxes for it to be compared in another view
Array = NDArray[np.float64]
BESIDE_HULL = 1e-3  # [rad] a lamp that is nearer to the hull of the others is among them
LEAST_LIT = 1e-3  # of the brightest pixel: a darker one does not show what share of the light passes
MOST_PASSED = 10.0  # of the light of the normals: boxes are brighter where voxels round an edge off
CLIPPED = 0.98  # of the largest valid value: masked values from there on are clipped, and compared
PREDICTIONS = {
    "boxes": "volume boxes, rendered",
    "boxes_learnt": "volume boxes, with shadows and misfit learnt from the photographs measured",
    "normals": "reflectance on the normals, no shadows",
    "learnt": "reflectance on the normals, with shadows and misfit learnt from the photographs measured",
    "lambert": "least-squares Lambert, a yardstick",
    "lambert_rig": "least-squares Lambert, lamps evened by the rig",
}
FILE_STEMS = {
    "boxes": "predicted",
    "boxes_learnt": "predicted_learnt",
    "normals": "normals",
    "learnt": "learnt",
    "lambert": "lambert",
    "lambert_rig": "lambert_rig",
}  # names of their files


class PredictionRecord(ForeignRecord, frozen=True, kw_only=True):
    """One photograph of relit.json."""

    photograph: Annotated[str, about("name of the photograph that was held out")]
    white: Annotated[float, about("value of the photograph that is white on the page and in the comparison")]
    lamps: Annotated[list[str], about("description of each lamp")]
    compared: Annotated[dict[str, dict[str, Any]], about("difference of each prediction from the photograph")]
    object_pixels: Annotated[int | None, about("pixels of the object; those compared are covered by the boxes")] = None
    expected_error: Annotated[
        float | None, about("relative error of the boxes, with what was learnt, that photographs left out let expect")
    ] = None
    outside_deg: Annotated[
        float | None, about("angle of the lamp from the hull of the lamps measured [°]; 0: in it")
    ] = None
    linearity: Annotated[
        dict[str, Any] | None, about("what the shading says about the transfer of what was measured; null: not tested")
    ] = None
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """A photograph that was held out, and its predictions.

    source: the photograph, of this name; its files have this number. photograph: (h, w, 3) linear sRGB, 1 being the
    value `white` of the photograph; values of the camera where its response is not known. predictions: key of
    PREDICTIONS → (h, w, 3) likewise; all but "boxes" only for the measured view. mask: (h, w) pixels that are
    compared, of object_pixels that the photograph shows of the object. compared: key of PREDICTIONS → its difference
    from the photograph. lamps: description of each lamp. expected: relative error of the boxes with what was learnt
    that photographs left out let expect of a lamp so far `outside` the hull of those measured [rad]; None: unknown.
    shown: what these boxes show per unit of irradiance; None where nothing was learnt of them.
    """

    name: str
    number: int
    source: Photograph
    photograph: Array
    predictions: Mapping[str, Array]
    mask: NDArray[np.bool_]
    compared: Mapping[str, Comparison]
    white: float
    lamps: tuple[str, ...]
    object_pixels: int
    expected: float | None = None
    outside: float | None = None
    shown: ShownLight | None = None

    @property
    def of_boxes(self) -> str:
        """Key of what the volume boxes predict: with what was learnt, where photographs taught it."""
        return "boxes_learnt" if "boxes_learnt" in self.predictions else "boxes"

    def __repr__(self) -> str:
        figures = self.compared[self.of_boxes]
        return (
            f"Prediction({self.name[:40]!r}: relative rmse {100 * figures.relative_rmse:.1f} %, "
            f"ΔE00 {figures.delta_e_2000:.2f})"
        )

    @property
    def forecast(self) -> str:
        """What was expected, in words; "" where nothing was."""
        if self.expected is None or self.outside is None:
            return ""
        where = f"{math.degrees(self.outside):.2g}° outside" if self.outside > BESIDE_HULL else "among"
        return f"{100 * self.expected:.1f} % were expected of a lamp {where} those measured"

    def record(self) -> dict[str, Any]:
        """Its entry in relit.json."""
        return {
            "photograph": self.name,
            "white": self.white,
            "lamps": list(self.lamps),
            "compared": {key: figures.record() for key, figures in self.compared.items()},
            "object_pixels": self.object_pixels,
            "expected_error": self.expected,
            "outside_deg": None if self.outside is None else math.degrees(self.outside),
            "hagoromo": written_by(),
        }

    def write_into(self, folder: Path) -> None:
        """Write photograph_NN and the FILE_STEMS of the predictions, each as EXR and PNG, and mask_NN.png."""
        pictures = {"photograph": self.photograph} | {
            FILE_STEMS[key]: picture for key, picture in self.predictions.items()
        }
        header = {"colour_space": f"linear sRGB, 1 is {self.white:g} of the photograph"}
        for stem, picture in pictures.items():
            path = folder / f"{stem}_{self.number:02d}.exr"
            write_exr(path, dict(zip("RGB", np.moveaxis(picture.astype(np.float32), 2, 0), strict=True)), header)
            write_png(path.with_suffix(".png"), srgb_encode(picture))
        write_png(folder / f"mask_{self.number:02d}.png", self.mask.astype(np.uint8) * 255)


def predict(
    stage: Stage,
    photograph: Photograph,
    number: int,
    home: Path,
    yardsticks: Mapping[str, Array] | None = None,
    learnt: Mapping[str, Learnt] | None = None,
    field: NDArray[np.floating] | None = None,
) -> Prediction:
    """Render the boxes of `stage`, whose files are in the folder `home`, as `photograph` shows them.

    The scene is written to `home` under the `number` of the photograph. yardsticks: their values (h, w, C), and learnt:
    by its key of PREDICTIONS, both of the measured view. field: (h, w, C) of the rig, by which lamps in this view are
    uneven.
    `InputError` for a photograph without a lamp, or one that shows nothing of the surface.
    """
    if not photograph.lamps:
        raise InputError(f"photograph {photograph.name!r} has no lamp: add its lamp, or do not hold it out")
    of_measured_view, learnt = stage.was_measured_in(photograph.camera), learnt or {}
    alone = [replace(photograph, lamps=(lamp,)) for lamp in photograph.lamps]
    several = of_measured_view and "boxes_learnt" in learnt and len(alone) > 1
    by_lamp = [rendered(stage, one, number, home)[0] for one in alone] if several else []
    boxes, covered = rendered(stage, photograph, number, home)  # last: its scene stays
    values, by_boxes = {"boxes": boxes}, None
    clipped, white = _clipped(photograph)
    shown = photograph.mask | clipped
    if of_measured_view:
        if "boxes_learnt" in learnt:
            lit, one = by_lamp or [boxes], learnt["boxes_learnt"]
            passed = [_passed(stage, *pair, one.solved.views) for pair in zip(alone, lit, strict=True)]
            values["boxes_learnt"] = _with_learnt(alone, lit, passed, one)
            by_boxes = _per_irradiance(photograph, values["boxes_learnt"], one.solved.views)
        values["normals"] = on_normals(stage, photograph)
        if "learnt" in learnt:
            lit = [on_normals(stage, one) for one in alone]
            values["learnt"] = _with_learnt(alone, lit, [1.0] * len(lit), learnt["learnt"])
        covered = stage.relief.known() | _is_lit(photograph)
    if field is not None:
        values = {key: one * field for key, one in values.items()}
    values |= yardsticks or {}
    mask = shown & (covered if of_measured_view else _without_rim(covered))
    if not mask.any():
        raise InputError(f"photograph {photograph.name!r} shows nothing of the measured surface: check its camera")
    matrix = _to_srgb(photograph)
    object_pixels = int((photograph.mask | mask).sum())
    seen = np.where(np.isfinite(photograph.values), photograph.values, 0.0).astype(np.float64)
    shown, values = np.minimum(seen, white) @ matrix.T, {key: np.minimum(one, white) for key, one in values.items()}
    level = float(np.percentile(shown[mask].max(axis=1), PAGE_WHITE_PERCENTILE))
    if not level > 0.0:
        raise InputError(f"photograph {photograph.name!r} is black where the surface is: nothing can be compared")
    shown, predictions = shown / level, {key: value @ matrix.T / level for key, value in values.items()}
    compared = {key: compare(np.float32(one), np.float32(shown), mask, 1.0) for key, one in predictions.items()}
    lamps = tuple(_described(lamp) for lamp in photograph.lamps)
    parts = photograph, shown, predictions, mask, compared, level, lamps
    return Prediction(photograph.name, number, *parts, object_pixels, shown=by_boxes)


def rendered(stage: Stage, photograph: Photograph, number: int, home: Path) -> tuple[Array, NDArray[np.bool_]]:
    """Values (h, w, 3) of the boxes as `photograph` shows them, and where they cover it; writes the scene to `home`."""
    scene, settings = load_scene(stage.write_scene(photograph, number, home))
    image, response = render(scene, settings), scene.camera.response
    assert response is not None
    return image.expose(response).astype(np.float64), image.alpha > LEAST_COVERAGE


def passed_by_boxes(stage: Stage, photographs: Sequence[Photograph], views: Views, home: Path) -> Array:
    """(K, P) share of the light that the boxes let pass in photographs of the measured view.

    Scenes are written to `home`.
    """
    return np.stack(
        [_passed(stage, one, rendered(stage, one, number, home)[0], views) for number, one in enumerate(photographs)]
    )


def _passed(stage: Stage, photograph: Photograph, boxes: Array, views: Views) -> Array:
    """(P,) share of the light in values (h, w, 3) of the boxes: of the normals'; 1 where these are dark."""
    passed, whole = (one[views.rows, views.columns].sum(axis=1) for one in (boxes, on_normals(stage, photograph)))
    bright = whole > LEAST_LIT * whole.max(initial=0.0)
    return np.where(bright, np.clip(passed / np.where(bright, whole, 1.0), 0.0, MOST_PASSED), 1.0)


def _clipped(photograph: Photograph) -> tuple[NDArray[np.bool_], float]:
    """(h, w) pixels that are masked because they are clipped, and the value at which; infinity without any."""
    seen = np.where(np.isfinite(photograph.values), photograph.values, -np.inf).max(axis=2)
    top = float(np.max(seen, where=photograph.mask, initial=0.0))
    clipped = ~photograph.mask & (seen >= CLIPPED * top) & (top > 0.0)
    return clipped, top if clipped.any() else np.inf


def _is_lit(photograph: Photograph) -> NDArray[np.bool_]:
    """(h, w) pixels whose value is above the noise."""
    value = np.where(np.isfinite(photograph.values), photograph.values, 0.0).mean(axis=2)
    noise = np.where(np.isfinite(photograph.variance), photograph.variance, np.inf).mean(axis=2)
    return np.asarray(value > DARK * np.sqrt(noise), np.bool_)


def _without_rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    from scipy.ndimage import binary_erosion

    return np.asarray(binary_erosion(mask, iterations=RELIEF_RIM_PX), np.bool_)


def _to_srgb(photograph: Photograph) -> Array:
    """(3, 3) from the values of the photograph to linear sRGB; the identity where its response is not known."""
    response = photograph.camera.response
    return np.eye(3) if response is None else srgb_from_camera(response, photograph.lamps[0].spectrum)


def on_normals(stage: Stage, photograph: Photograph) -> Array:
    """(h, w, 3) values from the reflectance on the normals; 0 where the surface is unknown."""
    relief, known = stage.relief, stage.relief.known()
    values, matrix = np.zeros(photograph.values.shape), np.eye(3)
    response, lamp = photograph.camera.response, photograph.lamps[0].spectrum
    if stage.spectrum is not None and response is not None:  # the body under this lamp, not under the measured ones
        basis = body_basis(stage.camera.response, stage.spectrum)
        matrix = response_matrix(basis, lamp, response) / camera_white(lamp, response)[:, None]
    for label, material in enumerate(stage.materials):
        region = known & (relief.labels == label)
        if not region.any():
            continue
        view = sight_of(photograph, relief.points[region].astype(np.float64), relief.normals[region].astype(np.float64))
        interface = interface_of(view, material)
        body = view.body_of(material.body_law)
        values[region] = body * (relief.body[region] @ matrix.T) + interface
    return values


def _with_learnt(
    alone: Sequence[Photograph], lit: Sequence[Array], passed: Sequence[Array | float], learnt: Learnt
) -> Array:
    """(h, w, 3) values under all lamps, with what was learnt; as they are where nothing was fitted.

    alone: the photograph under each of its lamps alone; lit: values (h, w, 3) under each; passed: share of its light,
    see `Learnt.added`.
    """
    views, whole = learnt.solved.views, np.sum(lit, axis=0)
    total = np.zeros((len(views.rows), whole.shape[2]))
    for photograph, values, share in zip(alone, lit, passed, strict=True):
        to_lamp, light = light_of(photograph.lamps[0], photograph.camera, whole.shape[2], views.points)
        light = np.maximum(light, 1e-12 * light.max())
        total += light * learnt.added((values[views.rows, views.columns] / light).T, to_lamp, share).T
    whole[views.rows, views.columns] = total
    return np.asarray(whole, np.float64)


def _per_irradiance(photograph: Photograph, values: Array, views: Views) -> ShownLight:
    """What values (h, w, 3) under all lamps of the photograph show per unit of their irradiance."""
    camera, channels = photograph.camera, values.shape[2]
    light = np.sum([light_of(lamp, camera, channels, views.points)[1] for lamp in photograph.lamps], axis=0)
    return ShownLight.of(values[views.rows, views.columns] / np.maximum(light, 1e-12 * light.max()))


def _described(lamp: Lamp) -> str:
    """`key at (0.1, 0.2, 0.3) m`, or `key towards (0, 0, 1)`."""
    figures = ", ".join(f"{x:.3g}" for x in lamp.place)
    return f"{lamp.name or 'lamp'} " + (f"at ({figures}) m" if lamp.near else f"towards ({figures})")
