"""Laws of surfaces that give off light, and of lights that the camera sees: area lamps of the same shape, closed forms,
a furnace, the transmittance of what stands in front. Significance 0.1 %, fixed seeds.
"""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.shape_mesh import shape_mesh
from tests.judges import blocks_agree, mean_is
from tests.laws.test_lights import radiance
from tests.laws.test_path import cube, matter
from tests.laws.test_surface_texture import SCENE

BLACK, GREY, WHITE = (matter("plane", albedo / math.pi) for albedo in (0.0, 0.5, 1.0))
GLOW = hg.SurfaceEmission(5.0)
FEW, MANY = hg.Settings(samples=2, tolerance=0.5), hg.Settings(samples=512)
DOWN = np.array(
    [[0.3, 0, 0, 0], [0, -0.2, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1.0]]
)  # of a unit square, which shines down
WINDOW = hg.AreaLamp((0, 0, 0.6), edges=((0, 0.4, 0), (0.6, 0, 0)), radiance=5.0, visible=True)
FLOOR = hg.Surface.floor(-0.2, 1.0, GREY)


def camera(size=12, eye=(0.0, -1.3, 0.2), target=(0.0, 0.0, 0.2), focal=1.0):
    return hg.Camera(size, size, (focal * size, focal * size), (size / 2, size / 2)).look_at(eye, target)


def square(shape):
    """The window as a surface; `mesh`: of triangles that are very different in size."""
    if shape == "rectangle":
        return hg.Surface(BLACK, "rectangle", pose=DOWN, emission=GLOW)
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0.9, 0.8, 0)], float)
    faces = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    return hg.Surface(BLACK, "mesh", corners, faces, pose=DOWN, emission=GLOW, smooth=False)


@pytest.mark.parametrize("shape", ["rectangle", "mesh"])
def test_a_square_that_gives_off_light_is_the_area_lamp_in_its_place(shape):
    """Seen from below, over a floor and a cloud, all orders: z-test per block. 3 % more light is seen."""
    ball = cube(matter("sphere"), 3.0)
    own, lamp = (
        hg.render(hg.Scene(camera(), (), (ball,), surfaces, areas), MANY, mode="path")
        for surfaces, areas in (((FLOOR, square(shape)), ()), ((FLOOR,), (WINDOW,)))
    )
    assert own.variance is not None and lamp.variance is not None
    variance = own.variance + lamp.variance
    # the back of the surface hides and shades, that of the lamp does not: the camera is below it
    assert blocks_agree(radiance(own), radiance(lamp), variance, 3)
    assert not blocks_agree(1.03 * radiance(own), radiance(lamp), variance, 3)


@pytest.mark.parametrize(("mode", "tolerance"), [("march", 0.05), ("full", 0.1)])
def test_point_lamps_in_its_place_light_as_walks_find(mode, tolerance):
    """Twice `tolerance` in each block and once in the mean, beside the noise of path, where the lamp is not seen."""
    scene = hg.Scene(camera(), (), (cube(matter("sphere"), 3.0),), (FLOOR, square("mesh")))
    ours = hg.render(scene, hg.Settings(samples=4, tolerance=tolerance, walks=0), mode=mode)
    walked = hg.render(scene, hg.Settings(samples=256), mode="path")
    assert walked.variance is not None
    light = ours.metadata["light_points"][0]
    assert light["error"] <= tolerance and 2 <= light["places"] <= 16
    kept = [radiance(image.part("first") if mode == "march" else image)[4:] for image in (ours, walked)]
    own, theirs, noise = (each.reshape(4, 2, 4, 3).mean(axis=(1, 3)) for each in (*kept, walked.variance[4:]))
    assert (np.abs(own - theirs) <= 2.0 * tolerance * theirs + 4.0 * np.sqrt(noise / 6.0)).all()
    assert own.sum() == pytest.approx(theirs.sum(), rel=tolerance) and theirs.max() > 0.05


