"""Yarns hold the fibre of their recipe, fibres run along them, and a period of cloth repeats without a seam."""

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness, fill
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_matter.cloth.draft import plain, satin, twill
from hagoromo_matter.cloth.fabric import Fabric, knitted, woven
from hagoromo_matter.cloth.knit import JERSEY, Knitted, loop_of
from hagoromo_matter.cloth.weave import LINEN, SILK, WOOL, Woven
from hagoromo_matter.cloth.yarn import Yarn, check_yarn

BARE = {"hairs_per_cm": 0.0, "slubs_per_cm": 0.0}
SINGLE = Yarn(0.34, 1.2, 1, 5.0, "Z", 0.0, 150, 18.0, **BARE)
FOLDED = Yarn(0.37, 1.1, 2, 5.0, "S", 6.0, 45, 20.0, **BARE)
CLOTH = Woven(plain(), 14.0, 12.0, SINGLE, FOLDED)
GREY = Reflectance(0.2, 0.1, 0.2, 1.5, Spectrum.constant(0.8), element="cylinder")


def sampled(fabric: Fabric, voxel: float, size: tuple[float, float] | None = None, start=(0.0, 0.0), variant: int = 0):
    """Density, tangent and population on a lattice (height, v, u) over a part of the period [mm]."""
    jit, (bottom, top) = arrays(), fabric.heights_mm
    size = size or fabric.period_mm
    nx, ny, nz = (max(1, round(span / voxel)) for span in (*size, top - bottom))
    index = dr.arange(jit.UInt, nx * ny * nz)
    at = [jit.Float(n) + 0.5 for n in (index % nx, index // nx % ny, index // (nx * ny))]
    spans, low = (*size, top - bottom), (*start, bottom)
    point = jit.Array3f(*(low[k] + at[k] * (spans[k] / n) for k, n in enumerate((nx, ny, nz))))
    density, tangent, population = fabric.field(point, jit.UInt(variant) + 0 * index)
    shape = (nz, ny, nx)
    return (
        np.array(density).reshape(shape),
        np.array(tangent).reshape(3, *shape),
        np.array(population).reshape(shape),
    )


def peirce_length(cloth: Woven, crossed: Yarn, pitch: float, share: float) -> float:
    """Length of yarn between crossings of a plain weave [mm], by Peirce's l = (p − D sin θ) / cos θ + D θ."""
    both = cloth.warp.thickness_mm + cloth.weft.thickness_mm
    flat, left = crossed.width_mm - crossed.thickness_mm, both * (1.0 - share)
    angle = np.arcsin(both / np.hypot(pitch - flat, left)) - np.arctan2(left, pitch - flat)
    return (pitch - flat - both * np.sin(angle)) / np.cos(angle) + both * angle + flat


@pytest.mark.by_night("0.0-twelve voxels a yarn", "0.0-six voxels a yarn")
@pytest.mark.parametrize("part", [1, 2], ids=["twelve voxels a yarn", "six voxels a yarn"])
@pytest.mark.parametrize("uneven", [0.0, 0.08])
def test_a_cloth_holds_the_fibre_of_its_recipe(part, uneven):
    """Volume of fibres over that of the period, within the 3 % asked, on voxels that show plies and that do not."""
    cloth = CLOTH._replace(**{k: getattr(CLOTH, k)._replace(uneven=uneven) for k in ("warp", "weft")})
    fabric = woven(cloth, part * 0.34 / 12, 1)
    volume = np.prod([*fabric.period_mm, np.diff(fabric.heights_mm)[0]])
    found = sampled(fabric, 0.34 / 12)[0].mean() * volume / (fabric.period_mm[0] * fabric.period_mm[1])
    (u, v), expected = cloth.pitch, 0.0
    for yarn, crossed, pitch in ((cloth.warp, cloth.weft, v), (cloth.weft, cloth.warp, u)):
        length = peirce_length(cloth, crossed, pitch, 0.5)
        area = yarn.fibres * yarn.plies * np.pi * (0.5e-3 * yarn.fibre_um) ** 2
        expected += area * yarn.lengthening * length / (u * v)
    assert found == pytest.approx(expected, rel=0.03)


def test_single_fibres_fill_what_their_mean_fills():
    """On voxels of a sixth of a fibre, against voxels that show none: the same yarn, within 3 %."""
    span, start = (1.2, 0.6), (2.0, 2.0)
    made = [woven(CLOTH, voxel, 1) for voxel in (0.003, 0.028)]
    fine, coarse = (sampled(fabric, 0.006, span, start)[0] for fabric in made)
    heights = [np.diff(fabric.heights_mm)[0] for fabric in made]
    assert fine.mean() * heights[0] == pytest.approx(coarse.mean() * heights[1], rel=0.03)
    inside = fine[fine > 0.01]
    assert (inside > 0.9).mean() > 0.3  # fibres with soft edges and air between them, not a grey mean of a half


def test_tangents_run_along_the_yarn():
    """Mean tangents of slices across warp yarns, against the direction of the middle of these slices: 5°."""
    cloth = CLOTH._replace(uneven=0.0, warp=SINGLE._replace(uneven=0.0))
    fabric = woven(cloth, 0.34 / 12, 1)
    density, tangent, population = sampled(fabric, 0.34 / 12)
    weight = density * (population == 0)
    (nz, _, nx), ends = density.shape, round(fabric.period_mm[0] * cloth.warp_per_cm / 10)
    angles = []
    for end in range(ends):
        part = slice(end * nx // ends, (end + 1) * nx // ends)
        own, along = weight[:, :, part], tangent[:, :, :, part]
        mass = own.sum(axis=(0, 2))
        height = (own * np.arange(nz)[:, None, None]).sum(axis=(0, 2)) / mass
        slope = 0.5 * (np.roll(height, -1) - np.roll(height, 1))
        mean = (own * along).sum(axis=(1, 3)) / mass
        angles += np.abs(np.arctan2(mean[2], mean[1]) - np.arctan(slope))[2:-2].tolist()
        assert np.abs(mean[0]).mean() < 0.1  # of the helix nothing is left on the mean
    assert np.degrees(np.mean(angles)) < 5.0


@pytest.mark.parametrize("hand", ["Z", "S"])
def test_fibres_wind_by_their_twist(hand):
    """On the top of a float, tan of the fibres' angle is 2π R T, and Z leans as the letter: within 15 % for bundles."""
    yarn = SINGLE._replace(hand=hand, migration=0.0, uneven=0.0, flatness=1.0)
    cloth = Woven(satin(8), 12.0, 12.0, yarn, yarn, uneven=0.0)
    fabric = woven(cloth, yarn.diameter_mm / 12, 1)
    density, tangent, population = sampled(fabric, yarn.diameter_mm / 12)
    top = fabric.thickness_mm / 2 - 0.05 * yarn.diameter_mm
    level = round((top - fabric.heights_mm[0]) / np.diff(fabric.heights_mm)[0] * density.shape[0] - 0.5)
    seen = (density[level] > 0.2) & (population[level] == 0) & (np.abs(tangent[2, level]) < 0.1)
    lean = tangent[0, level][seen] / tangent[1, level][seen]
    turns = round(yarn.twist_per_cm * fabric.period_mm[1] / 10)  # of a period: whole ones
    expected = 2 * np.pi * (0.45 * yarn.diameter_mm) * turns / fabric.period_mm[1]
    # seen from above, a right-handed screw along v leans to +u on its upper side
    assert np.median(lean) == pytest.approx(expected if hand == "Z" else -expected, rel=0.15)


@pytest.mark.by_night("jersey")
@pytest.mark.parametrize(
    "make", [lambda: woven(WOOL, 0.05, 3), lambda: knitted(JERSEY, 0.06, 3)], ids=["wool", "jersey"]
)
def test_a_period_has_no_seam_and_variants_share_their_border(make):
    """At u = 0 and at the period densities agree but for rounding; variants do to two voxels from it, not inside."""
    fabric, jit = make(), arrays()
    voxel, draw = 0.05, np.random.default_rng(2)
    count = 20_000
    across, height = draw.random(count), draw.uniform(fabric.heights_mm[0], fabric.heights_mm[1], count)
    for axis in (0, 1):
        low = np.zeros((3, count))
        low[1 - axis], low[2] = across * fabric.period_mm[1 - axis], height
        high = low.copy()
        low[axis], high[axis] = 1e-4, fabric.period_mm[axis] - 1e-4
        ends = [np.array(fabric.field(jit.Array3f(*p.astype(np.float32)), jit.UInt(1))[0]) for p in (low, high)]
        assert ends[0].max() > 0.2
        assert np.abs(ends[0] - ends[1]).mean() < 0.01
        for inward in (0.0, 2.0 * voxel, 0.5 * fabric.period_mm[axis]):
            low[axis] = inward
            point = jit.Array3f(*low.astype(np.float32))
            first, other = (np.array(fabric.field(point, jit.UInt(k))[0]) for k in (0, 2))
            if inward < 1.0:
                # steps of the paths lie elsewhere; between two edges of a course, in a few points, either is found
                assert np.quantile(np.abs(first - other), 0.999) < 0.04
            else:
                assert np.abs(first - other).max() > 0.2


def test_one_seed_one_result():
    first, again, other = (sampled(woven(CLOTH, 0.08, 2, seed), 0.1, variant=1)[0] for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def seen_through(cloth: Woven, size: float) -> np.ndarray:
    """Share of light that a flat cloth keeps from a camera far above it, 16 pixels a mm over a square of `size` mm."""
    fabric, jit = woven(cloth, 0.02, 1), arrays()

    def field(point):
        (pu, pv), u, v = fabric.period_mm, point.x + 0.5 * size, point.z + 0.5 * size
        place = jit.Array3f(u - pu * dr.floor(u / pu), v - pv * dr.floor(v / pv), -point.y)
        density, tangent, _ = fabric.field(place, jit.UInt(0))
        return density, jit.Array3f(tangent.x, -tangent.z, tangent.y)

    half, top = 0.5 * size, fabric.heights_mm[1]
    extent = ((-half, -top, -half), (half, top, half))
    box = fill(field, lambda p: abs(p.y) - top, extent, Fineness(0.02, 0.02), GREY).box()
    pixels = round(16 * size)
    camera = Camera(pixels, pixels, (1000.0 * pixels / size, 1000.0 * pixels / size), (pixels / 2, pixels / 2))
    camera = camera.look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3))
    lamp = Lamp(to_lamp=(0.0, -1.0, 0.0), intensity=1.0, spectrum=Spectrum.named("D65"))
    return render(Scene(camera, (lamp,), (box,)), Settings(shadows="none")).alpha


@pytest.mark.by_night("twill")
@pytest.mark.parametrize("draft", [plain(), twill(2, 2)], ids=["plain", "twill"])
def test_threads_and_cover_of_a_cloth_are_counted_in_transmitted_light(draft):
    """Threads from the spectrum of the picture, cover e₁ + e₂ − e₁ e₂ (Peirce) of yarns so wide and so far apart.

    8 mm hold 10 and 8 yarns; cover to 0.03: a voxel at each edge of the yarns is 0.05 of their distance.
    """
    yarn = SINGLE._replace(uneven=0.0, migration=0.0)
    cloth = Woven(draft, 12.5, 10.0, yarn, yarn, uneven=0.0)
    kept = seen_through(cloth, 8.0)
    counts = [int(np.abs(np.fft.rfft(kept.mean(axis=axis))[4:25]).argmax()) + 4 for axis in (0, 1)]
    assert counts == [10, 8]
    warp, weft = (yarn.width_mm / pitch for pitch in cloth.pitch)
    assert (kept > 0.5).mean() == pytest.approx(warp + weft - warp * weft, abs=0.03)


def test_a_loop_holds_the_yarn_that_relaxed_wool_does():
    """Munden's k_s = 19, and legs of the face above, heads below the middle."""
    curve = knitted(JERSEY, 0.1, 1)
    assert loop_of(JERSEY).depth > 0.3 * JERSEY.yarn.diameter_mm
    density, tangent, population = sampled(curve, 0.08)
    held = density > 0.2
    upper = np.arange(density.shape[0])[:, None, None] > 0.5 * density.shape[0]
    legs = (np.abs(tangent[1]) > np.abs(tangent[0]))[held & upper]
    heads = (np.abs(tangent[0]) > np.abs(tangent[1]))[held & ~upper]
    assert legs.mean() > 0.7
    assert heads.mean() > 0.5
    assert set(np.unique(population)) == {0, 1}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"diameter_mm": -0.3}, "diameter_mm of the yarn is -0.3: give a number above 0"),
        ({"diameter_mm": float("nan")}, "diameter_mm"),
        ({"fibre_um": 0.0}, "fibre_um"),
        ({"plies": 0}, "plies"),
        ({"plies": 1.5}, "plies of the yarn is 1.5: give a whole number"),
        ({"fibres": 1000}, "1000 fibres of 18 µm do not fit a ply"),
        ({"fibres": 10**9}, "give a whole number from 1 to"),
        ({"twist_per_cm": 40.0}, "beyond the packing limit"),
        ({"twist_per_cm": -1.0}, "twist_per_cm"),
        ({"hand": "left"}, "hand of the yarn is left: give Z or S"),
        ({"migration": 2.0}, "migration"),
        ({"uneven": 0.9}, "uneven"),
        ({"hairs_per_cm": -1.0}, "hairs_per_cm"),
        ({"ply_twist_per_cm": 3.0}, "a yarn of one ply has none"),
        ({"flatness": 0.5}, "flatness"),
    ],
)
def test_bad_yarns_are_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as refused:
        check_yarn(SINGLE._replace(**change), "yarn")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"warp_per_cm": 0.0}, "warp_per_cm"),
        ({"warp_per_cm": 30.0}, "warp yarns 0.408 mm wide do not fit at warp_per_cm 30: give at most 24.5"),
        ({"weft_per_cm": 24.0, "weft": SINGLE._replace(flatness=1.0)}, "jam at weft_per_cm 24"),
        ({"crimp": 2.0}, "crimp"),
        ({"uneven": -1.0}, "uneven"),
        ({"warp_colours": (0, 1, 2, 3)}, "5 colours"),
        ({"warp_colours": ()}, "colours"),
        ({"warp_colours": (0,) * 300 + (1,)}, "repeats after"),
    ],
)
def test_cloths_that_cannot_be_woven_are_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as refused:
        woven(CLOTH._replace(weft=SINGLE)._replace(**change), 0.05)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wales_per_cm": -1.0}, "wales_per_cm"),
        ({"courses_per_cm": float("inf")}, "courses_per_cm"),
        ({"loop_mm": -1.0}, "loop_mm"),
        ({"loop_mm": 50.0}, "does not fit"),
        ({"wales_per_cm": 20.0}, "does not fit"),
        ({"uneven": 2.0}, "uneven"),
    ],
)
def test_cloths_that_cannot_be_knitted_are_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as refused:
        knitted(Knitted(**change), 0.05)
    assert "\n" not in str(refused.value)


