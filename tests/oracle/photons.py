"""Photons through a homogeneous cube of elements, from the lamp outwards, in NumPy and float64: no code of the kernels.

Matter is surface: τρ times half of it per volume. A photon meets a normal of the element in proportion to the area that
faces it, and leaves that little surface by its BRDF f/cosθ_i; both of its faces take light, that of a plane's back
sends none on.
"""

from __future__ import annotations

import math

import numpy as np

import hagoromo as hg
from tests.oracle.lattice import Array
from tests.oracle.reflection import plane

GREY_AT = 550.0  # [nm]


def escaped(
    axes: list[Array], material: hg.Reflectance, depth: float, side: float, to_lamp: Array, count: int, seed: int
) -> Array:
    """Share of the light [m²] of a far lamp of irradiance 1 that leaves a cube about the origin once scattered, and
    scattered more often: draws (count, 2). axes: of elements that are there in equal numbers. depth: τρ of all of
    them together, times the side.
    """
    random, radius = np.random.default_rng(seed), 0.5 * math.sqrt(3.0) * side
    across = unit(np.cross(to_lamp, [0.1, 0.9, 0.3]))
    r, turn = radius * np.sqrt(random.random(count)), 2.0 * math.pi * random.random(count)
    x, y = r * np.cos(turn), r * np.sin(turn)
    place = np.outer(x, across) + np.outer(y, np.cross(to_lamp, across)) + 2.0 * radius * to_lamp
    way = np.broadcast_to(-np.asarray(to_lamp, float), place.shape).copy()
    weight, left = np.full(count, math.pi * radius**2), np.zeros((count, 2))
    inside = np.arange(count)
    order = 0
    while len(inside):
        enter, leave = span(place[inside], way[inside], side)
        rates = depth / side / len(axes) * np.array([area(material.element, way[inside] @ axis) for axis in axes])
        rate = rates.sum(axis=0)
        flight = np.maximum(enter, 0.0) - np.log1p(-random.random(len(inside))) / np.maximum(rate, 1e-12)
        out = ~(flight < leave)
        if order:
            np.add.at(left, (inside[out], np.full(out.sum(), min(order, 2) - 1)), weight[inside[out]])
        inside, flight, rates = inside[~out], flight[~out], rates[:, ~out]
        which = (random.random(len(inside)) * rates.sum(axis=0) > np.cumsum(rates, axis=0)[:-1]).sum(axis=0)
        place[inside] += flight[:, None] * way[inside]
        order += 1
        normal = facing(material.element, np.array(axes)[which], -way[inside], random)
        onwards, share = sent(material, normal, -way[inside], random)
        way[inside] = onwards
        weight[inside] *= share
        dark = share <= 0.0
        faint = ~dark & (weight[inside] < 0.02 * math.pi * radius**2)
        stays = random.random(len(inside)) < 0.5
        weight[inside[faint & stays]] *= 2.0
        inside = inside[~dark & (~faint | stays)]
    return left


def span(place: Array, way: Array, side: float) -> tuple[Array, Array]:
    """Distances at which rays enter and leave the cube."""
    with np.errstate(divide="ignore"):
        faces = [(sign * 0.5 * side - place) / way for sign in (-1.0, 1.0)]
    return np.minimum(*faces).max(axis=1), np.maximum(*faces).min(axis=1)


def area(element: str, cosine: Array) -> Array:
    """Projected area over half of the surface."""
    if element == "plane":
        return np.abs(cosine)
    return 2.0 / math.pi * np.sqrt(1.0 - cosine**2) if element == "cylinder" else np.full(len(cosine), 0.5)


def facing(element: str, axis: Array, back: Array, random: np.random.Generator) -> Array:
    """A normal for each direction `back`, in proportion to the area that faces it; of planes +a always."""
    if element == "plane":
        return axis
    normal = np.zeros_like(back)
    todo = np.arange(len(back))
    while len(todo):  # by rejection
        drawn = random.normal(size=(len(todo), 3))
        if element == "cylinder":
            drawn -= np.sum(drawn * axis[todo], axis=1, keepdims=True) * axis[todo]
        drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
        taken = random.random(len(todo)) < np.sum(drawn * back[todo], axis=1)
        normal[todo[taken]] = drawn[taken]
        todo = todo[~taken]
    return normal


def sent(material: hg.Reflectance, normal: Array, to_lamp: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Directions by the cosine about normals, and the weight of what is sent there: π f / cosθ_i."""
    onwards = unit(normal + unit(random.normal(size=normal.shape)))
    incidence = np.sum(normal * to_lamp, axis=1)
    body, interface = plane(material, normal, to_lamp, onwards)
    f = body * material.body_colour.at(GREY_AT) + interface * material.interface_colour.at(GREY_AT)
    return onwards, math.pi * f / np.maximum(incidence, 1e-9)


def unit(vector: Array) -> Array:
    """Of length 1."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)
