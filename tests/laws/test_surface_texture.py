"""Laws of textures of surfaces: places on an image and between vertices, exact weights, orders above one, files."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.image.prepared.higher_orders import albedos_of
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.transport.path.bands import bands_of
from tests.laws.test_field_surfaces import RED, blocks, paint
from tests.laws.test_lights import radiance
from tests.surface_scene import BEFORE_A_SURFACE

GREEN = hg.Spectrum([360, 500, 560, 830], [0.1, 0.7, 0.7, 0.1])
SQUARE = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
FACES = np.array([(0, 1, 2), (0, 2, 3)])
UV = 0.5 + 0.5 * SQUARE[:, :2]
CORNERS = np.array([(1, 0), (0, 1), (1, 0), (0, 1)])  # of two spectra, pixel after pixel
CHECKER = hg.SurfaceTexture(np.reshape([(1, 0), (0, 1), (0, 1), (1, 0)], (2, 2, 2)), [RED, GREEN], smooth=False)
FAR = hg.Lamp(to_lamp=(0.48, 0.0, 0.64))  # 0.8 · 1 after normalisation: the cosine is 0.8
SIDE = 24


def above(height=2.0, size=SIDE):
    """A camera that sees the square of 2 m from above, exactly; y is up in the picture."""
    camera = hg.Camera(size, size, (0.5 * size * height, 0.5 * size * height), (0.5 * size, 0.5 * size))
    return camera.look_at((0.0, 0.0, height), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def quarter(x, y, colour):
    return hg.Surface(paint(0.8, colour=colour), "mesh", 0.5 * SQUARE + (x, y, 0.0), FACES, smooth=False)


def mesh(texture=None, beta=None, albedo=0.8, share=0.0):
    material = paint(albedo, share)
    return hg.Surface(material, "mesh", SQUARE, FACES, uv=UV, body_texture=texture, beta_texture=beta, smooth=False)


def body(image, *spectra):
    """Weights of body colours by their spectra."""
    values = [s.values.tolist() for s in image.palette.bodies]
    return [image.weights[..., values.index(s.values.tolist())] for s in spectra]


@pytest.mark.parametrize("mode", ["march", "full", "path"])
def test_a_checker_of_two_colours_is_squares_of_one_colour_each_pixel_by_pixel(mode):
    """First order, in all modes: the same bits for every weight."""
    squares = (quarter(-0.5, 0.5, RED), quarter(0.5, 0.5, GREEN), quarter(-0.5, -0.5, GREEN), quarter(0.5, -0.5, RED))
    settings = hg.Settings(samples=1, walks=0)
    one, four = (
        hg.render(hg.Scene(above(), (FAR,), surfaces=surfaces), settings, mode=mode)
        for surfaces in ((mesh(CHECKER),), squares)
    )
    for own, other in zip(body(one, RED, GREEN), body(four, RED, GREEN), strict=True):
        np.testing.assert_array_equal(own, other)
    assert body(one, RED)[0][2, 2] > 0.0 and body(one, GREEN)[0][2, 2] == 0.0  # the first pixel is at the top left


@pytest.mark.parametrize("where", ["vertices", "mesh", "rectangle"])
def test_values_between_vertices_and_between_pixels_are_linear(where):
    """Weights of the first order in closed form, α cosθ times the value at the place of each pixel."""
    x, y = np.meshgrid((np.arange(SIDE) + 0.5) / SIDE * 2 - 1, 1 - (np.arange(SIDE) + 0.5) / SIDE * 2)
    values = 0.5 + 0.25 * SQUARE[:, 0] + 0.2 * SQUARE[:, 1]
    if where == "vertices":
        surface = mesh(hg.SurfaceTexture(values, [GREEN], of="vertices"))
    else:
        column, row = (np.arange(8) + 0.5) / 4 - 1, 1 - (np.arange(4) + 0.5) / 2
        texture = hg.SurfaceTexture(0.5 + 0.25 * column + 0.2 * row[:, None], [GREEN])
        surface = mesh(texture) if where == "mesh" else hg.Surface(paint(0.8), "rectangle", body_texture=texture)
    image = hg.render(hg.Scene(above(), (FAR,), surfaces=(surface,)))
    within = (np.abs(x) < 0.87) & (np.abs(y) < 0.74)  # nearer to the edge an image repeats
    expected = 0.8 / math.pi * 0.8 * (0.5 + 0.25 * x + 0.2 * y)
    np.testing.assert_allclose(body(image, GREEN)[0][within], expected[within], rtol=2e-5)


def test_uvs_beyond_the_image_repeat():
    shifted = hg.Surface(
        paint(0.8), "mesh", SQUARE, FACES, uv=UV + np.array([3.0, -2.0]), body_texture=CHECKER, smooth=False
    )
    images = [hg.render(hg.Scene(above(), (FAR,), surfaces=(s,))) for s in (shifted, mesh(CHECKER))]
    np.testing.assert_array_equal(images[0].weights, images[1].weights)


def test_a_factor_on_beta_scales_the_interface_alone():
    factor = hg.SurfaceTexture([[0.25, 1.0]], smooth=False)
    plain, scaled = (
        hg.render(hg.Scene(above(), (FAR,), surfaces=(mesh(None, beta, share=0.3),))) for beta in (None, factor)
    )
    expected = plain.part("interface").weights * np.repeat([0.25, 1.0], SIDE // 2)[:, None]
    np.testing.assert_allclose(scaled.part("interface").weights, expected, rtol=1e-6)
    np.testing.assert_array_equal(scaled.part("body").weights, plain.part("body").weights)
    assert expected[:, 0].max() > 0.0 and expected[:, -1].max() > 0.0


def test_red_green_blue_become_the_spectra_of_environments():
    """The picture under D65 has the linear sRGB of the texture, times the albedo and the cosine."""
    rgb = np.array([[(0.8, 0.1, 0.3), (0.2, 0.6, 0.4)]])
    day = hg.Lamp(to_lamp=(0.48, 0.0, 0.64), intensity=math.pi, spectrum=hg.Spectrum.named("D65"))
    image = hg.render(hg.Scene(above(), (day,), surfaces=(mesh(hg.SurfaceTexture(rgb, smooth=False)),)))
    seen = image.linear_srgb()[SIDE // 2]
    np.testing.assert_allclose(seen[[3, -3]], 0.8 * 0.8 * rgb[0], atol=2e-3)


def test_bands_are_chosen_by_the_colours_that_are_there():
    """Not by the spectra that they are sums of, which are far steeper than pale colours."""
    pale, pure = (hg.SurfaceTexture([[(a, b, b), (b, a, b), (b, b, a)]]) for a, b in ((0.5, 0.42), (1.0, 0.0)))
    np.testing.assert_allclose([s.at([630.0])[0] for s in pure.purest()], [s.at([630.0])[0] for s in pure.spectra])
    error = [
        bands_of(albedos_of(hg.Scene(above(), (FAR,), surfaces=(mesh(t),))), [FAR.spectrum], 0.01, 7).error
        for t in (pale, pure)
    ]
    assert error[0] < 0.02 < error[1]


def test_light_of_higher_orders_takes_the_texture_along():
    """A white wall beside the checker, full against path: z-test per block, with 3 % of the mean for full's patches."""
    pose = np.array([[0, 0, 1, -1.0], [0, 1, 0, 0], [-1, 0, 0, 1.0], [0, 0, 0, 1]])
    wall = hg.Surface(paint(0.8), "rectangle", pose=pose)
    camera = hg.Camera(32, 24, (32, 32), (16, 12)).look_at((2.4, -1.6, 2.2), (-0.3, 0.0, 0.5))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.8, 0.0, 0.6)),), surfaces=(mesh(CHECKER), wall))
    full, path = (
        hg.render(scene, hg.Settings(samples=1, walks=0), mode="full"),
        hg.render(scene, hg.Settings(samples=1024), mode="path"),
    )
    assert path.variance is not None
    for wavelength in (450.0, 540.0, 640.0):
        solved, walked = (blocks(radiance(image.part("higher"), wavelength)) for image in (full, path))
        noise = 3.3 * math.sqrt(float(path.variance.max()) / 16)
        assert walked.max() > 10.0 * noise
        assert (np.abs(solved - walked) < 0.03 * blocks(radiance(path, wavelength)) + noise).all()


