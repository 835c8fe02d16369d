"""Tables of RGL that are written: Mitsuba's values are those of the reflectance, and a fit of them gives it back."""

import json
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.format import format_of
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_formats.reflectances.rgl import read_rgl
from hagoromo_formats.reflectances.rgl_out import write_rgl
from tests.app.published_ball import ball
from tests.oracle.reflection import plane

WAVELENGTHS = np.arange(380.0, 781.0, 50.0)
BODY = hg.Spectrum(WAVELENGTHS, 0.8 + 0.4 * np.sin(WAVELENGTHS / 70.0))
RAMP = hg.Spectrum(WAVELENGTHS, np.linspace(0.6, 1.2, WAVELENGTHS.size))
MATERIALS = {
    "paint": hg.Reflectance(0.13, 1.3, 0.19, 1.48, BODY),
    "silk": hg.Reflectance(0.1, 0.5, 0.05, 1.5, BODY, RAMP),
    "tails": hg.Reflectance(0.05, 1.0, 0.05, 1.7, BODY, nu=1.5, epsilon=0.2, sigma=0.3),
    "lobes": hg.Reflectance(0.1, 0.9, 0.12, 1.5, BODY, lobes=((4.0, 0.03), (0.2, 0.4))),
    "chalk": hg.Reflectance.matte(0.15, BODY),
}
UP = np.array([0.0, 0.0, 1.0])


def directions(count: int, farthest: float, random: np.random.Generator) -> np.ndarray:
    """Even over the cap of directions up to `farthest` [°] from the normal."""
    cosine, turn = random.uniform(np.cos(np.radians(farthest)), 1.0, count), random.uniform(0.0, 2.0 * np.pi, count)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], 1)


def mirrored(lamp: np.ndarray, width: float, random: np.random.Generator) -> np.ndarray:
    """Directions whose half vectors lie within some `width` of the normal."""
    angle, turn = np.abs(random.normal(0.0, 1.5 * width, len(lamp))), random.uniform(0.0, 2.0 * np.pi, len(lamp))
    half = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], 1)
    return 2.0 * (lamp * half).sum(1)[:, None] * half - lamp


@pytest.fixture
def spectral():
    """Mitsuba in its spectral variant, and as it was afterwards."""
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("llvm_ad_spectral")
    yield mi
    if before is not None:
        mi.set_variant(before)


def seen(mi, path, lamp, eye, wavelengths) -> np.ndarray:
    """f cosθ_o (N, W) by Mitsuba's plugin, with wi to the lamp."""
    plugin = mi.load_dict({"type": "measured", "filename": str(path)})
    at = dr.zeros(mi.SurfaceInteraction3f, len(lamp))
    at.wi = mi.Vector3f(*lamp.T.astype(np.float32))
    at.wavelengths = mi.Spectrum(*map(float, wavelengths))
    return np.array(plugin.eval(mi.BSDFContext(), at, mi.Vector3f(*eye.T.astype(np.float32)))).T


@pytest.mark.by_night("paint", "silk", "chalk")
@pytest.mark.parametrize("name", MATERIALS)
def test_mitsuba_evaluates_the_table_as_the_closed_form(tmp_path, spectral, name):
    """Oracle: the written-out formula in float64. Tolerance: the figures in the docstring of `write_rgl`."""
    made, random, asked = MATERIALS[name], np.random.default_rng(7), (440.0, 500.0, 560.0, 640.0)
    write_rgl(tmp_path / "a.bsdf", made, WAVELENGTHS)
    lamp = directions(20_000, 80.0, random)
    for eye in (directions(20_000, 80.0, random), mirrored(lamp, made.gamma, random)):
        near = eye[:, 2] > np.cos(np.radians(80.0))
        found = seen(spectral, tmp_path / "a.bsdf", lamp[near], eye[near], asked)
        if name == "tails":
            exact = made.evaluate(UP, eye[near], lamp[near], asked)
        else:
            body, gloss = plane(made, np.broadcast_to(UP, (near.sum(), 3)), eye[near], lamp[near])
            gloss = gloss + sum(
                plane(replace(made, beta=beta, gamma=gamma, lobes=()), np.broadcast_to(UP, (near.sum(), 3)), eye[near],
                      lamp[near])[1]
                for beta, gamma in made.lobes
            )  # fmt: skip
            exact = body[:, None] * BODY.at(np.array(asked)) + gloss[:, None] * made.interface_colour.at(
                np.array(asked)
            )
        error = np.abs(found / exact - 1.0).max(axis=1)
        figures = np.median(error), np.quantile(error, 0.99), error.max()
        assert figures[0] < 0.0025 and figures[1] < 0.07 and figures[2] < 0.6, figures


