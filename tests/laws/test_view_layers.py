"""Laws of what a viewer shows beside the picture: layers, spectra of pixels, and its controls."""

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.files.record import read_toml
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.preview import Preview
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.colour import srgb_decode
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_page.viewer.controls import Choice, Colour, Slider, VectorControl, body_of_rgb, controls, rgb_of_body
from hagoromo_page.viewer.development import shoulder
from hagoromo_page.viewer.layers import MATERIAL_COLOURS, light_layer, matter_pictures, shadow_pictures
from hagoromo_page.viewer.probe import WAVELENGTHS, probe
from hagoromo_page.viewer.scene_files import opened
from hagoromo_page.viewer.view_state import ViewTransform
from tests.ball_scene import ball_scene

CAMERA = Camera(13, 11, (90.0, 90.0), (6.5, 5.5)).look_at((0.0, -1.0, 0.0), (0, 0, 0))
DENSE = 1e4  # extinction at which a voxel is opaque [1/m]


def matte(element: Element = "plane", colour=0.8):
    return Reflectance(0.2, 0.1, 0.2, 1.5, Spectrum.constant(colour), element=element)


def half_and_half(axis, element) -> VolumeBox:
    """An opaque cube of 4 cm about (0, 0, 0): material 0 on the left (x < 0), material 1 on the right."""
    shape, pose = (8, 8, 8), np.eye(4)
    pose[:3, 3] = -0.02
    material = np.broadcast_to(np.arange(8) >= 4, shape).astype(np.uint8)
    axes = np.broadcast_to(np.array(axis, float), (*shape, 3))
    both = [matte(element), matte(element, 0.5)]
    return VolumeBox.from_arrays(np.ones(shape), axes, 0.005, DENSE, both, material=material, pose=pose)


def last_layer(scene, layer):
    *_, last = matter_pictures(scene, Settings(), SceneCache(), layer, rays=16)
    assert last.share == 1.0 and last.picture.shape == (11, 13, 3)
    return last.picture.astype(float) / 255


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normals_face_the_eye_and_are_coded_as_half_plus_half(sign):
    """Of planes in a box, whichever way their axis points, and of a surface."""
    lamp = Lamp(to_lamp=(0.0, 0.0, 1.0))
    normal = np.array([0.48, -0.6, 0.64])
    coded = last_layer(Scene(CAMERA, (lamp,), (half_and_half(sign * normal, "plane"),)), "normals")[5, 6]
    assert np.abs(coded - (0.5 + 0.5 * normal)).max() < 0.01
    ball = Surface.sphere((0.0, 0.0, 0.0), 0.05, matte())
    coded = last_layer(Scene(CAMERA, (lamp,), surfaces=(ball,)), "normals")
    assert np.abs(coded[5, 6] - (0.5, 0.0, 0.5)).max() < 0.01 and not coded[0, 0].any()


def test_density_is_that_of_what_is_seen_over_the_densest():
    """As opaque as a cube is, d (1 − exp(−σ d L)), whose right half is a quarter as dense; of a surface 1."""
    sigma, shares = 40.0, (1.0, 0.25)
    density = np.where(np.arange(8) < 4, *shares) * np.ones((8, 8, 8), np.float32)
    axes = np.broadcast_to([0.0, 0.0, 1.0], (8, 8, 8, 3))
    pose = np.eye(4)
    pose[:3, 3] = -0.02
    cube = VolumeBox.from_arrays(density, axes, 0.005, sigma, [matte("cylinder")], pose=pose)
    lamp = Lamp(to_lamp=(0.0, 0.0, 1.0))
    coded = last_layer(Scene(CAMERA, (lamp,), (cube,)), "density")
    for column, share in zip((5, 7), shares, strict=True):
        assert np.allclose(coded[5, column], -share * np.expm1(-sigma * share * 0.04), atol=0.003)
    assert not coded[0, 0].any()
    ball = Surface.sphere((0.0, 0.0, 0.0), 0.05, matte())
    assert (last_layer(Scene(CAMERA, (lamp,), surfaces=(ball,)), "density")[5, 6] == 1.0).all()


def test_axes_are_coded_by_their_absolute_components():
    axis = np.array([-0.48, 0.6, 0.64])
    scene = Scene(CAMERA, (Lamp(to_lamp=(0.0, 0.0, 1.0)),), (half_and_half(axis, "cylinder"),))
    assert np.abs(last_layer(scene, "axes")[5, 6] - np.abs(axis)).max() < 0.01


def test_materials_have_their_colours_boxes_first():
    floor = Surface.floor(-0.03, 1.0, matte())
    camera = CAMERA.look_at((0.0, -1.0, 0.3), (0, 0, 0))
    scene = Scene(camera, (Lamp(to_lamp=(0.0, 0.0, 1.0)),), (half_and_half((0, -1, 0), "plane"),), (floor,))
    shown = last_layer(scene, "material")
    linear = srgb_decode(np.round(255 * shown))
    for place, material in (((5, 5), 0), ((5, 7), 1), ((0, 0), 2)):
        assert np.abs(linear[place] - MATERIAL_COLOURS[material]).max() < 0.02, material