BAD = {
    "is 2 × 2 × 2 × 2": lambda: hg.SurfaceTexture(np.ones((2, 2, 2, 2))),
    "has 1 values outside 0…100, first nan in row 0, column 1": lambda: hg.SurfaceTexture([[1.0, math.nan]]),
    "outside 0…100, first -1 in vertex 0": lambda: hg.SurfaceTexture([-1.0], of="vertices"),
    "has 2 values a place: give 1": lambda: hg.SurfaceTexture(np.ones((2, 2, 2))),
    "2 values a place and 1 spectra": lambda: hg.SurfaceTexture(np.ones((2, 2, 2)), [RED]),
    "must hold numbers": lambda: hg.SurfaceTexture([["a"]]),
    "places of 1 values": lambda: hg.SurfaceTexture(np.broadcast_to(np.float32(1), (1 << 16, 1 << 16))),
    "its mesh has no UVs": lambda: hg.Surface(paint(0.8), "mesh", SQUARE, FACES, body_texture=CHECKER),
    "uv are (3, 2)": lambda: hg.Surface(paint(0.8), "mesh", SQUARE, FACES, uv=UV[:3]),
    "uv are of a mesh": lambda: hg.Surface(paint(0.8), "sphere", uv=UV),
    "is of 3 vertices, and the surface has 4": lambda: mesh(hg.SurfaceTexture(np.ones(3), of="vertices")),
    "where its body_texture is brightest": lambda: mesh(hg.SurfaceTexture([[1.0, 1.5]]), albedo=0.9),
    "beta_texture is a factor on beta": lambda: mesh(None, hg.SurfaceTexture([[2.0]])),
    "has a body_texture: leave": lambda: hg.Surface(paint(0.0), "sphere", optics="mirror", body_texture=CHECKER),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_no_texture_is_refused_in_one_line(message):
    with pytest.raises(InputError) as error:
        BAD[message]()
    assert message in str(error.value) and "\n" not in str(error.value)


SCENE = (
    BEFORE_A_SURFACE
    + """[[surface]]
mesh = "square.obj"
smooth = false
reflectance = { alpha = 0.25, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 1.0 }
body_texture = { file = "checker.png", smooth = false }
beta_texture = { file = "checker.png", smooth = false }
"""
)
OBJ = "".join(
    f"v {x} {y} {z} {r} {g} 0.5\nvt {u} {v}\n" for (x, y, z), (u, v), (r, g) in zip(SQUARE, UV, CORNERS, strict=True)
)


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "square.obj").write_text(OBJ + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    pixels = np.array([[(255, 128, 0), (0, 128, 255)], [(0, 0, 0), (255, 255, 255)]], np.uint8)
    hg.write_png(tmp_path / "checker.png", pixels)

    def path(old="", new=""):
        assert old in SCENE
        (tmp_path / "scene.toml").write_text(SCENE.replace(old, new))
        return tmp_path / "scene.toml"

    return path


def test_a_scene_file_has_textures(scene):
    """An 8-bit picture is sRGB where it is a colour, and linear where it is a factor or weights of spectra."""
    surface = load_scene(scene())[0].surfaces[0]
    assert surface.body_texture is not None and surface.beta_texture is not None
    np.testing.assert_allclose(surface.body_texture.values[0, 0], [1.0, 0.21586, 0.0], atol=1e-5)
    np.testing.assert_allclose(surface.beta_texture.values[..., 0], [[1.0, 0.0], [0.0, 1.0]])
    of_spectra = "smooth = false, spectra = [0.5, 0.3, 0.2] }\nbeta"
    weights = load_scene(scene("smooth = false }\nbeta", of_spectra))[0].surfaces[0].body_texture
    assert weights is not None and len(weights.spectra) == 3
    np.testing.assert_allclose(weights.values[0, 0], [1.0, 128 / 255, 0.0], atol=1e-6)


def test_a_scene_file_has_colours_of_vertices(scene):
    surface = load_scene(scene('file = "checker.png", smooth = false }\nbeta', "vertex_colours = true }\nbeta"))[
        0
    ].surfaces[0]
    assert surface.body_texture is not None and surface.vertices is not None
    left = surface.vertices[:, 0] * surface.vertices[:, 1] > 0
    np.testing.assert_allclose(surface.body_texture.values[left][:, :2], [[1.0, 0.0]] * left.sum())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('file = "checker.png", smooth = false }\nbeta', 'file = "../a.png" }\nbeta', "outside"),
        ('file = "checker.png", smooth = false }\nbeta', 'file = "a.png" }\nbeta', "a.png"),
        ('file = "checker.png", smooth = false }\nbeta', 'file = "square.obj" }\nbeta', "neither PNG"),
        ('file = "checker.png", smooth = false }\nbeta', "smooth = false }\nbeta", "give either file"),
        ('mesh = "square.obj"', 'shape = "rectangle"', None),
        (
            'file = "checker.png", smooth = false }\nbeta',
            "vertex_colours = true, spectra = [1.0] }\nbeta",
            "leave them out",
        ),
        ("body_colour = 1.0", "body_colour = 0.5", None),
    ],
)
def test_textures_of_a_scene_file_are_checked(scene, old, new, message):
    if message is None:
        assert load_scene(scene(old, new))[0].surfaces[0].body_texture is not None
        return
    with pytest.raises(InputError, match=r"surface 1|surface 'square'") as error:
        load_scene(scene(old, new))
    assert message in str(error.value) and "\n" not in str(error.value)
