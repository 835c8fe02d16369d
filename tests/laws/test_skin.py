"""Skin is what its recipe says: lines as deep, near and slanted as told, layers, pores; a colour by its pigments."""

from itertools import pairwise

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays, clip
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.table import read_table
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import build
from hagoromo.matter.fill import Fineness
from hagoromo.matter.shape import plane, sphere
from hagoromo.reflectance.pigment import Pigment, skin_colour
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.reflectance_record import reflectance_from_record
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.skin.skin import Flush, Granules, check_granules, skin, skin_on, skin_patch
from hagoromo_matter.skin.skin_lines import FurrowLattice, furrows, pores, primary, secondary
from tests.data import DATA, real_data

NIST = "nist_skin/nist_skin_70_subjects_250_1000nm.csv"
FIGURES = {"alpha": 0.3, "beta": 0.3, "gamma": 0.3, "n": 1.4}
FACING = (0.0, -1.0, 0.0)


def square(side_mm: float, pixels: int):
    """Points on the plane y = 0, `pixels` a side, and their normals."""
    jit = arrays()
    index = dr.arange(jit.UInt, pixels * pixels)
    step = side_mm / pixels
    flat = dr.zeros(jit.Float, pixels * pixels)
    point = jit.Array3f(jit.Float(index % pixels) * step, flat, jit.Float(index // pixels) * step)
    dr.make_opaque(point)
    return point, jit.Array3f(*FACING)


def relief(depth, side_mm: float, pixels: int) -> np.ndarray:
    """Depths (pixels, pixels) [mm] of a function of point and normal."""
    return np.array(depth(*square(side_mm, pixels))).reshape(pixels, pixels)


def same_bits(one: VolumeBox, other: VolumeBox) -> bool:
    grids = (one.bricks.density, other.bricks.density), (one.bricks.axis, other.bricks.axis)
    return np.array_equal(one.bricks.places, other.bricks.places) and all(
        np.array_equal(np.array(a.values), np.array(b.values)) for a, b in grids
    )


def test_one_seed_one_skin():
    material = Reflectance(0.3, 0.3, 0.3, 1.4, Spectrum.constant(0.5), element="sphere")
    first, again, other = (skin_patch(material, 2.0, fineness=Fineness(0.04, 0.08), seed=seed) for seed in (3, 3, 4))
    assert same_bits(first.box(), again.box())
    assert not same_bits(first.box(), other.box())
    assert [m.element for m in first.header.materials] == ["sphere", "plane"]


@pytest.mark.parametrize("primary_mm", [0.5, 0.8])
def test_primary_lines_are_as_deep_and_as_near_as_stated(primary_mm):
    """A family has a line every spacing: the mass of the furrows over a square is that of its lines.

    A furrow of depth d and profile exp(−(s/w)²) has the section d w √π; a line is ½ … 1 as strong as its family, and a
    family FAINTEST + (1 − FAINTEST) · 0.6 on average as the noise that fades it: bounds of a third hold any such mean.
    Two lines meet at one point only, so their masses add but for a few per cent.
    """
    lines = FurrowLattice(primary_mm=primary_mm, primary_depth_mm=0.03)
    side = 60 * primary_mm
    found = relief(lambda p, n: primary(p, n, lines, arrays().UInt(1)), side, 2400)
    assert found.max() == pytest.approx(lines.primary_depth_mm, rel=0.05)
    section = lines.primary_depth_mm * 1.2 * lines.primary_depth_mm * np.sqrt(np.pi)
    length = (1.0 + 1.0 + 0.6) / primary_mm  # of the three families on a unit of area, each as deep as its share
    strength = 0.35 + 0.65 * 0.6 * 0.75
    assert found.mean() == pytest.approx(section * length * strength, rel=0.15)


@pytest.mark.parametrize("rhomb_deg", [40.0, 90.0])
def test_primary_lines_run_along_the_sides_of_rhombs(rhomb_deg):
    """The relief's spectrum is strongest across the told directions, to the 8° that the warp spreads its peaks."""
    lines = FurrowLattice(primary_mm=0.8, primary_depth_mm=0.05, rhomb_deg=rhomb_deg)
    side, pixels = 60.0, 1200
    found = relief(lambda p, n: primary(p, n, lines, arrays().UInt(2)), side, pixels)
    power = np.abs(np.fft.fft2((found - found.mean()) * np.outer(np.hanning(pixels), np.hanning(pixels)))) ** 2
    frequency = np.fft.fftfreq(pixels, side / pixels)
    across, up = np.meshgrid(frequency, frequency)
    ring = np.abs(np.hypot(across, up) * lines.primary_mm - 1.0) < 0.4
    angle = np.degrees(np.arctan2(up, across)) % 180.0
    strength, edges = np.histogram(angle[ring], bins=90, range=(0.0, 180.0), weights=power[ring])
    strength = np.convolve(np.tile(strength, 3), np.hanning(9) / np.hanning(9).sum(), "same")[90:180]
    middle = 0.5 * (edges[1:] + edges[:-1])
    for expected in (90.0 - 0.5 * rhomb_deg, 90.0 + 0.5 * rhomb_deg):
        near = np.abs(middle - expected) < 15.0
        assert middle[near][strength[near].argmax()] == pytest.approx(expected, abs=8.0)
        assert strength[near].max() > 2.0 * strength.min()


def test_secondary_lines_enclose_fields_of_their_size():
    """Fields between the lines, counted as connected areas: one cell of side s has 1.46 sections on s² (Voronoi cells
    cut by a plane, Okabe et al. 2000, Poisson points); jittered points are more even: between 1 and 1.46.
    """
    from skimage.measure import label

    lines = FurrowLattice(secondary_mm=0.4, secondary_depth_mm=0.02)
    side = 16.0
    found = relief(lambda p, n: secondary(p, lines, arrays().UInt(3)), side, 1600)
    assert found.max() == pytest.approx(lines.secondary_depth_mm, rel=0.02)
    fields = np.asarray(label(found < 0.5 * lines.secondary_depth_mm, connectivity=1))
    sizes = np.bincount(fields.ravel())[1:]
    count = np.count_nonzero(sizes > 100) / (side / lines.secondary_mm) ** 2
    assert 0.8 < count < 1.46


def test_pores_stand_as_dense_as_stated():
    """Counted as connected hollows: Poisson scatter of ¹/√n at 3 σ, and a tenth for those that touch or are shallow."""
    from skimage.measure import label

    lines = FurrowLattice(pore_mm=0.12, pores_per_cm2=90.0)
    side = 40.0
    found = relief(lambda p, n: pores(p, lines, arrays().UInt(4)), side, 2400)
    count, expected = np.asarray(label(found > 0)).max(), lines.pores_per_cm2 * (0.1 * side) ** 2
    assert count == pytest.approx(expected, rel=0.1 + 3.0 / np.sqrt(expected))
    assert found.max() <= 0.7 * lines.pore_mm + 1e-6


def test_what_the_lattice_cannot_carry_fades():
    """No relief at voxels of its size, all of it at a fraction, more in between."""
    lines, (point, normal) = FurrowLattice(), square(8.0, 400)
    found = [
        float(np.array(furrows(point, normal, lines, Fineness(voxel, 0.1), arrays().UInt(5)) + 0.0 * point.x).mean())
        for voxel in (0.2, 0.1, 0.02, 0.01)
    ]
    assert found[0] == 0.0
    assert found[0] < found[1] < found[2] == pytest.approx(found[3], rel=0.2)


def test_scales_lie_over_granules():
    """Above the depth of the horn it is scales, below granules, and axes lean from the normal by the told tilt."""
    granules, fine = Granules(corneum_mm=0.05, granule_mm=0.01, scale_deg=8.0), Fineness(0.01, 0.05)
    flat = granules._replace(primary_depth_mm=0.0, secondary_depth_mm=0.0, pores_per_cm2=0.0)
    point, _ = square(4.0, 300)
    for depth, layer in ((0.03, 1), (0.07, 0)):
        below = type(point)(point.x, point.y + depth, point.z)
        density, axis, found = skin(below, lambda p: plane(p, FACING), flat, fine, 1)
        assert np.all(np.array(found) == layer)
        assert np.array(density).min() > 0.9
        tilt = np.degrees(np.arccos(np.clip(-np.array(axis)[1], -1, 1)))
        # the vector of three uniform numbers leans by sine of the tilt: its part across has that length √(2/3) rms
        assert np.sqrt(np.mean(tilt**2)) == pytest.approx(8.0 * np.sqrt(2 / 3), rel=0.15)


@pytest.mark.parametrize("lamp_deg", [0.0, 50.0])
def test_a_thick_skin_shows_the_mean_of_its_granules(lamp_deg):
    """Spheres without scales or relief, seen along the normal: f cosθ_i / (cosθ_i + cosθ_r) of a deep layer, with f the
    quadrature over the sphere's normals; to 1 %, twice the tolerance of the march.
    """
    bare = Granules(granule_mm=0.01, corneum_mm=0.0, primary_depth_mm=0, secondary_depth_mm=0, pores_per_cm2=0)
    material = Reflectance(0.3, 0.0, 0.3, 1.4, Spectrum.constant(0.5), element="sphere")
    corners = (-6.0, -0.3, -6.0), (6.0, 1.6, 6.0)
    box = skin_on(lambda p: plane(p, FACING), corners, material, bare, Fineness(0.1, 0.2)).box()
    to_lamp = np.array([np.sin(np.radians(lamp_deg)), -np.cos(np.radians(lamp_deg)), 0.0])
    lamp = Lamp(to_lamp=to_lamp, intensity=1.0, spectrum=Spectrum.constant(1.0))
    camera = Camera(7, 5, (700.0, 700.0), (3.5, 2.5)).look_at((0.0, -0.4, 0.0), (0.0, 0.0, 0.0))
    found = render(Scene(camera, (lamp,), (box,))).weights[..., 0]
    nodes, weights = np.polynomial.legendre.leggauss(40)
    cosine, turn = np.meshgrid(0.5 + 0.5 * nodes, 2 * np.pi * np.arange(80) / 80, indexing="ij")
    normals = np.sqrt(1 - cosine**2) * np.cos(turn), -cosine
    facing = np.maximum(normals[0] * to_lamp[0] + normals[1] * to_lamp[1], 0.0) * cosine
    f = 0.3 * 0.5 / np.pi * (facing.mean(axis=1) @ weights) * np.pi
    tilt = np.cos(np.radians(lamp_deg))
    assert found.mean() == pytest.approx(f * tilt / (tilt + 1.0) / 0.5, rel=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"granule_mm": 0.0}, "granule_mm must be a number above 0"),
        ({"primary_depth_mm": -0.1}, "primary_depth_mm must be a number from 0 to"),
        ({"primary_depth_mm": 0.5}, "no skin between lines"),
        ({"secondary_depth_mm": 0.5}, "no skin between lines"),
        ({"rhomb_deg": 5.0}, "rhomb_deg is 5"),
        ({"scale_deg": 80.0}, "scale_deg is 80"),
        ({"pores_per_cm2": 1e4}, "take up"),
        ({"material": FIGURES | {"body_colour": {"melanin": 2.0}}}, "melanin must be a number from 0 to 1"),
        ({"material": FIGURES | {"body_colour": {"blood": -1}}}, "blood must be a number from 0 to 0.2"),
        ({"material": FIGURES | {"body_colour": {"ink": 1}}}, "unknown key 'ink'"),
    ],
)
def test_bad_recipes_are_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as refused:
        build({"kind": "skin", "size_mm": 2.0, "material": FIGURES | {"body_colour": 0.5}} | change)
    assert "\n" not in str(refused.value)


