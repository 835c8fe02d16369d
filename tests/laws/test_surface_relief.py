"""Laws of images of normals and heights: shading of the surface that they stand for, in all modes, on all UVs."""

import math
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.content import content_with_named
from hagoromo.image.scene.scene_file import load_scene
from tests.laws.test_field_surfaces import paint
from tests.laws.test_surface_texture import FACES, FAR, SIDE, SQUARE, UV, above
from tests.surface_scene import BEFORE_A_SURFACE

SIZE = 128  # px of an image
HEIGHT = 0.1  # [m] of waves 2 m and 1 m long, on a square of 2 m: slopes of 0.16 and 0.31
TO_LAMP = np.array([0.6, 0.0, 0.8])


def places(size):
    """x and y of the middles of pixels, the first row at the top."""
    x = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    return np.meshgrid(x, -x)


def heights(x, y):
    return HEIGHT * (1.0 + 0.5 * np.sin(math.pi * x) + 0.5 * np.cos(2.0 * math.pi * y))


def normals(x, y):
    """Of z = heights(x, y), in closed form."""
    along_x = 0.5 * HEIGHT * math.pi * np.cos(math.pi * x)
    along_y = -HEIGHT * math.pi * np.sin(2.0 * math.pi * y)
    turned = np.stack([-along_x, -along_y, np.ones_like(x)], axis=-1)
    return turned / np.linalg.norm(turned, axis=-1, keepdims=True)


NORMALS = hg.SurfaceTexture((normals(*places(SIZE)) + 1.0) / 2.0, ())
HEIGHTS = hg.SurfaceTexture(heights(*places(SIZE)))
EXPECTED = 0.8 / math.pi * (normals(*places(SIDE)) @ TO_LAMP)


def sheet(**relief: Any):
    return hg.Surface(paint(0.8), "mesh", SQUARE, FACES, uv=UV, smooth=False, **relief)


def picture(surface, mode: Any = "march", camera=None, lamp=FAR, samples=1):
    settings = hg.Settings(samples=samples, walks=0 if mode == "full" else None, orders=1 if mode == "path" else None)
    scene = hg.Scene(camera or above(), (lamp,), surfaces=(surface,))
    return hg.render(scene, settings, mode=mode).weights.sum(axis=-1)


@pytest.mark.parametrize("relief", [{"normal_texture": NORMALS}, {"bump_texture": HEIGHTS}])
@pytest.mark.parametrize(("mode", "samples"), [("march", 1), ("full", 1), ("path", 256)])
def test_a_plane_is_shaded_as_the_surface_of_its_normals_or_heights(relief, mode, samples):
    """α n·l with the normal of the height field in closed form: of the first order, and all there is of a plane.

    Interpolation between pixels is off by slope · (π / SIZE)² / 2; walks jitter within pixels of a gradient of 3 %.
    """
    seen = picture(sheet(**relief), mode, samples=samples)
    np.testing.assert_allclose(seen, EXPECTED, rtol=1e-3 if mode != "path" else 5e-3)
    assert np.ptp(EXPECTED) > 0.1 * EXPECTED.mean()


