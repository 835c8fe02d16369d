"""Laws of projected extinction (MODEL §3): σ(ω) = τ ρ A(a·ω) keeps energy, reciprocity and the opaque limit.

The oracle is NumPy: quadrature over the normals of an element and over directions. Isotropic extinction breaks energy
and reciprocity by tens of percent: each test shows that it sees the difference.
"""

import math
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from hagoromo.app.info import info
from hagoromo.backend import arrays, column, name
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.ray_march import RayMarch
from hagoromo.image.scene.modes import Shadows
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import build, build_to
from hagoromo.reflectance.element import ELEMENTS, element_weights, projected_area
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.medium import Medium
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.header import header_from_record, header_record
from tests.oracle.radiance import radiance
from tests.oracle.scenes import box_of, centres

WHITE = Spectrum.constant(1.0)
CAMERA = Camera(31, 29, (40.0, 40.0), (15.5, 14.5))
AXIS = np.array([0.36, -0.48, 0.8])
VOXEL = 0.01


def unit(v):
    v = np.asarray(v, float)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def vectors(v):
    v = np.broadcast_to(v, np.shape(v)).reshape(-1, 3)
    return arrays().Array3f64(*(column(arrays().Float64, v[:, k]) for k in range(3)))


def sphere_of_directions(count):
    """Gauss–Legendre nodes in z, equal turns: directions (2 count², 3) and weights [sr]."""
    z, weight = np.polynomial.legendre.leggauss(count)
    turn = (np.arange(2 * count) + 0.5) * math.pi / count
    r = np.sqrt(1 - z * z)[:, None]
    way = np.stack([r * np.cos(turn), r * np.sin(turn), np.broadcast_to(z[:, None], (count, 2 * count))], axis=-1)
    return way.reshape(-1, 3), np.repeat(weight * math.pi / count, 2 * count)


def normals(element, axis, count=4001):
    """Normals of an element, each standing for an equal area: both faces of a plane."""
    if element == "plane":
        return np.stack([axis, -axis])
    if element == "cylinder":
        one = unit(np.cross(axis, [1.0, 0.0, 0.0]))
        turn = 2 * math.pi * (np.arange(count) + 0.5)[:, None] / count
        return np.cos(turn) * one + np.sin(turn) * np.cross(axis, one)
    k = np.arange(100 * count) + 0.5
    z, turn = 1 - 2 * k / len(k), math.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


def matter(element, alpha=0.2, beta=0.3, gamma=0.3):
    return Reflectance(alpha, beta, gamma, 1.5, WHITE, element=element)


def full_box(material, extinction, tau=30.0, shape=(5, 7, 6), axis=AXIS):
    """A box full of matter of one axis; arrays are indexed [z, y, x]."""
    axes = np.broadcast_to(axis, (*shape, 3))
    return VolumeBox.from_arrays(np.ones(shape), axes, VOXEL, tau, [material], extinction=extinction)


def cloud(element, extinction, tau=120.0, **figures):
    """A soft cloud whose axes wave around AXIS, smoothly on its lattice; its middle is a few mean free paths thick."""
    z, y, x = np.indices((19, 23, 17))
    density = np.exp(-(((z - 9) / 5) ** 2) - ((y - 11) / 6) ** 2 - ((x - 8) / 4) ** 2)
    axis = unit(AXIS + 0.7 * np.stack([np.sin(0.5 * y + 0.3 * z), np.sin(0.4 * z - 0.3 * x), np.cos(0.5 * x)], axis=-1))
    density[density < 0.02] = 0.0
    return VolumeBox.from_arrays(density, axis, VOXEL, tau, [matter(element, **figures)], extinction=extinction)


def scene_of(box, lamps):
    corners = box.corners()
    middle, away = corners.mean(axis=0), 2.0 * np.linalg.norm(np.ptp(corners, axis=0))
    return Scene(CAMERA.look_at(middle + away * unit([0.3, -1.0, 0.4]), middle), tuple(lamps), (box,))


def chord(box, way):
    """Length [m] of the line along `way` (n, 3) through the middle of an upright box."""
    return (box.size / np.maximum(np.abs(way), 1e-12)).min(axis=-1)


def through_middle(box, lamps, way, shadows: Shadows = "none"):
    """What rays along `way` (n, 3) through the middle of a box bring: weights (n, channels) and transmittance (n,)."""
    origins = box.corners().mean(axis=0) - 1.0 * way
    return RayMarch(scene_of(box, lamps), Settings(shadows=shadows, tolerance=0.01))(origins, way)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_projected_area_is_the_mean_over_the_normals_of_an_element(element):
    """2e-4: the oracle's points; the mean over all directions is ½."""
    ways, weights = sphere_of_directions(24)
    area = np.array(projected_area(element, dr.dot(vectors(AXIS), vectors(ways)))) * np.ones(len(ways))
    drawn = np.random.default_rng(1).choice(len(ways), 29, replace=False)
    true = [np.abs(normals(element, AXIS) @ way).mean() for way in ways[drawn]]
    assert area[drawn] == pytest.approx(np.array(true), abs=2e-4)
    assert (area * weights).sum() == pytest.approx(0.5 * 4 * math.pi, rel=2e-3)  # kinks of |cos|