def test_a_ply_holds_as_many_fibres_as_a_hexagonal_lattice():
    """Fibres of diameter d in a ply of diameter D: the disc's area over that of a lattice's cell, √3/2 d²."""
    most = int(np.pi / 4 * 1.0**2 / (np.sqrt(3.0) / 2 * 0.1**2))
    yarn = Yarn(diameter_mm=1.0, fibre_um=100.0, twist_per_cm=0.0, fibres=most)
    assert check_yarn(yarn, "yarn") == yarn
    with pytest.raises(InputError, match=f"{most + 1} fibres of 100 µm do not fit a ply of the yarn: at most {most}$"):
        check_yarn(yarn._replace(fibres=most + 1), "yarn")


def steepest(fits) -> float:
    """Largest angle [°] below 89 for which `fits`, which does up to it, to 1e-3."""
    low, high = 0.0, 89.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def test_plies_are_twisted_until_they_would_enter_each_other():
    """Two helices of radius 1 on opposite sides: while their lines are nearest straight across, plies only touch."""
    turn = np.linspace(1e-3, np.pi, 20_001)
    middle = np.array([1.0, 0.0, 0.0])

    def apart(angle: float) -> bool:
        rise = turn / np.tan(np.radians(angle))
        other = np.stack([-np.cos(turn), -np.sin(turn), rise], axis=1)
        return bool((((other - middle) ** 2).sum(axis=1) >= 4.0).all())

    plies = Yarn(plies=2, fibres=1)
    around = np.pi * plies.diameter_mm * plies.ply[1]  # length of a turn around the yarn [mm]

    def spun(angle: float) -> bool:
        try:
            check_yarn(plies._replace(twist_per_cm=10.0 * np.tan(np.radians(angle)) / around), "yarn")
        except InputError as refused:
            assert "beyond the packing limit" in str(refused)
            return False
        return True

    assert steepest(spun) == pytest.approx(steepest(apart), abs=0.01)


