"""Laws of light through elements: sums in float64, reciprocity, the white furnace, and that kernels show it.

The oracle (tests/oracle/transmission.py) sums over normals and rays, and knows M by its series.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.reflectance.material.material_table import reflectance_from_table
from hagoromo.reflectance.reflectance import VIEWS
from hagoromo.reflectance.reflectance_record import reflectance_from_record
from hagoromo.reflectance.torrance_sparrow import Weights
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from tests.files.test_schemas import material
from tests.oracle.transmission import transmitted

AXIS = np.array([0.36, -0.48, 0.8])
WHITE = hg.Spectrum.constant(1.0)
RED = hg.Spectrum([360, 560, 620, 830], [0.1, 0.1, 0.8, 0.8])


def matter(element, clearness=0.0, transmission=0.4, **keys):
    figures: dict[str, Any] = {"alpha": 0.12, "beta": 0.2, "gamma": 0.3, "n": 1.55, "body_colour": WHITE} | keys
    return hg.Reflectance(
        **figures, element=element, transmission=transmission, transmitted_colour=RED, clearness=clearness
    )


KINDS = [*((element, 0.0) for element in ELEMENTS), ("cylinder", 0.7), ("cylinder", 1.0)]


def unit(count, seed):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def vectors(v, kind="Array3f64"):
    jit = arrays()
    scalar = jit.Float64 if kind.endswith("64") else jit.Float
    return getattr(jit, kind)(*(scalar(np.ascontiguousarray(v[..., k].ravel())) for k in range(3)))


def directions(polar=300, round_=1024):
    """Directions about AXIS and their solid angles: lobes are as narrow as 0.05 rad along the axis and around it."""
    nodes, weights = np.polynomial.legendre.leggauss(polar)
    angle, weights = 0.5 * math.pi * (nodes + 1.0), 0.5 * math.pi * weights
    turn = (np.arange(round_) + 0.5) / round_ * 2.0 * math.pi
    a, t = (grid.ravel() for grid in np.meshgrid(angle, turn, indexing="ij"))
    x = np.cross(AXIS, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    ways = np.outer(np.sin(a) * np.cos(t), x) + np.outer(np.sin(a) * np.sin(t), np.cross(AXIS, x))
    return ways + np.outer(np.cos(a), AXIS), np.repeat(weights * np.sin(angle), round_) * (2.0 * math.pi / round_)


@pytest.mark.parametrize(("element", "clearness"), KINDS)
def test_kernels_transmit_as_sums_over_normals_and_rays(element, clearness):
    """0.2 % of the largest for sums over a spiral of normals, 1 % for tables of clear lobes in single precision."""
    one = matter(element, clearness)
    lamps, eyes = unit(600, 1), unit(600, 2)
    true = transmitted(one, np.broadcast_to(AXIS, lamps.shape), lamps, eyes)
    materials = Materials([one], palette_of([one], [], [WHITE]))
    axis = vectors(np.broadcast_to(AXIS, lamps.shape), "Array3f")
    got = materials.weights(arrays().UInt(0), axis, vectors(lamps, "Array3f"), vectors(eyes, "Array3f"))[2:]
    same = one.weights(vectors(np.broadcast_to(AXIS, lamps.shape)), vectors(lamps), vectors(eyes))[2:]
    tolerance = 0.01 if clearness else 0.002
    for mine, record, oracle in zip(got, same, true, strict=True):
        assert np.abs(np.array(mine) - oracle).max() <= tolerance * np.abs(true[0] + true[1]).max()
        assert np.abs(np.array(record) - oracle).max() <= tolerance * np.abs(true[0] + true[1]).max()


@pytest.mark.parametrize(("element", "clearness"), KINDS)
def test_every_lobe_is_reciprocal(element, clearness):
    """A(V) f(a; L, V) is the same from V to L, for each weight; 1e-9 in double precision."""
    one, lamps, eyes = matter(element, clearness), unit(4000, 3), unit(4000, 4)
    axis = vectors(np.broadcast_to(AXIS, lamps.shape))
    there, back = (one.weights(axis, *map(vectors, pair)) for pair in ((lamps, eyes), (eyes, lamps)))
    area = [np.broadcast_to(np.array(projected_area(element, arrays().Float64(v @ AXIS))), 4000) for v in (eyes, lamps)]
    for a, b in list(zip(there, back, strict=True))[2:] if element != "plane" else zip(there, back, strict=True):
        assert np.abs(area[0] * np.array(a) - area[1] * np.array(b)).max() <= 1e-9 * max(np.abs(np.array(a)).max(), 1.0)


@pytest.mark.parametrize(
    ("element", "figures"),
    [
        *((element, {"alpha": 0.6 / math.pi}) for element in ELEMENTS),
        ("cylinder", {"alpha": 0.0, "transmission": 1.0, "n": 1.0, "clearness": 1.0}),
        ("cylinder", {"alpha": 0.6 / math.pi, "n": 1.0, "clearness": 0.5, "gamma": 0.5}),
    ],
)
def test_the_white_furnace_of_elements_that_send_on_all_light_is_one(element, figures):
    """Body, far-side body and clear light together: ∫ f dL = 1 from every view, to 1e-3. n = 1 reflects nothing."""
    one = replace(matter(element, beta=0.0), transmitted_colour=WHITE, **figures)
    lamps, each = directions()
    for eye in unit(4, 5):
        eyes = np.broadcast_to(eye, lamps.shape)
        f = one.weights(vectors(np.broadcast_to(AXIS, lamps.shape)), vectors(lamps), vectors(eyes))
        total = sum(np.array(part) for part in f) @ each
        assert total == pytest.approx(1.0, abs=1e-3 if element != "plane" else 5e-3)  # a grid meets its edge


def test_conservation_of_energy_counts_what_clear_fibres_send_on():
    one = matter("cylinder", 1.0, 0.5, beta=0.0, alpha=0.0)
    lamps, each = directions()
    side = np.cross(AXIS, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    for view, stated in zip(VIEWS[:-1:2], one.transmitted_albedo()[:-1:2], strict=True):
        eyes = np.broadcast_to(math.cos(view) * side + math.sin(view) * AXIS, lamps.shape)
        f = one.weights(vectors(np.broadcast_to(AXIS, lamps.shape)), vectors(lamps), vectors(eyes))
        albedo = sum(np.array(part) for part in f[2:]) @ each
        assert stated == pytest.approx(0.8 * albedo, abs=1e-3)
        assert albedo < 0.5


def test_a_sheet_reflects_alike_on_both_sides_where_it_transmits():
    one, lamps, eyes = matter("plane"), unit(500, 6), unit(500, 7)
    axis = vectors(np.broadcast_to(AXIS, lamps.shape))
    for a, b in zip(
        one.weights(axis, vectors(lamps), vectors(eyes)),
        one.weights(-axis, vectors(lamps), vectors(eyes)),
        strict=True,
    ):
        assert np.array_equal(np.array(a), np.array(b))


@pytest.mark.parametrize(
    ("element", "keys", "words"),
    [
        ("cylinder", {"transmission": 0.6, "alpha": 0.2}, "breaks energy conservation"),
        ("cylinder", {"transmission": -0.1}, "transmission is -0.1"),
        ("cylinder", {"transmission": math.nan}, "transmission is nan"),
        ("cylinder", {"clearness": 1.5}, "clearness is 1.5"),
        ("sphere", {"clearness": 0.5}, "cylinders only"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(element, keys, words):
    with pytest.raises(InputError, match=words) as caught:
        matter(element, **keys)
    assert "\n" not in str(caught.value)


def test_a_transmitted_colour_above_one_is_refused():
    with pytest.raises(InputError, match="give a transmitted_colour from 0 to 1"):
        replace(matter("cylinder"), transmitted_colour=hg.Spectrum.constant(1.1))


def test_files_keep_transmission_and_those_without_have_no_such_keys():
    one = matter("cylinder", 0.7)
    record = one.record()
    assert reflectance_from_record(record, "table").record() == record
    usual = reflectance_from_record({k: v for k, v in record.items() if k != "transmitted_colour"}, "table")
    assert usual.transmitted[0] is usual.body_colour
    opaque = replace(one, transmission=0.0).record()
    assert not {"transmission", "transmitted_colour", "clearness"} & opaque.keys()


def test_materials_side_by_side_keep_their_own_transmission():
    """With tails, a body law and further lobes in the rows, kernels give each what its record does."""
    fibre = matter("cylinder", 0.6, lobes=((0.05, 0.5),))
    sheet = matter("plane", epsilon=0.2, sigma=0.1, nu=2.0, alpha=0.1)
    grain, opaque = matter("sphere", transmission=0.2), replace(matter("cylinder"), transmission=0.0)
    hair = matter("cylinder", 1.0, n=1.4, gamma=0.15, body_colour=RED)
    each = [opaque, fibre, sheet, grain, hair]
    materials, lamps, eyes = Materials(each, palette_of(each, [], [WHITE])), unit(900, 8), unit(900, 9)
    ways = np.broadcast_to(AXIS, lamps.shape), lamps, eyes
    number = arrays().UInt(np.repeat(np.arange(len(each), dtype=np.uint32), 900))  # all by one kernel
    got = materials.weights(number, *(vectors(np.tile(v, (len(each), 1)), "Array3f") for v in ways))
    got = np.stack([np.array(part).reshape(len(each), 900) for part in got], axis=1)
    for one, mine in zip(each, got, strict=True):
        true = list(one.weights(*map(vectors, ways)))
        for part in range(4):
            if one.element == "sphere" and part == 1:  # many nodes, of facets that do not transmit
                continue
            own = np.array(true[part]) if part < len(true) else np.zeros(900)
            # tables of clear light, and single precision where facets are narrow
            assert np.abs(mine[part] - own).max() <= 0.01 * max(np.abs(own).max(), 1e-6)


def test_a_measured_material_may_be_said_to_transmit(tmp_path):
    """It is not measured: the table that names the material states it, and the default colour is white."""
    hg.write_materials([material()], tmp_path / "materials.json")
    table = {"file": "materials.json", "material": "silk", "transmission": 0.2, "clearness": 0.5}
    silk = reflectance_from_table(table, tmp_path, "table", "cylinder")
    assert (silk.transmission, silk.clearness, silk.transmitted[0].at(550.0)) == (0.2, 0.5, 1.0)
    with pytest.raises(InputError, match=r"table: .*transmission is 1\.2"):
        reflectance_from_table(table | {"transmission": 1.2}, tmp_path, "table", "cylinder")


def test_matter_without_transmission_has_the_kernels_of_before():
    """Two weights, rows and channels as without the part; nothing of it is read."""
    one = replace(matter("cylinder"), transmission=0.0, clearness=0.3)
    palette = palette_of([one], [], [WHITE])
    materials = Materials([one], palette)
    assert (len(palette.colours), materials.width, materials.fibres) == (2, 7, None)
    got = materials.weights(arrays().UInt(0), *(arrays().Array3f(0, 0, 1) for _ in range(3)))
    assert type(got) is Weights


def fibres_in_front_of_a_lamp(material):
    """A box of even matter of one element, lit from behind and from the front."""
    density, shape = np.ones((6, 6, 6), np.float32), (6, 6, 6)
    axis = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (*shape, 3))
    box = hg.VolumeBox.from_arrays(
        density, axis, voxel_size=0.1, tau=3.0, materials=(material,), extinction="projected"
    )
    camera = hg.Camera(12, 10, (30, 30), (6, 5)).look_at(eye=(0.25, -2, 0.25), target=(0.25, 0.25, 0.25))
    lamps = hg.Lamp(to_lamp=(0.2, 1, 0.1), name="behind"), hg.Lamp(to_lamp=(0.1, -1, 0.3), name="front")
    return hg.Scene(camera, lamps, boxes=(box,))


SEPARATE = hg.Settings(separate_lamps=True)


def test_the_march_shows_transmitted_light_in_weights_of_its_own(tmp_path):
    """Body and interface weights are those without it; another colour needs no new rendering; EXR keeps it."""
    one = matter("cylinder", 0.5)
    scene = fibres_in_front_of_a_lamp(one)
    image = hg.render(scene, SEPARATE)
    plain = hg.render(fibres_in_front_of_a_lamp(replace(one, transmission=0.0)), SEPARATE)
    assert image.channel_names()[:4] == ["lamp0.body0", "lamp0.interface0", "lamp0.transmitted0", "lamp0.twice0"]
    behind, front = image.weights[..., :4], image.weights[..., 4:]
    assert behind[..., :2] == pytest.approx(plain.weights[..., :2], rel=1e-5, abs=1e-7)
    assert behind[5, 6, 2:].sum() > 3 * behind[5, 6, :2].sum() and front[5, 6, 2:].sum() < 0.5 * front[5, 6, :2].sum()
    green = hg.Spectrum([360, 500, 560, 830], [0.2, 0.7, 0.7, 0.1])
    dyed = hg.render(fibres_in_front_of_a_lamp(replace(one, transmitted_colour=green)), SEPARATE)
    assert np.array_equal(dyed.weights, image.weights)
    response = hg.Response.load("canon_eos_300d")
    palette = replace(image.palette, transmitted=(green,), twice=(green * green,))
    assert np.array_equal(replace(image, palette=palette).expose(response), dyed.expose(response))
    image.save(tmp_path / "a.exr")
    again = hg.read_image(tmp_path / "a.exr")
    assert np.array_equal(again.weights, image.weights)
    assert np.allclose(again.expose(response), image.expose(response), rtol=1e-6)


def test_even_matter_shows_the_light_of_its_elements():
    """Without shadows a pixel is f times its coverage, with f of the oracle along its ray; 1 %."""
    one = matter("cylinder", 0.5)
    scene = fibres_in_front_of_a_lamp(one)
    image = hg.render(replace(scene, lamps=scene.lamps[:1]), hg.Settings(shadows="none", tolerance=0.002))
    eye, lamp = (
        np.array([[-0.5 / 30, -1.0, -0.5 / 30]]),
        np.array([0.2, 1.0, 0.1])[None] / math.sqrt(1.05),
    )  # of row 4, column 6
    eye /= np.linalg.norm(eye)
    f = [part[0] for part in transmitted(one, np.array([[0.0, 0.0, 1.0]]), lamp, eye)]
    true = float(image.alpha[4, 6]) * np.array(f)
    assert image.weights[4, 6, 2:] == pytest.approx(true, abs=0.01 * true.max())