@pytest.mark.parametrize("element", ["plane", "cylinder"])
@pytest.mark.parametrize(("gamma", "beta"), [(0.15, 0.9), (0.4, 0.3)])
def test_light_that_an_element_scatters_is_the_same_there_and_back(element, gamma, beta):
    """A(V) f(L, V) = A(L) f(V, L), body and interface, in double precision: rounding. A sphere's f knows L·V alone."""
    there, back = (unit(np.random.default_rng(seed).normal(size=(2003, 3))) for seed in (2, 3))
    axis = vectors(np.broadcast_to(AXIS, there.shape))
    area = [np.array(projected_area(element, dr.dot(axis, vectors(way)))) for way in (there, back)]
    one = element_weights(element, axis, vectors(there), vectors(back), 0.2, beta, gamma, 1.5)
    other = element_weights(element, axis, vectors(back), vectors(there), 0.2, beta, gamma, 1.5)
    for first, second in zip(one, other, strict=True):
        assert np.abs(np.array(first)).max() > 0.0
        assert np.array(first) * area[1] == pytest.approx(np.array(second) * area[0], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("element", ELEMENTS)
def test_matter_sends_back_no_more_light_than_it_takes(element):
    """Furnace: ∫ σ(V) f dV = σ(L) of a white body, and ≤ σ(L) with an interface, for every lamp, in front and behind.

    Through the kernels: a ray that loses the share 1 − exp(−σs) of its light brings f times that share. 1e-3: axes
    are stored to 0.05°.
    """
    ways, weights = sphere_of_directions(24)
    lamps = unit([[0.6, -0.4, 0.7], [0.9, 0.5, -0.2], [-0.3, 0.6, -0.4]])
    facing = (lamps @ AXIS > 0) | (element != "plane")  # the back of a plane is black
    lit = [Lamp(to_lamp=tuple(way), spectrum=Spectrum.constant(1.0 + k)) for k, way in enumerate(lamps)]
    white, glossy = matter(element, 1 / math.pi, 0.0), matter(element, 0.1, 1.2, 0.25)

    def albedo(material, extinction):
        """∫ σ(V) f dV / σ(L) for every lamp."""
        box, seen_along = full_box(material, extinction), np.concatenate([-ways, -lamps])
        light = through_middle(box, lit, seen_along)
        passed = light.transmittance.astype(float)
        sigma = -np.log(passed) / chord(box, seen_along)
        f = light.weights.reshape(len(passed), len(lamps), 2).sum(axis=-1) / (1 - passed)[:, None]
        return ((sigma[: len(ways)] * weights)[:, None] * f[: len(ways)]).sum(axis=0) / sigma[len(ways) :]

    assert albedo(white, "projected") == pytest.approx(facing.astype(float), abs=1e-3)
    assert 0.3 < albedo(glossy, "projected").max() < 1.0
    if element != "sphere":
        assert albedo(white, "isotropic").max() > 1.2


def picture_total(box, to_lamp, to_eye, shadows):
    """∫ of the radiance that far eyes see over the plane across `to_eye` [m²], body and interface."""
    count, middle = 64, box.corners().mean(axis=0)
    reach = 0.5 * np.linalg.norm(box.size)
    one = unit(np.cross(to_eye, [0.31, 0.2, 0.93]))
    along = ((np.arange(count) + 0.5) / count * 2 - 1) * reach
    a, b = (grid.reshape(-1, 1) for grid in np.meshgrid(along, along))
    origins = middle + a * one + b * np.cross(to_eye, one) + 3 * reach * to_eye
    rays = RayMarch(scene_of(box, [Lamp(to_lamp=tuple(to_lamp))]), Settings(shadows=shadows, tolerance=0.01))
    light = rays(origins, np.broadcast_to(-to_eye, origins.shape))
    return light.weights.sum(axis=0, dtype=float) * (2 * reach / count) ** 2


@pytest.mark.parametrize(("element", "shadows"), [*((element, "march") for element in ELEMENTS), ("plane", "map")])
def test_lamp_and_eye_may_change_places(element, shadows):
    """∫ exp(−∫σ(V)) σ(V) f exp(−∫σ(L)) dx is the same for (L, V) and (V, L).

    0.5 %: steps (march) of either way; 2 % with maps. Isotropic extinction misses by 20 % with planes and cylinders.
    """
    lamp, eye = unit([0.4, -0.8, 0.6]), unit([-0.2, -0.7, 0.3])
    box = cloud(element, "projected")
    there, back = picture_total(box, lamp, eye, shadows), picture_total(box, eye, lamp, shadows)
    assert there == pytest.approx(back, rel=0.005 if shadows == "march" else 0.02)
    if element != "sphere" and shadows == "march":
        box = replace(box, extinction="isotropic")
        there, back = picture_total(box, lamp, eye, shadows), picture_total(box, eye, lamp, shadows)
        assert abs(math.log(there[0] / back[0])) > 0.2


def turning(element, seed):
    """A full box whose axes turn by up to half a radian from voxel to voxel, this way and that; they vanish nowhere."""
    random, shape = np.random.default_rng(seed), (7, 7, 7)
    wave, phase = 36.0 * unit(random.normal(size=(3, 3))), random.uniform(0.0, 2.0 * math.pi, 3)  # [1/m]
    waves = np.sin(np.moveaxis(np.array(centres(shape)), 0, -1) @ wave.T + phase)
    axis = unit(unit([0.5, -0.6, 0.7]) + 0.5 * waves)  # planes turn their fronts to the lamp
    return box_of(np.ones(shape), axis, 0.4, matter(element, beta=0.0), extinction="projected")


@pytest.mark.parametrize(("element", "seeds"), [("plane", (1, 2)), ("cylinder", (2, 3))])
def test_the_march_is_the_oracle_where_axes_turn_within_a_voxel(element, seeds):
    """Root mean square over the mean of light, 0.3 %; transmittance, 0.001. With one area for a whole step they were
    0.8 to 1.9 % and 0.003 to 0.008, with steps however fine.
    """
    lamp = Lamp(to_lamp=(0.5, -0.6, 0.7))
    for seed in seeds:
        voxels, random = turning(element, seed), np.random.default_rng(5)
        way = unit(random.normal(size=(40, 3)))
        origin = random.uniform(-0.06, 0.06, way.shape) - way
        true, passed = radiance([voxels], [lamp], (origin, way), 550.0)
        scene = Scene(CAMERA, (lamp,), (voxels.box(),))
        light = RayMarch(scene, Settings(shadows="march", tolerance=0.002))(origin, way)
        assert math.sqrt(np.mean((light.weights[:, 0] - true[:, 0]) ** 2)) < 0.003 * true.mean()
        assert math.sqrt(np.mean((light.transmittance - passed) ** 2)) < 0.001


def test_fibres_seen_end_on_in_the_middle_of_a_cell_alone_hide_what_is_behind_them():
    """Axes turn from one side to the other from layer to layer; each cell would have 4 optical depths from the side."""
    shape = (4, 4, 4)
    sides = np.where(np.arange(shape[0]) % 2, 0.6, -0.6)[:, None, None] * np.ones(shape)
    axis = np.stack([sides, np.zeros(shape), np.full(shape, 0.8)], axis=-1)
    fibres = VolumeBox.from_arrays(
        np.ones(shape), axis, VOXEL, 4.0 / VOXEL, [matter("cylinder")], extinction="projected"
    )
    scene, way = scene_of(fibres, [Lamp(to_lamp=(0.0, 0.0, -1.0))]), np.array([[0.0, 0.0, 1.0]])
    origin = fibres.corners().mean(axis=0) - way
    usual, fine = (
        float(RayMarch(scene, Settings(shadows="none", tolerance=tolerance))(origin, way)[1][0])
        for tolerance in (0.04, 0.0025)
    )
    assert math.log(usual) == pytest.approx(math.log(fine), rel=0.15)  # with areas of the middle alone 0.38 of it


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_opaque_limit_does_not_depend_on_the_extinction(element):
    """A dense face shows f without shadows, and f A_V μ_L / (A_V μ_L + A_L μ_V) with them (isotropic: A = 1).

    Eq. (11) over a half space: exponentials of depth with σ(V)/μ_V on the way out and σ(L)/μ_L on the way in. The face
    is that of a block of 20 mean free paths, half a one a voxel. 1 %: the march's steps.
    """
    eye, lamp = np.array([0.0, 0.0, -1.0]), unit([0.5, 0.3, -0.8])
    axis = unit([0.9, 0.6, 0.35] if element == "cylinder" else [0.3, 0.2, -0.9])  # near the highlight
    weights = element_weights(element, vectors(axis), vectors(lamp), vectors(eye), 0.2, 0.3, 0.3, 1.5)
    body, interface = (float(weight[0]) for weight in weights)
    area_lamp, area_eye = np.abs(normals(element, axis) @ np.stack([lamp, eye], axis=1)).mean(axis=0)
    for extinction in ("isotropic", "projected"):
        box = full_box(matter(element), extinction, 0.5 / VOXEL, (41, 61, 59), axis)
        middle = box.corners().mean(axis=0)
        for shadows in ("none", "march"):
            rays = RayMarch(scene_of(box, [Lamp(to_lamp=tuple(lamp))]), Settings(shadows=shadows, tolerance=0.005))
            light = rays([middle + eye], [-eye])
            limit = 1.0
            if shadows == "march":
                a, b = (1.0, 1.0) if extinction == "isotropic" else (area_eye, area_lamp)
                limit = a * -lamp[2] / (a * -lamp[2] + b * -eye[2])
            assert light.weights[0] == pytest.approx(limit * np.array([body, interface]), rel=0.01)


def test_spheres_of_half_the_area_are_isotropic():
    """A sphere's projected area is ½: twice the τ gives the same bits as isotropic extinction; on a GPU, where products
    and sums are joined in each kernel as its compiler likes, to a few units in the last place.
    """
    there, same = (cloud("sphere", *how) for how in (("projected", 240.0), ("isotropic", 120.0)))
    way = unit([[0.3, -0.9, 0.2], [-0.1, 0.8, 0.5]])
    one, other = (through_middle(box, [Lamp(to_lamp=(0.4, -0.8, 0.6))], way, "march") for box in (there, same))
    rounding = 0.0 if name() == "llvm" else 1e-6
    np.testing.assert_allclose(one.weights, other.weights, rtol=rounding)
    np.testing.assert_allclose(one.transmittance, other.transmittance, rtol=rounding)


def test_each_box_of_a_scene_keeps_its_own_extinction():
    """Rays through one of two boxes that stand apart bring what they bring without the other: rounding.

    Without a box of projected extinction kernels know nothing of it.
    """
    away = np.eye(4)
    away[:3, 3] = (0.5, 0.0, 0.0)
    boxes = cloud("plane", "isotropic"), cloud("cylinder", "projected").with_pose(away)
    assert Medium(boxes[:1]).flakes is None and Medium(boxes).flakes is not None
    lamp, eye = Lamp(to_lamp=(0.1, -0.8, 0.6)), unit([-0.05, -0.7, 0.3])
    together = replace(scene_of(boxes[0], [lamp]), boxes=boxes)
    for box in boxes:
        middle = box.corners().mean(axis=0) + 0.02 * np.random.default_rng(2).normal(size=(23, 3))
        alone, among = (
            RayMarch(scene, Settings(shadows="march"))(middle + eye, np.broadcast_to(-eye, middle.shape))
            for scene in (scene_of(box, [lamp]), together)
        )
        assert among.transmittance == pytest.approx(alone.transmittance, rel=1e-4)
        assert among.weights.sum(axis=1) == pytest.approx(alone.weights.sum(axis=1), rel=1e-4, abs=1e-7)


def test_the_extinction_is_kept_in_files_and_must_be_known(tmp_path):
    """Boxes stored without the key are isotropic; a scene may name another extinction, but no unknown one."""
    box = full_box(matter("cylinder"), "projected")
    box.save(tmp_path / "box.zarr")
    assert VolumeBox.load(tmp_path / "box.zarr").extinction == "projected"
    assert info(tmp_path / "box.zarr")["extinction"] == "projected"
    record = header_record(box)
    assert record.pop("extinction") == "projected" and header_from_record(record, "here").extinction == "isotropic"
    assert "extinction" not in header_record(replace(box, extinction="isotropic"))
    with pytest.raises(InputError, match="extinction is 'opaque': give one of isotropic, projected"):
        replace(box, extinction="opaque")  # pyrefly: ignore[bad-argument-type]
    text = """
        camera = {size = [31, 29], focal = [40, 40], eye = [0.03, -1, 0.03]}
        lamp = [{to_lamp = [0, -1, 1]}]
        box = [{file = "box.zarr"}, {file = "box.zarr", extinction = "isotropic"}]
    """
    (tmp_path / "scene.toml").write_text("\n".join(line.strip() for line in text.splitlines()))
    scene, _ = load_scene(tmp_path / "scene.toml")
    assert [box.extinction for box in scene.boxes] == ["projected", "isotropic"]
    assert scene.record()["boxes"][0]["extinction"] == "projected"


def test_recipes_name_the_extinction(tmp_path):
    material = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
    ball = {"kind": "solid", "shape": {"form": "sphere", "radius_mm": 2.0}, "voxel_mm": 0.5, "material": material}
    assert build(ball).extinction == "isotropic"
    assert build(ball | {"extinction": "projected"}).extinction == "projected"
    build_to(ball | {"extinction": "projected"}, tmp_path / "ball.zarr")
    assert VolumeBox.load(tmp_path / "ball.zarr").extinction == "projected"
    with pytest.raises(InputError, match="extinction must be one of isotropic, projected: given 'opaque'"):
        build(ball | {"extinction": "opaque"})
