"""The rows of a COLMAP model, the same in text and binary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class ColmapCamera(NamedTuple):
    """A row of `cameras`: number, model by name, size [px], parameters as the model orders them [px, or 1]."""

    number: int
    model: str
    width: int
    height: int
    parameters: Sequence[float]


class ColmapImage(NamedTuple):
    """A row of `images`: file name, its camera's number, world-to-camera (w, x, y, z) and translation."""

    name: str
    camera: int
    quaternion: Sequence[float]
    translation: Sequence[float]
