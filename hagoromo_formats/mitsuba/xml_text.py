"""XML text: elements of a scene of Mitsuba, by their tag, type and name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hagoromo.light.spectrum import Spectrum
from hagoromo_formats.mitsuba.colours import LIMITS

Element = ElementTree.Element
VERSION = "3.0.0"


def plugin(tag: str, kind: str, name: str = "", parts: Iterable[Element] = (), **values: Any) -> Element:
    """An element with a type; values: numbers, whole numbers, truths, texts, spectra and (4, 4) places by name."""
    element = Element(tag, {"type": kind, **({"name": name} if name else {})})
    element.extend([_value(key, value) for key, value in values.items() if value is not None])
    element.extend(parts)
    return element


def _value(name: str, value: Any) -> Element:
    if isinstance(value, Spectrum):
        return spectrum(name, value)
    if isinstance(value, np.ndarray) and value.shape == (4, 4):
        place = Element("transform", {"name": name})
        place.append(Element("matrix", {"value": numbers(value.ravel())}))
        return place
    if isinstance(value, np.ndarray):
        return Element("vector", {"name": name, "value": numbers(value)})
    if isinstance(value, bool):
        return Element("boolean", {"name": name, "value": str(value).lower()})
    if isinstance(value, int):
        return Element("integer", {"name": name, "value": str(value)})
    if isinstance(value, float):
        return Element("float", {"name": name, "value": repr(value)})
    return Element("string", {"name": name, "value": str(value)})


def spectrum(name: str, values: Spectrum) -> Element:
    """A spectrum by its knots, held beyond its ends; a constant by its number, which is the same in every variant."""
    if np.ptp(values.values) == 0.0:
        text = repr(float(values.values[0]))
    else:
        held = values.held(*LIMITS)
        text = ", ".join(f"{w:.9g}:{v:.9g}" for w, v in zip(held.wavelengths, held.values, strict=True))
    return Element("spectrum", {"name": name, "value": text})


def numbers(values: Iterable[float]) -> str:
    """Numbers as text, to the last digit."""
    return " ".join(repr(float(x)) for x in values)


def text_of(scene: Element) -> str:
    """The whole file."""
    ElementTree.indent(scene)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(scene, encoding="unicode") + "\n"
