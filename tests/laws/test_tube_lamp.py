"""A tube lamp: irradiance and solid angle by quadrature, its sampler, Mitsuba's cylinder, files."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, mitsuba
from hagoromo.image.scene.scene_lights import area_lamp_from
from hagoromo.light.shapes.tube import Tube
from hagoromo_formats.mitsuba.write import write_mitsuba

WHITE = hg.Spectrum.constant(1.0)
TUBES = {
    "thin": hg.AreaLamp((0.2, 0.3, 0.8), radius=0.013, along=(1.0, 0.4, 0.1), radiance=40.0),
    "stout": hg.AreaLamp((0.1, -0.2, 0.6), radius=0.25, along=(0.1, 0.3, 0.2), radiance=3.0),
    "towards": hg.AreaLamp((0.0, 0.02, 1.4), radius=0.05, along=(0.05, 0.0, 1.0), radiance=20.0),
}
POINT = np.zeros(3)
DRAWS = 1 << 16


def patches(lamp, along=2000, around=2000):
    """Middles (n, 3), normals and areas of small parts of a tube, by NumPy alone."""
    way, radius = np.array(lamp.shape.along), lamp.shape.radius
    axis = way / np.linalg.norm(way)
    side = np.linalg.svd(axis[None])[2][1:]
    turn = 2.0 * math.pi * (np.arange(around) + 0.5) / around
    normals = np.cos(turn)[:, None] * side[0] + np.sin(turn)[:, None] * side[1]
    places = lamp.position + ((np.arange(along) + 0.5) / along - 0.5)[:, None, None] * way + radius * normals
    return places.reshape(-1, 3), np.tile(normals, (along, 1)), lamp.area / (along * around)


def solid_angles(lamp, point):
    """Unit directions to the parts of a tube that a point sees, and their solid angles [sr]."""
    places, normals, area = patches(lamp)
    away = places - point
    distance = np.linalg.norm(away, axis=1)
    ways = away / distance[:, None]
    return ways, np.maximum(-(normals * ways).sum(axis=1), 0.0) * area / distance**2


@pytest.mark.by_night("thin")
@pytest.mark.parametrize("name", TUBES)
def test_directions_follow_their_density(name):
    """Means over the draws are integrals over what the point sees; a ray in each direction finds the same place."""
    lamp, jit = TUBES[name], arrays()
    light, point = lamp.on_device(), jit.Array3f(0, 0, 0)
    u, v = (jit.Float(row) for row in np.random.default_rng(4).random((2, DRAWS)).astype(np.float32))
    drawn = light.drawn(point, u, v)
    seen = light.seen(point, drawn.to_lamp)
    ways = np.array(drawn.to_lamp, np.float64).T
    density, again = np.array(drawn.density, np.float64), np.array(seen.density, np.float64)
    found = np.array(seen.there) & (density > 0.0)
    assert found.mean() > 0.99  # all but rounding at the outline
    off = np.abs(again[found] / density[found] - 1.0)  # at the outline the cosine is a difference of like numbers
    assert np.quantile(off, 0.99) < 0.01 and np.median(off) < 1e-4
    np.testing.assert_allclose(np.array(seen.distance)[found], np.array(drawn.distance)[found], rtol=2e-3)
    truth, solid = solid_angles(lamp, POINT)
    weights = np.where(found, 1.0 / np.maximum(density, 1e-30), 0.0)
    spread = weights.std() / math.sqrt(DRAWS)
    assert weights.mean() == pytest.approx(solid.sum(), abs=4.0 * spread + 1e-3 * solid.sum())
    for k in range(3):
        value = weights * ways[:, k]
        expected = (solid * truth[:, k]).sum()
        assert value.mean() == pytest.approx(expected, abs=4.0 * value.std() / math.sqrt(DRAWS) + 1e-3 * solid.sum())


def test_rays_that_miss_see_nothing():
    """Beside it, beyond its ends, behind the eye; along its axis the dark end is no light."""
    jit, light = arrays(), hg.AreaLamp((0, 0, 2.0), radius=0.1, along=(0, 0, 1.0), radiance=1.0).on_device()
    ways = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.3, 0.0, 1.0], [1.0, 0.0, 0.0]])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    point = jit.Array3f(0, 0, 0)
    seen = light.seen(point, jit.Array3f(*(jit.Float(np.float32(c)) for c in ways.T)))
    assert not np.array(seen.there).any()
    aside = light.seen(jit.Array3f(1.0, 0.0, 2.0), jit.Array3f(-1.0, 0.0, 0.0))
    assert bool(np.array(aside.there).all()) and np.array(aside.distance).item() == pytest.approx(0.9, rel=1e-5)


@pytest.mark.by_night("path-stout", "path-towards", "march-stout")
@pytest.mark.parametrize("name", TUBES)
@pytest.mark.parametrize("mode", ["path", "march"])
def test_a_floor_is_lit_as_by_quadrature(name, mode):
    """Lambert's floor seen at one point: L = α E."""
    lamp = TUBES[name]
    ways, solid = solid_angles(lamp, POINT)
    truth = 0.25 * lamp.radiance * float((solid * np.maximum(ways[:, 2], 0.0)).sum())
    floor = hg.Surface.floor(0.0, 2.0, hg.Reflectance(0.25, 0.0, 0.2, 1.5, WHITE))
    view = hg.Camera(8, 8, (8e4, 8e4), (4, 4)).look_at((0.0, -1.0, 1.0), (0, 0, 0))
    scene = hg.Scene(view, (), (), (floor,), area_lamps=(lamp,))
    settings = hg.Settings(samples=400 if mode == "path" else 1, orders=1 if mode == "path" else None)
    image = hg.render(scene, settings, mode=mode)
    light = image.weights.sum(axis=-1)  # of a body of 1, and no gloss
    if mode == "march":
        np.testing.assert_allclose(light, truth, rtol=settings.tolerance)
    else:
        assert image.variance is not None
        error = math.sqrt(float(image.variance.mean()) / light.size)
        assert abs(light.mean() - truth) < 3.3 * error + 5e-4 * truth and error < 0.01 * truth


