"""Scenes go to Mitsuba and come from it: the same picture there and here, all orders, judged block by block.

Mitsuba's `path` draws our surfaces by the plugin `hagoromo`, its `volpath` our box of spheres as a stock medium.
Pictures are judged as in `test_mitsuba_orders.py`, with the variance of both solvers, and refused when ours is made 3 %
brighter.
"""

from typing import Any

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
import hagoromo_formats.mitsuba as hm
from hagoromo import backend
from hagoromo.files.exr import write_exr
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import colour_matching, xyz_from_srgb
from hagoromo.light.spectrum import integrate_product
from hagoromo_formats.mitsuba.bsdfs import diffuse_fresnel
from hagoromo_formats.mitsuba.medium import flakes
from hagoromo_formats.mitsuba.textures import ply_of
from tests.agreement.test_mitsuba import INTENSITY, LAMP, TAU, VOXELS, cloud
from tests.agreement.test_mitsuba import camera as camera_of_cloud
from tests.judges import blocks_agree

RENDERS, PATHS, BLOCK = 16, 24, 8
SILK = hg.Reflectance(0.15, 0.6, 0.25, 1.5, hg.Spectrum.constant(1.0))
PLASTER = hg.Reflectance(0.28, 0.1, 0.4, 1.5, hg.Spectrum.constant(1.0), epsilon=0.1)
FRAME = hg.Camera(32, 24, (40, 40), (14, 13)).look_at((0, -3, 1.0), (0, 0, 0.3))  # its axis is not in the middle


def renders_of_mitsuba(colours, load, paths=PATHS):
    """Independent renders (RENDERS, height, width, channels) in a variant of Mitsuba; afterwards ours is set again."""
    import mitsuba as mi

    mi.set_variant(f"{backend.name()}_ad_{colours}")
    hm.register()
    scene = load(mi)
    pictures = np.array([np.array(mi.render(scene, spp=paths, seed=mi.UInt32(seed))) for seed in range(RENDERS)])
    backend.mitsuba()
    return pictures


def assert_same_radiance(scene, walks, paths=PATHS, load=None):
    """In grey light. load: what loads the scene into Mitsuba; None: as we write it."""
    seen = renders_of_mitsuba("mono", load or (lambda mi: hm.load_into_mitsuba(scene)), paths)[..., 0]
    image = hg.render(scene, hg.Settings(samples=walks), mode="path")
    radiance = image.weights @ np.array([colour.at(550.0) for colour in image.palette.colours])
    both = seen.var(axis=0, ddof=1) / RENDERS + image.variance
    assert blocks_agree(seen.mean(axis=0), radiance, both, BLOCK)
    assert not blocks_agree(seen.mean(axis=0), 1.03 * radiance, both, BLOCK)


def bowl():
    """The lower half of a sphere as a mesh, of flat faces."""
    polar, turn = np.meshgrid(np.linspace(0.5, 1.0, 9) * np.pi, np.arange(24) * 2 * np.pi / 24, indexing="ij")
    corners = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    one = np.arange(8 * 24).reshape(8, 24)
    right = np.roll(one, -1, axis=1)
    faces = np.concatenate([np.stack([one, right, one + 24], -1), np.stack([right, right + 24, one + 24], -1)])
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def plates():
    """Two plates that face each other, a ball between them."""
    low, high = np.diag([0.8, 0.8, 1.0, 1.0]), np.diag([0.8, 0.8, 1.0, 1.0])
    high[2, 3] = 0.8
    return (hg.Surface(PLASTER, "rectangle", pose=low), hg.Surface(SILK, "rectangle", pose=high),
            hg.Surface.sphere((0.1, 0, 0.3), 0.25, SILK))  # fmt: skip


def test_our_reflectance_sends_light_on_in_mitsuba_as_here():
    """Plates and a ball, by a near and a far lamp, all orders."""
    lamps = hg.Lamp(position=(0.5, -2, 1.2), intensity=5.0), hg.Lamp(to_lamp=(-1, -1, 0.6), intensity=0.5)
    assert_same_radiance(hg.Scene(FRAME, lamps, surfaces=plates()), 256)