def test_defaults_pass_their_checks():
    assert check_granules(Granules()) == Granules()


def test_pigments_darken():
    """More melanin or more blood: darker at all wavelengths; a reflectance is within 0…1."""
    nm = np.arange(380.0, 731.0, 2.0)
    for name in ("melanin", "blood"):
        rows = [skin_colour(Pigment(**{name: share})).at(nm) for share in (0.0, 0.005, 0.02, 0.1, 0.2)]
        assert all((above > below).all() for above, below in pairwise(rows))
        assert min(row.min() for row in rows) > 0
        assert max(row.max() for row in rows) < 1


def test_blood_shows_its_two_bands():
    """Dips at 542 and 576 nm with oxygen, one at 556 nm without (Prahl's table), to its spacing there of 6 nm."""
    nm = np.arange(520.0, 601.0, 1.0)

    def dips(oxygenation: float) -> np.ndarray:
        colour = skin_colour(Pigment(blood=0.02, oxygenation=oxygenation)).at(nm)
        return nm[1:-1][(colour[1:-1] < colour[:-2]) & (colour[1:-1] <= colour[2:])]

    assert dips(1.0) == pytest.approx([542.0, 576.0], abs=3)
    assert dips(0.0) == pytest.approx([556.0], abs=3)


def test_a_recipe_names_the_pigments():
    found = reflectance_from_record(FIGURES | {"body_colour": {"melanin": 0.1}}, "material").body_colour
    assert np.array_equal(found.values, skin_colour(Pigment(melanin=0.1)).values)