def test_few_points_are_within_the_error_that_is_stated():
    found = TUBES["thin"].points(np.full(3, -0.2), np.full(3, 0.2), 0.04)
    assert found.error <= 0.04 and 2 <= found.places <= 256


def test_the_camera_sees_a_tube_as_it_is():
    """A bright band of the width and length of the tube, in both modes."""
    lamp = hg.AreaLamp((0, 0, 0), radius=0.1, along=(0.8, 0, 0), radiance=2.0, visible=True)
    dark = hg.Surface.floor(-2.0, 5.0, hg.Reflectance(0.0, 0.0, 0.2, 1.5, WHITE))
    view = hg.Camera(40, 40, (400.0, 400.0), (20, 20)).look_at((0, 0, 10.0), (0, 0, 0), up=(0, 1, 0))
    scene = hg.Scene(view, (), (), (dark,), area_lamps=(lamp,))
    march = hg.render(scene, hg.Settings(samples=16)).xyz()[..., 1]
    path = hg.render(scene, hg.Settings(samples=64), mode="path").xyz()[..., 1]
    band = np.zeros((40, 40), bool)
    band[16:24, 4:36] = True  # 0.2 m × 0.8 m at 10 m, 400 px
    for y in (march, path):
        bright = y > 0.5 * y.max()
        assert (bright != band).mean() < 0.03
        np.testing.assert_allclose(y[18:22, 8:32], y.max(), rtol=0.02)


