"""Laws of the preview: it ends in the picture, begins in time, keeps what did not change, and compiles nothing anew."""

import gc
import math
from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.preview import Preview, preview, strides
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_profile import LampProfile
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import sphere_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.film import Film, tile_order
from hagoromo.volume.box import VolumeBox
from tests.compilations import compilations

SETTINGS = Settings(samples=3, seed=2)
GREY = Spectrum.constant(1.0)
FELT = Reflectance(0.2, 0.3, 0.3, 1.5, GREY, element="cylinder", name="felt")
GRAIN = Reflectance(0.15, 0.2, 0.2, 1.4, GREY, element="sphere", name="grain")


def a_box(holes=0.5, seed=3, side=0.01) -> VolumeBox:
    """Threads in 4³ bricks, of which about a share `holes` is empty; two materials."""
    rng = np.random.default_rng(seed)
    shape = (31, 29, 27)
    bricks = rng.random((4, 4, 4)) > holes
    density = rng.random(shape) * np.kron(bricks, np.ones((8, 8, 8)))[:31, :29, :27]
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return VolumeBox.from_arrays(density, axis, side, 60.0, [FELT, GRAIN], (rng.random(shape) > 0.5).astype(np.uint8))


def a_camera(width=53, height=41, focal=70.0, eye=(0.9, -0.8, 0.6)) -> Camera:
    camera = Camera(width, height, (focal, focal), (width / 2, height / 2))
    return camera.look_at(eye, (0.14, 0.14, 0.15))


def lamps(shift=0.0, intensity=1.0, spectrum=GREY) -> tuple[Lamp, ...]:
    """Two near lamps and a far one."""
    near = ((0.8 + shift, -0.6, 0.9), (-0.7, 0.6 + shift, 0.8))
    return (
        *(Lamp(position=place, intensity=intensity, spectrum=spectrum) for place in near),
        Lamp(to_lamp=(0.2, -0.3 + shift, 1.0), intensity=0.5 * intensity, spectrum=spectrum),
    )


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(a_camera(), lamps(), (a_box(),), (Surface.floor(-0.02, 1.0, replace(FELT, element="plane")),))


def turned(box: VolumeBox, angle=0.3) -> VolumeBox:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:3, 3] = 0.02, -0.01, 0.015
    return box.with_pose(pose)


CHANGES = {
    "camera": lambda s: s.with_camera(a_camera(eye=(-0.7, -0.9, 0.5))),
    "focal length": lambda s: s.with_camera(a_camera(focal=91.0)),
    "odd size": lambda s: s.with_camera(a_camera(width=67, height=37)),
    "one row": lambda s: s.with_camera(a_camera(width=71, height=1)),
    "lamps moved": lambda s: s.with_lamps(*lamps(shift=0.13)),
    "a lamp close by": lambda s: s.with_lamps(replace(lamps()[0], position=np.array((0.05, 0.03, 0.35))), *lamps()[1:]),
    "lamps dimmed": lambda s: s.with_lamps(*lamps(intensity=0.7)),
    "lamps coloured": lambda s: s.with_lamps(*lamps(spectrum=Spectrum.constant(0.8))),
    "box posed": lambda s: replace(s, boxes=(turned(s.boxes[0]),)),
    "voxel size": lambda s: replace(s, boxes=(replace(s.boxes[0], voxel_size=0.0093),)),
    "tau": lambda s: replace(s, boxes=(replace(s.boxes[0], tau=33.0),)),
    "other bricks": lambda s: replace(s, boxes=(a_box(holes=0.2, seed=5),)),
    "materials": lambda s: replace(
        s,
        boxes=(s.boxes[0].with_materials([replace(FELT, alpha=0.1, beta=0.4, gamma=0.23, n=1.33), GRAIN]),),
    ),
    "grains": lambda s: replace(
        s,
        boxes=(s.boxes[0].with_materials([FELT, replace(GRAIN, alpha=0.2, beta=0.1, gamma=0.31, n=1.6)]),),
    ),
}


def test_a_new_scene_compiles_and_the_count_sees_it():
    """The count is not blind: another number of lamps is another kernel."""
    box = a_box(holes=0.7)
    one = Scene(a_camera(), lamps()[:1], (box,))
    render(one)
    assert compilations(lambda: render(one)) == 0
    assert compilations(lambda: render(one.with_lamps(*lamps()[:2], *lamps(0.1)[:2]))) > 0


