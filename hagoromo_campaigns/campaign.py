"""Campaign: what a comparison asks of one measurement: places, directions, colours and gloss, each with its variance.

Enters: a Measurement that states its errors. Leaves: maps of h × w pixels, NaN where the quantity is unknown.

Where body.exr states no errors (of tiles, and of older versions), they follow from those of the normals: normal n and
body colour a are solved together from g = a n, and lamps l_k that light a pixel give g the covariance G⁻¹,
G = Σ_k l_k l_kᵀ. The relative variance of a is so the variance of the direction times nᵀG⁻¹n / tr(P G⁻¹ P), P across n.
A channel holds its share of that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.scale import has_scale
from hagoromo.measurement.squares import square_means
from hagoromo.reflectance.torrance_sparrow import normal_fresnel

Array = NDArray[np.float64]
LONGEST_PX = 1600  # of a side of the maps that are compared: larger ones are averaged over squares of pixels
LIT = 0.1  # smallest cosine between normal and lamp that counts as lit
RIDGE = 1e-3  # of a lamp, added to G: keeps it invertible where few lamps light a pixel
MAPS = ("points", "normals", "body", "body_variance", "normal_variance", "point_variance", "gloss", "gloss_variance")
GLOSS = ("gloss", "width")  # ln of β F₀ [1/sr], and ln of γ [rad]


@dataclass(frozen=True, eq=False)
class Campaign:
    """One measurement of an object, h × w pixels in C channels.

    name: as messages call it. known: (h, w) of the object. points: (h, w, 3) [m], world. normals: (h, w, 3), world.
    body: (h, w, C) α c_b [1/sr]. gloss: (h, w, 2) GLOSS; None where no highlight was measured.
    body_variance: (h, w, C) of ln body; normal_variance: (h, w) of the normal about one axis [rad²]; point_variance:
    (h, w) of the distance [m²]; gloss_variance: (h, w, 2). NaN where unknown; None where the shape was given.
    body_shared, gloss_shared: standard errors, of logarithms, that all pixels have in common.
    gloss_varies: whether the gloss was measured for each pixel; else it is one of each material.
    in_metres: whether lengths are metres; else they are of an arbitrary unit. step: pixels of the measurement along
    each side of a pixel here.
    """

    name: str
    camera: Camera
    lamp: Spectrum | None
    known: NDArray[np.bool_]
    points: Array
    normals: Array
    body: Array
    body_variance: Array
    normal_variance: Array | None
    point_variance: Array | None
    gloss: Array | None
    gloss_variance: Array | None
    body_shared: float
    gloss_shared: Array
    gloss_varies: bool
    in_metres: bool
    step: int = 1

    @property
    def pitch(self) -> float:
        """Distance of neighbouring pixels on the object, in the unit of the points."""
        away = np.linalg.norm(self.points[self.known] - self.camera.position, axis=1)
        return float(np.median(away) / np.mean(self.camera.focal))

    def averaged(self) -> Campaign:
        """It with maps of at most LONGEST_PX: means over squares of pixels, whose errors are taken for independent."""
        step = -(-max(self.known.shape) // LONGEST_PX)
        if step == 1:
            return self
        maps = {key: square_means(one, step) for key, one in vars(self).items() if key in MAPS and one is not None}
        maps |= {key: one / step**2 for key, one in maps.items() if key.endswith("variance")}
        maps["normals"] = maps["normals"] / np.linalg.norm(maps["normals"], axis=2, keepdims=True)
        known = np.asarray(np.isfinite(maps["points"]).all(axis=2))
        camera = self.camera.resampled(known.shape[1], known.shape[0], (step, step))
        return replace(self, camera=camera, known=known, step=step, **maps)


def campaign(measurement: Measurement, name: str) -> Campaign:
    """What `measurement` offers to a comparison; `InputError`, with `name`, where it has no points or no errors."""
    taken, body, points = measurement.photographed_with, measurement.body, measurement.points
    if taken is None or body is None or points is None:
        lacks = "camera.json" if taken is None else "body.exr" if body is None else "points.exr"
        raise InputError(f"{name} has no {lacks}, which a comparison needs: measure the photographs again")
    fine = measurement.fine
    labels, normals, value = measurement.labels, measurement.normals, np.asarray(body.value, np.float64)
    variances = measurement.normal_variance, measurement.distance_variance
    if fine is not None:
        labels, normals, points, value = fine.labels, fine.normals, fine.points, np.asarray(fine.body, np.float64)
        variances = fine.variance, fine.depth_variance
    known = (labels >= 0) & (np.linalg.norm(normals, axis=2) > 0.5) & np.isfinite(points).all(axis=2)
    with np.errstate(invalid="ignore"):
        known &= (value > 0.0).all(axis=2)
    if not known.any():
        raise InputError(f"{name} knows no pixel of its object: measure it again")
    normal_variance, point_variance = (None if one is None else np.where(known, one, np.nan) for one in variances)
    if body.error is not None and fine is None:
        with np.errstate(invalid="ignore", divide="ignore"):
            body_variance = (np.asarray(body.error, np.float64) / value) ** 2
    elif normal_variance is None:
        raise InputError(
            f"{name} states no errors (neither variance.exr nor error.* in body.exr), so that nothing says what is "
            "significant: measure the photographs again"
        )
    else:
        body_variance = _body_variance(value, points.astype(np.float64), normals, normal_variance, taken.lamps)
    known &= np.isfinite(body_variance).all(axis=2)
    gloss, gloss_variance, gloss_shared = _gloss(measurement, labels)
    empty = ~known[..., None]
    spectra = {id(lamp.spectrum): lamp.spectrum for lamp in taken.lamps}
    return Campaign(
        name,
        taken.camera,
        next(iter(spectra.values())) if spectra else None,
        known,
        np.where(empty, np.nan, points).astype(np.float64),
        np.where(empty, np.nan, normals).astype(np.float64),
        np.where(empty, np.nan, value),
        np.where(empty, np.nan, body_variance),
        None if normal_variance is None else np.where(np.isfinite(normal_variance), 0.5 * normal_variance, np.nan),
        None if point_variance is None else np.where(np.isfinite(point_variance), point_variance, np.nan),
        gloss,
        gloss_variance,
        _shared(measurement, "alpha"),
        gloss_shared,
        gloss is not None and measurement.gloss is not None,
        has_scale(measurement, taken),
    )


def _body_variance(
    body: Array, points: Array, normals: NDArray, normal_variance: Array, lamps: tuple[Lamp, ...]
) -> Array:
    """(h, w, C) of ln body, by the equation at the head of the file."""
    gram = np.broadcast_to(RIDGE * np.eye(3), (*normals.shape[:2], 3, 3)).copy()
    for lamp in lamps:
        way = lamp.to_lamp if lamp.position is None else lamp.position - points
        to_lamp = np.broadcast_to(np.asarray(way, np.float64), normals.shape)
        to_lamp = to_lamp / np.maximum(np.linalg.norm(to_lamp, axis=2, keepdims=True), 1e-30)
        lit = np.einsum("hwi,hwi->hw", to_lamp, normals) > LIT
        gram += np.where(lit[..., None, None], to_lamp[..., :, None] * to_lamp[..., None, :], 0.0)
    inverse = np.linalg.inv(gram)
    along = np.einsum("hwi,hwij,hwj->hw", normals, inverse, normals)
    across = np.maximum(np.trace(inverse, axis1=2, axis2=3) - along, 1e-30)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = body / body.sum(axis=2, keepdims=True)
        return (normal_variance * along / across)[..., None] / share


def _gloss(measurement: Measurement, labels: NDArray[np.integer]) -> tuple[Array | None, Array | None, Array]:
    """GLOSS of each pixel, its own variance, and the standard errors that all pixels have in common."""
    gloss = measurement.gloss
    usable = [one.beta > 0.0 and one.identifiable.get("gamma", False) for one in measurement.materials]
    if not any(usable):
        return None, None, np.full(2, np.nan)
    facing = [normal_fresnel(one.n) for one in measurement.materials]
    rows = [
        [np.log(one.beta * f0), np.log(one.gamma)] if good else [np.nan, np.nan]
        for one, f0, good in zip(measurement.materials, facing, usable, strict=True)
    ]
    each = np.array([*rows, [np.nan, np.nan]])  # the last row is that of label −1
    own = np.array([*(_variation(one.gloss) for one in measurement.materials), [np.nan, np.nan]])
    value, variance = each[labels], own[labels]
    if gloss is not None:
        if measurement.fine is not None:
            gloss = gloss.of_size(*labels.shape)
        factor = np.array([*facing, np.nan])[labels]
        with np.errstate(invalid="ignore", divide="ignore"):
            value = np.log(np.stack([gloss.beta * factor, gloss.gamma], axis=2))
            variance = np.stack([gloss.beta_error / gloss.beta, gloss.gamma_error / gloss.gamma], axis=2) ** 2
        value[~np.append(usable, False)[labels]] = np.nan
    return value, variance, np.array([_shared(measurement, key) for key in ("beta", "gamma")])


def _variation(record: Mapping[str, object] | None) -> list[float]:
    """Variances of ln β and ln γ from pixel to pixel of a material whose gloss is taken for the same everywhere."""
    found = (record or {}).get("variation")
    if not isinstance(found, Mapping):
        return [0.0, 0.0]
    return [float(found.get(key, 0.0) or 0.0) ** 2 for key in ("beta", "gamma")]


def _shared(measurement: Measurement, key: str) -> float:
    """Relative standard error of a parameter of the largest material; infinite where it is unknown."""
    material = measurement.materials[0]
    error, value = material.standard_error.get(key), float(getattr(material, key))
    return float(error) / value if isinstance(error, float) and value > 0.0 else np.inf
