"""Each parameter of a reflectance reaches every file and program, or what is written says that it is lost there.

Each test changes one field and looks whether the output changes, whatever the table of parameters says: a field that is
new fails here until every consumer carries or names it.
"""

import dataclasses
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from docs.hooks.parameters import page as parameters_page
from hagoromo.app.info import info
from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.toml_text import toml_text
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance import parameters
from hagoromo.reflectance.facets import TAILS_OF_GGX
from hagoromo.reflectance.material.material_estimate import MaterialEstimate, materials_html
from hagoromo.reflectance.material.materials_file import read_materials, write_materials
from hagoromo.reflectance.parameters import EVIDENCE, EXPORTS, FORMATS, NUMBERS, PARAMETERS, PLAIN_BODY, VOLUMES, lost
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.reflectance_record import reflectance_from_record
from hagoromo.transport.field.scattering import _figures
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from hagoromo_formats.convert import ConvertOptions, convert
from hagoromo_formats.mitsuba import medium
from hagoromo_formats.mitsuba.bsdf_numbers import PLACED, numbers_of
from hagoromo_formats.mitsuba.plugin import COLOURS
from hagoromo_formats.mitsuba.read import scene_from_mitsuba
from hagoromo_formats.mitsuba.write import write_mitsuba
from hagoromo_formats.reflectances import rgl_out
from hagoromo_formats.relightable import export as export_module
from hagoromo_formats.relightable import openmaterial
from hagoromo_formats.scenes.gltf_scene import gltf_from_scene
from hagoromo_formats.scenes.usd_out import usd_from_scene
from hagoromo_page.publication.document import document
from hagoromo_page.publication.object_page import single_page
from hagoromo_page.publication.publish import page_source
from hagoromo_page.viewer.maps_plate import MapsPlate
from hagoromo_page.viewer.open_desk import open_desk
from hagoromo_page.viewer.plates import PlateLight
from hagoromo_page.viewer.view_state import ViewTransform
from tests.app.published_ball import TRUTHS, estimate

ROWS = {row.name: row for row in PARAMETERS}
GREY, RAMP = Spectrum.constant(0.6), Spectrum([400.0, 700.0], [0.3, 0.7])
BASE = Reflectance(0.15, 0.5, 0.1, 1.5, GREY, name="base")
CLEAR = {"transmission": 0.3, "transmitted_colour": GREY, "element": "cylinder"}
# field → what it is changed to, and what else is changed in both so that it has an effect
CHANGED = {
    "name": ("other", {}), "alpha": (0.25, {}), "beta": (0.2, {}), "gamma": (0.2, {}), "n": (1.7, {}),
    "body_colour": (RAMP, {}), "interface_colour": (RAMP, {}), "element": ("cylinder", {}), "nu": (1.1, {}),
    **{name: (plain + 0.4, {}) for name, plain in PLAIN_BODY.items()}, "lobes": (((0.05, 0.3),), {}),
    "transmission": (0.3, {}), "transmitted_colour": (RAMP, CLEAR), "clearness": (0.5, CLEAR),
}  # fmt: skip
OF_LIGHT = [name for name in CHANGED if ROWS[name].part != "label"]
FIRST = estimate("base", replace(TRUTHS[0], lobes=()))
COLOUR = (1.3, 1.0, 0.7)
OF_ESTIMATE: dict[str, Any] = {
    "name": "other", "pixels": 7, "body_colour": COLOUR, "interface_colour": COLOUR, "alpha": 0.25, "beta": 0.5,
    "gamma": 0.2, "n": 1.7, "specular_albedo": 0.07, "standard_error": {**FIRST.standard_error, "alpha": 0.02},
    "interval_95": {**FIRST.interval_95, "alpha": (0.05, 0.3)}, "correlation": ((0.5,) * 4,) * 4,
    "identifiable": dict.fromkeys(("alpha", "beta", "gamma", "n", "nu", "interface_colour"), False),
    "chi_square": 2.0, "element": "cylinder",
    "remarks": ("a remark",), "lack_of_fit": {"p": 0.5}, "texture": {"variation": [0.1]}, "gloss": {"per_pixel": False},
    "convergence": {"status": "converged"}, "nu": 1.1, "epsilon": 0.4, "sigma": 0.4, "lobes": ((0.3, 0.03),),
}  # fmt: skip
LIT = [name for name in OF_ESTIMATE if ROWS[name].part not in ("label", "evidence")]