@real_data(NIST)
def test_measured_skin_is_met_by_some_pigments():
    """70 people's skin at 400–700 nm (NIST, doi 10.18434/M38597), three parameters each: rms 0.014 of reflectance in
    the median and 0.028 at worst were found; a surface's ((n−1)/(n+1))² is added, which the measured ones include.
    """
    from scipy.optimize import least_squares

    table, nm = read_table(DATA / NIST), np.arange(400.0, 701.0, 5.0)
    errors = []
    for name in [column for column in table if column != "wavelength_nm"][::3]:
        measured = np.interp(nm, table["wavelength_nm"], table[name])

        def off(shares: np.ndarray, measured: np.ndarray = measured) -> np.ndarray:
            return skin_colour(Pigment(*shares)).at(nm) + (0.4 / 2.4) ** 2 - measured

        errors.append(np.sqrt(np.mean(least_squares(off, (0.05, 0.02, 0.7), bounds=([0] * 3, [1, 0.2, 1])).fun ** 2)))
    assert np.median(errors) < 0.016
    assert max(errors) < 0.03


def test_the_colour_of_flushed_skin_goes_over_into_that_of_the_rest():
    """Voxels hold shares of both colours, so that a border between them has no steps."""
    red = Spectrum([400, 700], [0.2, 0.8])
    flush = Flush(lambda p: clip(0.5 + p.x, 0.0, 1.0), red)
    grey = Reflectance(0.25, 0.3, 0.3, 1.4, Spectrum.constant(0.6), element="sphere")
    extent = (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)
    box = skin_on(lambda p: sphere(p, (0, 0, 0), 0.8), extent, grey, fineness=Fineness(0.1, 0.1), flush=flush).box()
    assert box.basis == (grey.body_colour, red) and len(box.materials) == 2
    held = box.bricks.read(0, box.bricks.kept)
    shares = held["colour"][held["density"] > 0.0][:, :2].astype(float)
    assert np.abs(shares.sum(axis=1) - 1.0).max() < 2e-3 and shares.min() >= 0.0
    between = (shares[:, 1] > 0.2) & (shares[:, 1] < 0.8)
    assert between.mean() > 0.2  # of dithered materials, none