def coarse_view(settings: Settings = SETTINGS) -> Preview:
    """A preview that begins with strides 4 and 2."""
    view = Preview(settings)
    view.rays = dict.fromkeys(view.rays, 200)
    return view


@pytest.fixture(scope="module")
def look(scene):
    """Looks at a scene by a preview that has looked at `scene`, and by a picture."""
    view = coarse_view()

    def look_at(seen):
        list(view.pictures(seen))
        render(seen, SETTINGS)

    gc.collect()  # a kernel with surfaces depends on how many of them are alive
    look_at(scene)
    return look_at


@pytest.mark.by_night(
    "lamps coloured", "odd size", "lamps dimmed", "other bricks", "a lamp close by", "voxel size", "grains", "tau",
    "one row",
)  # fmt: skip
@pytest.mark.parametrize("change", CHANGES)
def test_a_change_compiles_nothing(scene, look, change):
    """After one look at a scene, neither the preview nor the picture of the changed scene compiles a kernel."""
    gc.collect()
    changed = CHANGES[change](scene)
    assert compilations(lambda: look(changed)) == 0


def test_another_reflectance_compiles_nothing():
    """Its energy is checked, and a sphere's facets tabled, by the same kernels for every γ and n."""
    sphere_table(Reflectance(0.2, 0.3, 0.25, 1.5, GREY, element="sphere").gamma, 7)
    assert compilations(lambda: sphere_table(Reflectance(0.2, 0.3, 0.26, 1.41, GREY, element="sphere").gamma, 7)) == 0


def test_a_turned_spot_and_another_luminaire_compile_nothing():
    """Angles, sizes of tables, axes and powers are read from memory; the preview ends with the bits of the render."""
    random, floor = np.random.default_rng(2), Surface.floor(0.0, 0.5, Reflectance(0.2, 0.3, 0.2, 1.5, GREY))

    def scene_under(angles: int, tilt: float) -> Scene:
        profile = LampProfile([0, 20, 90], np.linspace(0, 90, angles), random.random((3, angles)))
        luminaire = Lamp((0.1, -0.2, 0.9), axis=(tilt, 0.2, -1.0), profile=profile, roll=tilt)
        spot = Lamp((0.3, -0.2, 0.8), axis=(-tilt, 0.1, -1.0), axis_power=10.0 * tilt)
        return Scene(a_camera(), (luminaire, spot), surfaces=(floor,))

    def look(seen: Scene) -> None:
        *_, last = coarse_view().pictures(seen)
        assert np.array_equal(last.weights, render(seen, SETTINGS).weights)

    gc.collect()  # a kernel with surfaces depends on how many of them are alive
    look(scene_under(7, 0.3))
    assert compilations(lambda: look(scene_under(19, 0.5))) == 0


def test_other_tails_compile_nothing():
    """One kernel serves every ν, also beside a material without tails; the energy of all of them is one kernel, too."""

    def look(*exponents):
        materials = [Reflectance(0.2, 0.1, 0.25, 1.5, GREY, element="cylinder", nu=nu) for nu in exponents]
        render(Scene(a_camera(), lamps()[:1], (a_box(holes=0.7).with_materials(materials),)))

    look(0.8, 2.0)
    assert compilations(lambda: look(1.7, math.inf)) == 0


def test_a_scene_is_let_go_with_its_picture(scene):
    """A render leaves no cycle that would hold shadow maps until a collection."""

    def prepared() -> set[int]:
        return {id(thing) for thing in gc.get_objects() if isinstance(thing, PreparedScene)}

    gc.collect()
    gc.disable()
    try:
        before = prepared()  # a viewer that another test of this process serves may keep one
        render(scene)
        left = prepared() - before
    finally:
        gc.enable()
    assert not left


def test_the_last_picture_is_the_render(scene):
    """Bit by bit, whatever was looked at before."""
    view = coarse_view()
    list(view.pictures(scene.with_lamps(*lamps(0.2))))
    next(view.pictures(turned_scene := replace(scene, boxes=(turned(scene.boxes[0]),))))
    for seen in (scene, turned_scene):
        *_, last = view.pictures(seen)
        true = render(seen, SETTINGS)
        assert np.array_equal(last.weights, true.weights) and np.array_equal(last.alpha, true.alpha)
        assert last.metadata["scene"] == true.metadata["scene"]