def fields(kind):
    return {field.name for field in dataclasses.fields(kind)}


def test_every_field_has_a_row_and_a_change_here():
    assert len(ROWS) == len(PARAMETERS)
    assert set(ROWS) == fields(Reflectance) | fields(MaterialEstimate)
    assert set(CHANGED) == fields(Reflectance) and set(OF_ESTIMATE) == fields(MaterialEstimate)
    assert {form for row in PARAMETERS for form in row.lost} <= set(FORMATS)


def test_every_number_has_what_records_and_messages_take_from_its_row():
    kinds = {field.name: field for field in dataclasses.fields(Reflectance)}
    assert {name for name, field in kinds.items() if field.type == "float"} == {row.name for row in NUMBERS}
    for row in NUMBERS:
        assert row.symbol and row.meaning
        assert kinds[row.name].default in (row.plain, dataclasses.MISSING)


@pytest.mark.parametrize("row", NUMBERS, ids=lambda row: row.name)
def test_numbers_beyond_their_range_are_refused(row):
    low, high = row.range
    beyond = high + 0.1 if high < np.inf else low / 2
    for wrong in (low - 0.1, beyond, float("nan"), "1", None):
        with pytest.raises(InputError, match=f"^reflectance 'base': {row.name} is {wrong}: give a number from {low}"):
            replace(BASE, **dict[str, Any]({row.name: wrong}))


@pytest.mark.parametrize("row", [row for row in PARAMETERS if row.fitted], ids=lambda row: row.name)
def test_a_fit_moves_a_coordinate_that_gives_the_parameter_back(row):
    low, high = row.fit.range
    assert row.range[0] <= low < high <= row.range[1]
    given = [low, 0.7 * low + 0.3 * min(high, 9.0), high]
    moved = np.array([row.fit.of(value) for value in given])
    assert (np.diff(moved) > 0).all() or (np.diff(moved) < 0).all()
    np.testing.assert_allclose([row.fit.back(one) for one in moved], given, rtol=1e-12)
    assert row.fit.bounds == (moved.min(), moved.max())


def test_the_page_of_parameters_has_each_with_its_range_and_its_losses():
    first, second = parameters_page().split("## What formats lose")
    for row in PARAMETERS:
        assert (f"| `{row.name}` |" in first) == (row.part != "evidence")
        assert (f"| `{row.name}` |" in second) == bool(row.lost)
    assert (
        "| `gamma` | γ | rad | half width of the distribution of facets γ [rad] | 0.0001 … 1.571 | ln γ | 0.001 … 1.2 |"
        in first
    )
    assert "| `nu` | png, tiff, exr, glb, materialx, openpbr, gltf, usd | those of GGX |" in second


def test_rows_say_what_may_differ_from_place_to_place():
    """As the maps of a measurement, the textures of a surface and of the BSDF, and the voxels of a box hold it."""
    of_gloss = fields(GlossMap) & set(ROWS)
    textures = {name.removesuffix("_texture") for name in fields(hg.Surface) if name.endswith("_texture")}
    holders = {
        "measurement": of_gloss | {"body_colour"},
        "scene": textures - {"body", "normal", "bump"} | {"body_colour"},  # the latter two are of the surface
        "mitsuba": {*PLACED, *COLOURS},
        "box": {"body_colour"},
    }
    assert {where: {row.name for row in PARAMETERS if where in row.varies} for where in holders} == holders
    assert {where for row in PARAMETERS for where in row.varies} == set(holders)


def values(made):
    """All fields, spectra as numbers; the colour of what passes through is the body's where none is given."""
    held = {key: getattr(made, key) for key in fields(Reflectance)}
    held["transmitted_colour"] = made.transmitted[0]
    return {key: one.record() if isinstance(one, Spectrum) else one for key, one in held.items()}


def scene_of(reflectance):
    surface = hg.Surface.sphere(centre=(0, 0, 0.1), radius=0.1, reflectance=reflectance, name="ball")
    return hg.Scene(CAMERA, (LAMP,), (), (surface,))


CAMERA = Camera(17, 13, (20.0, 20.0), (8.5, 6.5)).look_at((0, -1, 0), (0, 0, 0))
LAMP = Lamp(to_lamp=(0.0, -1.0, 1.0))


def box_of(reflectance):
    density = np.full((5, 3, 4), 0.5, np.float32)
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (*density.shape, 3))
    return hg.VolumeBox.from_arrays(density, axis, 0.01, 100.0, [reflectance], name="slab")


