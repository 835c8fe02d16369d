"""The bench of the coverage study: random materials, and the readings of a camera from a ball made of each.

No picture is rendered: points of the ball are sampled as a far camera sees them, under each lamp alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.goniometer import Directions, cosines_of
from studies.merl_rival import torrance_sparrow

Array = NDArray[np.float64]
BALL_PIXELS = 400  # number of visible pixels of the ball
METERED = 0.8  # brightest value as a share of the full well
READ_NOISE = 10.0  # [electrons]
FULL_WELLS = {"45,000 electrons": 45_000.0, "6,000 electrons": 6_000.0, "1,000 electrons": 1_000.0}


@dataclass(frozen=True)
class CoverageBench:
    """Range of materials and lamps. betas: range of β [1/sr], log-uniform. azimuths: of the lamps [°], from the eye.
    tails: range of ν, log-uniform; None: Gaussian facets. tint: standard deviation of ln e of the interface colour.

    Three lamps at phase angles of 35° to 130° determine n, because the Fresnel term grows 2 to 5 times over them; one
    lamp beside the camera does not; faint gloss is below the noise for many of the materials.
    """

    betas: tuple[float, float]
    azimuths: tuple[float, ...]
    tails: tuple[float, float] | None = None
    tint: float = 0.0


BENCHES = {
    "three lamps": CoverageBench((0.05, 1.0), (35.0, 80.0, 130.0)),
    "one lamp": CoverageBench((0.05, 1.0), (20.0,)),
    "three lamps, faint gloss": CoverageBench((0.0005, 0.05), (35.0, 80.0, 130.0)),
    "three lamps, tails and colour": CoverageBench((0.05, 0.5), (35.0, 80.0, 130.0), (0.7, 6.0), 0.3),
}


@dataclass(frozen=True, eq=False)
class TrueMaterial:
    """Parameters of a material; alpha_body (3,): α c_b; interface_colour (3,): of mean 1."""

    alpha_body: Array
    beta: float
    gamma: float
    n: float
    nu: float = np.inf
    interface_colour: tuple[float, ...] = (1.0, 1.0, 1.0)

    def values(self) -> dict[str, float | Array]:
        """By the names of `MaterialEstimate`; body colours have mean 1."""
        mean = float(self.alpha_body.mean())
        return {
            "alpha": mean,
            "beta": self.beta,
            "gamma": self.gamma,
            "n": self.n,
            "nu": self.nu,
            "interface_colour": np.array(self.interface_colour),
            "specular_albedo": self.beta * float(hg.interface_albedo(self.gamma, self.n, self.nu)[0]),
            "body_colour": self.alpha_body / mean,
        }


def drawn(bench: CoverageBench, random: np.random.Generator) -> TrueMaterial:
    """A material of realistic ranges: body albedo 0.1–0.8 per channel, γ 0.06–0.4 rad, n 1.3–1.7."""
    usual = (
        random.uniform(0.1, 0.8, 3) / np.pi,
        float(np.exp(random.uniform(*np.log(bench.betas)))),
        float(np.exp(random.uniform(*np.log([0.06, 0.4])))),
        float(random.uniform(1.3, 1.7)),
    )
    nu = np.inf if bench.tails is None else float(np.exp(random.uniform(*np.log(bench.tails))))
    colour = np.exp(bench.tint * random.standard_normal(3)) if bench.tint else np.ones(3)
    return TrueMaterial(*usual, nu, tuple((colour / colour.mean()).tolist()))


def observed(
    bench: CoverageBench, truth: TrueMaterial, full_well: float, random: np.random.Generator
) -> hg.Observations:
    """Noisy values with shot and read noise; the variance that they state is that of the noisy electrons."""
    sight = ball(bench.azimuths)
    return exposed(sight, reflected(sight.cosines, truth), full_well, random)


def reflected(cosines: hg.Cosines, truth: TrueMaterial) -> Array:
    """Radiance per unit irradiance facing the lamp (N, 3), eq. (2)–(6) in NumPy; 0 where unlit or unseen."""
    lit = (cosines.incidence > 0.0) & (cosines.view > 0.0)
    safe = hg.Cosines(*(np.where(lit, cosine, 1.0) for cosine in cosines))
    interface = torrance_sparrow(safe, truth.gamma, truth.n, 1.0 / truth.nu)
    body = truth.alpha_body * safe.incidence
    return np.where(lit, body + truth.beta * interface * np.array(truth.interface_colour), 0.0)


def exposed(sight: hg.Sight, clean: Array, full_well: float, random: np.random.Generator) -> hg.Observations:
    """Sensor readings of the values `clean` (N, C), the brightest of which fills METERED of the full well."""
    per_unit = METERED * full_well / clean.max()
    electrons = random.poisson(clean * per_unit) + random.normal(0.0, READ_NOISE, clean.shape)
    variance = np.maximum(electrons, 0.0) + 1.0 + READ_NOISE**2
    used = np.broadcast_to(sight.fit_to_use[:, None], clean.shape)
    gain, ceiling = np.full(clean.shape, 1.0 / per_unit), np.full(clean.shape, np.inf)
    place = np.arange(len(clean))
    return hg.Observations(
        electrons / per_unit, variance / per_unit**2, gain, used, sight, ceiling, place, place % BALL_PIXELS
    )


def ball(azimuths: tuple[float, ...]) -> hg.Sight:
    """BALL_PIXELS of a ball, evenly over the disc that the eye at +z sees, under each far lamp in turn."""
    number = np.arange(BALL_PIXELS) + 0.5
    radius, turn = (
        np.sqrt(number / BALL_PIXELS),
        np.pi * (1.0 + 5.0**0.5) * number,
    )  # sunflower: even and without rows
    normal = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - radius**2)], axis=1)
    angle = np.radians(azimuths)
    lamps = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    to_lamp = np.repeat(lamps, BALL_PIXELS, axis=0)
    normals = np.tile(normal, (len(lamps), 1))
    directions = Directions(
        *(_local(normals, way) for way in (to_lamp, np.broadcast_to((0.0, 0.0, 1.0), normals.shape)))
    )
    return hg.Sight(cosines_of(directions), np.ones((len(normals), 1, 3)))


def _local(normals: Array, directions: Array) -> Array:
    """`directions` (N, 3) in axes whose +z is the normal (N, 3)."""
    aside = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    axes = np.stack([aside, np.cross(normals, aside), normals], axis=1)
    return np.einsum("nij,nj->ni", axes, directions)
