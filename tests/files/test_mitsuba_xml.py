"""Scenes of Mitsuba as files of others: what they may say, what is lost, and what is refused in one line."""

import math
import struct
import zlib

import numpy as np
import pytest

import hagoromo as hg
import hagoromo_formats.mitsuba as hm
from hagoromo import backend
from hagoromo.app.cli import main
from hagoromo.backend import mitsuba
from hagoromo.errors import InputError
from hagoromo.files.record import read_toml
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import linear_colour
from hagoromo_formats.mitsuba.bsdfs import METALS
from hagoromo_formats.mitsuba.serialized import read_serialized
from hagoromo_formats.mitsuba.xml_tree import read_xml

HEAD = '<scene version="3.0.0">'
SENSOR = """<sensor type="perspective"><float name="fov" value="45"/><transform name="to_world">
<lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform></sensor>"""
LAMP = '<emitter type="point"><point name="position" x="1" y="2" z="3"/><rgb name="intensity" value="5"/></emitter>'
BALL = '<shape type="sphere">{}</shape>'
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], "<u4")


def converted(folder, text, name="scene.xml"):
    (folder / name).write_text(text)
    return hm.scene_from_mitsuba(folder / name, folder / "out", force=True)


def ball(folder, bsdf):
    """The table of a sphere with this BSDF, and what is lost."""
    lost = converted(folder, HEAD + SENSOR + LAMP + BALL.format(bsdf) + "</scene>")
    return read_toml(folder / "out" / "scene.toml")["surface"][0], lost


def test_glass_within_glass_keeps_its_index_there_and_back(tmp_path):
    """Mitsuba's has the index inside and that around it, ours its own; glass in water alone is that of their ratio."""
    mitsuba()
    glass = """<shape type="sphere" id="{}"><float name="radius" value="{}"/><bsdf type="dielectric">
    <float name="int_ior" value="{}"/><float name="ext_ior" value="{}"/></bsdf></shape>"""
    both = glass.format("outer", 0.8, 1.5, 1.0) + glass.format("inner", 0.4, 1.33, 1.5)
    converted(tmp_path, HEAD + SENSOR + LAMP + both + "</scene>")
    scene, _ = load_scene(tmp_path / "out" / "scene.toml")
    assert {surface.name: surface.reflectance.n for surface in scene.surfaces} == {"outer": 1.5, "inner": 1.33}
    hm.write_mitsuba(scene, tmp_path / "back")
    hm.scene_from_mitsuba(tmp_path / "back" / "scene.xml", tmp_path / "again")
    again, _ = load_scene(tmp_path / "again" / "scene.toml")
    assert [s.reflectance.n for s in again.surfaces] == [s.reflectance.n for s in scene.surfaces]
    converted(tmp_path, HEAD + SENSOR + LAMP + glass.format("alone", 0.8, 1.5, 1.33) + "</scene>")
    alone = load_scene(tmp_path / "out" / "scene.toml")[0].surfaces[0]
    assert alone.reflectance.n == pytest.approx(1.5 / 1.33)
    with pytest.raises(InputError, match=r"'alone' is glass of index 0\.75\d* against what is around"):
        converted(tmp_path, HEAD + SENSOR + LAMP + glass.format("alone", 0.8, 1.0, 1.3333) + "</scene>")


def test_stock_materials_become_ours_with_what_is_lost(tmp_path):
    """Exact ones lose nothing; a rough coat has Mitsuba's value where eye, lamp and normal are one."""
    mitsuba()  # the package's variant, whatever was set before
    table, lost = ball(tmp_path, '<bsdf type="diffuse"><spectrum name="reflectance" value="0.6"/></bsdf>')
    assert table["reflectance"]["alpha"] == pytest.approx(1 / math.pi) and lost == []
    assert table["reflectance"]["body_colour"]["values"] == [0.6, 0.6]
    table, lost = ball(tmp_path, '<bsdf type="dielectric"><string name="int_ior" value="water"/></bsdf>')
    assert table["optics"] == "glass" and table["reflectance"]["n"] == pytest.approx(1.333 / 1.000277) and lost == []
    table, lost = ball(tmp_path, '<bsdf type="conductor"><string name="material" value="none"/></bsdf>')
    assert table["optics"] == "mirror" and lost == []
    table, lost = ball(tmp_path, '<bsdf type="mask"><bsdf type="diffuse"/></bsdf>')
    assert len(lost) == 1 and "mask" in lost[0]
    for kind in ("beckmann", "ggx"):
        coat = f'''<bsdf type="roughplastic"><string name="distribution" value="{kind}"/>
        <float name="alpha" value="0.2"/><spectrum name="diffuse_reflectance" value="0"/></bsdf>'''
        table, lost = ball(tmp_path, coat)
        scene, _ = load_scene(tmp_path / "out" / "scene.toml")
        ours = peak(hm.bsdf(scene.surfaces[0].reflectance))
        theirs = peak({"type": "roughplastic", "distribution": kind, "alpha": 0.2,
                       "diffuse_reflectance": {"type": "uniform", "value": 0.0}})  # fmt: skip
        assert any("grazing" in line for line in lost) and ours == pytest.approx(theirs, rel=1e-3)
    table, lost = ball(tmp_path, '<bsdf type="plastic"><float name="int_ior" value="1.5"/></bsdf>')
    body = 0.5 * (1.0 - 0.0918)  # of even light a dielectric of 1.5 reflects 9.18 % (Walsh)
    assert table["reflectance"]["body_colour"]["values"][0] == pytest.approx(body, rel=1e-3)
    table, lost = ball(tmp_path, '<bsdf type="roughconductor"><string name="material" value="Au"/></bsdf>')
    assert table["reflectance"]["alpha"] == 0.0 and any("Fresnel" in line for line in lost)