def test_pictures_grow_up_to_the_samples_asked_for(scene):
    images = list(coarse_view().pictures(scene))
    levels = [image.metadata["preview"] for image in images]
    assert [(level["stride"], level["samples"]) for level in levels] == [(4, 1), (2, 1), (1, 1), (1, 2), (1, 3)]
    assert [image.alpha.shape for image in images[:3]] == [(11, 14), (21, 27), (41, 53)]
    shares = [level["share"] for level in levels]
    assert shares == sorted(shares) and 0 < shares[0] and shares[-1] == 1.0


def test_a_coarse_picture_is_the_picture_seen_from_afar(scene):
    """Its mean light is that of the whole picture within a few per cent: 600 rays see what 2173 see."""
    first, *_, last = coarse_view(Settings()).pictures(scene)
    assert first.alpha.mean() == pytest.approx(last.alpha.mean(), rel=0.05)
    assert first.weights.mean() == pytest.approx(last.weights.mean(), rel=0.1)


def test_what_did_not_change_is_not_made_again(scene):
    """Bricks, surfaces and maps survive another camera and other materials; other lamps need other maps only."""
    view = coarse_view()

    def things(seen):
        list(view.pictures(seen))
        return {name: thing for name, (_, thing) in view.cache._entries.items()}

    first = things(scene)
    assert set(first) == {"medium", "surfaces", "maps"}
    for change in ("camera", "materials", "lamps dimmed"):
        assert things(CHANGES[change](scene)) == first
    moved = things(CHANGES["lamps moved"](scene))
    assert {name for name in first if moved[name] is not first[name]} == {"maps"}
    posed = things(CHANGES["box posed"](scene))
    assert {name for name in first if posed[name] is not first[name]} == {"medium", "maps"}


def test_finer_shadows_than_needed_are_kept(scene):
    """A camera that moves sees the finest shadows at once; a lamp that moves begins with coarse ones."""
    view = coarse_view()
    list(view.pictures(scene))
    finest = view.cache.key("maps")[1]
    next(view.pictures(CHANGES["camera"](scene)))
    assert view.cache.key("maps")[1] == finest
    next(view.pictures(CHANGES["lamps moved"](scene)))
    assert view.cache.key("maps")[1] < finest


def test_a_late_first_picture_has_fewer_rays_the_next_time(scene):
    late, early = Preview(seconds=1e-6), Preview(seconds=1e6)
    for view in (late, early):
        view.rays = dict.fromkeys(view.rays, 600)
        for _ in ("with new shadows", "with those"):
            next(view.pictures(scene))
    assert next(late.pictures(scene)).alpha.size < 600 < next(early.pictures(scene)).alpha.size
    with pytest.raises(InputError, match="above 0"):
        next(preview(scene, seconds=0.0))


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (53, 41), (64, 2)])
def test_every_pixel_gets_one_ray(size):
    """The order of rays is a permutation of the pixels, and each ray leaves its own place in its own pixel."""
    width, height = size
    assert sorted(tile_order(width, height)) == list(range(width * height))
    camera = Camera(width, height, (10.0, 10.0), (0.0, 0.0))
    film = Film(camera, 2)
    film.add(lambda origin, direction, phase: ([*(direction / direction.z).xy], phase), np.array([0.25, 0.75, 0.5]))
    places, phases = film.mean()
    row, column = np.mgrid[0:height, 0:width]
    assert np.allclose(places * 10.0 - np.array([0.25, 0.75]), np.stack([column, row], -1), atol=1e-4)
    assert (phases == 0.5).all()


def test_strides_halve_from_the_first_that_leaves_few_enough_rays():
    assert strides(512 * 512, 1 << 14) == [4, 2]
    assert strides(512 * 512, 1 << 15) == [3]
    assert strides(53 * 41, 1 << 15) == []
    assert strides(1920 * 1080, 1 << 15) == [8, 4, 2]
    assert [strides(144 * one**2, 144)[:1] for one in range(1, 8)] == [[], [2], [3], [4], [6], [6], [8]]
