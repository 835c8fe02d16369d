"""Stack page: a weight stack and its colours as what the viewer's script reads, within a number of bytes."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo_page.publication.colours import PageColours
from hagoromo_page.publication.document import Viewer, overhead
from hagoromo_page.publication.lit import Array
from hagoromo_page.publication.object_page import DISPLAY_KEY, GENTLE, ObjectPage, first_direction
from hagoromo_page.publication.planes import Plane, pack_planes
from hagoromo_page.publication.stack_basis import PackedStack, packed_stack
from hagoromo_page.publication.weight_stack import WeightStack

TRIES = 8
SMALLEST_SIDE = 16  # px
DEPTH_TOP = 65535
LENGTHS = "Lengths are those of straight lines between two places where the line of sight first meets matter."


def packed_for_page(stack: WeightStack, colours: PageColours) -> PackedStack:
    """The whole stack as a page of any size has it."""
    to_display = _to_display(colours)
    return packed_stack(stack, to_display, _exposure(stack, to_display))


def stack_page(stack: WeightStack, colours: PageColours, title: str, limit: int) -> tuple[ObjectPage, PackedStack]:
    """The page as one file of at most `limit` bytes; its picture is reduced where it must be."""
    whole, factor = stack, 1.0
    to_display = _to_display(colours)
    exposure = _exposure(whole, to_display)
    for _ in range(TRIES):
        stack = whole if factor == 1.0 else whole.reduced(factor)
        packed = packed_stack(stack, to_display, exposure)
        lengths, planes = _lengths(stack)
        text = pack_planes(packed.planes | planes, stack.known)
        data = _data(stack, packed, colours, title, exposure, factor) | lengths
        data["scales"] = packed.scales | lengths.get("scales", {})
        viewer = Viewer(data | {"tiles": [{"key": "0-0-0", "header": text.header}]}, {"0-0-0": text.text})
        rest = overhead(viewer)
        height, width = stack.alpha.shape
        if rest + len(text.text) <= limit:
            return ObjectPage(viewer, (width, height), factor), packed
        if rest >= limit or min(width, height) < SMALLEST_SIDE:
            raise InputError(f"a page of {limit} bytes is too small: give {2 * rest} or more, or fewer lamps")
        factor *= max(math.sqrt(len(text.text) / (limit - rest)) / GENTLE, 1.02)
    raise InputError(f"the picture does not fit into {limit} bytes: give more, or fewer lamps")


def _to_display(colours: PageColours) -> Array:
    """(3, P) from weights under irradiance 1 to linear display values, under the first spectrum of a lamp."""
    return math.pi * colours.balanced[0][0] @ colours.body[0][0]


def _exposure(stack: WeightStack, to_display: Array) -> float:
    """Exposure that shows the brightest half percent under the stored lamp next to the first one at DISPLAY_KEY."""
    nearest = int(np.argmax(stack.directions @ first_direction()))
    brightest = (stack.weights[:, :, nearest][stack.known] @ to_display.T).max(axis=1)
    level = float(np.percentile(brightest, 99.5))
    return DISPLAY_KEY / level if level > 0.0 else 1.0


def _data(
    stack: WeightStack, packed: PackedStack, colours: PageColours, title: str, exposure: float, factor: float
) -> dict[str, Any]:
    height, width = stack.alpha.shape
    functions = packed.functions
    return {
        "title": title,
        "about": "Rendered from a volume box under one lamp at a time; any light is a sum of these.",
        "note": f"{width} × {height} px" + (f", reduced {factor:.2f}-fold to fit" if factor > 1.001 else ""),
        "assumptions": _assumptions(stack, packed),
        "folder": False,
        "width": width,
        "height": height,
        "pixel": factor,
        "side": max(width, height),
        "levels": [{"factor": 1, "width": width, "height": height, "tiles": 1}],
        "scales": packed.scales,
        "stack": {
            "directions": [[float(f"{x:.9g}") for x in one] for one in functions.directions],
            "length": functions.length,
            "values": base64.b64encode(functions.values.astype("<f4").tobytes()).decode(),
        },
        "materials": [],
        "colours": colours.record(),
        "lamps": [],
        "photographs": [],
        "exposure": exposure,
        "views": [{"label": "Lit", "number": 0}],
    }


def _lengths(stack: WeightStack) -> tuple[dict[str, Any], dict[str, Plane]]:
    """What the ruler of the page needs, and the plane of depths."""
    if stack.depth is None or stack.camera is None:
        return {"hasScale": False}, {}
    known = stack.known
    low, high = float(stack.depth[known].min()), float(stack.depth[known].max())
    high = max(high, low * (1.0 + 1e-6))
    plane = np.rint(DEPTH_TOP * np.clip((stack.depth - low) / (high - low), 0.0, 1.0))
    camera = stack.camera
    focal, principal = list(camera.focal), list(camera.principal)
    lengths = {"hasScale": True, "focal": focal, "principal": principal, "scales": {"depth": [low, high]}}
    return lengths, {"depth": np.where(known, plane, 0.0).astype(np.uint16)}


def _assumptions(stack: WeightStack, packed: PackedStack) -> list[str]:
    lamps, colours = stack.weights.shape[2:]
    spacing = math.degrees(math.sqrt(2.0 * math.pi / lamps))
    return [
        f"Stored: what {colours} colours send to the camera under {lamps} far lamps, about {spacing:.0f}° apart over "
        "the hemisphere in front of it. Light of any spectrum and any camera follow exactly from these.",
        f"Error of display values under the stored lamps: {packed.stored_error:.1f} of 255 (root mean square).",
        f"Error between them: {packed.error_between:.1f} of 255, found by leaving out each lamp in turn. Highlights "
        "and edges of shadows narrower than the spacing of the lamps fade and come back as the lamp moves.",
        "The lamps are far away. The camera and the object cannot be moved.",
        *([LENGTHS] if stack.depth is not None else []),
    ]
