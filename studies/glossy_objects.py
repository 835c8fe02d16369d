"""Simulated glossy objects: a bumpy dome under far lamps, whose highlights are a spike on a wide haze and are clipped.

The truth is written down here once more and shares no line with the product: a body after Minnaert with a colour that
varies, and two Gaussian lobes with Fresnel's and the masking factor of eq. (5) and (6). Photographs have shot noise,
read noise, 8 or more bits, and a white at which they are clipped; lamps are off their stated directions and strengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.cast_shadow import lit_share

Array = NDArray[np.float64]
FOCAL, PIXEL = 1e5, 5e-4  # px and m: seen from afar
LAMPS = 20
LARGEST_TILT = 62.0  # ° of a lamp from the camera's axis
DIRECTION_ERROR, STRENGTH_ERROR = 0.2, 0.005  # °, and relative, of the stated lamps
FULL_WELL, READ_NOISE = 20_000.0, 8.0  # electrons
CLIPPED_SHARE = 99.7  # percentile of the values of a photograph that is its white


@dataclass(frozen=True)
class TrueGloss:
    """Truth of an object: exponent ε of the body, β [1/sr] and γ [°] of both lobes; n is 1.5. sigma: of the facets of
    a rough body [rad], after Oren and Nayar.
    """

    epsilon: float
    haze: tuple[float, float]
    spike: tuple[float, float]
    sigma: float = 0.0


GLOSSY = {
    "glaze": TrueGloss(0.10, (0.8, 8.0), (6.0, 1.8)),
    "lacquer": TrueGloss(-0.12, (0.4, 12.0), (10.0, 2.5)),
    "waxed": TrueGloss(0.05, (0.5, 20.0), (1.5, 5.0)),
}
ROUGH = {"biscuit": TrueGloss(0.0, (0.3, 28.0), (0.3, 12.0), 0.5)}  # and matt: of no study of gloss
OBJECTS = *sorted(GLOSSY), *ROUGH


def glossy_object(
    name: str,
    seed: int = 0,
    size: int = 120,
    lamps: int | None = None,
    largest_tilt: float | None = None,
    strength_error: float | None = None,
) -> tuple[hg.Capture, Array]:
    """The capture of an object of GLOSSY or ROUGH, of unknown shape, and its true normals (h, w, 3), 0 beside it.

    lamps: how many; None: LAMPS. largest_tilt: of them [°]; None: LARGEST_TILT. strength_error: relative, of those
    stated; None: STRENGTH_ERROR.
    """
    strength_error = STRENGTH_ERROR if strength_error is None else strength_error
    objects = dict(sorted(GLOSSY.items())) | ROUGH
    if name not in objects:
        raise hg.InputError(f"object is {name!r}: give one of {', '.join(objects)}")
    random, gloss = np.random.default_rng([seed, list(objects).index(name)]), objects[name]
    camera = hg.Camera(size, size, (FOCAL, FOCAL), (size / 2, size / 2), name="simulated")
    camera = camera.look_at((0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    points, normals, on_object = _dome(random, size)
    body = _body(random, size)
    directions = _lamps(
        random, LAMPS if lamps is None else lamps, LARGEST_TILT if largest_tilt is None else largest_tilt
    )
    values = []
    for direction in directions:
        light = _reflected(normals, direction, gloss, body) * lit_share(points, camera, direction)[..., None]
        values.append(np.pi * np.where(on_object[..., None], light, 0.0) * (1.0 + strength_error * random.normal()))
    white = float(np.percentile(np.stack(values)[:, on_object].max(axis=2), CLIPPED_SHARE))
    photographs = []
    for number, (direction, true) in enumerate(zip(directions, values, strict=True)):
        electrons = random.poisson(true / white * FULL_WELL) + random.normal(0.0, READ_NOISE, true.shape)
        read = np.minimum(np.rint(electrons / FULL_WELL * 4095.0) / 4095.0, 1.0)
        variance = np.maximum(read, 0.0) / FULL_WELL + (READ_NOISE / FULL_WELL) ** 2 + 1.0 / 4095.0**2 / 12.0
        valid = on_object & (read < 1.0).all(axis=2)
        stated = direction + np.radians(DIRECTION_ERROR) * random.normal(size=3)
        lamp = hg.Lamp(to_lamp=stated / np.linalg.norm(stated), intensity=np.pi / white, name=f"lamp {number}")
        photographs.append(
            hg.Photograph(read, variance, valid, camera, (lamp,), f"{name} {number}"),  # pyrefly: ignore[bad-argument-type]
        )
    return hg.Capture(tuple(photographs), name), np.where(on_object[..., None], normals, 0.0)


def _dome(random: np.random.Generator, size: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Points [m], normals and mask of a dome with bumps, which throw shadows."""
    from scipy.ndimage import gaussian_filter

    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) / (0.46 * size)
    radius2 = x * x + y * y
    on_object = radius2 < 1.0
    height = 0.85 * np.sqrt(np.maximum(1.02 - radius2, 0.02))
    noise = gaussian_filter(random.normal(size=(size, size)), 0.035 * size)
    height = (height + 0.035 * noise / noise.std()) * 0.46 * size  # px
    down, across = np.gradient(height)
    normals = np.stack([-across, down, np.ones_like(height)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    points = PIXEL * np.stack([x * 0.46 * size, -y * 0.46 * size, height], axis=2)
    return np.where(on_object[..., None], points + 1e-12, 0.0), normals, on_object


def _body(random: np.random.Generator, size: int) -> Array:
    """(h, w, 3) α c_b [1/sr]: one hue whose lightness varies smoothly by a fifth."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(random.normal(size=(size, size)), 0.08 * size)
    return (1.0 + 0.2 * noise / noise.std())[..., None] * np.array([0.10, 0.07, 0.05])


def _lamps(random: np.random.Generator, count: int, largest_tilt: float) -> Array:
    """(count, 3) unit directions, evenly over a cap about the camera's axis (world: z to the camera)."""
    k = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.cos(np.radians(largest_tilt))) * k / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k + random.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)