def disc_irradiance(r, height, radius):
    """On a plane parallel to a disc of radiance 1, at the distance r from its axis (configuration factor of a disc)."""
    whole = r**2 + height**2 + radius**2
    return 0.5 * math.pi * (1.0 - (r**2 + height**2 - radius**2) / np.sqrt(whole**2 - 4.0 * r**2 * radius**2))


@pytest.mark.parametrize("mode", ["march", "path"])
def test_a_disc_lights_a_plane_as_in_closed_form(mode):
    radius, height = 0.4, 0.5
    pose = np.diag([radius, -radius, -1.0, 1.0])
    pose[2, 3] = height
    disc = hg.Surface(BLACK, "disk", pose=pose, emission=GLOW)
    floor = hg.Surface.floor(0.0, 3.0, GREY)
    view = camera(16, (0.0, -0.9, 0.2), (0.0, 0.2, 0.0), 2.0)
    scene, settings = (
        hg.Scene(view, (), (), (floor, disc)),
        hg.Settings(samples=256 if mode == "path" else 1, tolerance=2e-3),
    )
    image = hg.render(scene, settings, mode=mode).part("first")
    x, y = np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5)
    ways = np.stack([(x - 8) / 32, (y - 8) / 32, np.ones_like(x)], axis=-1) @ view.world_to_camera[:3, :3]
    place = view.position + ways * (-view.position[2] / ways[..., 2])[..., None]
    below = (ways[..., 2] < -0.05) & (np.linalg.norm(place[..., :2], axis=-1) < 1.0)
    truth = 0.5 / math.pi * 5.0 * disc_irradiance(np.linalg.norm(place[..., :2], axis=-1), height, radius)
    ratio = (radiance(image) / truth)[below]
    assert below.sum() > 100
    if mode == "march":
        assert np.abs(ratio - 1.0).max() < 0.01
    else:
        assert mean_is(ratio, 1.0, tolerance=1e-3)


@pytest.mark.parametrize("albedo", [0.0, 0.5])
def test_within_a_furnace_of_its_own_light_all_looks_alike(albedo):
    """A closed ball that gives off light inwards and reflects, around a white ball: L/(1 − albedo) everywhere."""
    vertices, faces, _ = shape_mesh("sphere", 8, 2)
    inwards = hg.Surface(
        matter("plane", albedo / math.pi), "mesh", 2.0 * vertices, faces[:, ::-1], emission=GLOW, smooth=False
    )
    ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.4, WHITE)
    image = hg.render(hg.Scene(camera(), (), (), (ball, inwards)), hg.Settings(samples=256), mode="path")
    truth = 5.0 / (1.0 - albedo)
    assert mean_is(radiance(image), truth, tolerance=1e-3 * truth) and radiance(image).std() < 0.2 * truth


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "cube"])
def test_round_shapes_give_off_light_from_their_outside(shape):
    """The flux through a far plane is that of their area: intensity L · the area that is seen."""
    seen = {"sphere": math.pi, "cylinder": 2.0, "cube": 4.0}[shape] * 0.01
    turned = np.diag([0.1, 0.1, 0.1, 1.0])
    turned[:3, :3] = turned[:3, :3] @ np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)])  # the cylinder lies along y
    lamp = hg.Surface(BLACK, shape, pose=turned, emission=GLOW)
    floor = hg.Surface.floor(-10.0, 1.0, GREY)
    view = camera(8, (4.0, 0.0, -8.0), (0.0, 0.0, -10.0), 20.0)
    image = hg.render(hg.Scene(view, (), (), (floor, lamp)), hg.Settings(samples=1024), mode="path")
    truth = 0.5 / math.pi * 5.0 * seen / 100.0
    assert image.variance is not None
    error = math.sqrt(float(image.variance.mean()) / image.variance.size)
    assert abs(radiance(image).mean() - truth) < 3.3 * error < 0.03 * truth


