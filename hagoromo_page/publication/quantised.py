"""Quantised maps: the maps of a page as whole numbers, fine enough that no pixel of the picture shows the steps.

A step of the normal turns the highlight by δ; where a highlight of half width γ passes through white, an 8-bit display
value changes by at most STEEPEST · δ/γ. Bits are chosen so that it changes by less than half a step of the display.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.inspection.map_files import end_of_curvature, end_of_occlusion
from hagoromo_page.publication.planes import Plane
from hagoromo_page.publication.surface_maps import Map, SurfaceMaps

STEEPEST = 0.42 * 3.1 * 255  # 8-bit values per δ/γ: sRGB's slope at white times the lobe's, of a peak 30 times white
STRETCH = 1.8  # largest angle [rad] that half a step of an octahedral normal turns it by, times 2^bits
LEAST_BITS, MOST_BITS = 14, 16  # of a normal; at the terminator sRGB is 13 times as steep as in the light
BODY_BITS, GLOSS_BITS, TAIL_BITS, ERROR_BITS = 10, 12, 8, 8
CLOSE_TOP = 255  # of curvature and occlusion; 0 is unknown
CLOSE = ("curvature", "occlusion")
WIDTH_TOP, WIDTH_OCTAVES = 127, 16  # of errors by the width of pixels: steps of 9 %; 0 is none
LEAST_ERROR = 1e-5  # of the logarithmic scales of errors
ERROR_ENDS = (1.0, 99.0)  # % of the pixels whose errors are below each end of a scale: few wild ones do not stretch it


@dataclass(frozen=True, eq=False)
class Quantised:
    """planes: by name. scales: how the page makes values of them again."""

    planes: dict[str, Plane]
    scales: dict[str, Any]


def quantised(maps: SurfaceMaps, scales: dict[str, Any] | None = None) -> Quantised:
    """The maps as planes: u, v (octahedral normal), label, body0 … (square roots), depth, beta and gamma (logarithms) …

    scales: those of other maps of the same object, which are then used.
    """
    known = maps.known
    scales = scale_of(maps) if scales is None else scales
    u, v = octahedral(maps.normals)
    levels = (1 << scales["normal_bits"]) - 1
    planes = {"u": _whole((u + 1.0) / 2.0 * levels), "v": _whole((v + 1.0) / 2.0 * levels)}
    planes["label"] = np.where(known, maps.labels + 1, 0).astype(np.uint16)
    top = (1 << BODY_BITS) - 1
    for channel in range(maps.body.shape[2]):
        share = np.clip(maps.body[..., channel] / scales["body"], 0.0, 1.0)
        planes[f"body{channel}"] = _whole(np.sqrt(share) * top)
    if maps.depth is not None and "depth" in scales:
        low, high = scales["depth"]
        planes["depth"] = _whole(np.clip((maps.depth - low) / (high - low), 0.0, 1.0) * 65535)
    for name, bits in (("beta", GLOSS_BITS), ("gamma", GLOSS_BITS)):
        if name in scales:
            planes[name] = _logarithmic(getattr(maps, name), scales[name], bits)
    if maps.tail is not None and "tail" in scales:
        low, high = scales["tail"]
        planes["tail"] = _whole(np.clip((maps.tail - low) / (high - low), 0.0, 1.0) * ((1 << TAIL_BITS) - 1))
    for name in CLOSE:
        if name in scales:
            low, high = scales[name]
            value = getattr(maps, name)
            share = np.clip((np.nan_to_num(value) - low) / (high - low), 0.0, 1.0)
            planes[name] = np.where(np.isfinite(value), 1 + np.rint(share * (CLOSE_TOP - 1)), 0).astype(np.uint16)
    if maps.width is not None and "width" in scales:
        low, high = scales["width"]
        share = np.log2(np.maximum(maps.width, low) / low) / np.log2(high / low)
        planes["width"] = np.where(maps.width > low, 1 + np.rint(share * (WIDTH_TOP - 1)), 0).astype(np.uint16)
    for name in ("normal_error", "body_error", "gloss_error"):
        if name in scales:
            planes[name] = _logarithmic(getattr(maps, name), scales[name], ERROR_BITS)
    return Quantised(planes, scales)


def scale_of(maps: SurfaceMaps) -> dict[str, Any]:
    """Bits of the normals and ranges of the other planes."""
    known = maps.known
    narrowest = [min(width for _, width in one.all_lobes(1.0, 1.0)) for one in maps.materials]  # lobe, in γ
    widths = [one.gamma * least for one, least in zip(maps.materials, narrowest, strict=True) if one.beta > 0.0]
    if maps.gamma is not None:
        widths = maps.gamma[known] * np.array(narrowest)[maps.labels[known]]
    gamma = float(np.percentile(widths, 1)) if len(widths) else math.pi / 2
    bits = math.ceil(math.log2(STRETCH * STEEPEST * 2.0 / max(gamma, 1e-4)))
    scales: dict[str, Any] = {
        "normal_bits": min(max(bits, LEAST_BITS), MOST_BITS),
        "body": float(max(maps.body[known].max(), 1e-6)),
        "body_bits": BODY_BITS,
        "channels": maps.body.shape[2],
    }
    if maps.depth is not None:
        low, high = float(maps.depth[known].min()), float(maps.depth[known].max())
        scales["depth"] = [low, high if high > low else low * (1.0 + 1e-6)]
    if maps.curvature is not None and maps.occlusion is not None:
        end = end_of_curvature(maps.curvature)
        scales |= {"curvature": [-end, end], "occlusion": [end_of_occlusion(maps.occlusion), 1.0]}
    if maps.width is not None and maps.depth is not None and (maps.width[known] > 0.0).any():
        high = float(maps.width[known].max())
        scales |= {"width": [high / 2.0**WIDTH_OCTAVES, high], "width_top": WIDTH_TOP}
    for name in ("beta", "gamma"):
        values = getattr(maps, name)
        if values is not None:
            scales[name] = _log_range(np.maximum(values[known], 1e-9))
    if maps.tail is not None:
        low, high = float(maps.tail[known].min()), float(maps.tail[known].max())
        scales["tail"] = [low, max(high, low + 1e-6)]
    for name in ("normal_error", "body_error", "gloss_error"):
        values = getattr(maps, name)
        if values is not None and (values[known] > 0.0).any():
            stated = np.maximum(values[known][values[known] > 0.0], LEAST_ERROR)
            scales[name] = _log_range(np.percentile(stated, ERROR_ENDS))
    return scales


def octahedral(normals: Map) -> tuple[Map, Map]:
    """Unit vectors (..., 3) as two numbers in −1 … 1 (Meyer et al. 2010, "On floating-point normal vectors")."""
    x, y, z = np.moveaxis(normals / np.maximum(np.abs(normals).sum(axis=-1, keepdims=True), 1e-12), -1, 0)
    sign = lambda t: np.where(t < 0.0, -1.0, 1.0)  # noqa: E731
    behind = z < 0.0
    return np.where(behind, (1.0 - np.abs(y)) * sign(x), x), np.where(behind, (1.0 - np.abs(x)) * sign(y), y)


def _log_range(values: Map) -> list[float]:
    low, high = float(values.min()), float(values.max())
    return [low, max(high, low * 1.000001)]


def _logarithmic(values: Map, limits: list[float], bits: int) -> Plane:
    low, high = limits
    share = np.log(np.clip(values, low, high) / low) / math.log(high / low)
    return _whole(share * ((1 << bits) - 1))


def _whole(values: Map) -> NDArray[np.uint16]:
    return np.rint(values).astype(np.uint16)
