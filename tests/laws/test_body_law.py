"""Exponent and roughness of the body: reciprocal, of the albedo of a quadrature, kept by files, shown by boxes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.reflectance.body import RoughBody, body_albedo_ratio, body_factor, diffuse_albedo_ratio
from hagoromo.reflectance.element import element_weights
from hagoromo.reflectance.reflectance_record import reflectance_from_record

MATTE = hg.Reflectance(alpha=0.15, beta=0.0, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(1.0))
LAWS = [(0.3, 0.0), (-0.2, 0.0), (0.0, 0.4), (-0.15, 0.25), (0.0, -0.2)]


def upper(count: int, seed: int) -> np.ndarray:
    """Unit directions above the plane, evenly spread over the half sphere."""
    draw = np.random.default_rng(seed)
    cosine, turn = draw.uniform(0.01, 1.0, count), draw.uniform(0.0, 2.0 * math.pi, count)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine])


def body(lamp: np.ndarray, eye: np.ndarray, law: tuple[float, float]) -> np.ndarray:
    vector = arrays().Array3f64
    figures = 1.0, 0.0, 0.2, 1.5, np.inf, RoughBody(epsilon=law[0], sigma=law[1])
    weights = element_weights("plane", vector(0, 0, 1), vector(lamp), vector(eye), *figures)
    return np.array(weights.body)


@pytest.mark.parametrize("law", LAWS)
def test_lamp_and_eye_can_change_places(law):
    """The body over cosθ_i is the same, also where a cosine is held at its least."""
    lamp, eye = upper(5000, 0), upper(5000, 1)
    there, back = body(lamp, eye, law) / lamp[2], body(eye, lamp, law) / eye[2]
    assert there == pytest.approx(back, rel=1e-12) and np.isfinite(there).all()
    assert abs(there - 1.0).max() > 0.1  # it does depart from Lambert's law


@pytest.mark.parametrize("law", LAWS)
def test_the_albedo_is_the_integral(law):
    """To the noise of 4·10⁵ directions; Minnaert's is 2/(2 + ε) cos^ε θ_r, where no cosine is held."""
    lamp, rough = upper(400_000, 2), RoughBody(epsilon=law[0], sigma=law[1])
    for view in (0.0, 0.9, 1.4):
        eye = np.broadcast_to([[math.sin(view)], [0.0], [math.cos(view)]], lamp.shape)
        integral = 2.0 * float(np.mean(body(lamp, eye, law)))  # over 2π, in units of π
        assert float(body_albedo_ratio(rough, (view,))[0]) == pytest.approx(integral, rel=0.02)
    epsilon = law[0]
    if law[1] == 0.0:
        exact = 2.0 / (2.0 + epsilon) * math.cos(0.9) ** epsilon
        assert float(body_albedo_ratio(rough, (0.9,))[0]) == pytest.approx(exact, rel=1e-3)
        assert diffuse_albedo_ratio(rough) == pytest.approx((2.0 / (2.0 + epsilon)) ** 2, rel=2e-3)


