"""An orthographic view: its rays are parallel, so that four balls in the corners of a picture are measured alike."""

import json

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.camera import camera as unplaced
from hagoromo.camera.camera import unplaced_camera
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.measurement.scale import has_scale
from tests.inverse.simulated_ball import BallMaterial, reflected

SIZE, SMALL, RADIUS, PLACES = 61, 33, 0.24, (-0.25, 0.25)  # px; in sides of the picture
FULL_WELL, READ_NOISE = 36_000.0, 4.0  # electrons
TO_EYE = (0.0, 0.0, 1.0)


def four_balls(size=SIZE):
    """Glossy balls as parallel rays see them, under twelve far lamps, and their normals (h, w, 3), 0 beside them."""
    camera, random = unplaced_camera(size, size, None), np.random.default_rng(0)
    row, column = (np.mgrid[:size, :size] + 0.5) / size - 0.5
    normals, mask = np.zeros((size, size, 3)), np.zeros((size, size), bool)
    for x, y in ((x, y) for x in PLACES for y in PLACES):
        right, up = (column - x) / RADIUS, (y - row) / RADIUS
        inside = right**2 + up**2 < 0.9
        ball = np.stack([right, up, np.sqrt(np.maximum(1.0 - right**2 - up**2, 0.0))], axis=2)
        normals[inside], mask = ball[inside], mask | inside
    photographs, seen = [], normals[mask]
    for azimuth, elevation in ((a, e) for a in np.radians([-45, -15, 15, 45]) for e in np.radians([-30, 10, 45])):
        lamp = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
        to_lamp, to_eye = (np.broadcast_to(one, seen.shape) for one in (lamp, TO_EYE))
        clean = np.zeros((size, size, 3))
        clean[mask] = np.maximum(reflected(seen, to_lamp, to_eye, BallMaterial((0.2, 0.15, 0.1), 0.5, 0.15, 1.5)), 0.0)
        scale = clean.max() / FULL_WELL
        electrons = random.poisson(clean / scale)
        variance = (electrons + READ_NOISE**2) * scale**2
        lamps = (hg.Lamp(to_lamp=lamp, intensity=1.0),)
        photographs.append(hg.Photograph(electrons * scale, variance, mask, camera, lamps, f"balls {len(photographs)}"))
    return hg.Capture(tuple(photographs), "balls"), normals, mask


def degrees_off():
    """Rms angle of the measured normals to the true ones, and the measured γ."""
    capture, normals, mask = four_balls()
    found = hg.measure(capture, facets="gaussian", interface="neutral")
    cosine = np.clip((found.normals * normals).sum(axis=2)[mask], -1.0, 1.0)
    return float(np.degrees(np.sqrt(np.mean(np.arccos(cosine) ** 2)))), found.materials[0].gamma


def test_rays_of_an_orthographic_view_are_parallel():
    camera = unplaced_camera(300, 200, None)
    off = np.degrees(np.arccos(np.clip(camera.pixel_directions() @ camera.world_to_camera[2, :3], -1.0, 1.0)))
    assert off.max() < 0.05
    assert np.allclose(camera.project([[-0.5, 0.0, 0.1], [0.5, 0.0, -0.1]]), [[0.0, 100.0], [300.0, 100.0]], atol=0.02)


def test_an_orthographic_view_has_the_scale_of_its_width_and_none_of_a_distance():
    """Its pinhole is a thousand widths long: a distance of 0.6 m would make the picture 0.6 mm wide."""
    capture, _, mask = four_balls(SMALL)
    with pytest.raises(InputError, match=r"a distance gives no scale: give .* \(--across\)"):
        hg.measure(capture, distance=0.6)
    with pytest.raises(InputError, match="state one of them"):
        hg.measure(capture, distance=0.6, across=0.3)
    found = hg.measure(capture, across=0.3, facets="gaussian", interface="neutral")
    assert found.points is not None and found.photographed_with is not None
    wide = np.ptp(found.points[mask & (found.labels >= 0)][:, 0])
    columns = np.ptp(np.flatnonzero((mask & (found.labels >= 0)).any(axis=0)))
    assert wide == pytest.approx(0.3 * columns / SMALL, rel=1e-3)
    assert has_scale(found, found.photographed_with)


@pytest.mark.nightly
def test_what_an_orthographic_view_measures_is_as_good_as_its_noise(monkeypatch):
    """A pinhole at 20 widths, as before, is off by 1.4° at a corner: normals 0.127° off in place of 0.114°."""
    parallel, gamma = degrees_off()
    monkeypatch.setattr(unplaced, "ORTHOGRAPHIC_FOCAL", 1e5)
    exact, _ = degrees_off()
    monkeypatch.setattr(unplaced, "ORTHOGRAPHIC_FOCAL", 20.0)
    near, gamma_near = degrees_off()
    assert abs(parallel - exact) < 0.01 * exact and near > 1.05 * exact
    assert abs(gamma - 0.15) < 0.5 * abs(gamma_near - 0.15)


@pytest.mark.nightly
def test_an_orthographic_view_is_relit_rendered_and_published(tmp_path):
    """By the commands, from the folder of the capture. The boxes of a lamp kept aside are as good as the fit's own
    forecast, the scene renders to the same picture, and the page of what was measured has its pixels.
    """
    hg.save_capture(four_balls(SMALL)[0], tmp_path / "balls")
    relit, page = tmp_path / "relit", tmp_path / "page.html"
    assert main(["relight", str(tmp_path / "balls"), "--hold", "balls 4", "--out", str(relit)]) == 0
    (record,) = json.loads((relit / "relit.json").read_text())
    errors = {key: figures["relative_rmse"] for key, figures in record["compared"].items()}
    assert errors["boxes"] < 1.1 * errors["normals"] and errors["boxes"] < 0.5 * errors["lambert"]
    assert main(["render", str(relit / "scene_00.toml"), "--out", str(tmp_path / "again.exr")]) == 0
    response = hg.Response.load(relit / "response_00.csv")
    again = hg.read_image(tmp_path / "again.exr").expose(response) / record["white"]
    shown = np.stack([read_exr(relit / "predicted_00.exr")[0][name] for name in "RGB"], axis=2)
    assert np.allclose(again, shown, atol=1e-4)
    assert main(["publish", str(relit / "measured"), "--out", str(page)]) == 0
    assert f'"width":{SMALL},' in page.read_text(encoding="utf-8")