def peak(record):
    import drjit as dr

    mi = mitsuba()
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    return float(np.array(mi.load_dict(record).eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1))).ravel()[1])


def test_metals_have_the_colours_of_mitsuba():
    """What Mitsuba's conductors reflect at normal incidence, by wavelength, as linear sRGB under D65."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(f"{backend.name()}_ad_spectral")
    waves = np.arange(380.0, 781.0, 5.0)
    si = dr.zeros(mi.SurfaceInteraction3f, len(waves))
    si.wi = mi.Vector3f(0, 0, 1)
    si.wavelengths = mi.Spectrum(*(mi.Float(waves.astype(np.float32)),) * 4)
    for name, rgb in ((name, rgb) for name, rgb in METALS.items() if name != "none"):
        metal = mi.load_dict({"type": "conductor", "material": name})
        weight = metal.sample(mi.BSDFContext(), si, mi.Float(0), mi.Point2f(0))[1]
        seen = linear_colour(hg.Spectrum(waves, np.array(weight)[0]), hg.Spectrum.named("D65"))
        assert np.allclose(np.minimum(seen, 1.0), rgb, atol=6e-4), name
    backend.mitsuba()


def test_a_dictionary_is_read_as_its_xml(tmp_path):
    mi = mitsuba()
    text = (
        HEAD + SENSOR + LAMP + BALL.format('<bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.5 0.7"/></bsdf>')
    )
    converted(tmp_path, text + "</scene>")
    colour = {"type": "rgb", "value": [0.2, 0.5, 0.7]}
    look = mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    record = {
        "type": "scene", "camera": {"type": "perspective", "fov": 45.0, "to_world": look},
        "lamp": {"type": "point", "position": [1, 2, 3], "intensity": {"type": "rgb", "value": [5.0, 5.0, 5.0]}},
        "ball": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": colour}},
    }  # fmt: skip
    hm.scene_from_mitsuba(record, tmp_path / "other")
    one, two = (load_scene(tmp_path / each / "scene.toml")[0].record() for each in ("out", "other"))
    assert np.allclose(one["camera"]["world_to_camera"], two["camera"]["world_to_camera"], atol=1e-6)
    assert one["lamps"][0]["position"] == two["lamps"][0]["position"] and one["lamps"][0]["intensity"] == 5.0
    assert one["surfaces"][0]["reflectance"] == two["surfaces"][0]["reflectance"]
    with pytest.raises(InputError, match="made already"):
        hm.scene_from_mitsuba({"type": "scene", "ball": object()}, tmp_path / "no")


@pytest.mark.parametrize(("text", "words"), [
    ('<!DOCTYPE a [<!ENTITY b "c">]>' + HEAD + "</scene>", "defines entities"),
    (HEAD + SENSOR + LAMP + '<shape type="instance"/></scene>', "'instance', which is not read"),
    (HEAD + SENSOR + LAMP + BALL.format('<bsdf type="principled"/>') + "</scene>", "'principled', which is not read"),
    (HEAD + '<include filename="../a.xml"/></scene>', "points outside"),
    (HEAD + '<include filename="scene.xml"/></scene>', "includes more than"),
    (HEAD + SENSOR + '<emitter type="envmap"><string name="filename" value="/a.exr"/></emitter></scene>', "outside"),
    (HEAD + SENSOR + LAMP + '<shape type="ply"><string name="filename" value="no.ply"/></shape></scene>', "no.ply"),
    (HEAD + SENSOR + LAMP + BALL.format('<ref id="none"/>') + "</scene>", "refers to 'none'"),
    (HEAD + SENSOR + LAMP + BALL.format("<bsdf type='diffuse'>") + "</scene>", "cut off or damaged"),
    (HEAD + LAMP + BALL.format("") + "</scene>", "no camera"),
    (HEAD + "<a>" * 100 + "</a>" * 100 + "</scene>", "not known"),
    (HEAD + '<bsdf type="twosided">' * 100 + "</bsdf>" * 100 + "</scene>", "deep"),
    ("<mitsuba/>", "begins with <mitsuba>"),
])  # fmt: skip
def test_hostile_and_foreign_files_are_refused_in_one_line(tmp_path, text, words):
    with pytest.raises(InputError, match=words) as caught:
        converted(tmp_path, text)
    assert "\n" not in str(caught.value) and not (tmp_path / "out").exists()


def test_references_to_references_do_not_grow(tmp_path):
    """Thirty levels of two references each would be a thousand million parts."""
    levels = "".join(f'<bsdf type="twosided" id="b{k + 1}"><ref id="b{k}"/><ref id="b{k}"/></bsdf>' for k in range(30))
    (tmp_path / "a.xml").write_text(f'{HEAD}<bsdf type="diffuse" id="b0"/>{levels}</scene>')
    with pytest.raises(InputError, match="references resolved"):
        read_xml(tmp_path / "a.xml")


def test_names_of_old_files_are_those_of_today(tmp_path):
    text = (
        f'{HEAD.replace("3.0.0", "0.6.0")}<shape type="sphere"><transform name="toWorld"><scale value="2"/></transform>'
    )
    (tmp_path / "a.xml").write_text(text + "</shape></scene>")
    (shape,) = (part for part in read_xml(tmp_path / "a.xml").values() if isinstance(part, dict))
    assert np.array_equal(shape["to_world"], np.diag([2.0, 2.0, 2.0, 1.0]))


def serialized(path, version=4):
    """Two meshes, the second one moved by 1 along x."""
    data, offsets = b"", []
    for shift in (0.0, 1.0):
        offsets.append(len(data))
        head = struct.pack("<I", 0x1000) + (b"mesh\0" if version == 4 else b"") + struct.pack("<QQ", 4, 4)
        corners = CORNERS + np.array([shift, 0, 0], "<f4")
        body = zlib.compress(head + corners.tobytes() + TRIANGLES.tobytes())
        data += struct.pack("<HH", 0x041C, version) + body
    data += struct.pack("<2Q" if version == 4 else "<2I", *offsets) + struct.pack("<I", 2)
    path.write_bytes(data)


def test_serialized_meshes_are_those_that_mitsuba_reads(tmp_path):
    mi = mitsuba()
    serialized(tmp_path / "a.serialized")
    for number in (0, 1):
        vertices, faces = read_serialized(tmp_path / "a.serialized", number)
        theirs = mi.load_dict({"type": "serialized", "filename": str(tmp_path / "a.serialized"), "shape_index": number})
        held = mi.traverse(theirs)
        assert np.array_equal(np.array(held["vertex_positions"]).reshape(-1, 3), vertices)
        assert np.array_equal(np.array(held["faces"]).reshape(-1, 3), faces)
    serialized(tmp_path / "b.serialized", version=3)
    assert np.array_equal(read_serialized(tmp_path / "b.serialized", 1)[0], CORNERS + np.array([1, 0, 0], "<f4"))
    with pytest.raises(InputError, match="no number 2"):
        read_serialized(tmp_path / "a.serialized", 2)
    (tmp_path / "c.serialized").write_bytes((tmp_path / "a.serialized").read_bytes()[:-30])
    with pytest.raises(InputError):
        read_serialized(tmp_path / "c.serialized", 0)


def test_convert_and_info_know_scenes_of_mitsuba(tmp_path, capsys):
    (tmp_path / "scene.xml").write_text(HEAD + SENSOR + LAMP + BALL.format('<bsdf type="plastic"/>') + "</scene>")
    assert main(["convert", str(tmp_path / "scene.xml"), "--out", str(tmp_path / "ours")]) == 0
    assert "its coat" in capsys.readouterr().out
    assert main(["convert", str(tmp_path / "ours" / "scene.toml"), "--out", str(tmp_path / "there")]) == 0
    assert hg.info(tmp_path / "there" / "scene.xml")["kind"] == "Mitsuba scene"
    again = hg.convert(tmp_path / "there" / "scene.xml", tmp_path / "again")
    assert again == []
    scenes = [load_scene(tmp_path / each / "scene.toml")[0] for each in ("ours", "again")]
    alphas = [scene.surfaces[0].reflectance.record() for scene in scenes]
    assert alphas[0] | {"name": ""} == alphas[1] | {"name": ""}