SHEET = np.array([[-0.8, -0.8, 0.0], [0.8, -0.8, 0.0], [0.8, 0.8, 0.2], [-0.8, 0.8, 0.2]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])
TWO_LAMPS = hg.Lamp(position=(0.5, -2, 1.2), intensity=5.0), hg.Lamp(to_lamp=(-1, -1, 0.6), intensity=0.5)


def test_a_scene_with_images_is_loaded_where_kernels_have_one_thread(monkeypatch):
    """As on one core: there Mitsuba waited for ever for the threads that read its EXR."""
    import mitsuba as mi

    mi.set_variant(f"{backend.name()}_ad_mono")
    loaded, before = mi.load_file, dr.thread_count()

    def load_file(path, parallel=True):
        assert dr.thread_count() > 1 and not parallel
        return loaded(path, parallel=parallel)

    monkeypatch.setattr(mi, "load_file", load_file)
    body = hg.SurfaceTexture(np.full((4, 4), 0.5))
    scene = hg.Scene(FRAME, TWO_LAMPS, surfaces=(hg.Surface(SILK, "sphere", body_texture=body),))
    dr.set_thread_count(1)
    try:
        assert len(hm.load_into_mitsuba(scene).shapes()) == 1 and dr.thread_count() == 1
    finally:
        dr.set_thread_count(before)
        backend.mitsuba()


def test_textures_lie_in_mitsuba_as_here_and_come_back(tmp_path):
    """Images of body, beta and gamma that repeat on a mesh, one on a ball, and values by vertex; all orders."""
    random = np.random.default_rng(0)
    body = hg.SurfaceTexture(0.1 + 0.8 * random.random((6, 8)))
    gloss: dict[str, Any] = {"gamma_texture": hg.SurfaceTexture(0.1 + 0.3 * random.random((5, 4)), smooth=False),
             "beta_texture": hg.SurfaceTexture(random.random((4, 4)))}  # fmt: skip
    uv, pose = np.array([[0, 0], [2, 0], [2, 1.5], [0, 1.5]]), np.diag([0.25, 0.25, 0.25, 1.0])
    pose[2, 3] = 0.5
    by_vertex: dict[str, Any] = {"body_texture": hg.SurfaceTexture([0.1, 0.9, 0.4, 0.6], of="vertices"),
                 "gamma_texture": hg.SurfaceTexture([0.1, 0.4, 0.3, 0.2], of="vertices")}  # fmt: skip
    surfaces = (
        hg.Surface(SILK, vertices=SHEET, faces=TWO, uv=uv, smooth=False, body_texture=body, **gloss),
        hg.Surface(SILK, "sphere", pose=pose, body_texture=body),
        hg.Surface(PLASTER, vertices=0.3 * SHEET + [0.5, 0.1, 0.4], faces=TWO, smooth=False, **by_vertex),
    )
    scene = hg.Scene(FRAME, TWO_LAMPS, surfaces=surfaces)
    assert_same_radiance(scene, 384)
    assert hm.write_mitsuba(scene, tmp_path / "there") == []
    lost = hm.scene_from_mitsuba(tmp_path / "there" / "scene.xml", tmp_path / "back")
    assert len(lost) == 2 and all("half their scale" in line for line in lost)
    back = load_scene(tmp_path / "back" / "scene.toml")[0].surfaces
    for mine, other in zip(surfaces[:2], back, strict=False):
        assert other.reflectance.beta * _largest(other.beta_texture) == pytest.approx(0.6 * _largest(mine.beta_texture))
        for one, read in zip(mine.textures, other.textures, strict=True):
            assert (one is None) == (read is None)
            if one is not None and read is not None:
                assert read.smooth == one.smooth
                assert np.allclose(read.values / _largest(read), one.values / _largest(one), rtol=1e-5)


