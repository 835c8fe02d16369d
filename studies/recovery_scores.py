"""Scores of recoveries: pictures against exact light, surfaces against true points, and what stated errors hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo.image.relight.stage import basis_camera
from hagoromo_recovery.export import conserving
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.near_surface import on_surface
from studies.recover_scenes import Simulated

Array = NDArray[np.float64]
TWO_SIDED = NormalDist().inv_cdf(0.975)  # standard errors of a 95 % interval


def held_words(held: Sequence[float] | None, stated_of: float) -> str:
    """What intervals hold [%], and of how many places where they are not stated of all [%]."""
    words = "" if held is None else ", ".join(f"{each:.0f}" for each in held) + " %"
    if stated_of >= 99.5:
        return words
    return f"{words} of {stated_of:.0f} % of the places" if held else "stated nowhere"


def said_words(said: Sequence[str]) -> str:
    """The first clause of each; of a refusal all."""
    return "; ".join(s if s.startswith("refused") else s.split(":")[0].split(";")[0] for s in said) or "nothing"


def strengths_off(photographs: Sequence[hg.Photograph], photographed: Simulated) -> float:
    """Standard deviation of the logarithms of lamps' strengths over the true ones [%]."""
    pairs = zip(photographs, photographed.strengths, strict=True)
    return 100.0 * float(np.std([np.log(np.mean(p.lamps[0].intensity) / true) for p, true in pairs]))


def places_off(photographs: Sequence[hg.Photograph], photographed: Simulated) -> float:
    """How far the photographs' first lamps stand from where they are [mm], root mean square."""
    pairs = zip(photographs, photographed.places, strict=True)
    return 1e3 * float(np.sqrt(np.mean([np.sum((p.lamps[0].place - true) ** 2) for p, true in pairs])))


def psnr(found: hg.Recovered, aside: Simulated) -> float:
    """PSNR of all pictures together against exact light [dB]."""
    peak = max(float(exact.max()) for exact in aside.exact)
    errors = [
        np.mean((found.picture(p)[0] - exact) ** 2)
        for p, exact in zip(aside.capture.photographs, aside.exact, strict=True)
    ]
    return float(10.0 * np.log10(peak**2 / np.mean(errors)))


class SurfaceErrors(NamedTuple):
    """True points of the surface (n, 3) [m], how far the one that was found is from them (n,) [m], and angles of its
    normals (n,) [°].
    """

    points: Array
    distances: Array
    angles: Array


def shape_errors(found: hg.Recovered, aside: Simulated) -> SurfaceErrors:
    """The errors of the surface at the true points of all pictures."""
    there = [np.isfinite(normals[..., 0]) for normals in aside.normals]
    normals, points = (
        np.concatenate([each[which] for each, which in zip(all_of, there, strict=True)])
        for all_of in (aside.normals, aside.points)
    )
    return surface_errors(found, points, normals)


def seen_angles(found: hg.Recovered, aside: Simulated) -> Array:
    """Angles (n,) [°] between the normals that the cameras of pictures see, and the true ones.

    Normals of `surface_errors` are those at true points: where a wall is found much too thick, one of its true faces
    lies beyond the middle of the matter, and the normal there is that of the other face.
    """
    angles = []
    for p, normals in zip(aside.capture.photographs, aside.normals, strict=True):
        own, opacity = found.normals(p)
        there = np.isfinite(normals[..., 0]) & (opacity > 0.5)
        angles.append(np.degrees(np.arccos(np.clip((own * normals)[there].sum(axis=1), -1.0, 1.0))))
    return np.concatenate(angles)


def surface_errors(found: hg.Recovered, points: Array, normals: Array) -> SurfaceErrors:
    """The errors of the surface, of fuzzy matter that which stands for it, at true points with true normals."""
    field, at = DistanceField(found.distance, found.colours), places(found, points)
    slope = np.array(field.axis_at(at), np.float64).T
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    angles = np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", slope, normals), -1.0, 1.0)))
    own = found.lattice.from_world(points)
    distances = np.linalg.norm(on_surface(field, own) - own, axis=1) * found.lattice.voxel
    return SurfaceErrors(points, distances, angles)