def contents(folder, but=()):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in but
    }


def of_mitsuba(made, folder):
    if made.element == "plane":
        said = write_mitsuba(scene_of(made), folder / "out")
    else:
        numbers_of(made)
        raise AssertionError("the BSDF takes what is no plane")
    return contents(folder / "out"), said


def of_medium(made, folder):
    scene = hg.Scene(CAMERA, (LAMP,), (box_of(made),))
    said = write_mitsuba(scene, folder / "out")
    return contents(folder / "out"), said


def of_pbr(write, suffix):
    def written(made, folder):
        if made.element != "plane":
            scene_of(made)
            raise AssertionError("a surface takes what is no plane")
        said = write(scene_of(made), folder / f"a{suffix}")
        return contents(folder), said

    return written


def of_volume(suffix):
    def written(made, folder):
        hg.save_box(box_of(made), folder / "a.zarr")
        said = convert(folder / "a.zarr", folder / f"b.{suffix}", options=ConvertOptions())
        return (folder / f"b.{suffix}").read_bytes(), said

    return written


SCENES = {
    "mitsuba": of_mitsuba,
    "mitsuba medium": of_medium,
    "gltf": of_pbr(gltf_from_scene, ".glb"),
    "usd": of_pbr(usd_from_scene, ".usda"),
    **{suffix: of_volume(suffix) for suffix in VOLUMES},
}


def pair(name, form):
    """A reflectance and the same with the field changed; what a form loses in any case is not in the first."""
    value, more = CHANGED[name]
    more = more | ({"nu": TAILS_OF_GGX} if form in ("gltf", "usd") and name != "nu" else {})
    if form in ("mitsuba", "gltf", "usd") and name in ("transmitted_colour", "clearness"):
        more = {"transmission": 0.3}
        value = RAMP if name == "transmitted_colour" else 0.0
    first = replace(BASE, **dict[str, Any](more))
    return first, replace(first, **dict[str, Any]({name: value}))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """A function that gives the output of a form and its lines; a refusal is a line. Each is written once."""
    known = {}

    def written(form, made):
        key = form, repr(values(made))
        if key not in known:
            try:
                known[key] = SCENES[form](made, tmp_path_factory.mktemp("written"))
            except InputError as error:
                known[key] = "refused", [str(error)]
        return known[key]

    return written


def assert_carried_or_named(form, name, before, after, made):
    """A row that is lost is named; any other changes what is written."""
    row = ROWS[name]
    if row.is_lost(form, made):
        assert any(row.words in line for line in after[1]), f"{form} loses {name} without a word: {after[1]}"
    else:
        assert before[0] != after[0], f"{form} drops {name}"


def test_the_medium_of_mitsuba_names_what_it_loses():
    """Of the lines alone; the volumes themselves take a second each to make, and are tried by the slow test."""
    for name in OF_LIGHT:
        _, changed = pair(name, "mitsuba medium")
        if ROWS[name].is_lost("mitsuba medium", changed):
            assert any(ROWS[name].words in line for line in medium._lost(box_of(changed))), name


@pytest.mark.slow
@pytest.mark.parametrize("name", OF_LIGHT)
def test_the_medium_of_mitsuba_carries_or_names(outcome, name):
    first, changed = pair(name, "mitsuba medium")
    before, after = outcome("mitsuba medium", first), outcome("mitsuba medium", changed)
    assert_carried_or_named("mitsuba medium", name, before, after, changed)


@pytest.mark.parametrize("name", OF_LIGHT)
@pytest.mark.parametrize("form", [form for form in SCENES if form != "mitsuba medium"])
def test_a_scene_or_volume_carries_or_names(outcome, form, name):
    if form == "usd":
        pytest.importorskip("pxr", reason="OpenUSD is not installed")
    first, changed = pair(name, form)
    if first == changed:
        pytest.skip("of cylinders only, which this is not")
    if form == "mitsuba" and (first.transmits or changed.transmits):
        with pytest.raises(InputError, match="light that passes through it"):
            numbers_of(changed)
        return
    before, after = outcome(form, first), outcome(form, changed)
    if after[0] == "refused":
        assert any(word in after[1][0] for word in (ROWS[name].words, str(CHANGED[name][0]))), after[1]
        return
    assert_carried_or_named(form, name, before, after, changed)