def test_normals_and_heights_turn_surfaces_in_mitsuba_as_here_and_come_back(tmp_path):
    """By `normalmap` and `bumpmap`, on a mesh whose UVs repeat and on a ball, under gloss; all orders.

    Slopes of our heights are interpolated between pixels, those of Mitsuba are not: the image is a fine one.
    """
    x, y = np.meshgrid(2 * np.pi * (np.arange(96) + 0.5) / 96, 2 * np.pi * (np.arange(80) + 0.5) / 80)
    slopes = np.stack([0.4 * np.sin(x + y), 0.3 * np.cos(2 * x), np.ones_like(x)], axis=-1)
    normals = hg.SurfaceTexture(0.5 + 0.5 * slopes / np.linalg.norm(slopes, axis=-1, keepdims=True), ())
    heights = hg.SurfaceTexture(0.02 * (1.0 + np.sin(x) * np.cos(y)))
    uv, pose = np.array([[0, 0], [2, 0], [2, 1.5], [0, 1.5]]), np.diag([0.25, 0.25, 0.25, 1.0])
    pose[2, 3] = 0.5
    surfaces = (
        hg.Surface(SILK, vertices=SHEET, faces=TWO, uv=uv, smooth=False, normal_texture=normals),
        hg.Surface(PLASTER, "sphere", pose=pose, bump_texture=heights),
    )
    scene = hg.Scene(FRAME, TWO_LAMPS, surfaces=surfaces)
    assert_same_radiance(scene, 384)
    assert len(hm.write_mitsuba(scene, tmp_path / "there")) == 1
    assert hm.scene_from_mitsuba(tmp_path / "there" / "scene.xml", tmp_path / "back") == []
    sheet, ball = load_scene(tmp_path / "back" / "scene.toml")[0].surfaces
    for read, mine in ((sheet.normal_texture, normals), (ball.bump_texture, heights)):
        assert read is not None and np.allclose(read.values, mine.values, atol=1e-6)


def _largest(texture):
    return 1.0 if texture is None else texture.values.max()


def test_bitmaps_of_mitsuba_lie_here_as_there(tmp_path):
    """On an OBJ, whose images Mitsuba turns upside down, a PLY and a rectangle; one is transformed: its mean stands."""
    values = (0.1 + 0.8 * np.random.default_rng(3).random((6, 8))).astype(np.float32)
    write_exr(tmp_path / "image.exr", {"Y": values})
    uv = [(0, 0), (1.5, 0), (1.5, 1), (0, 1)]
    lines = [f"v {x} {y} {z}" for x, y, z in SHEET] + [f"vt {u} {v}" for u, v in uv]
    (tmp_path / "sheet.obj").write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4", ""]))
    columns = dict(zip(("u", "v"), np.array(uv).T, strict=True))
    (tmp_path / "small.ply").write_bytes(ply_of(0.3 * SHEET + [-0.4, 0.2, 0.5], TWO, columns))
    image = "<texture type='bitmap' name='{}'><string name='filename' value='image.exr'/>"
    matt = f"<bsdf type='twosided'><bsdf type='diffuse'>{image.format('reflectance')}</texture></bsdf></bsdf>"
    coat = f"<bsdf type='roughplastic'>{image.format('diffuse_reflectance')}</texture></bsdf>"
    flat = "<boolean name='face_normals' value='true'/>"
    text = f"""<scene version="3.0.0"><integrator type="path"/>
<sensor type="perspective"><float name="fov" value="44"/>
  <transform name="to_world"><lookat origin="0,-3,1" target="0,0,0.3" up="0,0,1"/></transform>
  <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/><rfilter type="box"/>
  <string name="component_format" value="float32"/></film></sensor>
<emitter type="point"><point name="position" x="0.5" y="-2" z="1.2"/><spectrum name="intensity" value="5"/></emitter>
<shape type="obj"><string name="filename" value="sheet.obj"/>{flat}{matt}</shape>
<shape type="ply"><string name="filename" value="small.ply"/>{flat}{matt}</shape>
<shape type="rectangle">{matt}
  <transform name="to_world"><scale value="0.25"/><translate x="0.4" z="0.5"/></transform></shape>
</scene>"""
    (tmp_path / "scene.xml").write_text(text)
    assert hm.scene_from_mitsuba(tmp_path / "scene.xml", tmp_path / "here") == []
    scene = load_scene(tmp_path / "here" / "scene.toml")[0]
    assert_same_radiance(scene, 256, load=lambda mi: mi.load_file(str(tmp_path / "scene.xml")))
    turned = "<transform name='to_uv'><scale value='2'/></transform></texture>"
    (tmp_path / "scene.xml").write_text(text.replace(matt, matt.replace("</texture>", turned), 1).replace(matt, coat))
    lost = hm.scene_from_mitsuba(tmp_path / "scene.xml", tmp_path / "other")
    assert any("the mean colour stands" in line for line in lost) and any("how its coat dims" in line for line in lost)
    other = load_scene(tmp_path / "other" / "scene.toml")[0].surfaces
    assert [surface.body_texture is None for surface in other] == [True, False, False]
    assert other[0].reflectance.body_colour.at(550.0) == pytest.approx(values.mean(), rel=1e-5)
    kept = 1.0 - diffuse_fresnel(1.49 / 1.000277)  # of what the base reflects, by the coat
    plain, coated = scene.surfaces[1].body_texture, other[1].body_texture
    assert plain is not None and coated is not None and np.allclose(coated.values, kept * plain.values, rtol=1e-5)