def angles(count: int, seed: int, sign: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of lamp and eye with the normal, with cosines above the one that is held, and the turn between them.

    sign: of the cosine of the turn, and so of s: above 0 they stand on one side of the normal, below on opposite sides.
    """
    draw = np.random.default_rng(seed)
    lamp, eye = np.arccos(draw.uniform(0.03, 1.0, (2, count)))
    return lamp, eye, draw.uniform(-0.5, 0.5, count) * math.pi + (0.0 if sign > 0.0 else math.pi)


@pytest.mark.parametrize("sigma", [0.8, -0.4])
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["lamp and eye on one side", "on opposite sides"])
def test_the_roughness_is_that_of_oren_and_nayar_as_fujii_writes_it(side, sigma):
    """1 + σ s/t, 0 or more, in angles: s is sinθ_i sinθ_r cosΔψ; t = max(cosθ_i, cosθ_r) where s > 0, else 1.

    Where s > 0, s/t is Oren and Nayar's cosΔψ sin(max θ) tan(min θ) (1994, eq. 30).
    """
    lamp, eye, turn = angles(2003, 5, side)
    s = np.sin(lamp) * np.sin(eye) * np.cos(turn)
    assert (s * side > 0.0).all()
    qualitative = np.cos(turn) * np.sin(np.maximum(lamp, eye)) * np.tan(np.minimum(lamp, eye))
    expected = np.maximum(1.0 + sigma * (qualitative if side > 0.0 else s), 0.0)
    zero = np.zeros_like(lamp)
    to_lamp = np.stack([np.sin(lamp), zero, np.cos(lamp)])
    to_eye = np.stack([np.sin(eye) * np.cos(turn), np.sin(eye) * np.sin(turn), np.cos(eye)])
    factor = body(to_lamp, to_eye, (0.0, sigma)) / to_lamp[2]
    assert factor == pytest.approx(expected, rel=1e-12)
    assert abs(factor - 1.0).max() > 0.3


def test_the_factor_has_no_step_where_lamp_and_eye_change_sides():
    """s/t is 0 there from either side, and its slope by the turn goes from 1/t to 1."""
    turns = 0.5 * math.pi + np.array([-1e-6, 1e-6])
    eye = np.stack([0.8 * np.cos(turns), 0.8 * np.sin(turns), np.full(2, 0.6)])
    lamp = np.broadcast_to([[0.96], [0.0], [0.28]], eye.shape)
    over = body(lamp, eye, (0.0, 1.0)) / lamp[2] - 1.0
    assert over == pytest.approx(0.96 * 0.8 * 1e-6 * np.array([1.0 / 0.6, -1.0]), rel=1e-6)


def test_energy_and_elements_are_checked():
    bright = {"alpha": 0.9 / math.pi}
    with pytest.raises(hg.InputError, match="breaks energy conservation: seen at 90"):
        replace(MATTE, epsilon=-0.3, **bright)
    assert replace(MATTE, epsilon=0.3, **bright).directional_albedo().max() < 0.9
    with pytest.raises(hg.InputError, match="planes only"):
        replace(MATTE, epsilon=0.1, element="sphere")
    with pytest.raises(hg.InputError, match="sigma is 7"):
        replace(MATTE, sigma=7.0)


def test_a_record_keeps_the_law_and_lamberts_has_no_key():
    rough = replace(MATTE, epsilon=-0.1, sigma=0.2)
    read = reflectance_from_record(rough.record(), "here")
    assert (read.epsilon, read.sigma) == (-0.1, 0.2)
    assert not {"epsilon", "sigma"} & MATTE.record().keys()


def test_kernels_read_what_some_material_needs():
    """The columns that they always have, one of the colour of body and interface each, and those that depart."""
    always = ("alpha", "beta", "gamma", "n", "element", "colour 0", "colour 1")
    camera = hg.Camera(8, 8, (8.0, 8.0), (4.0, 4.0)).look_at((0.0, -2.0, 0.0), (0.0, 0.0, 0.0))
    for changed, more in (({}, ()), ({"epsilon": 0.3}, ("epsilon",)), ({"sigma": 0.1, "nu": 2.0}, ("sigma", "nu"))):
        other = replace(MATTE, **dict[str, Any](changed))
        balls = [hg.Surface.sphere((k, 0.0, 0.0), 0.4, one) for k, one in enumerate((MATTE, other))]
        rays = hg.RayMarch(hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, 0.0, 1.0)),), (), tuple(balls)))
        assert rays.columns == (*always, *more)
        rows = np.array(rays.materials).reshape(2, -1)
        plain = {"epsilon": 0.0, "sigma": 0.0, "nu": np.inf}
        assert rows[:, 7:].tolist() == [
            [plain[name] for name in more],
            np.array([changed[name] for name in more], np.float32).tolist(),
        ]


def test_box_and_surface_show_the_law():
    """A dense slab that does not shade itself, and a sphere, beside a plane of Lambert's law and a coated cylinder."""
    rough = replace(MATTE, epsilon=0.3, sigma=0.2, name="rough")
    coated = replace(MATTE, beta=0.1, element="cylinder", nu=2.0, name="coated")
    to_lamp, eye = np.array([0.6, 0.0, 0.8]), np.array([-0.28, 0.0, 0.96])
    density = np.zeros((16, 16, 16))
    density[4:12] = 1.0
    axis = np.zeros((16, 16, 16, 3))
    axis[..., 2] = 1.0
    lamp = hg.Lamp(to_lamp=tuple(to_lamp), intensity=1.0)
    camera = hg.Camera(8, 8, (8.0, 8.0), (4.0, 4.0)).look_at(tuple(eye), (0.0, 0.0, 0.0))
    values = []
    for material in (MATTE, rough):
        box = hg.VolumeBox.from_arrays(
            density, axis, 0.01, 5000.0, [material, coated], np.zeros(density.shape, np.uint8), shadow_bias=0.01
        )
        scene = hg.Scene(camera, (lamp,), (box,))
        light = hg.march(scene, [[0.08 + eye[0], 0.08, 0.08 + eye[2]]], [-eye], hg.Settings(shadows="none"))
        values.append(light.weights[0].sum())
        ball = hg.Surface.sphere((0.0, 0.0, 0.0), 1.0, material)
        scene = hg.Scene(camera, (lamp,), surfaces=(ball,))
        light = hg.march(scene, [[2 * eye[0], 0.0, 1.0 + 2 * eye[2]]], [-eye], hg.Settings(shadows="none"))
        values.append(light.weights[0].sum())
    factor = float(body_factor(0.8, 0.96, float(to_lamp @ eye), 0.3, 0.2))
    assert factor < 0.95
    assert values[2] / values[0] == pytest.approx(factor, rel=1e-4)
    assert values[3] / values[1] == pytest.approx(factor, rel=1e-4)


def test_a_reflectance_prints_what_is_not_as_by_default():
    shown = "Reflectance(alpha=0.15, beta=0.0, gamma=0.2, n=1.5, body_colour=Spectrum(360–830 nm, 1){})"
    assert repr(MATTE) == shown.format("")
    assert repr(replace(MATTE, name="chalk", nu=2.0, epsilon=0.3)) == shown.format(
        ", name='chalk', nu=2.0, epsilon=0.3"
    )