def test_mitsuba_lights_a_floor_alike(tmp_path):
    """The scene that is written for Mitsuba holds a cylinder, and its floor is as bright."""
    mi = mitsuba()
    floor = hg.Surface.floor(0.0, 1.0, hg.Reflectance(0.25, 0.0, 0.2, 1.5, WHITE))
    view = hg.Camera(8, 8, (10.0, 10.0), (4, 4)).look_at((0.2, -0.9, 1.2), (0, 0, 0))
    lamp = hg.AreaLamp((0.2, 0.1, 0.7), radius=0.06, along=(0.5, 0.3, 0.2), radiance=5.0)
    scene = hg.Scene(view, (), (), (floor,), area_lamps=(lamp,))
    ours = hg.render(scene, hg.Settings(samples=512, orders=1), mode="path")
    write_mitsuba(scene, tmp_path / "out")
    (text,) = (path.read_text() for path in (tmp_path / "out").glob("*.xml"))
    assert 'type="cylinder"' in text
    shape, values = lamp.shape.mitsuba(lamp.position)
    light = {"type": "area", "radiance": {"type": "rgb", "value": 5.0}}
    values = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}
    corners = mi.ScalarTransform4f().scale([1, 1, 1])
    matter = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.25 * math.pi}}
    sensor = mi.ScalarTransform4f().look_at(origin=[0.2, -0.9, 1.2], target=[0, 0, 0], up=[0, 0, 1])
    theirs = np.array(
        mi.render(
            mi.load_dict(
                {
                    "type": "scene",
                    "integrator": {"type": "direct", "hide_emitters": True},
                    "floor": {"type": "rectangle", "to_world": corners, "bsdf": matter},
                    "tube": {"type": shape, **values, "emitter": light},
                    "sensor": {
                        "type": "perspective",
                        "to_world": sensor,
                        "fov": math.degrees(2.0 * math.atan(0.4)),
                        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
                    },
                }
            ),
            spp=2048,
            seed=3,
        )
    )[..., 1]
    whole = ours.alpha > 0.999
    assert whole.mean() > 0.4
    light = ours.weights.sum(axis=-1)
    assert light[whole].mean() == pytest.approx(float(theirs[whole].mean()), rel=0.01)
    assert (np.abs(light / np.maximum(theirs, 1e-9) - 1.0)[whole] < 0.12).mean() > 0.9


def test_a_scene_file_states_a_tube(tmp_path):
    table = {"position": [0, 0, 1], "radius": 0.02, "along": [0.6, 0, 0], "radiance": 7}
    lamp = area_lamp_from(table, tmp_path, "scene.toml area_lamp 1")
    assert lamp.shape.word == "tube" and lamp.area == pytest.approx(2.0 * math.pi * 0.02 * 0.6)
    again = area_lamp_from(lamp.record(), tmp_path, "again")
    assert again.record() == lamp.record() and lamp.moved((1, 0, 0)).position.tolist() == [1, 0, 1]
    assert np.ptp(lamp.corners(), axis=0) == pytest.approx([0.6, 0.04, 0.04])


SCENE = """
[camera]
size = [8, 8]
focal = [10.0, 10.0]
principal = [4.0, 4.0]
eye = [0.2, -0.9, 1.2]
target = [0.0, 0.0, 0.0]
[[surface]]
shape = "rectangle"
[surface.reflectance]
alpha = 0.25
beta = 0.0
gamma = 0.2
n = 1.5
body_colour = 1.0
[[area_lamp]]
position = [0.2, 0.1, 0.7]
radius = 0.06
along = [0.5, 0.3, 0.2]
radiance = 5.0
"""


@pytest.mark.parametrize("way", ["mitsuba", "scene.usda"])
def test_a_tube_comes_back_from_other_programs(way, tmp_path):
    if way.endswith("usda"):
        pytest.importorskip("pxr")
    (tmp_path / "scene.toml").write_text(SCENE)
    hg.convert(tmp_path / "scene.toml", tmp_path / way)
    source = tmp_path / way if way.endswith("usda") else next((tmp_path / way).glob("*.xml"))
    hg.convert(source, tmp_path / "back")
    (lamp,), (before,) = (
        hg.load_scene(folder / "scene.toml")[0].area_lamps for folder in (tmp_path / "back", tmp_path)
    )
    assert isinstance(lamp.shape, Tube) and isinstance(before.shape, Tube)
    np.testing.assert_allclose(lamp.position, before.position, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.array(lamp.shape.along)), np.abs(before.shape.along), atol=1e-5)
    assert lamp.shape.radius == pytest.approx(0.06, rel=1e-5) and lamp.radiance == pytest.approx(5.0, rel=0.01)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"radius": 0.1, "along": (0, 0, 0)}, "along is 0 m long: give the way from one end to the other"),
        ({"radius": 0.1, "along": (0, 0)}, "along"),
        ({"along": (0, 0, 1)}, "radius and along"),
        ({"radius": -1.0, "along": (0, 0, 1)}, "radius"),
        ({"radius": 0.1, "length": 2.0}, "give either radius .a sphere., or edges .a rectangle., or radius and along"),
    ],
)
def test_what_is_no_tube_is_one_line(keys, said):
    with pytest.raises(hg.InputError, match=said):
        hg.AreaLamp((0, 0, 1), **keys)