@pytest.mark.parametrize("mode", ["march", "full"])
def test_lights_are_seen_through_matter_and_behind_nothing_else(mode):
    """An environment by the transmittance of a box; a lamp in front of it, behind it, and behind a surface."""
    sky = hg.Environment(np.full((1, 2), 3.0), visible=True)
    box = cube(matter("sphere", 0.0), 1.5)
    image = hg.render(hg.Scene(camera(), (), (box,), environment=sky), FEW, mode=mode)
    np.testing.assert_allclose(radiance(image), 3.0 * (1.0 - image.alpha), rtol=2e-3)
    assert 0.3 < image.alpha.max() < 0.9
    hidden = hg.AreaLamp((0, 0, -0.5), edges=((0.4, 0, 0), (0, 0.4, 0)), radiance=5.0, visible=True)
    for y, share in ((-0.6, 1.0), (0.6, 1.0 - image.alpha)) if mode == "march" else ():  # the same code
        lamp = hg.AreaLamp((0, y, 0.2), edges=((2.0, 0, 0), (0, 0, 2.0)), radiance=5.0, visible=True)
        assert lamp.normal[1] < 0.0
        seen = hg.render(hg.Scene(camera(), (), (box,), (FLOOR,), (lamp, hidden)), FEW, mode=mode).part("higher")
        middle = np.s_[4:8, 4:8]
        np.testing.assert_allclose(radiance(seen)[middle], (5.0 * share * np.ones((12, 12)))[middle], rtol=2e-3)
        assert radiance(seen)[-1].max() < 5.0 if y > 0.0 else True


def test_what_is_seen_is_the_same_in_previews_and_under_many_lamps():
    lamps = tuple(hg.Lamp(to_lamp=(0.1 * k, -1.0, 1.0), intensity=0.01) for k in range(33))
    scene = hg.Scene(camera(), lamps, (), (FLOOR, square("mesh")))
    image = hg.render(scene, FEW)
    *_, last = hg.preview(scene, FEW)
    np.testing.assert_array_equal(last.weights, image.weights)
    assert radiance(image.part("higher")).max() == pytest.approx(5.0) and radiance(image.part("first")).max() > 0.0
    emission = {k for k in range(len(scene.lights)) if any(s.emission for s in scene.under([k]).surfaces)}
    assert emission == {33} and not any(s.emission for s in scene.with_lamps(lamps[0]).surfaces)
    assert (
        scene.lights[33].name == "surface 2" and image.metadata["scene"]["surfaces"][1]["emission"]["radiance"] == 5.0
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hg.SurfaceEmission(math.nan), "radiance of an emission is nan"),
        (lambda: hg.SurfaceEmission(1.0, hg.Spectrum.constant(-1.0)), "below 0"),
        (lambda: hg.Surface(BLACK, "sphere", optics="glass", emission=GLOW), "has an emission: leave"),
        (lambda: hg.Surface(GREY, "disk", emission=GLOW, body_texture=hg.SurfaceTexture([[1.0]])), "give a mesh"),
        (
            lambda: hg.render(hg.Scene(camera(), (), (), (square("mesh"),)), hg.Settings(separate_lamps=True)),
            "separate",
        ),
    ],
)
def test_what_gives_off_no_light_is_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_a_scene_file_has_emissions(tmp_path):
    text = SCENE[: SCENE.index("body_texture")].replace('mesh = "square.obj"', 'shape = "disk"')
    (tmp_path / "scene.toml").write_text(text + 'emission = { radiance = 3.0, spectrum = "D65", name = "moon" }\n')
    scene = load_scene(tmp_path / "scene.toml")[0]
    assert scene.surfaces[0].emission is not None and scene.surfaces[0].emission.radiance == 3.0
    assert scene.lights[-1].name == "moon"
    (tmp_path / "scene.toml").write_text(text + "emission = { radiance = 0.0 }\n")
    with pytest.raises(InputError, match="surface 1 emission"):
        load_scene(tmp_path / "scene.toml")