def test_shadows_are_the_share_of_the_light_that_arrives():
    block = Surface.sphere((0.0, 0.0, 0.2), 0.05, matte())
    scene = Scene(
        CAMERA.look_at((0.0, -1.0, 0.3), (0, 0, 0)),
        (Lamp(to_lamp=(0, 0, 1)),),
        surfaces=(block, Surface.floor(0, 1, matte())),
    )
    view = Preview(Settings())
    *_, last = shadow_pictures(view.pictures(scene), scene, Settings(), view.cache)
    assert last.picture[5, 6].tolist() == [0, 0, 0] and last.picture[10, 0].tolist() == [255, 255, 255]


def test_body_and_interface_light_make_the_picture():
    ball = Surface.sphere((0.0, 0.0, 0.0), 0.05, matte())
    lamps = Lamp(to_lamp=(0, -1, 0.2)), Lamp(to_lamp=(0, -1, -0.2))
    image = render(Scene(CAMERA, lamps, surfaces=(ball,)), Settings(separate_lamps=True))
    body, interface = light_layer(image, "body").weights, light_layer(image, "interface").weights
    assert np.array_equal(body + interface, image.weights)
    assert body[5, 6, [0, 2]].all() and not body[5, 6, [1, 3]].any() and interface[5, 6, [1, 3]].all()


def test_the_probe_reads_the_spectrum_that_a_body_reflects():
    """Of a body with a ramp for colour under illuminant A: α E S, and E is divided out."""
    ramp = Spectrum([380.0, 780.0], [0.2, 0.8])
    body = Reflectance(0.25, 0.0, 0.2, 1.5, ramp)
    ball = Surface.sphere((0.0, 0.0, 0.0), 0.05, body)
    lamp = Lamp(to_lamp=(0, -1, 0), intensity=2.0, spectrum=Spectrum.named("A"))
    image = render(Scene(CAMERA, (lamp,), surfaces=(ball,)))
    middle = probe(image, 0.5, 0.5)
    assert (middle.column, middle.row, middle.alpha) == (6, 5, 1.0)
    assert np.allclose(middle.values, 2.0 * 0.25 * ramp.at(WAVELENGTHS), rtol=1e-3)
    assert np.allclose(middle.linear, image.linear_srgb()[5, 6], rtol=1e-4)
    assert middle.difference(middle) == 0.0 and middle.difference(probe(image, 0.0, 0.0)) > 10.0


def test_every_control_gives_back_what_it_was_set_to_and_makes_a_scene(tmp_path):
    (tmp_path / "ball.toml").write_text(ball_scene() + "[[lamp]]\nto_lamp = [0.0, -1.0, 0.0]\n")
    files, first = opened(tmp_path / "ball.toml")
    stated, (scene, _) = read_toml(tmp_path / "ball.toml"), files.scene(first)
    found = controls(first, first, scene)
    assert len({one.name for one in found}) == len(found) == 5 + 2 + 3 * 3 + 6
    state = first.with_value(("render", "cut"), [0.0, 1.0, 0.0, 0.0])
    for control in found:
        value = {
            Slider: lambda kind: 0.5 * (max(kind.least, 0.3) + min(kind.most, 0.9)),
            Choice: lambda kind: kind.names[-1],
            VectorControl: lambda _: (0.6, -1.5, 0.8),
            Colour: lambda _: (120, 90, 70),
        }[type(control.kind)](control.kind)
        if control.name.endswith(("alpha", "beta")):
            value = 0.05
        if control.name.endswith(" n"):
            value = 1.7
        changed = control.put(state, value)
        assert changed is not state and first.tables == stated, control.name
        again, _ = files.scene(changed)
        now = next(one for one in controls(changed, first, again) if one.name == control.name)
        assert (
            np.allclose(now.get(changed), value, atol=1)
            if isinstance(control.kind, Colour)
            else (now.get(changed) == value if isinstance(value, str) else np.allclose(now.get(changed), value))
        ), control.name


@pytest.mark.parametrize("rgb", [(200, 200, 200), (180, 90, 70), (90, 110, 160)])
def test_a_body_of_a_colour_has_that_colour_under_daylight(rgb):
    body = Spectrum.load(body_of_rgb(rgb))
    assert rgb_of_body(body) == rgb and (body.values >= 0.0).all()
    assert (Spectrum.load(body_of_rgb((255, 0, 0))).values >= 0.0).all()


def test_the_shoulder_is_smooth_rises_and_stays_below_white():
    values = np.linspace(0.0, 50.0, 5001)
    curved = shoulder(values)
    assert np.array_equal(curved[values <= 0.8], values[values <= 0.8]) and (np.diff(curved) > 0).all()
    assert curved.max() < 1.0 and np.isclose((shoulder(np.array(0.8 + 1e-6)) - 0.8) / 1e-6, 1.0, rtol=1e-4)
    assert ViewTransform().tone == "clipped"