@pytest.mark.slow
def test_light_goes_to_and_fro_in_a_bowl_as_in_mitsuba():
    vertices, faces = bowl()
    inside = hg.Surface(PLASTER, vertices=vertices, faces=faces, smooth=False, pose=np.diag([0.9, 0.9, 0.9, 1.0]))
    camera = hg.Camera(32, 24, (40, 40), (16, 12)).look_at((0, -1.2, 2.0), (0, 0, -0.4))
    assert_same_radiance(hg.Scene(camera, (hg.Lamp(position=(0.3, 0.2, 1.0), intensity=2.0),), surfaces=(inside,)), 256)


@pytest.mark.slow
def test_a_box_of_spheres_is_a_stock_medium():
    """With a body and gloss, in `volpath`, all orders."""
    density, pose = cloud(), np.eye(4)
    pose[:3, 3] = -1.0
    matter = hg.Reflectance(0.2, 0.4, 0.4, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    box = hg.VolumeBox.from_arrays(density, np.zeros((*density.shape, 3)), 2.0 / VOXELS, TAU, [matter], pose=pose)
    lamp = hg.Lamp(position=LAMP, intensity=INTENSITY)
    assert_same_radiance(hg.Scene(camera_of_cloud(), (lamp,), boxes=(box,)), 512, paths=48)


SKY = 0.2 + np.random.default_rng(6).random((8, 16)).astype(np.float32)
SKY[2, 5] = 12.0
TURN = np.array([[0.6, 0.0, 0.8], [0.64, 0.6, -0.48], [-0.48, 0.8, 0.36]])
WINDOW = hg.AreaLamp((0.0, -2.5, 1.5), edges=[[0.0, 0.4, 0.5], [-0.6, 0.0, 0.0]], radiance=9.0)
BULB = hg.AreaLamp((1.5, -2.0, 1.0), radius=0.3, radiance=4.0)


@pytest.mark.slow
def test_an_environment_and_area_lamps_shine_there_as_here():
    """A turned map with a bright place, and lamps with a size that stand where they hide nothing from the rest."""
    sky = hg.Environment(SKY, scale=0.5, rotation=TURN)
    assert_same_radiance(hg.Scene(FRAME, (), surfaces=plates()[:1], environment=sky), 512, paths=48)
    assert_same_radiance(hg.Scene(FRAME, (), surfaces=plates(), area_lamps=(WINDOW, BULB)), 2048, paths=256)


def test_lights_and_camera_are_read_back_as_they_were_written(tmp_path):
    sky, lamps = hg.Environment(SKY, scale=0.5, rotation=TURN), (WINDOW, BULB)
    hm.write_mitsuba(hg.Scene(FRAME, (), surfaces=plates(), area_lamps=lamps, environment=sky), tmp_path / "there")
    hm.scene_from_mitsuba(tmp_path / "there" / "scene.xml", tmp_path / "back")
    back, _ = load_scene(tmp_path / "back" / "scene.toml")
    ways = np.random.default_rng(1).normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert back.environment is not None
    assert np.allclose(back.environment.radiance_from(ways).sum(axis=-1), sky.radiance_from(ways)[:, 0], rtol=1e-5)
    for mine, other in zip(lamps, back.area_lamps, strict=True):
        assert np.allclose(mine.position, other.position) and mine.radiance == pytest.approx(other.radiance)
        assert mine.area == pytest.approx(other.area)
    assert np.allclose(back.area_lamps[0].normal, lamps[0].normal)
    assert np.allclose(back.camera.world_to_camera, FRAME.world_to_camera)
    assert (back.camera.focal, back.camera.principal) == (pytest.approx(FRAME.focal), pytest.approx(FRAME.principal))


ROOM = """<scene version="3.0.0"><default name="w" value="48"/>
<integrator type="path"><integer name="max_depth" value="-1"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><string name="fov_axis" value="smaller"/>
  <float name="principal_point_offset_x" value="0.05"/>
  <transform name="to_world"><lookat origin="0.2,0.1,3.6" target="0,0,0" up="0,1,0"/></transform>
  <film type="hdrfilm"><integer name="width" value="$w"/><integer name="height" value="32"/>
    <string name="component_format" value="float32"/><rfilter type="box"/></film></sensor>
<bsdf type="diffuse" id="white"><spectrum name="reflectance" value="0.7"/></bsdf>
<bsdf type="diffuse" id="tint"><spectrum name="reflectance" value="400:0.1, 700:0.8"/></bsdf>
<shape type="rectangle"><transform name="to_world"><translate z="-1"/></transform><ref id="white"/></shape>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><translate y="-1"/></transform>
  <ref id="white"/></shape>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="1"/></transform>
  <ref id="white"/></shape>
<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="90"/><translate x="-1"/></transform>
  <ref id="tint"/></shape>
<shape type="sphere"><point name="center" x="0.4" y="-0.6" z="0.2"/><float name="radius" value="0.4"/>
  <ref id="tint"/></shape>
<shape type="cylinder"><point name="p0" x="-0.5" y="-1" z="0"/><point name="p1" x="-0.4" y="0" z="0.1"/>
  <float name="radius" value="0.2"/><bsdf type="twosided"><ref id="white"/></bsdf></shape>
<shape type="obj"><string name="filename" value="lamp.obj"/><boolean name="face_normals" value="true"/>
  <bsdf type="diffuse"><spectrum name="reflectance" value="0"/></bsdf>
  <emitter type="area"><spectrum name="radiance" value="20"/></emitter></shape>
<emitter type="spot"><spectrum name="intensity" value="400:1, 700:3"/><float name="cutoff_angle" value="25"/>
  <float name="beam_width" value="10"/>
  <transform name="to_world"><lookat origin="-0.5,0.5,2" target="0.3,-0.6,0" up="0,1,0"/></transform></emitter>
</scene>"""
LAMP_OBJ = "v -0.5 1.2 2.5\nv -0.5 1.8 2.5\nv 0.5 1.8 2.5\nv 0.5 1.2 2.5\nf 1 2 3\nf 1 3 4\n"


def room(folder, text=ROOM):
    """The room as a scene of ours. Its lamp stands outside, where it hides nothing from the rest."""
    (folder / "room.xml").write_text(text)
    (folder / "lamp.obj").write_text(LAMP_OBJ)
    lost = hm.scene_from_mitsuba(folder / "room.xml", folder / "room")
    assert lost == ["lamps with a size neither reflect nor hide what is behind them"]
    scene, _ = load_scene(folder / "room" / "scene.toml")
    assert scene.area_lamps[0].radius is None and scene.lamps[0].profile is not None
    return scene


def test_a_scene_of_mitsuba_is_the_same_picture_here(tmp_path):
    """A grey room with a lamp of triangles and a spot, all orders."""
    scene = room(tmp_path, ROOM.replace("400:0.1, 700:0.8", "0.4").replace("400:1, 700:3", "2"))
    assert_same_radiance(scene, 256, load=lambda mi: mi.load_file(str(tmp_path / "room.xml")))
    assert not any("spot" in line for line in hm.write_mitsuba(scene, tmp_path / "there"))
    hm.scene_from_mitsuba(tmp_path / "there" / "scene.xml", tmp_path / "back")
    (back,), (spot,) = load_scene(tmp_path / "back" / "scene.toml")[0].lamps, scene.lamps
    assert spot.axis is not None
    ways = np.random.default_rng(2).normal(size=(500, 3)) + 3.0 * spot.axis
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert np.allclose(back.relative_intensity(ways), spot.relative_intensity(ways), atol=1e-6)
    assert back.intensity == spot.intensity == 2.0


@pytest.mark.slow
def test_a_coloured_scene_of_mitsuba_is_the_same_picture_here(tmp_path):
    """In its spectral variant: Y of all orders."""
    scene = room(tmp_path)
    theirs = renders_of_mitsuba("spectral", lambda mi: mi.load_file(str(tmp_path / "room.xml")), paths=64)
    seen, luminosity = xyz_from_srgb(theirs)[..., 1], colour_matching()[1]
    white = integrate_product(scene.lamps[0].spectrum, luminosity) / integrate_product(luminosity)
    drawn = np.array([
        white * hg.render(scene, hg.Settings(samples=96, seed=seed), mode="path").xyz()[..., 1]
        for seed in range(RENDERS)
    ])  # fmt: skip
    both = (seen.var(axis=0, ddof=1) + drawn.var(axis=0, ddof=1)) / RENDERS
    assert blocks_agree(seen.mean(axis=0), drawn.mean(axis=0), both, BLOCK)
    assert not blocks_agree(seen.mean(axis=0), 1.03 * drawn.mean(axis=0), both, BLOCK)


def test_a_box_is_loaded_as_the_nearest_medium_and_says_what_is_lost(tmp_path):
    """A box of fibres, turned: it stands where ours does, and the light that it sends on is named."""
    turn = np.eye(4)
    turn[:3, :3] = TURN
    density, axis = np.ones((3, 4, 5), np.float32), np.zeros((3, 4, 5, 3))
    axis[..., 0] = 1.0
    matter = hg.Reflectance(0.2, 0.2, 0.3, 1.5, hg.Spectrum.constant(0.8), element="cylinder")
    box = hg.VolumeBox.from_arrays(density, axis, 0.1, 5.0, [matter], pose=turn, extinction="projected")
    frame = hg.Camera(8, 6, (8, 8), (4, 3)).look_at((0, -3, 1.0), (0, 0, 0.3))
    lost = hm.write_mitsuba(hg.Scene(frame, (hg.Lamp(to_lamp=(0, -1, 1)),), (box,)), tmp_path / "there")
    assert len(lost) == 2 and "SGGX" in lost[0] and "extinction by direction" in lost[1]
    (shape,) = backend.mitsuba().load_file(str(tmp_path / "there" / "scene.xml"), parallel=False).shapes()
    assert shape.interior_medium() is not None and np.allclose(box.corners().min(axis=0), np.array(shape.bbox().min))


@pytest.mark.parametrize("element", ["plane", "cylinder"])
def test_flakes_are_as_wide_as_they_are_seen(element):
    """1 along normals of planes and across fibres, else their roughness squared."""
    matter = hg.Reflectance(0.2, 0.2, 0.3, 1.5, hg.Spectrum.constant(0.8), element=element)
    s, along, across = flakes(matter, TURN[:, 0]), TURN[:, 0], TURN[:, 1]
    matrix = np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])
    rough = (np.tan(0.3) / np.sqrt(np.sqrt(2.0) - 1.0)) ** 2
    seen = [along @ matrix @ along, across @ matrix @ across]
    assert seen == pytest.approx([1.0, rough] if element == "plane" else [rough, 1.0], rel=1e-5)
