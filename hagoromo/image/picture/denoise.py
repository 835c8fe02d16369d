"""Denoising by Open Image Denoise, with albedo and normal of what is seen. It is a guess by a network that
was trained on other pictures: it invents and removes detail, so that it is never done by itself, and is marked.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module, metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

EXTRA = "Open Image Denoise is missing: pip install 'hagoromo[denoise]'"
BORDER = 32  # pixels that are added on every side: the network has seen nothing beyond the edge of a picture


def denoiser() -> Any:
    """The module of the denoiser; `InputError` where it is not installed."""
    try:
        return import_module("pyoidn")
    except (ImportError, OSError) as error:
        raise InputError(EXTRA) from error


def name_of_denoiser() -> str:
    """Its name and version; `InputError` where it is not installed."""
    denoiser()
    return f"Open Image Denoise, pyoidn {metadata.version('pyoidn')}"


def denoised(layers: Mapping[str, NDArray] | None, values: NDArray) -> NDArray[np.float32]:
    """Values (height, width, channels) of an image in linear light without most of their noise.

    layers: of the image, with its albedo and normal. `InputError` for none, and where Open Image Denoise is missing.
    The network sees the picture with its reflection around it, so that its edge is as smooth as its middle.
    """
    network = denoiser()
    if layers is None:
        raise InputError("the image has no layers of albedo and normal, which denoising needs: render it with layers")
    albedo, normal = (
        _with_border(np.stack([layers[f"{layer}.{name}"] for name in names], axis=-1))
        for layer, names in (("albedo", "RGB"), ("normal", "XYZ"))
    )
    scale = max(float(np.abs(values).max(initial=0.0)), 1e-30)
    parts = []
    for first in range(0, values.shape[-1], 3):  # of three channels, the last ones with copies of the last
        index = np.minimum(np.arange(first, first + 3), values.shape[-1] - 1)
        colour = _with_border(np.maximum(values[..., index] / scale, 0.0))
        clean = network.denoise(colour, albedo=np.clip(albedo, 0.0, 1.0), normal=normal, hdr=True)
        inside = np.asarray(clean)[BORDER:-BORDER, BORDER:-BORDER]
        parts.append(inside[..., : min(3, values.shape[-1] - first)])
    return (np.concatenate(parts, axis=-1) * scale).astype(np.float32)


def _with_border(values: NDArray) -> NDArray[np.float32]:
    """Values (height, width, 3) with BORDER pixels of their reflection on every side."""
    return np.ascontiguousarray(np.pad(values, ((BORDER, BORDER), (BORDER, BORDER), (0, 0)), "reflect"), np.float32)