@pytest.mark.nightly
@pytest.mark.parametrize("field", ["spectra", "rgb"])
def test_a_fit_of_the_written_table_gives_the_parameters_back(tmp_path, field):
    """To half a per cent: what readers interpolate is off in one sense where values curve, which noise would not be."""
    made = MATERIALS["paint"]
    wavelengths = WAVELENGTHS if field == "spectra" else np.array([400.0, 500.0, 600.0])
    path = tmp_path / "paint.bsdf"
    write_rgl(path, made, wavelengths, field)
    assert format_of(path).name == "RGL BRDF"
    table = read_rgl(path)
    material = table.with_relative_error(0.01).fit()
    read = wavelengths if field == "rgb" else np.array([float(name.split()[0]) for name in table.channels])
    alpha = made.alpha * BODY.at(read).mean()
    for name, true in {"alpha": alpha, "beta": 1.3, "gamma": 0.19, "n": 1.48}.items():
        assert getattr(material, name) == pytest.approx(true, rel=0.005), name


def ball_picture(mi, bsdf):
    scene = {
        "type": "scene", "integrator": {"type": "direct", "emitter_samples": 16, "bsdf_samples": 16},
        "ball": {"type": "sphere", "bsdf": bsdf},
        "lamp": {"type": "sphere", "center": [2.0, 3.0, 4.0], "radius": 1.0,
                 "emitter": {"type": "area", "radiance": {"type": "uniform", "value": 10.0}}},
        "sky": {"type": "constant", "radiance": {"type": "uniform", "value": 0.3}},
        "camera": {"type": "perspective", "fov": 30.0,
                   "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                   "film": {"type": "hdrfilm", "width": 48, "height": 48, "rfilter": {"type": "box"}}},
    }  # fmt: skip
    return np.array(mi.render(mi.load_dict(scene), spp=64, seed=3))[:, :, :3]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["paint", "tails"])
def test_a_ball_by_the_table_is_that_of_our_own_bsdf(tmp_path, spectral, name):
    """Mitsuba renders both, with the importance sampling of each: a sampler that did not fit its values would show."""
    import hagoromo_formats.mitsuba as hm

    made = MATERIALS[name]
    write_rgl(tmp_path / "a.bsdf", made, WAVELENGTHS)
    table = ball_picture(spectral, {"type": "measured", "filename": str(tmp_path / "a.bsdf")})
    ours = ball_picture(spectral, hm.bsdf(made))
    blocks = [picture.reshape(12, 4, 12, 4, 3).mean(axis=(1, 3)) for picture in (table, ours)]
    ball_there = np.abs(blocks[1] - blocks[1][0, 0]).max(axis=2) > 1e-6
    ratio = blocks[0][ball_there] / blocks[1][ball_there]
    print(name, table.mean() / ours.mean(), ratio.min(), ratio.max(), np.abs(ratio - 1).mean())
    assert table.mean() == pytest.approx(ours.mean(), rel=5e-3)
    assert np.abs(ratio - 1.0).mean() < 0.01


def spectrum() -> SpectrumEstimate:
    wavelengths = np.arange(380.0, 781.0, 10.0)
    return SpectrumEstimate(wavelengths, BODY.at(wavelengths), 1e-4 * np.eye(41) + 1e-5, {}, {})


def test_materials_are_exported_with_their_covariance(tmp_path, capsys):
    _, measured = ball()
    measured = replace(measured, body_spectra={measured.materials[0].name: spectrum()})
    record = hg.export(measured, ["rgl"], tmp_path / "out")["formats"]["rgl"]
    first, second = record["files"]
    assert first.endswith("_spec.bsdf") and second.endswith("_rgb.bsdf")
    assert any("its spectrum, which is not known" in line for line in record["lost_of_materials"])
    assert len(read_rgl(tmp_path / "out" / first).channels) == 16
    assert read_rgl(tmp_path / "out" / second).channels == ("R", "G", "B")
    known = json.loads((tmp_path / "out" / "covariance.json").read_text())["materials"]
    assert [one["file"] for one in known] == record["files"]
    material = measured.materials[0]
    assert known[0]["parameters"] == ["alpha", "beta", "gamma", "n"] and known[0]["units"] == [
        "1/sr",
        "1/sr",
        "rad",
        "",
    ]
    expected = np.array(material.correlation) * 0.01**2
    np.testing.assert_allclose(known[0]["covariance"], expected)
    np.testing.assert_allclose(
        known[0]["body_spectrum"]["covariance"], material.alpha**2 * spectrum().covariance, rtol=1e-12
    )
    assert "body_spectrum" not in known[1] and known[1]["standard_error"]["nu"] == 0.01


def test_a_file_of_materials_is_exported_without_a_surface(tmp_path, capsys):
    """Also of a fit whose light adds up to 1.02 at grazing angles, as fits are free to."""
    _, measured = ball()
    hg.write_materials(measured.materials, tmp_path / "materials.json")
    given = [
        "export",
        str(tmp_path / "materials.json"),
        "--to",
        "rgl",
        "materialx",
        "png",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(given) == 2
    said = capsys.readouterr()
    assert "png: a file of materials has no surface" in said.err and said.err.count("\n") == 1
    assert {path.suffix for path in (tmp_path / "out").glob("[a-z]*")} == {".bsdf", ".json", ".mtlx"}