def test_a_parameter_that_is_dropped_in_silence_is_found(tmp_path_factory, monkeypatch):
    """The test above fails where the table says that a format carries what it does not."""
    row = replace(ROWS["lobes"], lost={})
    monkeypatch.setitem(ROWS, "lobes", row)
    monkeypatch.setattr(parameters, "PARAMETERS", tuple({**ROWS}.values()))
    first, changed = pair("lobes", "gltf")
    before, after = (SCENES["gltf"](made, tmp_path_factory.mktemp("silent")) for made in (first, changed))
    with pytest.raises(AssertionError, match="drops lobes"):
        assert_carried_or_named("gltf", "lobes", before, after, changed)


@pytest.mark.parametrize("name", CHANGED)
def test_records_and_mitsuba_give_back_what_they_were_given(tmp_path, name):
    """Scene files and boxes hold every field; Mitsuba's XML, which our plugin reads, all of a surface."""
    _, made = pair(name, "record")
    assert values(reflectance_from_record(made.record(), "a record")) == values(made)
    hg.save_box(box_of(made), tmp_path / "a.zarr")
    assert [values(one) for one in hg.load_box(tmp_path / "a.zarr").materials] == [values(made)]
    if lost("mitsuba", made) or name == "name":
        return
    write_mitsuba(scene_of(made), tmp_path / "out")
    scene_from_mitsuba(tmp_path / "out" / "scene.xml", tmp_path / "again")
    found = hg.load_scene(tmp_path / "again" / "scene.toml")[0].surfaces[0].reflectance
    waves = np.arange(450.0, 651.0, 50.0)
    for field in fields(Reflectance) - {"name"}:
        one, other = getattr(found, field), getattr(made, field)
        if isinstance(other, Spectrum):
            np.testing.assert_allclose(one.at(waves), other.at(waves), rtol=1e-5)
        elif not isinstance(other, (str, type(None))):
            np.testing.assert_allclose(np.array(one), np.array(other), rtol=1e-6)


@pytest.mark.parametrize("name", OF_LIGHT)
def test_kernels_know_it(name):
    """The march on the device gives what the record does; both change with the field, as does what mode full takes."""
    first, changed = pair(name, "kernels")
    before, after = kernel_of(first), kernel_of(changed)
    np.testing.assert_allclose(after[0], weights_of(changed), rtol=2e-3, atol=1e-5)
    assert not np.allclose(before[0], after[0], rtol=1e-3) or before[1] != after[1]
    if ROWS[name].words not in (ROWS[key].words for key in ("body_colour", "interface_colour", "transmitted_colour")):
        assert repr(_figures(first)) != repr(_figures(changed))  # colours of mode full are on the palette


def directions():
    random = np.random.default_rng(5)
    vectors = random.normal(size=(3, 3, 11)) * 0.4 + np.array([0.0, 0.0, 1.0])[:, None]
    return [arrays().Array3f((one / np.linalg.norm(one, axis=0)).astype(np.float32)) for one in vectors]


def kernel_of(made):
    palette = palette_of([made], [], [LAMP.spectrum])
    weights = Materials([made], palette).weights(arrays().UInt(np.zeros(11, np.uint32)), *directions())
    return four(weights), repr(palette)


def weights_of(made):
    return four(made.weights(*directions()))


def four(weights):
    """Weights of body, interface and what passes through once and twice: (4, 11); what does not transmit has two."""
    rows = [np.array(one) + np.zeros(11) for one in weights]
    return np.array(rows + [np.zeros(11)] * (4 - len(rows)))


