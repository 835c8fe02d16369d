"""Photographs that a picture is held against, and cameras to jump to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_views
from hagoromo.camera.response import srgb_from_camera
from hagoromo.light.colour import delta_e_2000
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo_page.viewer.view_state import POSE_KEYS, ViewState

LARGEST_DIFFERENCE = 20.0  # ΔE00 that is shown white
LENS_KEYS = ("preset", "focal_mm", "file", "size", "focal", "principal", "distortion", "binning", *POSE_KEYS)


@dataclass(frozen=True, eq=False)
class Against:
    """A camera, and what it photographed: linear sRGB (height, width, 3), None where only the camera is known."""

    name: str
    camera: Camera
    linear: NDArray[np.float64] | None = None


def photographs_of(path: Path) -> list[Against]:
    """Those of a capture (a folder with transforms.json); of any other file of cameras, the cameras alone."""
    if (path / "transforms.json").is_file():
        return [Against(one.name, one.camera, _linear(one)) for one in load_capture(path).photographs]
    return [Against(name or str(k), camera) for k, (name, camera) in enumerate(read_views(path).items())]


def through(state: ViewState, camera: Camera) -> ViewState:
    """The state through another camera: its lens and place; the response stays."""
    kept = {key: value for key, value in state.tables["camera"].items() if key not in LENS_KEYS}
    lens: dict[str, Any] = {
        "size": [camera.width, camera.height], "focal": list(camera.focal), "principal": list(camera.principal),
        "distortion": list(camera.distortion), "world_to_camera": camera.world_to_camera.ravel().tolist(),
    }  # fmt: skip
    return state.with_value(("camera",), kept | lens)


def as_bright(photograph: NDArray[np.float64], picture: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """The photograph in the picture's size, times the factor that brings it nearest to the picture, and that factor.

    Least squares over all values: their units differ where the strength of the lamps was not measured.
    """
    import cv2

    height, width = picture.shape[:2]
    small = np.asarray(cv2.resize(photograph, (width, height), interpolation=cv2.INTER_AREA), np.float64)
    power = float((small * small).sum())
    factor = float((small * picture).sum()) / power if power > 0.0 else 1.0
    return small * factor, factor


def wiped(photograph: NDArray[np.uint8], picture: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """The photograph on the left `share` of the width, the picture on the rest."""
    columns = np.arange(picture.shape[1]) < share * picture.shape[1]
    return np.where(columns[:, None], photograph, picture)


def difference_map(photograph: NDArray[np.float64], picture: NDArray[np.float64]) -> NDArray[np.uint8]:
    """ΔE00 of linear sRGB, 0 black, LARGEST_DIFFERENCE and more white."""
    share = np.clip(delta_e_2000(photograph, picture) / LARGEST_DIFFERENCE, 0.0, 1.0)
    return np.repeat(np.round(255.0 * share).astype(np.uint8)[..., None], 3, axis=2)


def _linear(photograph: Photograph) -> NDArray[np.float64]:
    """Linear sRGB with the light of the first lamp as white; of a camera of unknown response, its values."""
    values = np.asarray(photograph.values, np.float64)
    if values.shape[2] == 1:
        values = np.repeat(values, 3, axis=2)
    response = photograph.camera.response
    if response is None or values.shape[2] != 3 or len(response.channels) != 3:
        return values[..., :3]
    lamp = photograph.lamps[0].spectrum if photograph.lamps else Spectrum.constant(1.0)
    return values @ srgb_from_camera(response, lamp).T