def places(found: hg.Recovered, points: Array) -> Any:
    """Points (n, 3) [m] as places of the lattice."""
    return vectors(found.lattice.from_world(points))


def _nodes_of(found: hg.Recovered, points: Array) -> NDArray[np.int64]:
    """Numbers (n,) of the nodes near the surface that are nearest to points (n, 3) [m]."""
    assert found.errors is not None
    node = found.surface_field.nearest_node(places(found, points))
    near = np.isfinite(found.errors.position) | found.errors.thin
    away = ~near.ravel()[node]
    if away.any():
        known = np.argwhere(near)
        nearest = KDTree(known[:, ::-1]).query(found.lattice.from_world(points[away]))[1]
        node[away] = np.ravel_multi_index(tuple(known[nearest].T), near.shape)
    return node


def stated(found: hg.Recovered, points: Array) -> float:
    """Share [%] of points (n, 3) [m] that have errors: of the others matter is too thin for the lattice."""
    if found.errors is None:
        return 0.0
    return 100.0 * float(np.isfinite(found.errors.position.ravel()[_nodes_of(found, points)]).mean())


def covered(found: hg.Recovered, shown: SurfaceErrors, colours: Array) -> tuple[float, float, float] | None:
    """Share [%] of points of which 95 % intervals of position, normal and body colour hold the truth.

    colours: (n, 3) true ones. The angle of a normal has two components: 95 % are within √(−ln 0.05) times its root of
    the mean square. The errors of a point are those of the nearest place of the surface that was found. Body colours
    that no photograph shows lit have none, and do not count, and neither do places whose matter is too thin for the
    lattice (`stated` has the others); None where no place has errors.
    """
    if found.errors is None:
        return None
    errors, node = found.errors, _nodes_of(found, shown.points)
    known = np.isfinite(errors.position.ravel()[node])
    if not known.any():
        return None
    at, field = places(found, shown.points), found.rendering.field
    position, normal = errors.position.ravel()[node], errors.normal.ravel()[node]
    colour = errors.colour.reshape(-1, 3)[node]
    own = np.stack([np.array(c) for c in field.colours_at(at)], 1)
    held = (
        (shown.distances < TWO_SIDED * position)[known],
        (np.radians(shown.angles) < np.sqrt(-np.log(0.05)) * normal)[known],
        (np.abs(own - colours) < TWO_SIDED * colour)[np.isfinite(colour)],
    )
    return tuple(float(100.0 * each.mean()) for each in held)  # type: ignore[return-value]


def gloss_held(found: hg.Recovered, beta: float, gamma: float) -> bool:
    """Whether 95 % intervals of β and γ hold the truth; that of β alone where it is 0, as there is no γ then."""
    interval = found.record()["material"]["interval_95"]
    if beta == 0.0:
        return bool(interval["beta"][0] == 0.0)
    return all(interval[k][0] <= v <= interval[k][1] for k, v in (("beta", beta), ("gamma", gamma)))


def box_psnr(found: hg.Recovered, aside: Simulated, samples: int = 4) -> float:
    """PSNR of all pictures together, made of the object's box by `render`, against exact light [dB]."""
    shown, peak = found.box(), max(float(exact.max()) for exact in aside.exact)
    (_, dim), response, errors = conserving(found), basis_camera(), []
    for p, exact in zip(aside.capture.photographs, aside.exact, strict=True):
        camera = p.camera if p.camera.response is not None else replace(p.camera, response=response, sensor=None)
        lamps = tuple(replace(lamp, intensity=float(np.mean(lamp.intensity)) / dim) for lamp in p.lamps)
        image = hg.render(hg.Scene(camera, lamps, boxes=(shown,)), hg.Settings(samples=samples))
        errors.append(np.mean((image.expose(camera.response) - exact) ** 2))
    return float(10.0 * np.log10(peak**2 / np.mean(errors)))