def test_a_plane_is_shaded_as_a_mesh_of_its_heights():
    """Of a fifth of them: from 2 m the mesh stands aside in the picture by 1 % of the way to its middle."""
    wide, tall, share = 251, 239, 0.2
    points = np.stack(np.meshgrid(np.linspace(-1, 1, wide), np.linspace(1, -1, tall)), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([points, share * (heights(*points.T) - HEIGHT)])
    corner = np.arange(tall * wide).reshape(tall, wide)[:-1, :-1].ravel()
    below = corner + wide
    halves = (corner, below, corner + 1), (corner + 1, below, below + 1)
    faces = np.concatenate([np.stack(half, axis=1) for half in halves])
    displaced = hg.Surface(paint(0.8), "mesh", vertices, faces, smooth=True)
    bumpy = picture(sheet(bump_texture=HEIGHTS.between(0.0, share)))
    inner = slice(1, -1)  # the normals of the mesh at its edge are those of half its triangles
    np.testing.assert_allclose(picture(displaced)[inner, inner], bumpy[inner, inner], rtol=3e-3)
    assert np.abs(bumpy / (0.8 / math.pi * TO_LAMP[2]) - 1.0).max() > 0.02


def test_normals_and_heights_add():
    """Two reliefs of half the slope are one: gradients add on the surface."""
    x, y = places(SIZE)
    halved = normals(x, y) * [0.5, 0.5, 1.0]
    halved /= np.linalg.norm(halved, axis=-1, keepdims=True)
    both = sheet(normal_texture=hg.SurfaceTexture((halved + 1.0) / 2.0, ()), bump_texture=HEIGHTS.between(0.0, 0.5))
    np.testing.assert_allclose(picture(both), EXPECTED, rtol=1e-3)


@pytest.mark.parametrize("turn", ["mirrored", "turned", "stretched", "repeated"])
def test_the_picture_does_not_depend_on_how_uvs_lie(turn):
    """The same heights by other UVs: the image goes along, and x, y of normals with u, v."""
    stored = NORMALS.values
    uv, image = UV, stored
    if turn == "mirrored":
        uv, image = UV * [-1.0, 1.0], stored[:, ::-1] * [-1, 1, 1] + [1, 0, 0]
    elif turn == "turned":  # u along y, v along −x
        uv = np.stack([UV[:, 1], 1.0 - UV[:, 0]], axis=-1)
        image = np.rot90(stored)[::-1, ::-1]
        image = np.stack([image[..., 1], 1.0 - image[..., 0], image[..., 2]], axis=-1)
    elif turn == "stretched":
        uv, image = UV * [1.0, 0.5], np.concatenate([stored, stored])  # the lower half of the image is used
    else:
        uv = UV + np.array([3.0, -2.0])
    surface = hg.Surface(
        paint(0.8), "mesh", SQUARE, FACES, uv=uv, smooth=False, normal_texture=hg.SurfaceTexture(image, ())
    )
    np.testing.assert_allclose(picture(surface), EXPECTED, rtol=1e-3)


def test_a_shape_has_its_own_uvs_and_a_bump_is_a_dent_from_behind():
    """A rectangle seen from below under a lamp below: the normal of the front, turned round."""
    rectangle = hg.Surface(paint(0.8), "rectangle", bump_texture=HEIGHTS)
    np.testing.assert_allclose(picture(rectangle), EXPECTED, rtol=1e-3)
    below = hg.Camera(SIDE, SIDE, (SIDE, SIDE), (0.5 * SIDE, 0.5 * SIDE)).look_at((0, 0, -2), (0, 0, 0), (0, 1, 0))
    lamp = hg.Lamp(to_lamp=TO_LAMP * [1.0, 1.0, -1.0])
    x, y = places(SIDE)
    expected = 0.8 / math.pi * (-normals(-x, y) @ (TO_LAMP * [1.0, 1.0, -1.0]))
    np.testing.assert_allclose(picture(rectangle, camera=below, lamp=lamp), expected, rtol=1e-3)


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "cube", "disk"])
def test_flat_images_change_nothing(shape):
    """A normal along z, and one height everywhere."""
    flat = hg.SurfaceTexture(np.full((2, 2, 3), (0.5, 0.5, 1.0)), ())
    camera = hg.Camera(SIDE, SIDE, (SIDE, SIDE), (0.5 * SIDE, 0.5 * SIDE)).look_at((3, -4, 2), (0, 0, 0))
    bumps = HEIGHTS.between(0.1, 0.1)
    plain = picture(hg.Surface(paint(0.8), shape), camera=camera)
    own = picture(hg.Surface(paint(0.8), shape, normal_texture=flat, bump_texture=bumps), camera=camera)
    np.testing.assert_allclose(own, plain, rtol=2e-6, atol=2e-6)
    assert plain.max() > 0.05


def test_normals_that_turn_from_the_eye_are_seen_edge_on():
    """At grazing view no pixel of a strong relief under a lamp at the eye is black."""
    steep = hg.SurfaceTexture(heights(*places(SIZE)) * 3.0)
    eye = np.array([0.0, -3.0, 0.3])
    camera = hg.Camera(SIDE, 12, (4 * SIDE, 4 * SIDE), (0.5 * SIDE, 6.0)).look_at(eye, (0, 0, 0))
    seen = picture(sheet(bump_texture=steep), camera=camera, lamp=hg.Lamp(position=eye))
    assert (seen[5:7] > 0.0).all()