def _reflected(normals: Array, to_lamp: Array, gloss: TrueGloss, body: Array) -> Array:
    """(h, w, 3) radiance per unit irradiance, seen along z."""
    eye = np.array([0.0, 0.0, 1.0])
    half = (to_lamp + eye) / np.linalg.norm(to_lamp + eye)
    cos_i, cos_r, cos_q = normals @ to_lamp, normals[..., 2], float(half @ eye)
    phi = np.degrees(np.arccos(np.clip(normals @ half, -1.0, 1.0)))
    g = np.sqrt(1.5**2 + cos_q**2 - 1.0)
    fresnel = 0.5 * ((g - cos_q) / (g + cos_q)) ** 2
    fresnel *= 1.0 + ((cos_q * (g + cos_q) - 1.0) / (cos_q * (g - cos_q) + 1.0)) ** 2
    masked = np.minimum(1.0, 2.0 * (normals @ half) * np.minimum(cos_i, cos_r) / cos_q)
    density = sum(beta * 2.0 ** -((phi / width) ** 2) for beta, width in (gloss.haze, gloss.spike))
    lit, low = (cos_i > 0.0) & (cos_r > 0.0), 0.02
    diffuse = cos_i * (np.maximum(cos_i, low) * np.maximum(cos_r, low)) ** gloss.epsilon
    diffuse *= _rough(normals, to_lamp, gloss.sigma)
    interface = density * fresnel * np.maximum(masked, 0.0) / np.where(lit, cos_r, 1.0)
    return np.where(lit[..., None], body * diffuse[..., None] + interface[..., None], 0.0)


def _rough(normals: Array, to_lamp: Array, sigma: float) -> Array | float:
    """(h, w) what facets of slopes `sigma` [rad] make of Lambert's law, seen along z.

    Oren & Nayar 1994, the qualitative model.
    """
    if sigma == 0.0:
        return 1.0
    eye, square = np.array([0.0, 0.0, 1.0]), sigma**2
    cosines = [np.clip(normals @ way, -1.0, 1.0)[..., None] for way in (to_lamp, eye)]
    along = [way - cosine * normals for way, cosine in zip((to_lamp, eye), cosines, strict=True)]
    lengths = [np.linalg.norm(one, axis=-1) for one in along]
    turn = np.sum(along[0] * along[1], axis=-1) / np.maximum(lengths[0] * lengths[1], 1e-9)
    lamp, view = (np.arccos(np.clip(cosine[..., 0], 0.0, 1.0)) for cosine in cosines)
    far, near = np.maximum(lamp, view), np.minimum(lamp, view)
    low, high = 1.0 - 0.5 * square / (square + 0.33), 0.45 * square / (square + 0.09)
    return low + high * np.maximum(turn, 0.0) * np.sin(far) * np.tan(near)
