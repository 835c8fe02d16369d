"""Pictures in the viewer: what is developed is the image, its light changes without a march, and probes have bands."""

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.camera.response import Response, camera_white, srgb_from_camera
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.image import march_picture
from hagoromo.image.picture.image import Image
from hagoromo.image.picture.spectral_exr import SpectralPicture, write_spectral_exr
from hagoromo.image.render import render
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.colour import delta_e_2000, srgb_encode
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.inspection.profile import profile
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_page.publication.lit import reflected
from hagoromo_page.publication.publish import page_source
from hagoromo_page.viewer.development import metered
from hagoromo_page.viewer.heights_panel import END, HeightsPanel
from hagoromo_page.viewer.image_plate import ImagePlate
from hagoromo_page.viewer.maps_plate import OF_CURVATURE, OF_NORMALS, OF_SKY, OF_STRETCH, MapsPlate
from hagoromo_page.viewer.open_desk import open_desk
from hagoromo_page.viewer.photographs import as_bright
from hagoromo_page.viewer.picture_desk import PictureDesk
from hagoromo_page.viewer.plates import LARGEST_NOISE, NOISE_LAYER, PlateLight
from hagoromo_page.viewer.probe import WAVELENGTHS, plain
from hagoromo_page.viewer.view_state import ViewTransform
from tests.app.published_ball import ball
from tests.ball_scene import ball_scene
from tests.inverse.simulated_relief import SimulatedRelief, relief_camera, relief_measurement