TABLES = (
    BEFORE_A_SURFACE
    + """[[surface]]
shape = "rectangle"
reflectance = {alpha = 0.2546479, beta = 0.0, gamma = 0.2, n = 1.5, body_colour = 1.0}
"""
)


def scene_of(folder, line):
    (folder / "scene.toml").write_text(TABLES + line)
    return load_scene(folder / "scene.toml")[0]


def test_scene_files_have_both(tmp_path):
    """PNG of 8 bits: a step turns the normal by 0.4°, 1 % of the light; DirectX has its green upside down."""
    stored = np.round(255.0 * NORMALS.values).astype(np.uint8)
    hg.write_png(tmp_path / "n.png", stored)
    stored[..., 1] = 255 - stored[..., 1]
    hg.write_png(tmp_path / "d.png", stored)
    top = 1e3 * HEIGHTS.values.max()
    hg.write_png(tmp_path / "h.png", np.round(65535.0 * 1e3 * HEIGHTS.values[..., 0] / top).astype(np.uint16))
    for line, error in (
        ('normal_texture = {file = "n.png"}', 0.01),
        ('normal_texture = {file = "d.png", green = "directx"}', 0.01),
        (f'bump_texture = {{file = "h.png", height_mm = {top}}}', 2e-3),
    ):
        scene = scene_of(tmp_path, line)
        np.testing.assert_allclose(hg.render(scene).weights.sum(axis=-1), EXPECTED, rtol=error)
        assert scene.record()["surfaces"][0][line.split()[0]]["size"] == [SIZE, SIZE]
    scene = scene_of(tmp_path, f'bump_texture = {{file = "h.png", height_mm = {-top}}}')
    dents = 0.8 / math.pi * (normals(*places(SIDE)) * [-1.0, -1.0, 1.0] @ TO_LAMP)
    np.testing.assert_allclose(hg.render(scene).weights.sum(axis=-1), dents, rtol=2e-3)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('normal_texture = {file = "grey.png"}', "one channel"),
        ('normal_texture = {file = "dark.png"}', "tangent space"),
        ('normal_texture = {file = "none.png"}', "none.png"),
        ('normal_texture = {file = "dark.png", green = "up"}', "green must be one of opengl, directx"),
        ('bump_texture = {file = "grey.png"}', "height_mm"),
        ('bump_texture = {file = "grey.png", height_mm = 1e9}', "outside 0…100"),
        ('optics = "mirror"\nbump_texture = {file = "grey.png", height_mm = 1.0}', "leave one of them out"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, line, said):
    hg.write_png(tmp_path / "grey.png", np.full((4, 4), 90, np.uint8))
    hg.write_png(tmp_path / "dark.png", np.full((4, 4, 3), (60, 65, 69), np.uint8))
    with pytest.raises(InputError, match=said):
        scene_of(tmp_path, line)


def test_surfaces_refuse_what_is_no_relief():
    with pytest.raises(InputError, match="three values"):
        sheet(normal_texture=HEIGHTS)
    with pytest.raises(InputError, match="one value"):
        sheet(bump_texture=NORMALS)
    with pytest.raises(InputError, match="no UVs"):
        hg.Surface(paint(0.8), "mesh", SQUARE, FACES, bump_texture=HEIGHTS)


TILES = """
[[surface]]
mesh = "two.obj"
smooth = false
reflectance = {alpha = 0.3183099, beta = 0.0, gamma = 0.2, n = 1.5, body_colour = 1.0}
"""


def obj_of_tiles(folder, tiles=((1, 0), (0, 2))):
    """Two squares side by side, 1 m wide each, the UVs of each on a tile of its own."""
    lines, faces = [], []
    for k, (u, v) in enumerate(tiles):
        for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)):
            lines += [f"v {x + k - 1} {y - 0.5} 0", f"vt {u + x} {v + y}"]
        faces.append("f " + " ".join(f"{4 * k + n}/{4 * k + n}" for n in (1, 2, 3, 4)))
    (folder / "two.obj").write_text("\n".join([*lines, *faces, ""]))


