"""MaterialX: each material as `standard_surface`, the nearest that renderers of surfaces have. MaterialX 1.39."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import lost
from hagoromo_formats.relightable.mesh import roughness
from hagoromo_page.publication.lit import three_channels

LOSS = "an approximation: facets become those of GGX, of the same half width; colours are the camera's channels"


def write_materialx(path: Path, materials: Sequence[MaterialEstimate]) -> None:
    """A document with a standard_surface and a surfacematerial per material; the loss stands in `doc`."""
    root = ElementTree.Element("materialx", {"version": "1.39", "colorspace": "lin_rec709"})
    for number, material in enumerate(materials):
        name = document_name(number, material)
        said = "; ".join(filter(None, [LOSS, lost("materialx", material)]))
        shader = ElementTree.SubElement(
            root, "standard_surface", {"name": f"{name}_shader", "type": "surfaceshader", "doc": f"Lost: {said}"}
        )
        colour = np.clip(np.pi * material.alpha * three_channels(np.array(material.body_colour)), 0.0, 1.0)
        inputs = {
            "base": ("float", "1"),
            "base_color": ("color3", ", ".join(f"{value:.6g}" for value in colour)),
            "diffuse_roughness": ("float", f"{min(material.sigma, 1.0):.6g}"),
            "specular": ("float", "0" if material.beta <= 0.0 else "1"),
            "specular_roughness": ("float", f"{roughness(material):.6g}"),
            "specular_IOR": ("float", f"{material.n:.6g}"),
        }
        for key, (kind, value) in inputs.items():
            ElementTree.SubElement(shader, "input", {"name": key, "type": kind, "value": value})
        surface = ElementTree.SubElement(root, "surfacematerial", {"name": name, "type": "material"})
        ElementTree.SubElement(
            surface, "input", {"name": "surfaceshader", "type": "surfaceshader", "nodename": f"{name}_shader"}
        )
    ElementTree.indent(root)
    path.write_bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def document_name(number: int, material: MaterialEstimate) -> str:
    """A name in letters, digits and _ that no other material of the object has."""
    return f"m{number}_" + re.sub(r"\W+", "_", material.name, flags=re.ASCII)