DAY, BULB = Spectrum.named("D65"), Spectrum.named("A")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A rendered image in image.exr, and its scene."""
    folder = tmp_path_factory.mktemp("pictures")
    (folder / "scene.toml").write_text(ball_scene(size=(31, 23), focal=45.0))
    scene, _ = load_scene(folder / "scene.toml")
    render(scene, Settings(separate_lamps=True)).save(folder / "image.exr")
    return folder


def set_to(desk, **values):
    """Set controls by their labels, as the panel does."""
    for label, value in values.items():
        (control,) = [
            one for one in desk.controls(desk.history.now) if one.label.split(" [")[0].replace(" ", "_") == label
        ]
        desk.edit(control.put(desk.state, value), label)


def lamp_set_to(desk, number, key, value):
    (control,) = [
        one for one in desk.controls(desk.state) if one.folder.startswith(f"Lamp {number}") and one.name.endswith(key)
    ]
    desk.edit(control.put(desk.state, value), key)


def test_an_image_is_lit_and_seen_anew_without_a_march(folder, monkeypatch):
    scene, _ = load_scene(folder / "scene.toml")
    desk = open_desk(folder / "image.exr")
    assert isinstance(desk, PictureDesk)
    watcher = desk.watcher()
    shown = watcher.next()
    assert shown is not None and watcher.next() is None
    image = render(scene, Settings(separate_lamps=True))
    assert np.array_equal(shown.picture, image.display()), "it is not the picture that render writes"
    monkeypatch.setattr(march_picture, "PreparedScene", None)
    lamp_set_to(desk, 1, "stops", 1.0)
    lamp_set_to(desk, 2, "spectra", "A")
    set_to(desk, camera_response="Nikon 5100 (NPL)")
    changed = watcher.next()
    camera = Response.load("Nikon 5100 (NPL)")
    truth = image.with_lamps({0: 2.0}, {1: BULB})
    linear = truth.expose(camera) @ srgb_from_camera(camera, truth.palette.lamps[0]).T
    factor = desk.factors["image.exr", "picture"]
    assert changed is not None and np.abs(changed.picture.astype(int) - srgb_encode(linear * factor)).max() <= 1
    assert np.isclose(factor, metered(image, ViewTransform(), None))
    assert [desk.undo() for _ in range(4)] == ["camera_response", "spectra", "stops", None]
    again = watcher.next()
    assert again is not None and np.array_equal(again.picture, shown.picture)


def test_a_spectral_image_of_any_program_is_probed_lit_and_seen(tmp_path):
    """Its values come back at their wavelengths; under another lamp its colours are those of the spectra."""
    waves = np.arange(400.0, 701.0, 20.0)
    values = np.random.default_rng(1).uniform(0.1, 0.9, (3, 4, len(waves))).astype(np.float32)
    write_spectral_exr(tmp_path / "patches.exr", SpectralPicture(values, waves, False))
    desk = open_desk(tmp_path / "patches.exr")
    assert isinstance(desk, PictureDesk)
    found = desk.watcher().probe(0.6, 0.5)  # of column 2, row 1
    assert found is not None and (found.column, found.row) == (2, 1)
    at = np.isin(WAVELENGTHS, waves)
    assert np.allclose(found.values[at], values[1, 2], atol=1e-6)
    lamp_set_to(desk, 1, "spectra", "A")
    plate = desk.plate
    observer = Response.load("cie1931")
    inside = Spectrum(waves, values[1, 2])
    curves = observer.values * BULB.at(observer.wavelengths)[:, None]
    xyz = np.trapezoid(np.interp(observer.wavelengths, waves, values[1, 2], 0.0, 0.0)[:, None] * curves, dx=1.0, axis=0)
    linear = plate.linear("picture", desk.state.light(), desk.state.development)
    assert linear is not None
    white = np.trapezoid(curves, dx=1.0, axis=0)
    from hagoromo.camera.response import WHITE_XYZ
    from hagoromo.light.colour import srgb_from_xyz

    assert inside.values.shape == waves.shape
    assert delta_e_2000(linear[1, 2], srgb_from_xyz(xyz / white * WHITE_XYZ)) < 0.2  # sums of steps of 1 nm
    assert not open_desk_of_light(tmp_path, waves, values).plate.lamps, "light itself has no lamp to change"


def open_desk_of_light(folder, waves, values):
    write_spectral_exr(folder / "light.exr", SpectralPicture(values, waves, True))
    desk = open_desk(folder / "light.exr")
    assert isinstance(desk, PictureDesk)
    return desk


def test_the_noise_of_a_picture_is_a_layer_and_the_band_of_its_probe(folder):
    scene, _ = load_scene(folder / "scene.toml")
    image = render(scene, Settings(samples=8), mode="path")
    assert image.variance is not None
    plate = ImagePlate(image)
    assert NOISE_LAYER in plate.layers
    bright = image.xyz()[..., 1]
    row, column = np.unravel_index(np.argmax(bright), bright.shape)
    noise = float(np.sqrt(image.variance[row, column]) / bright[row, column])
    found = plate.probe((column + 0.5) / 31, (row + 0.5) / 23, PlateLight())
    assert found.low is not None and found.high is not None
    assert np.allclose(found.high - found.low, 2 * 1.96 * noise * found.values)
    import matplotlib

    wanted = matplotlib.colormaps["inferno"](min(noise / LARGEST_NOISE, 1.0), bytes=True)[:3]
    assert np.abs(plate.coded(NOISE_LAYER)[row, column].astype(int) - wanted).max() <= 1


def test_a_photograph_is_looked_at_near_and_its_spectrum_has_a_band_that_holds_the_truth(photographed):
    desk = open_desk(photographed)
    assert isinstance(desk, PictureDesk)
    watcher = desk.watcher()
    assert watcher.seen == (slice(0, 47), slice(0, 61))
    camera = desk.camera
    watcher.look_from(camera.look_at((0.1, -0.5, 0.0), (0.1, 0.0, 0.0)).world_to_camera)
    assert watcher.seen == (slice(12, 36), slice(22, 52))  # half of it, 0.1 of its width to the right of the middle
    shown = watcher.next()
    assert shown is not None and shown.picture.shape == (24, 30, 3)
    watcher.look_from(camera.look_at((0.0, -2.0, 0.0), (0.0, 0.0, 0.0)).world_to_camera)
    assert watcher.seen == (slice(0, 47), slice(0, 61)), "from afar it is whole"
    found = watcher.probe(0.5, 0.5)
    assert found is not None and found.low is not None and found.high is not None
    middle = (WAVELENGTHS >= 450) & (WAVELENGTHS <= 650)
    grey = found.values[middle].mean()
    assert (found.low[middle] <= grey).all() and (grey <= found.high[middle]).all(), "the ball is grey"
    assert (found.high - found.low)[middle].max() < 0.5 * grey
    (photograph,) = [desk.plate]
    assert photograph.layers == ("picture", NOISE_LAYER, "valid")
    set_to(desk, photograph="2 0001")
    assert desk.plate is not photograph


def test_a_measurement_is_lit_by_its_reflectance_and_shows_its_uncertainty(tmp_path):
    _, measurement = ball(response=Response.load("canon_eos_300d"), spectrum=DAY)
    waves = np.arange(400.0, 701.0, 10.0)
    known_body = SpectrumEstimate(waves, waves / 550.0, 0.01**2 * np.eye(len(waves)), {}, {})
    measurement = replace(measurement, body_spectra={"material 0": known_body})
    measurement.save(tmp_path / "measured")
    desk = open_desk(tmp_path / "measured")
    assert isinstance(desk, PictureDesk)
    plate, maps = desk.plate, page_source(measurement, None).maps
    x, y = 0.3, 0.4
    values = reflected(maps, np.array([x, y, np.sqrt(1 - x * x - y * y)]))
    response = Response.load("canon_eos_300d")
    matrix = srgb_from_camera(response, DAY) * camera_white(DAY, response)
    linear = plate.linear("picture", PlateLight(towards=(x, y)), ViewTransform())
    assert linear is not None
    factor = as_bright(linear, values @ matrix.T)[1]
    assert np.isclose(factor, 1.0, rtol=1e-4)
    assert np.allclose(linear, values @ matrix.T, atol=1e-3)
    shown = plate.coded(OF_NORMALS)
    known = maps.known
    assert (shown[~known] == 64).all() and len(np.unique(shown[known], axis=0)) == 1  # 0.57° everywhere
    found = plate.probe(0.4, 0.5, PlateLight())
    assert "normal ± 1.12° (95 %)" in found.said and "β" in " ".join(found.said)
    share = np.pi * maps.body[found.row, found.column].mean()
    middle = WAVELENGTHS == 550.0
    assert found.low is not None and found.high is not None
    assert np.allclose(found.values[middle], share) and np.isnan(found.values[0])
    assert np.allclose((found.high - found.low)[middle], 2 * 1.96 * 0.01 * share)
    assert plate.probe(0.6, 0.5, PlateLight()).low is None, "the other material has no spectrum"
    assert {"body", "normals", "material", "depth", "γ roughness"} <= set(plate.layers)
    for layer in (OF_CURVATURE, OF_SKY):
        assert layer in plate.layers and len(np.unique(plate.coded(layer)[known], axis=0)) > 1
    assert OF_STRETCH not in plate.layers, "its colours differ in one way alone"
    assert any(one.startswith("curvature") for one in found.said)


def test_a_part_of_a_measurement_has_the_stretched_colours_of_the_whole():
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1)
    source = page_source(measurement, None, closely=True)
    plate = MapsPlate(source.maps, measurement, source.look)
    part = plate.part(slice(10, 20), slice(10, 20), (10, 10))
    assert np.array_equal(part.coded(OF_STRETCH), plate.coded(OF_STRETCH)[10:20, 10:20])
    assert part.coded(OF_CURVATURE).shape == (10, 10, 3)


def test_two_clicks_give_the_heights_of_the_program():
    """Of a measurement that is cropped to its object: the same line, heights and band as `hagoromo profile`."""
    pytest.importorskip("viser", reason="viser is not installed")
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(48), 1)
    source = page_source(measurement, None, closely=True)
    plate = MapsPlate(source.maps, measurement, source.look)
    gui = MagicMock()
    panel = HeightsPanel(SimpleNamespace(gui=gui), plate, lambda act, read: act)
    clicks = [plate.probe(x, y, PlateLight()) for x, y in ((0.2, 0.3), (0.8, 0.7), (0.5, 0.5))]
    panel.clicked(clicks[0])
    assert panel.start is None and panel.found is None, "clicks are for the probe alone"
    panel.switch(True)
    panel.clicked(clicks[0])
    assert panel.said.content == END and panel.found is None
    panel.clicked(clicks[1])
    places = [(one.column + 0.5 + source.maps.x, one.row + 0.5 + source.maps.y) for one in clicks[:2]]
    known = profile(measurement, *places)
    assert panel.found is not None and plain(known.sentence) in panel.said.content
    np.testing.assert_array_equal(panel.found.height, known.height)
    np.testing.assert_array_equal(panel.found.error, known.error)
    data = gui.add_uplot.call_args.args[0]
    for column, wanted in zip(data, (known.distance, known.height, *known.band_95), strict=True):
        np.testing.assert_array_equal(column, wanted[known.known])
    panel.clicked(clicks[2])
    with pytest.raises(InputError, match="px long"):
        panel.clicked(clicks[2])
    assert panel.start is None, "the next click begins anew"


@pytest.mark.parametrize("name", ["{globalThis.x = 1}", "<img src=x onerror=y>", "*a* _b_ `c` [d](e) $f$ \\g"])
def test_a_name_is_no_markup(name):
    """Of CommonMark, nor of MDX, whose braces hold programs: every mark has a backslash before it."""
    text = plain(name)
    marks = [k for k, one in enumerate(text) if one in "{}<>*_`[]()$"]
    assert marks and all(text[k - 1] == "\\" for k in marks)


def test_an_exr_of_colours_alone_and_photographs_to_hold_a_picture_against_are_refused(
    tmp_path, refused, folder, scene
):
    write_exr(tmp_path / "plain.exr", {name: np.zeros((3, 4), np.float32) for name in "RGB"})
    assert "neither weights nor spectra" in refused("view", tmp_path / "plain.exr")
    assert "is no scene" in refused("view", folder / "image.exr", "--against", scene())
    (tmp_path / "empty.exr").write_bytes(b"v/1\x01")
    refused("view", tmp_path / "empty.exr")


def test_a_picture_is_saved_beside_what_was_opened_and_nothing_is_overwritten(folder):
    desk = open_desk(folder / "image.exr")
    assert isinstance(desk, PictureDesk) and isinstance(desk.plate, ImagePlate) and isinstance(desk.plate.image, Image)
    assert [desk.save().name for _ in range(2)] == ["image-view1.png", "image-view2.png"]
    assert main(["compare", str(folder / "image-view1.png"), str(folder / "image.png")]) == 0