def gradient(size, top, left):
    """An image of 16 bits: grey that rises to the right and upwards."""
    x, y = np.meshgrid((np.arange(size) + 0.5) / size, 1.0 - (np.arange(size) + 0.5) / size)
    return np.round(65535 * (0.2 + top * y + left * x)).astype(np.uint16)


@pytest.mark.parametrize("key", ["body_texture", "gamma_texture"])
def test_tiles_by_udim_are_one_image_each_on_its_own_square(tmp_path, key):
    """Tiles 1002 and 1021, one of half the size: as if each square had its own image, within its edges."""
    obj_of_tiles(tmp_path)
    more = ", spectra = [1.0]" if key == "body_texture" else ", range = [0.1, 1.0]"
    images = {1002: gradient(32, 0.3, 0.2), 1021: gradient(16, 0.1, 0.5)}
    for number, image in images.items():
        hg.write_png(tmp_path / f"map.{number}.png", image)
    base = BEFORE_A_SURFACE
    (tmp_path / "scene.toml").write_text(base + TILES + f'{key} = {{file = "map.<UDIM>.png"{more}}}\n')
    (surface,) = load_scene(tmp_path / "scene.toml")[0].surfaces
    texture = getattr(surface, key)
    assert texture.values.shape == (3 * 32, 2 * 32, 1)
    stored = texture.values if key == "body_texture" else (texture.values - 0.1) / 0.9
    np.testing.assert_allclose(stored[64:, 32:, 0], images[1002] / 65535, atol=1e-6)
    np.testing.assert_allclose(stored[:32:2, :32:2, 0], images[1021] / 65535, atol=1e-6)
    if key == "gamma_texture":
        return
    seen = hg.render(load_scene(tmp_path / "scene.toml")[0]).weights.sum(axis=-1)
    x, y = places(SIDE)
    inner = (np.abs(y) < 0.42) & (np.abs(np.abs(x) - 0.5) < 0.42)  # without the pixels at the edges of the squares
    bright = np.where(x < 0.0, 0.2 + 0.3 * (y + 0.5) + 0.2 * (x + 1.0), 0.2 + 0.1 * (y + 0.5) + 0.5 * x)
    np.testing.assert_allclose(seen[inner], (bright * TO_LAMP[2] / math.pi)[inner], rtol=0.03)  # half a pixel of 16


@pytest.mark.parametrize(
    ("files", "line", "said"),
    [
        ([1002], 'body_texture = {file = "m.<UDIM>.png"}', "UVs on tile 1021, of which m.<UDIM>.png has no file"),
        ([], 'body_texture = {file = "m.<UDIM>.png"}', "no tile such as m.1001.png"),
        ([1002, 1021], 'body_texture = {file = "m.<UDIM>.png"}\nbeta_texture = {file = "m.1002.png"}', "alike"),
        ([1002, 1021], 'body_texture = {file = "<UDIM>/m.png"}', "once, in the name of the file"),
        ([1002, 1021], 'body_texture = {file = "../m.<UDIM>.png"}', "outside"),
    ],
)
def test_wrong_tiles_are_refused(tmp_path, files, line, said):
    obj_of_tiles(tmp_path)
    for number in files:
        hg.write_png(tmp_path / f"m.{number}.png", gradient(8, 0.1, 0.2))
    (tmp_path / "scene.toml").write_text(BEFORE_A_SURFACE + TILES + line)
    with pytest.raises(InputError, match=said) as refused:
        load_scene(tmp_path / "scene.toml")
    assert "\n" not in str(refused.value)


def test_tiles_of_sizes_that_do_not_fit_are_refused_and_changed_ones_are_noticed(tmp_path):
    obj_of_tiles(tmp_path)
    hg.write_png(tmp_path / "m.1002.png", gradient(8, 0.1, 0.2))
    hg.write_png(tmp_path / "m.1021.png", gradient(5, 0.1, 0.2))
    scene = tmp_path / "scene.toml"
    scene.write_text(BEFORE_A_SURFACE + TILES + 'body_texture = {file = "m.<UDIM>.png"}')
    with pytest.raises(InputError, match="no multiple of it"):
        load_scene(scene)
    before = content_with_named(scene)
    hg.write_png(tmp_path / "m.1021.png", gradient(4, 0.1, 0.2))
    assert content_with_named(scene) != before and load_scene(scene)
