"""The page of a volume box: its pixels are those of `render` under stored and other lamps, to what it states."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.image.box_camera import box_camera
from hagoromo.image.scene.scene import Scene
from hagoromo_page.publication.lit import hemisphere, shown
from hagoromo_page.publication.stack_basis import STORED_ERROR, packed_stack
from hagoromo_page.publication.stack_lamps import directions_to_add
from hagoromo_page.publication.surface_maps import FLIP
from hagoromo_page.publication.weight_stack import WeightStack, framed
from tests.app.in_browser import Opened

LAMPS, SIZE, CAMERA = 12, 31, "canon_eos_300d"
ROUNDED = 0.5  # of 255: 8 bits of a pixel (0.29), single precision in the browser


def scene():
    """A fuzzy ball of a coloured body and some gloss, seen from the front."""
    z, y, x = np.mgrid[:13, :13, :13] - 6.0
    radius = np.sqrt(x * x + y * y + z * z)
    axis = np.stack([x, y, z], axis=-1) / np.maximum(radius, 0.1)[..., None]
    matter = hg.Reflectance(0.2, 0.3, 0.35, 1.5, hg.Spectrum([400, 550, 700], [0.2, 0.5, 0.9]))
    density = np.clip(5.5 - radius, 0, 1).astype(np.float32)
    box = hg.VolumeBox.from_arrays(density, axis.astype(np.float32), 0.01, 200.0, [matter], name="ball of fuzz")
    camera = hg.Camera(SIZE, SIZE + 4, (200, 200), (15, 17), response=hg.Response.load(CAMERA))
    return Scene(camera.look_at((0.065, -1.0, 0.3), (0.065, 0.065, 0.065)), (hg.Lamp(to_lamp=(0, -1, 1)),), (box,))


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    path = tmp_path_factory.mktemp("stack") / "page.html"
    return hg.publish_scene(scene(), path, lamps=LAMPS)


@pytest.fixture(scope="module")
def elsewhere():
    """The scene by `render` under twelve lamps, of which four are stored ones: directions, and an Image of each."""
    directions = np.concatenate([hemisphere(LAMPS, 0.0)[[0, 4, 7, 10]], hemisphere(LAMPS - 4, 0.12)])
    turn = scene().camera.world_to_camera[:3, :3].T @ FLIP
    lamps = [hg.Lamp(to_lamp=turn @ one, intensity=math.pi, name=str(k)) for k, one in enumerate(directions)]
    image = hg.render(scene().with_lamps(*lamps), hg.Settings(separate_lamps=True))
    off = {str(k): 0.0 for k in range(LAMPS)}
    return directions, [image.with_lamps(strength=off | {str(k): 1.0}) for k in range(LAMPS)]


def differences(opened, directions, images, lamp="D65"):
    """Root mean square difference [of 255] of the page from `render` under each lamp, where there is matter."""
    exposure, off = opened.data()["exposure"], []
    for to_lamp, image in zip(directions, images, strict=True):
        opened.point_lamp(to_lamp)
        light = hg.Spectrum.named(lamp)
        linear = image.linear_srgb([light] * LAMPS)
        pixels, inside = opened.pixels(), image.alpha > 0
        np.testing.assert_allclose(pixels[..., 3] / 255.0, image.alpha, atol=1 / 255)
        off.append(np.sqrt(np.mean((pixels[..., :3] - 255.0 * shown(exposure * linear, 1.0))[inside] ** 2)))
    return np.array(off)


def test_pixels_are_those_of_render_under_stored_and_other_lamps(browser, published, elsewhere):
    """Under stored lamps to STORED_ERROR, between them to what the page states, which is from other lamps left out.

    A lamp left out is farther from its neighbours than one between them, so that the stated error is an upper bound of
    the mean; that a lamp is worse than twice it would say that the statement misleads.
    """
    directions, images = elsewhere
    opened = Opened(browser, published.path)
    opened.page.select_option("#hv-camera", label="Human eye (CIE 1931)")
    off = differences(opened, directions, images)
    assert np.sqrt(np.mean(off[:4] ** 2)) < STORED_ERROR + ROUNDED
    assert np.sqrt(np.mean(off[4:] ** 2)) < published.error_between
    assert off[4:].max() < 2.0 * published.error_between
    assert published.error_between > 2.0 * STORED_ERROR  # twelve lamps are too few, and it says so
    assert opened.said == [] and opened.asked == [published.path.resolve().as_uri()]


def test_lamps_are_added_until_the_error_between_them_is_that_asked_for(tmp_path, published):
    finer = hg.publish_scene(scene(), tmp_path / "finer.html", lamps=LAMPS, error=0.6 * published.error_between)
    assert finer.lamps == 2 * LAMPS and finer.error_between <= 0.6 * published.error_between
    assert finer.stored_error <= STORED_ERROR + ROUNDED
    same = hg.publish_scene(scene(), tmp_path / "same.html", lamps=LAMPS, error=1.01 * published.error_between)
    assert same.lamps == LAMPS
    for error in (0.0, -1.0, math.nan, 300.0):
        with pytest.raises(hg.InputError, match="of 255 between the lamps"):
            hg.publish_scene(scene(), tmp_path / "a.html", error=error)
    assert not (tmp_path / "a.html").exists()


def test_lamps_are_added_in_the_widest_gaps_and_where_the_error_is():
    """Evenly where all err alike; nearly all on the side of the lamps that err ten times as much."""
    directions = hemisphere(64, 0.0)
    added = directions_to_add(directions, np.ones(64), 64)
    apart = np.linalg.norm(added[:, None] - np.concatenate([directions, added])[None], axis=2)
    apart[np.arange(64), 64 + np.arange(64)] = np.inf
    assert apart.min() > 0.5 * np.sqrt(2 * np.pi / 128)  # half the distance of as many lamps on a square lattice
    one_side = directions_to_add(directions, np.where(directions[:, 0] > 0, 10.0, 1.0), 32)
    assert (one_side[:, 0] > -0.5 * np.sqrt(2 * np.pi / 64)).all()  # half the distance of the lamps beside the edge


def test_spectra_of_lamps_are_exact_and_lamps_add(browser, published, elsewhere):
    directions, images = elsewhere
    opened = Opened(browser, published.path)
    opened.page.select_option("#hv-camera", label="Human eye (CIE 1931)")
    opened.page.select_option("#hv-spectrum", label="Incandescent (A)")
    assert differences(opened, directions[:2], images[:2], "A").max() < STORED_ERROR + 2 * ROUNDED
    one = opened.pixels()[..., :3].astype(float)
    opened.page.get_by_title("Add a lamp").click()
    opened.page.evaluate(
        "() => { const [a, b] = hagoromo.state.lamps; Object.assign(b, a); a.strength = b.strength = 0.5;"
        "hagoromo.redraw(); }"
    )
    assert np.abs(opened.pixels()[..., :3] - one).max() <= 1


def test_the_page_says_what_it_assumes_and_offers_nothing_else(browser, published):
    opened = Opened(browser, published.path)
    said = opened.page.locator("#hv-assumptions").text_content()
    assert f"{LAMPS} far lamps" in said and f"{published.error_between:.1f} of 255" in said
    assert not opened.page.locator("#hv-view").is_visible() and not opened.page.locator("#hv-shadows").is_visible()
    assert opened.page.title() == "ball of fuzz"
    assert published.size == published.path.stat().st_size < 5_000_000


def test_the_ruler_says_millimetres_in_space(browser, published):
    """Across the ball and along its depth: its voxels are 10 mm wide and its fuzz ends 5.5 of them from the middle."""
    opened = Opened(browser, published.path)
    data = opened.data()
    middle, camera = np.full(3, 0.065), scene().camera
    eye = camera.position
    to_eye = (eye - middle) / np.linalg.norm(eye - middle)
    right = np.cross(to_eye, (0.0, 0.0, 1.0)) * -1.0
    right /= np.linalg.norm(right)
    found = []
    for radius in (0.0, 0.04):  # places of the matter that face the camera, so many m beside its middle
        point = middle + radius * right + math.sqrt(0.053**2 - radius**2) * to_eye
        found.append((camera.project(point[None])[0], point))
    places = [[float(x) for x in pixel] for pixel, _ in found]
    said = opened.page.evaluate("([a, b]) => hagoromo.length(a, b)", places)
    true = 1000.0 * np.linalg.norm(found[0][1] - found[1][1])
    assert said.endswith(" mm") and abs(float(said.split()[0]) / true - 1.0) < 0.15
    assert data["hasScale"] and not opened.page.locator("#hv-shadows-label").is_visible()


def test_smooth_light_is_stored_and_interpolated_nearly_exactly():
    """A sphere by Lambert, far from its edge, is a smooth function of the direction: an oracle without a renderer."""
    y, x = (np.mgrid[:23, :29] - np.array([11, 14])[:, None, None]) / 30.0
    normal = np.stack([x, -y, np.sqrt(1 - x * x - y * y)], axis=-1)
    directions = hemisphere(64, 0.0)
    lit = np.stack([1.2 + normal @ one for one in directions], axis=2)
    weights = np.stack([lit, 0.2 * lit**2], axis=3).astype(np.float32)
    colours = (hg.Spectrum.constant(1.0), hg.Spectrum.constant(0.5))
    stack = WeightStack(weights, np.ones((23, 29), np.float32), directions, colours)
    packed = packed_stack(stack, np.array([[1.0, 0.2]] * 3), 0.4)
    assert packed.stored_error <= STORED_ERROR and packed.error_between < 1.5 * STORED_ERROR
    assert packed.scales["components"] < 20  # of 128
    black = packed_stack(replace(stack, weights=0.0 * weights), np.ones((3, 2)), 1.0)
    assert black.stored_error == black.error_between == 0.0 and black.scales["components"] == 1


def test_a_box_alone_fills_its_picture():
    """The ball, seen from where no one placed a camera: to 3 px of a sketch of 96."""
    (box,) = scene().boxes
    view = Scene(box_camera(box, 60), scene().lamps, (box,))
    camera = framed(view, 60)
    seen = hg.render(view.with_camera(camera), hg.Settings(shadows="none")).alpha > 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    for found, size in ((rows, camera.height), (columns, camera.width)):
        assert 0 < found[0] <= 0.08 * size and 0.92 * size <= found[-1] < size - 1
    assert max(camera.width, camera.height) == 60


def test_a_page_of_a_scene_is_refused_in_one_line(refused, box, tmp_path):
    assert "page.html" in refused("publish", box, "--out", tmp_path / "folder")
    assert "give 8 to 512" in refused("publish", box, "--out", tmp_path / "a.html", "--lamps", "3")
    assert "--capture" in refused("publish", box, "--out", tmp_path / "a.html", "--capture", tmp_path)
    assert "--lamps" in refused("publish", tmp_path, "--out", tmp_path / "a.html", "--lamps", "9")
    assert "--error" in refused("publish", tmp_path, "--out", tmp_path / "a.html", "--error", "2")


def test_a_page_of_a_scene_keeps_its_limit(published, tmp_path):
    limit = published.size - 4_000
    small = hg.publish_scene(scene(), tmp_path / "small.html", lamps=LAMPS, limit=limit)
    assert small.size <= limit and small.width < published.width == SIZE
    assert "reduced" in (tmp_path / "small.html").read_text("utf-8")
    with pytest.raises(hg.InputError, match="too small"):
        hg.publish_scene(scene(), tmp_path / "a.html", lamps=LAMPS, limit=20_000)
    assert main(["publish", str(tmp_path / "none.toml"), "--out", str(tmp_path / "a.html")]) == 2
    assert [one.name for one in tmp_path.iterdir()] == ["small.html"]
