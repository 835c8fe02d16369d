"""MaterialX 1.39: each material as the nearest surface of a model that renderers have, its loss in `doc`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import lost
from hagoromo_formats.relightable.measured_brdf import document_name
from hagoromo_formats.relightable.mesh import roughness
from hagoromo_formats.relightable.openpbr import LAMPS, difference, open_pbr
from hagoromo_page.publication.lit import three_channels

LOSS = "an approximation: facets become those of GGX, of the same half width; colours are the camera's channels"


def write_materialx(path: Path, materials: Sequence[MaterialEstimate]) -> None:
    """A document with a standard_surface and a surfacematerial per material; the loss stands in `doc`."""
    surfaces = [(standard_surface(one), _said("materialx", one)) for one in materials]
    _write(path, "standard_surface", materials, surfaces)


def write_openpbr(path: Path, materials: Sequence[MaterialEstimate]) -> list[tuple[float, ...]]:
    """A document with an open_pbr_surface per material; gives the `difference` of each, which stands in its `doc`."""
    surfaces = [open_pbr(one) for one in materials]
    off = [difference(one, surface) for one, surface in zip(materials, surfaces, strict=True)]
    said = [f"{_said('openpbr', one)}; {differences(each)}" for one, each in zip(materials, off, strict=True)]
    _write(path, "open_pbr_surface", materials, list(zip(map(asdict, surfaces), said, strict=True)))
    return off


def differences(off: Sequence[float]) -> str:
    """The `difference` of a surface in words."""
    parts = ", ".join(f"{100 * one:.0f} % at {angle:.0f}°" for one, angle in zip(off, LAMPS, strict=True))
    return f"reflected light differs, summed over all directions to the eye, by {parts} of the lamp from the normal"


def standard_surface(material: MaterialEstimate) -> dict[str, Any]:
    """Inputs of Autodesk's standard_surface."""
    colour = np.clip(np.pi * material.alpha * three_channels(np.array(material.body_colour)), 0.0, 1.0)
    return {
        "base": 1.0,
        "base_color": tuple(colour.tolist()),
        "diffuse_roughness": min(material.sigma, 1.0),
        "specular": 0.0 if material.beta <= 0.0 else 1.0,
        "specular_roughness": roughness(material),
        "specular_IOR": material.n,
    }


def _said(form: str, material: MaterialEstimate) -> str:
    return "; ".join(filter(None, [LOSS, lost(form, material)]))


def _write(
    path: Path, model: str, materials: Sequence[MaterialEstimate], surfaces: Sequence[tuple[dict[str, Any], str]]
) -> None:
    """Write a document of surfaces: inputs by name, and what is lost."""
    root = ElementTree.Element("materialx", {"version": "1.39", "colorspace": "lin_rec709"})
    for number, (material, (inputs, said)) in enumerate(zip(materials, surfaces, strict=True)):
        name = document_name(number, material)
        attributes = {"name": f"{name}_shader", "type": "surfaceshader", "doc": f"Lost: {said}"}
        shader = ElementTree.SubElement(root, model, attributes)
        for key, value in inputs.items():
            many = isinstance(value, tuple)
            text = ", ".join(f"{one:.6g}" for one in (value if many else (value,)))
            kind = "color3" if many else "float"
            ElementTree.SubElement(shader, "input", {"name": key, "type": kind, "value": text})
        surface = ElementTree.SubElement(root, "surfacematerial", {"name": name, "type": "material"})
        ElementTree.SubElement(
            surface, "input", {"name": "surfaceshader", "type": "surfaceshader", "nodename": f"{name}_shader"}
        )
    ElementTree.indent(root)
    path.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
