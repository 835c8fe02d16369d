"""Light in shadows: of the object itself, of the room, or veiling glare, as far as photographs can separate them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.surface.shadow_light import GLARE, OWN, ROOM, ShadowLight, shadow_light
from tests.inverse.test_veiling_glare import DISTANCE, far_ball

SIDE, COUNT, NOISE = 40, 6, 1e-3
STRENGTHS = {OWN: 0.8, ROOM: 0.05, GLARE: 0.04}


def shadows(sources: tuple[int, ...], seed: int, even: bool = False, matt: bool = False) -> ShadowLight:
    """Of a surface whose lower half lies in its own shadow; the light there is that of `sources`.

    even: all photographs have one mean. matt: all pixels have one body colour.
    """
    random = np.random.default_rng(seed)
    rows, columns = np.divmod(np.arange(SIDE**2), SIDE)
    body = np.full((SIDE, SIDE, 1), 0.2) if matt else random.uniform(0.1, 0.3, (SIDE, SIDE, 1))
    dark = (rows >= SIDE // 2).reshape(SIDE, SIDE, 1)
    own = np.linspace(0.0, 0.2, SIDE)[:, None] * np.linspace(1.0, 0.2, COUNT)[:, None, None, None] * body
    own = own if OWN in sources else np.zeros_like(own)
    towards = np.where(dark.reshape(-1, 1), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
    photographs = []
    for k in range(COUNT):
        clean = np.where(dark, 0.0, body * (1.0 if even else 0.3 + 0.3 * k))
        clean = clean + sum(STRENGTHS[one] * {OWN: own[k], ROOM: body}[one] for one in sources if one != GLARE)
        if GLARE in sources:  # of the mean that is recorded
            clean = clean + STRENGTHS[GLARE] / (1.0 - STRENGTHS[GLARE]) * clean.mean()
        value = clean + NOISE * random.standard_normal(body.shape)
        variance = np.full(body.shape, NOISE**2)
        photographs.append(SimpleNamespace(values=value, mask=np.ones((SIDE, SIDE), bool), variance=variance))
    views = SimpleNamespace(rows=rows, columns=columns, shape=(SIDE, SIDE), to_lamp=np.tile(towards, (COUNT, 1, 1)))
    fit = SimpleNamespace(normals=np.tile((0.0, 0.0, 1.0), (SIDE**2, 1)), labels=np.zeros(SIDE**2, int))
    normal_map: Any = SimpleNamespace(views=views, fit=fit, body=body)
    capture: Any = SimpleNamespace(photographs=photographs)
    return shadow_light(capture, normal_map, list(own))


@pytest.mark.parametrize("sources", [(ROOM,), (OWN,), (GLARE,), (OWN, ROOM), (ROOM, GLARE), (OWN, GLARE)])
def test_each_source_is_found_with_its_error_and_no_other(sources):
    light = shadows(sources, 3)
    asked = [OWN, ROOM, GLARE] if OWN in sources else [ROOM, GLARE]
    found = light.solved(asked)
    assert found is not None
    for one, strength, error in zip(asked, found.strength, found.error, strict=True):
        assert abs(strength - STRENGTHS[one] * (one in sources)) < 4.0 * error < 0.2 * STRENGTHS[one]
    assert light.glares == (GLARE in sources)
    said = light.sentence
    assert "cannot be separated" not in said
    for one, advice in ((OWN, "--own-light"), (ROOM, "lamps off"), (GLARE, "--estimate glare")):
        assert (advice in said) == (one in sources), said


@pytest.mark.parametrize("sources", [(ROOM,), (GLARE,)])
def test_room_and_glare_of_one_body_in_photographs_alike_cannot_be_separated(sources):
    """One colour and one mean: both are one number in all shadows. What they are together is known."""
    said = shadows(sources, 4, even=True, matt=True).sentence
    assert "cannot be separated" in said and "(take" not in said and "takes it out" not in said


def test_dark_shadows_are_not_spoken_of():
    assert shadows((), 5).sentence == ""


def test_own_light_that_is_as_even_as_that_of_a_room_cannot_be_separated_from_it():
    light = shadows((ROOM, GLARE), 6)
    square, towards, order = light.square, light.towards, [ROOM, ROOM, GLARE]
    square = square[:, :, order][..., order]
    alike = ShadowLight(square, towards[..., order], light.power, light.mean[:, order], light.dark, light.lit)
    assert "cannot be separated" in alike.sentence and alike.solved([OWN, ROOM]) is None


@pytest.mark.nightly
@pytest.mark.parametrize("room, glare", [(0.03, 0.0), (0.0, 0.02), (0.03, 0.02)])
def test_a_measured_ball_says_what_lies_in_its_shadows(room, glare):
    """Light of the room moves normals and bodies that are measured with it; yet it is not taken for glare."""
    capture = far_ball(0.0, 7)
    photographs = []
    for one in capture.photographs:
        values = one.values + room * one.mask[..., None] * np.array((0.20, 0.15, 0.10))
        values = values + glare / (1.0 - glare) * values.mean(axis=(0, 1))
        photographs.append(replace(one, values=values))
    found = hg.measure(
        replace(capture, photographs=tuple(photographs)), distance=DISTANCE, facets="gaussian", interface="neutral"
    )
    said = found.assumptions["light in shadows"]
    assert ("subtract it" in said) == (room > 0.0) and ("--estimate glare" in said) == (glare > 0.0), said
