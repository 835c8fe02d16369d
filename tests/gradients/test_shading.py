"""Slopes of `shading` by turns of normal and lamp and by the gloss, against finite differences of eq. (2)–(6)."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.shading import N, Shading, shading, tangents
from tests.oracle.reflection import dot, plane

Array = NDArray[np.float64]

LAMPS, PIXELS = 5, 211
DIM = 0.05  # α and β of a reflectance that conserves energy: both parts are in proportion to theirs
STEP = 1e-6  # of a central difference in double precision: h² and 1e-16/h are both below 1e-9
# rows (ln β, ln γ, σ, ln(1 + ε), tail 1/ν)
ROWS = {
    "Lambert's body": [math.log(20.0), math.log(0.25), 0.0, 0.0, 0.0],
    "rough body": [math.log(20.0), math.log(0.4), 0.35, math.log(1.2), 0.0],
    "facets with tails": [math.log(30.0), math.log(0.2), -0.15, math.log(0.8), 0.7],
}


def near_upright(count: int, seed: int) -> Array:
    """Unit vectors (count, 3) around +z, up to some 60° from it: lamps stand on both sides of the eye."""
    vectors = np.random.default_rng(seed).normal(size=(count, 3)) * (0.45, 0.45, 0.0) + (0.0, 0.0, 1.0)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def parts(normals: Array, to_lamp: Array, to_eye: Array, row: list[float]) -> tuple[Array, Array]:
    """Body and interface (P,) of one lamp in float64: eq. (2)–(6), Minnaert's exponent and Oren–Nayar's roughness."""
    beta, gamma, sigma, exponent = math.exp(row[0]), math.exp(row[1]), row[2], math.exp(row[3])
    nu = 1.0 / row[4] if row[4] else math.inf
    dim = hg.Reflectance(DIM, DIM, gamma, N, hg.Spectrum.constant(1.0), nu=nu)
    body, interface = (weight / DIM for weight in plane(dim, normals, to_lamp, to_eye))  # of α = β = 1
    lit, seen, phase = dot(normals, to_lamp), dot(normals, to_eye), dot(to_lamp, to_eye)
    s = phase - lit * seen
    t = np.where(s > 0.0, np.maximum(np.maximum(lit, seen), 0.02), 1.0)
    product = np.maximum(lit, 0.02) * np.maximum(seen, 0.02)
    return body * product ** (exponent - 1.0) * np.maximum(1.0 + sigma * s / t, 0.0), beta * interface


def turned(vectors: Array, towards: Array, angle: float) -> Array:
    """`vectors` (P, 3) turned by `angle` [rad] towards `towards`, which are unit and perpendicular."""
    return math.cos(angle) * vectors + math.sin(angle) * towards


@pytest.fixture(scope="module", params=ROWS)
def shaded(request) -> tuple[Shading, Callable[..., Array]]:
    """`shading` of a row, and slopes (2, K, P) of the oracle's two parts by what is named."""
    row = ROWS[request.param]
    normals, to_eye = near_upright(PIXELS, 1), near_upright(PIXELS, 2)
    to_lamp = near_upright(LAMPS * PIXELS, 3).reshape(LAMPS, PIXELS, 3)

    def slopes(what: str, which: int) -> Array:
        def moved(step: float) -> Array:
            normal, lamps, numbers = normals, to_lamp, list(row)
            if what == "normal":
                normal = turned(normals, tangents(normals)[which], step)
            elif what == "lamp":
                lamps = np.stack([turned(lamp, tangents(lamp)[which], step) for lamp in to_lamp])
            else:
                numbers[which] += step
            return np.stack([parts(normal, lamp, to_eye, numbers) for lamp in lamps], axis=1)

        return (moved(STEP) - moved(-STEP)) / (2.0 * STEP)

    return shading(normals, to_lamp, to_eye, np.tile(row, (PIXELS, 1))), slopes


def agree(slope: Array, difference: Array) -> None:
    """To 1e-5 of the largest: cosines in single precision (1e-7), magnified by 1/γ² of a highlight (25)."""
    assert np.abs(difference).max() > 0.1  # there is a slope
    assert np.abs(slope - difference).max() < 1e-5 * np.abs(difference).max()


@pytest.mark.parametrize("which", [0, 1])
def test_slopes_by_turns_of_the_lamp(shaded, which):
    shade, slopes = shaded
    body, interface = slopes("lamp", which)
    agree(shade.body_led[which], body)
    agree(shade.interface_led[which], interface)


@pytest.mark.parametrize("which", [0, 1])
def test_slopes_by_turns_of_the_normal(shaded, which):
    shade, slopes = shaded
    body, interface = slopes("normal", which)
    agree(shade.body_turned[which], body)
    agree(shade.interface_turned[which], interface)


def test_slopes_by_the_numbers_of_the_gloss(shaded):
    shade, slopes = shaded
    agree(shade.interface, slopes("row", 0)[1])  # by ln β it is the interface itself
    agree(shade.by_width, slopes("row", 1)[1])
    agree(shade.by_body[0], slopes("row", 2)[0])
    agree(shade.by_body[1], slopes("row", 3)[0])


def test_tangents_make_a_right_handed_frame():
    normals = np.concatenate([near_upright(101, 4), np.eye(3), -np.eye(3)])
    first, second = tangents(normals)
    frame = np.stack([first, second, normals], axis=1)
    assert frame @ frame.swapaxes(1, 2) == pytest.approx(np.broadcast_to(np.eye(3), (107, 3, 3)), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
