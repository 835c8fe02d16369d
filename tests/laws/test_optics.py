"""Laws of mirrors and smooth glass in mode path. Oracles: the furnace, Fresnel's slab, and the mirrored scene."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image.prepared.nesting import is_closed

WHITE = hg.Spectrum.constant(1.0)
RED = hg.Spectrum([360, 400, 700, 830], [0.2, 0.2, 0.8, 0.8])
PAINT = hg.Reflectance(0.6 / math.pi, 0.0, 0.3, 1.5, WHITE)
SKY = hg.Environment(np.ones((4, 8)), scale=1.0, visible=True)


def camera(eye=(0, -3, 0), focal=20.0):
    return hg.Camera(12, 8, (focal, focal), (6, 4)).look_at(eye, (0, 0, 0))


def mean_light(image, wavelength=550.0):
    return image.weights @ np.array([colour.at(wavelength) for colour in image.palette.colours])


def glass(n=1.5, colour=WHITE):
    return replace(PAINT, n=n, interface_colour=colour)


def test_a_glass_ball_in_a_furnace_is_not_seen():
    """Reflected, refracted and totally reflected light together are the light of the sky: radiance 1 everywhere."""
    ball = replace(hg.Surface.sphere((0, 0, 0), 1.0, glass()), optics="glass")
    image = hg.render(hg.Scene(camera(), (), surfaces=(ball,), environment=SKY), hg.Settings(samples=64), mode="path")
    assert np.abs(mean_light(image) - 1.0).max() < 1e-3


@pytest.mark.parametrize("n", [1.33, 1.8])
def test_a_slab_passes_what_fresnel_says(n):
    """An area lamp behind a slab, seen along its normal: T = (1 − R)/(1 + R), R = ((n − 1)/(n + 1))²."""
    slab = hg.Surface(glass(n), "cube", pose=np.diag([4.0, 0.05, 4.0, 1.0]), optics="glass")
    lamp = hg.AreaLamp(position=(0, 2, 0), edges=((8, 0, 0), (0, 0, 8)), radiance=1.0, visible=True)
    scene = hg.Scene(camera(focal=200.0), (), surfaces=(slab,), area_lamps=(lamp,))
    image = hg.render(scene, hg.Settings(samples=1024), mode="path")
    reflected = ((n - 1) / (n + 1)) ** 2
    passed = (1 - reflected) / (1 + reflected)
    deviation = math.sqrt(passed * (1 - passed) / (12 * 8 * 1024))
    assert abs(mean_light(image).mean() - passed) < 4 * deviation + 1e-4


def test_a_slab_of_coloured_glass_passes_what_beer_and_lambert_leave():
    """t (1 − R)² / (1 − R² t²) of a slab 0.1 m thick, t = exp(−a d), at two bands; a of 4 and 12 [1/m]."""
    absorption = hg.Spectrum([400, 700], [4.0, 12.0])
    slab = hg.Surface(glass(), "cube", pose=np.diag([4.0, 0.05, 4.0, 1.0]), optics="glass", absorption=absorption)
    lamp = hg.AreaLamp(position=(0, 2, 0), edges=((8, 0, 0), (0, 0, 8)), radiance=1.0, visible=True)
    scene = hg.Scene(camera(focal=200.0), (), surfaces=(slab,), area_lamps=(lamp,))
    image = hg.render(scene, hg.Settings(samples=1024), mode="path")
    for wavelength in (400.0, 700.0):
        left = math.exp(-0.1 * absorption.at(wavelength))
        passed = left * 0.96**2 / (1 - (0.04 * left) ** 2)
        deviation = left * math.sqrt(0.96**2 * (1 - 0.96**2) / (12 * 8 * 1024))  # about, of walks that pass or not
        assert abs(mean_light(image, wavelength).mean() - passed) < 4 * deviation + 5e-4 * passed


@pytest.mark.parametrize(("outer", "inner"), [(1.33, 1.9), (1.9, 1.0)])
def test_glass_within_glass_passes_what_fresnel_says(outer, inner):
    """A slab in a slab, also one of air: (1 − T)/T = Σ R/(1 − R) over the four faces, R = ((a − b)/(a + b))²."""
    slabs = tuple(
        hg.Surface(glass(n), "cube", pose=np.diag([4.0 - k, thick, 4.0 - k, 1.0]), optics="glass", name=str(n))
        for k, (n, thick) in enumerate([(outer, 0.05), (inner, 0.02)])
    )
    lamp = hg.AreaLamp(position=(0, 2, 0), edges=((8, 0, 0), (0, 0, 8)), radiance=1.0, visible=True)
    scene = hg.Scene(camera(focal=200.0), (), surfaces=slabs[::-1], area_lamps=(lamp,))
    image = hg.render(scene, hg.Settings(samples=1024), mode="path")
    faces = [((a - b) / (a + b)) ** 2 for a, b in ((1.0, outer), (outer, inner))]
    passed = 1.0 / (1.0 + 2.0 * sum(one / (1.0 - one) for one in faces))
    deviation = math.sqrt(passed * (1 - passed) / (12 * 8 * 1024))
    assert abs(mean_light(image).mean() - passed) < 4 * deviation + 1e-4


def test_what_lies_in_coloured_glass_is_seen_through_it():
    """A white ball in a furnace: all light comes back through clear glass, of 1/m what is left of 1 m at the most."""
    shell = hg.Surface.sphere((0, 0, 0), 1.0, glass())
    core = hg.Surface.sphere((0, 0, 0), 0.5, replace(PAINT, alpha=1.0 / math.pi))
    light = []
    for rate in (0.0, 1.0):
        outer = replace(shell, optics="glass", absorption=hg.Spectrum.constant(rate))
        scene = hg.Scene(camera(focal=60.0), (), surfaces=(outer, core), environment=SKY)
        light.append(mean_light(hg.render(scene, hg.Settings(samples=128), mode="path")).mean())
    assert abs(light[0] - 1.0) < 0.02
    assert light[1] < 0.04 + 0.96 * math.exp(-2 * 0.5)  # the glint, and at least 0.5 m in and out


def test_a_mirror_shows_the_mirrored_scene_in_its_colour():
    """A lit ball in a red mirror, against the ball seen from the mirrored place of the camera."""
    ball, lamp = hg.Surface.sphere((0, 0, 0), 0.4, PAINT), hg.Lamp(to_lamp=(0.3, -1, 0.5))
    mirror = hg.Surface(glass(colour=RED), "rectangle", pose=np.diag([3.0, 3.0, 1.0, 1.0]), optics="mirror", name="m")
    mirror.pose[:3, 3] = (0, 0, -1)
    through = hg.Camera(12, 8, (20, 20), (6, 4)).look_at((0, -3, 1.0), (0, -1.5, -1.0))
    image = hg.render(hg.Scene(through, (lamp,), surfaces=(ball, mirror)), hg.Settings(samples=512), mode="path")
    pose = np.array(through.world_to_camera)
    flip = np.eye(4)
    flip[2, 2], flip[2, 3] = -1.0, -2.0  # about z = −1
    behind = through.with_pose(np.diag([-1.0, 1, 1, 1]) @ pose @ flip)  # turned left to right: a proper rotation
    direct = hg.render(hg.Scene(behind, (lamp,), surfaces=(ball,)), hg.Settings(samples=512), mode="path")
    for wavelength in (420.0, 680.0):
        seen, truth = mean_light(image, wavelength), RED.at(wavelength) * mean_light(direct, wavelength)[:, ::-1]
        assert truth.max() > 0.02 and abs(seen.sum() - truth.sum()) < 0.02 * truth.sum()
        assert np.abs(seen - truth).max() < 0.1 * truth.max()


def test_a_closed_mesh_is_known_wherever_its_vertices_coincide():
    tetrahedron = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    apart = tetrahedron[faces].reshape(-1, 3), np.arange(12).reshape(4, 3)
    assert is_closed(hg.Surface(glass(), "mesh", tetrahedron, faces)) and is_closed(hg.Surface(glass(), "mesh", *apart))
    assert not is_closed(hg.Surface(glass(), "mesh", tetrahedron, faces[:3]))


def test_what_mirrors_and_glass_cannot_do_is_said_in_one_line():
    ball = replace(hg.Surface.sphere((0, 0, 0), 1.0, glass(), name="drop"), optics="glass")
    scene = hg.Scene(camera(), (hg.Lamp(to_lamp=(0, 0, 1)),), surfaces=(ball,))
    for mode in ("march", "full"):
        with pytest.raises(hg.InputError, match=r"'drop' is glass.*use --mode path"):
            hg.render(scene, mode=mode)
    with pytest.raises(hg.InputError, match=r"stands within the glass of surface 'drop'"):
        hg.render(scene.with_lamps(hg.Lamp(position=(0.2, 0.1, 0.3))), mode="path")
    with pytest.raises(hg.InputError, match=r"the camera stands within the glass of surface 'drop'"):
        hg.render(scene.with_camera(camera(eye=(0, -0.5, 0))), mode="path")
    core = hg.Surface.sphere((0, 0, 0), 0.5, PAINT)  # in front of the wall of the drop, as a lamp sees it
    hidden = replace(scene.with_lamps(hg.Lamp(position=(-0.2, -0.5, -0.6))), surfaces=(ball, core))
    with pytest.raises(hg.InputError, match=r"stands within the glass of surface 'drop'"):
        hg.render(hidden, mode="path")
    beside = replace(hg.Surface.sphere((0.9, 0, 0), 0.5, glass(), name="bubble"), optics="glass")
    with pytest.raises(hg.InputError, match=r"'(drop|bubble)' crosses that of '(drop|bubble)': put it wholly within"):
        hg.render(replace(scene, surfaces=(ball, beside)), mode="path")
    pane = replace(hg.Surface.floor(0.0, 1.0, glass(), name="pane"), optics="glass")
    with pytest.raises(hg.InputError, match=r"'pane' is glass and has an open edge: give a closed mesh"):
        hg.render(replace(scene, surfaces=(pane,)), mode="path")
    with pytest.raises(hg.InputError, match="absorption is of glass, and optics is 'mirror'"):
        replace(ball, optics="mirror", absorption=WHITE)
    with pytest.raises(hg.InputError, match="absorption is below 0"):
        replace(ball, absorption=hg.Spectrum([400, 700], [0.0, -1.0]))
    with pytest.raises(hg.InputError, match="optics is 'jelly': give mirror or glass"):
        replace(ball, optics="jelly")
