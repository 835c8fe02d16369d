"""Photographs of a bowl, a Lambertian cap of a sphere seen from its inside, with all the light that it sends to itself.

Between any two points of a sphere the form factor is dA / (4 π R²). So the light that the bowl receives from itself is
the same everywhere, and the radiosity of all bounces has a closed form: B = ρ (E + M), M = ρ Ē f / (1 − ρ f), where Ē
is the mean of the direct light E over the cap and f the share of the sphere that the cap is.
"""

import numpy as np

import hagoromo as hg

FOCAL, PIXEL = 1e5, 5e-4  # px and m: seen from afar
OPENING = np.radians(62.0)  # half of the angle of the cap
TILTS = (20.0, 45.0)  # ° of the lamps from the camera's axis
AROUND = 4  # lamps of each tilt
FULL_WELL = 40_000.0  # electrons


def bowl(albedo, size=41, seed=0, bounces=True, unit=1.0):
    """The capture of unknown shape, its true normals (h, w, 3), and the true share of light from the bowl (K, h, w).

    albedo: (3,). bounces: whether the bowl lights itself. unit: of the photographs, which a lamp does not know.
    """
    random, albedo = np.random.default_rng(seed), np.asarray(albedo, float)
    camera = hg.Camera(size, size, (FOCAL, FOCAL), (size / 2, size / 2)).look_at(
        (0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)
    )
    y, x = (np.mgrid[:size, :size] + 0.5 - size / 2) * PIXEL
    radius = 0.47 * size * PIXEL / np.sin(OPENING)
    inside = x * x + y * y < (radius * np.sin(OPENING)) ** 2
    depth = np.sqrt(np.maximum(radius**2 - x * x - y * y, 1e-12))
    place = np.stack([x, -y, -depth], axis=2) / radius  # on the unit sphere
    normals = np.where(inside[..., None], -place, 0.0)
    f = 0.5 * (1.0 - np.cos(OPENING))
    photographs, shares = [], []
    for number, (tilt, turn) in enumerate(
        (np.radians(t), 2 * np.pi * k / AROUND) for t in TILTS for k in range(AROUND)
    ):
        lamp = np.array([np.sin(tilt) * np.cos(turn + tilt), np.sin(tilt) * np.sin(turn + tilt), np.cos(tilt)])
        direct = _direct(place, lamp)
        own = albedo * _mean_over_cap(lamp) * f / (1.0 - albedo * f) if bounces else np.zeros(3)
        light = albedo / np.pi * (direct[..., None] + own) * inside[..., None]
        electrons = random.poisson(light / light.max() * 0.9 * FULL_WELL)
        scale = unit * light.max() / (0.9 * FULL_WELL)
        photographs.append(hg.Photograph(electrons * scale, (electrons + 4.0) * scale**2, inside, camera,
                                         (hg.Lamp(to_lamp=lamp, intensity=1.0),), f"lamp {number}"))  # fmt: skip
        shares.append(np.where(inside, (own / (direct[..., None] + own + 1e-12)).mean(axis=2), 0.0))
    return hg.Capture(tuple(photographs), "bowl"), normals, np.stack(shares)


def _direct(place, lamp):
    """cosθ of unit light at places (…, 3) of the unit sphere, 0 where the rim of the bowl is in its way."""
    cosine = -(place @ lamp)
    leaves = place - 2.0 * (place @ lamp)[..., None] * lamp  # where the ray to the lamp meets the sphere again
    return np.where((cosine > 0.0) & (leaves[..., 2] > -np.cos(OPENING)), cosine, 0.0)


def _mean_over_cap(lamp, count=400):
    """Mean of the direct light over the cap, by area."""
    height = -1.0 + (1.0 - np.cos(OPENING)) * (np.arange(count) + 0.5) / count  # equal areas
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    ring = np.sqrt(1.0 - height**2)
    place = np.stack([ring[:, None] * np.cos(turn), ring[:, None] * np.sin(turn),
                      np.broadcast_to(height[:, None], (count, count))], axis=2)  # fmt: skip
    return float(_direct(place, lamp).mean())