def measured(material):
    """A tilted plane of one material, photographed by a known camera under daylight."""
    response, day = hg.Response.load("canon_eos_300d"), Spectrum.named("D65")
    height, width = 7, 9
    camera = Camera(width, height, (30.0, 30.0), (4.5, 3.5), response=response)
    x, y = np.meshgrid(np.arange(width) - 4.0, np.arange(height) - 3.0)
    points = np.stack([x / 30.0, y / 30.0, np.ones_like(x)], axis=2)
    normals = np.stack([0.1 * x, 0.1 * y, -np.ones_like(x)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    values = np.full((height, width, 3), 0.2)
    lamp = Lamp(to_lamp=(0.3, 0.1, -1.0), spectrum=day, name="one")
    shot = Photograph(
        values, np.full_like(values, 1e-4, np.float32), np.ones((height, width), bool), camera, (lamp,), "one"
    )
    spectra = {material.name: material.body_spectrum(response, day)}
    return Measurement(
        (material,), np.zeros((height, width), int), (), (), normals.astype(np.float32), points, body_spectra=spectra,
        capture=Capture((shot,), "plane"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """Field of an estimate → of every form its output and what is said to be lost; "" is the first estimate."""
    made = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export_module, "LAMPS", 9)
        patch.setattr(export_module, "TESTED", 2)
        for name, few in {"INCIDENCES": 6, "PLACES": 8, "FINE": 256}.items():
            patch.setattr(rgl_out, name, few)
        patch.setattr(openmaterial, "EVERY_NM", 100.0)
        for name in ("", *LIT):
            material = FIRST if not name else replace(FIRST, **{name: OF_ESTIMATE[name]})
            made[name] = forms_of(measured(material), tmp_path_factory.mktemp(name or "first"))
    return made


def forms_of(measurement, folder):
    page = single_page(page_source(measurement, None), 10**6)
    data = dict(page.viewer.data)
    forms: dict[str, Any] = {"page": ((data, page.viewer.tiles), data.pop("assumptions"))}
    for form in EXPORTS:
        record = hg.export(measurement, [form], folder / form)["formats"][form]
        forms[form] = contents(folder / form, ("export.json",)), [record["lost"], *record["lost_of_materials"]]
    plate = MapsPlate(page_source(measurement, None).maps, measurement)
    shown = np.asarray(plate.linear("picture", PlateLight(), ViewTransform()))
    forms["viewer"] = shown.tolist(), [repr(measurement.materials)]
    return forms


@pytest.mark.parametrize("form", ["page", *EXPORTS, "viewer"])
@pytest.mark.parametrize("name", LIT)
def test_a_measured_object_carries_or_names(published, form, name):
    changed = replace(FIRST, **{name: OF_ESTIMATE[name]})
    if form == "viewer" and name == "element":
        pytest.skip("its pictures are those of the relightable images, which say that planes stand instead")
    if form == "csv" and not ROWS[name].is_lost(form, changed):
        assert name == "body_colour"
    assert_carried_or_named(form, name, published[""][form], published[name][form], changed)


@pytest.mark.parametrize("form", ["page", *EXPORTS])
def test_how_well_it_is_known_is_said_to_be_elsewhere(published, form):
    assert any(EVIDENCE in line for line in published[""][form][1])


@pytest.mark.parametrize("name", OF_ESTIMATE)
def test_the_file_of_materials_holds_it(tmp_path, name):
    material = replace(FIRST, **{name: OF_ESTIMATE[name]})
    write_materials([material], tmp_path / "materials.json")
    (again,) = read_materials(tmp_path / "materials.json")
    assert getattr(again, name) == getattr(material, name)
    if name in LIT:
        assert json.dumps(info(tmp_path / "materials.json")) != json.dumps(of_first(tmp_path)), "info is silent"
    if name in ("alpha", "beta", "gamma", "n", "nu", "lobes"):
        assert materials_html([material]) != materials_html([FIRST]) and repr(material) != repr(FIRST)


def of_first(folder):
    write_materials([FIRST], folder / "first" / "materials.json") if (folder / "first").mkdir() is None else None
    return info(folder / "first" / "materials.json")


def test_a_document_says_what_its_page_loses():
    cylinder = replace(FIRST, element="cylinder")
    text = document(single_page(page_source(measured(cylinder), None), 10**6).viewer)
    assert "the shape of its micro-elements (planes stand instead)" in text


@pytest.mark.parametrize("name", OF_LIGHT)
def test_an_edit_in_the_viewer_keeps_all_else(tmp_path, name):
    """A slider changes its own parameter: what it does not know stays as the scene has it."""
    _, made = pair(name, "usd")
    if made.element != "plane":
        made = replace(made, element="plane", clearness=0.0)
    tables = {
        "camera": {"size": [17, 13], "focal": [20.0, 20.0], "eye": [0.0, -1.0, 0.0]},
        "lamp": [{"to_lamp": [0.0, -1.0, 1.0]}],
        "surface": [{"shape": "sphere", "scale": 0.1, "reflectance": made.record()}],
    }
    (tmp_path / "scene.toml").write_text(toml_text(tables))
    desk: Any = open_desk(tmp_path / "scene.toml")
    before = desk.scene.surfaces[0].reflectance
    (control,) = (one for one in desk.controls(desk.state) if one.name == "surface 0 n")
    desk.edit(control.put(desk.state, 1.45), "n")
    after = desk.scene.surfaces[0].reflectance
    assert after.n == 1.45 and values(replace(after, n=before.n)) == values(before)
