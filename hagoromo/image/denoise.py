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
    """Values (height, width, channels) of an image in linear light without their noise, as far as it can be guessed.

    layers: of the image, with its albedo and normal. `InputError` for none, and where Open Image Denoise is missing.
    """
    network = denoiser()
    if layers is None:
        raise InputError("the image has no layers of albedo and normal, which denoising needs: render it with layers")
    albedo, normal = (
        np.stack([layers[f"{layer}.{name}"] for name in names], axis=-1).astype(np.float32)
        for layer, names in (("albedo", "RGB"), ("normal", "XYZ"))
    )
    scale = max(float(np.abs(values).max(initial=0.0)), 1e-30)
    parts = []
    for first in range(0, values.shape[-1], 3):  # of three channels, the last ones with copies of the last
        index = np.minimum(np.arange(first, first + 3), values.shape[-1] - 1)
        colour = np.ascontiguousarray(np.maximum(values[..., index] / scale, 0.0), np.float32)
        clean = network.denoise(colour, albedo=np.clip(albedo, 0.0, 1.0), normal=normal, hdr=True)
        parts.append(np.asarray(clean)[..., : min(3, values.shape[-1] - first)])
    return (np.concatenate(parts, axis=-1) * scale).astype(np.float32)
