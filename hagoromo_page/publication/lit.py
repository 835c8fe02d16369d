"""Pictures of a measured object under far white lamps, from its own reflectance: relightable formats fit them.

Enters: SurfaceMaps, directions to lamps in the page's axes (x right, y up, z to the eye). Leaves: display values.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo.light.colour import srgb_curve
from hagoromo.reflectance.element import element_weights
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo_page.publication.surface_maps import SurfaceMaps

NARROWEST = 1e-3  # rad, of a highlight: what is unknown has a width of 0
Array = NDArray[Any]


def hemisphere(count: int, lowest: float = 0.15) -> Array:
    """(count, 3) unit directions spread evenly by the golden angle, z from `lowest` to 1."""
    k = np.arange(count) + 0.5
    z = 1.0 - (1.0 - lowest) * k / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def white_level(maps: SurfaceMaps) -> float:
    """π α c_b that is shown as white: the 99th percentile of the body colour, at least that of a reflectance of 0.1."""
    return max(float(np.percentile(np.pi * maps.body[maps.known].max(axis=1), 99.0)), 0.1)


def colour_factor(maps: SurfaceMaps) -> float:
    """What body colours are multiplied by for formats that hold 0…1: 1, or less where they are beyond it.

    Under lamps whose strength nobody stated only ratios of the colours are known, and white may be far from 1.
    """
    return min(1.0 / white_level(maps), 1.0)


def reflected(maps: SurfaceMaps, to_lamp: Array) -> Array:
    """(h, w, 3) linear values under a far lamp of irradiance π that is as white as the interface; no cast shadows."""
    known = maps.known
    ray = _to_eye(maps)[known]
    vectors = _vector(maps.normals[known]), _vector(np.broadcast_to(to_lamp, ray.shape)), _vector(ray)
    labels, colours = maps.labels[known], three_channels(maps.body)[known]
    values = np.zeros((len(labels), 3))
    for number, material in enumerate(maps.materials):
        if (labels == number).any():
            body, interface = _weights(maps, material, vectors)
            lit = body[:, None] * colours + interface[:, None] * three_channels(np.array(material.interface_colour))
            values = np.where((labels == number)[:, None], lit, values)
    result = np.zeros((*known.shape, 3))
    result[known] = np.pi * values
    return result


def _weights(maps: SurfaceMaps, material: MaterialEstimate, vectors: tuple[Any, Any, Any]) -> tuple[Array, Array]:
    """Weights of body, for α = 1, and interface (P,) [1/sr] of the known pixels, if all were of a material.

    vectors: normals, directions to the lamp and to the eye. Pixels have their own gloss where it is known.
    """
    known = maps.known
    beta = material.beta if maps.beta is None else maps.beta[known]
    gamma = material.gamma if maps.gamma is None else maps.gamma[known]
    nu: Any = material.nu
    if maps.tail is not None:
        tail = maps.tail[known]
        nu = _real(np.where(tail > 0.0, 1.0 / np.maximum(tail, 1e-6), np.inf))
    first, *further = [(_real(b), _real(np.maximum(g, NARROWEST))) for b, g in material.all_lobes(beta, gamma)]
    whole = element_weights("plane", *vectors, 1.0, *first, material.n, nu, material.body_law)
    interface = whole.interface
    for one in further:
        interface = interface + element_weights("plane", *vectors, 0.0, *one, material.n).interface
    return np.array(whole.body), np.array(interface)


def shown(values: Array, white: float) -> Array:
    """Display values 0…1 (sRGB curve) of linear ones, as the viewers of these formats expect."""
    return srgb_curve(np.clip(values / white, 0.0, 1.0))


def _to_eye(maps: SurfaceMaps) -> Array:
    """(h, w, 3) unit vectors to the camera."""
    ray = rays_to_eye(maps)
    return ray / np.linalg.norm(ray, axis=2, keepdims=True)


def rays_to_eye(maps: SurfaceMaps) -> Array:
    """(h, w, 3) vectors to the camera in the page's axes, from 1 m in front of it along its axis."""
    height, width = maps.labels.shape
    camera = maps.camera
    x = (np.arange(width) + 0.5 - camera.principal[0]) / camera.focal[0]
    y = (np.arange(height) + 0.5 - camera.principal[1]) / camera.focal[1]
    return np.stack([*np.broadcast_arrays(-x[None], y[:, None]), np.ones((height, width))], axis=2)


def _real(values: Any) -> Any:
    """Numbers, or one of all pixels, on the device."""
    return column(arrays().Float, np.asarray(values, np.float32))


def _vector(values: Array) -> Any:
    return arrays().Array3f(*(_real(each) for each in values.T))


def three_channels(values: Array) -> Array:
    """Three channels, of one or more."""
    return values if values.shape[-1] == 3 else np.repeat(values.mean(axis=-1, keepdims=True), 3, axis=-1)