def flat_skin(fineness: Fineness, granules: Granules, tilt: tuple[float, float, float]) -> VolumeBox:
    """Skin of a plane through the origin, 8 × 6 × 8 mm around it."""
    normal = np.array(tilt) / np.linalg.norm(tilt)

    def distance(point):
        return sum(float(n) * x for n, x in zip(normal, point, strict=True))

    material = Reflectance(**FIGURES, body_colour=Spectrum.constant(0.5), element="sphere")
    return skin_on(distance, ((-4.0, -3.0, -4.0), (4.0, 3.0, 4.0)), material, granules, fineness).box()


SMOOTH = Granules(corneum_mm=9.0, scale_deg=0.0, primary_depth_mm=0.0, secondary_depth_mm=0.0, pores_per_cm2=0.0)


def test_grazing_light_on_even_skin_shows_no_lattice():
    """The light of an even plane of thick skin is even; trilinear density ripples: 1.2 % with an edge of two voxels."""
    box = flat_skin(Fineness(0.12, 0.17), SMOOTH, (0.13, -1.0, 0.21))
    eye = 0.2 * np.array((0.5, -1.0, 0.1)) / np.linalg.norm((0.5, -1.0, 0.1))
    camera = Camera(96, 96, (7200.0, 7200.0), (48.0, 48.0)).look_at(eye, (0.0, 0.0, 0.0))
    settings = Settings(samples=4, tolerance=0.01, shadows="march")
    light = render(Scene(camera, (Lamp(to_lamp=(1.1, -0.6, 3.4)),), (box,)), settings).weights[..., 0]
    down, across = np.indices(light.shape).reshape(2, -1) / 96.0
    bent = np.polynomial.polynomial.polyvander2d(down, across, (2, 2))
    even = (bent @ np.linalg.lstsq(bent, light.ravel(), rcond=None)[0]).reshape(light.shape)
    assert light.min() > 0.0 and np.std(light / even - 1.0) < 0.007


def test_skin_of_scales_as_deep_as_light_reaches_has_them_alone():
    """One element and no materials of voxels: shadows are those of even matter."""
    deep, thin = (flat_skin(Fineness(0.2, 0.17), SMOOTH._replace(corneum_mm=mm), FACING) for mm in (9.0, 0.3))
    assert [m.element for m in deep.materials] == ["plane"] and deep.bricks.material is None
    assert [m.element for m in thin.materials] == ["sphere", "plane"] and thin.bricks.material is not None