@pytest.mark.parametrize(("plies", "touching", "filled"), [(2, 1 / 2, 0.610), (3, 0.6462, 0.743), (4, 0.6863, 0.797)])
def test_pressed_plies_fill_more_of_the_yarn(plies, touching, filled):
    """The section, counted on a lattice: plies touch the yarn's outline and keep their own side of each flat face.

    touching: share that round plies fill, n / (1 + 1/sin(π/n))²; filled: with a radius 1.15 times as large.
    """
    yarn = Yarn(plies=plies, fibres=10)
    radius, offset = yarn.ply
    assert radius + offset == pytest.approx(1.0)
    assert plies * (radius / 1.15) ** 2 == pytest.approx(touching, rel=1e-4)
    at = (np.arange(800) + 0.5) / 400.0 - 1.0
    points = np.stack(np.meshgrid(at, at), axis=-1)
    angles = 2.0 * np.pi * np.arange(plies) / plies
    middles = offset * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    distances = np.linalg.norm(points[..., None, :] - middles, axis=-1)
    own = distances[..., 0] <= np.minimum(radius, distances.min(axis=-1))  # of the first ply
    counted = plies * own.mean() * 4.0 / np.pi
    assert counted == pytest.approx(filled, abs=1e-3)
    assert plies * radius**2 * yarn.kept == pytest.approx(counted, abs=1e-3)


@pytest.mark.nightly
def test_the_presets_can_be_made():
    for cloth in (LINEN, WOOL, SILK):
        assert woven(cloth, 0.1, 1).populations == 2
    assert knitted(JERSEY, 0.1, 1).populations == 2
