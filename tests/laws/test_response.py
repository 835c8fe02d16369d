"""Eq. 10 against direct integration; names, files and the stand-in for the EOS 300D."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import hagoromo as hg
from hagoromo.camera.response import Response, camera_response, camera_white, response_matrix, srgb_from_camera
from hagoromo.errors import InputError
from hagoromo.files import checks, table
from hagoromo.files.table import read_table
from hagoromo.light.spectrum import Spectrum
from tests.data import DATA, real_data

MEASURED = "camera_sensitivities/canon_eos_300d.csv"
RANDOM = np.random.default_rng(11)


def spectrum(knots: int, start: float, end: float) -> Spectrum:
    inner = np.sort(RANDOM.uniform(start, end, knots - 2))
    return Spectrum([start, *inner, end], RANDOM.uniform(0.1, 1.0, knots))


def response() -> Response:
    return Response(np.arange(390.0, 721.0, 11.0), RANDOM.uniform(0.0, 1.0, (31, 5)), ("a", "b", "c", "d", "e"))


@pytest.mark.parametrize(("lo", "hi"), [(400.0, 700.0), (360.0, 830.0), (512.3, 541.7)])
def test_eq_10_is_the_direct_integral(lo, hi):
    """Knots of all three curves unlike each other, some inside the limits only; to 1e-9, the promise of `quad`."""
    surface, lamp, curves = spectrum(13, 380.0, 730.0), spectrum(7, 420.0, 760.0), response()
    ours = camera_response(surface, lamp, curves, lo, hi)
    for channel in range(5):
        curve = curves.curve(channel)
        ends = [max(lo, 420.0), min(hi, 720.0)]
        knots = np.concatenate([surface.wavelengths, lamp.wavelengths, curve.wavelengths])
        pieces = [ends[0], *np.unique(knots[(knots > ends[0]) & (knots < ends[1])]), ends[1]]
        theirs = sum(
            quad(lambda nm, c=curve: float(surface.at(nm) * lamp.at(nm) * c.at(nm)), a, b)[0]
            for a, b in pairwise(pieces)
        )
        assert ours[channel] == pytest.approx(theirs, rel=1e-9)


def test_eq_10_takes_400_to_700_nm_where_nothing_is_said():
    """Constant 2 · 3 · 0.5 over 300 nm."""
    flat = Response([300.0, 900.0], [[0.5], [0.5]], ("grey",))
    assert camera_response(Spectrum.constant(2.0), Spectrum.constant(3.0), flat)[0] == pytest.approx(900.0, rel=1e-12)


def test_the_matrix_of_bases_reads_their_sum():
    bases, lamp, curves = [spectrum(k, 380.0, 730.0) for k in (3, 5, 7)], Spectrum.named("A"), response()
    matrix = response_matrix(bases, lamp, curves)
    assert matrix.shape == (5, 3)
    knots = np.unique(np.concatenate([basis.wavelengths for basis in bases]))
    total = Spectrum(knots, sum(b * basis.at(knots) for b, basis in zip((0.2, 0.5, 0.3), bases, strict=True)))
    np.testing.assert_allclose(matrix @ (0.2, 0.5, 0.3), camera_response(total, lamp, curves), rtol=1e-12)


def test_white_is_the_reading_of_a_surface_that_reflects_all():
    lamp, curves = Spectrum.named("FL2"), response()
    np.testing.assert_allclose(
        camera_white(lamp, curves), camera_response(Spectrum.constant(1.0), lamp, curves), rtol=1e-12
    )


def table_xyz(reflectance: np.ndarray, lamp: Spectrum) -> np.ndarray:
    """XYZ relative to Y = 1 of white, the sum at 1 nm over 360–830 nm that CIE 15 defines; reflectance: at each."""
    import colour

    nm = np.arange(360.0, 831.0)
    weights = lamp.at(nm)[:, None] * colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].values
    return reflectance @ weights / weights[:, 1].sum()


@pytest.mark.parametrize("name", ["A", "D65", "E", "FL2"])
@pytest.mark.parametrize("ends", [(360.0, 830.0), (400.0, 700.0)])
def test_xyz_is_the_sum_over_360_to_830_nm(name, ends):
    """Steep reflectances, dark at one end, known as far as `ends` and held beyond, as CIE 15 recommends.

    3e-4 of each: sums at 1 nm differ from integrals by that much. A cut to 400–700 nm is off by more.
    """
    lamp, observer, nm = Spectrum.named(name), Response.load("cie1931"), np.arange(360.0, 831.0)
    for edge, way in ((620.0, 0.02), (480.0, -0.03), (560.0, 0.004)):
        knots = np.arange(ends[0], ends[1] + 1.0, 10.0)
        surface = Spectrum(knots, 1.0 / (1.0 + np.exp(-way * (knots - edge))))
        ours = camera_response(surface, lamp, observer) / camera_white(lamp, observer)[1]
        theirs = table_xyz(np.interp(nm, knots, surface.values), lamp)
        np.testing.assert_allclose(ours, theirs, rtol=3e-4)
        cut = camera_response(surface, lamp, observer, 400.0, 700.0) / camera_white(lamp, observer, 400.0, 700.0)[1]
        assert name == "FL2" or np.abs(cut / theirs - 1.0).max() > 3e-4  # FL2 has little light beyond


@pytest.mark.parametrize("name", ["A", "D65"])
def test_colours_of_images_and_their_differences_are_those_of_the_whole_range(name):
    """Two matte patches under a far lamp: XYZ of the pixels to 3e-4; ΔE00 between them to 0.02 of about 30."""
    lamp, nm = Spectrum.named(name), np.arange(360.0, 831.0)
    values = [1.0 / (1.0 + np.exp(-0.03 * (nm - edge))) for edge in (640.0, 600.0)]
    seen = []
    for body in values:
        matte = hg.Reflectance(0.9 / np.pi, 0.0, 0.2, 1.5, Spectrum(nm, body))
        camera = hg.Camera(2, 3, (9.0, 9.0), (1.0, 1.5)).look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        sun = hg.Lamp(to_lamp=(0.0, 0.0, 1.0), intensity=np.pi, spectrum=lamp)
        seen.append(hg.render(hg.Scene(camera, (sun,), surfaces=(hg.Surface.floor(0.0, 1.0, matte),))))
    theirs = [0.9 * table_xyz(body, lamp) for body in values]
    for image, xyz in zip(seen, theirs, strict=True):
        np.testing.assert_allclose(image.xyz()[1, 1], xyz, rtol=3e-4)
    white = np.array([0.95047, 1.0, 1.08883]) / table_xyz(np.ones_like(nm), lamp)
    expected = hg.delta_e_2000(*(hg.srgb_from_xyz(xyz * white) for xyz in theirs))
    ours = hg.delta_e_2000(*(image.linear_srgb()[1, 1] for image in seen))
    assert ours == pytest.approx(float(expected), abs=0.02)


def test_the_limits_of_a_response_go_with_it(tmp_path):
    """By hand: 2 · 3 · 0.5 over 200 nm beyond the visible; the file of a camera states other limits than 400–700 nm."""
    band = Response([700.0, 1000.0], [[0.5], [0.5]], ("ir",), "ir")
    lamp = Spectrum([600.0, 900.0], [3.0, 3.0])
    assert camera_response(Spectrum.constant(2.0), lamp, band)[0] == 0.0
    wide = band.with_limits(700.0, 1000.0)
    assert camera_response(Spectrum.constant(2.0), lamp, wide)[0] == pytest.approx(600.0, rel=1e-12)
    for response in (band, wide):
        assert Response.load(response.save(tmp_path / "ir.csv", force=True)).limits == response.limits
    observer = Response.load("cie1931")
    assert Response.load(observer.save(tmp_path / "cie.csv")).limits == observer.limits == (360.0, 830.0)
    for limits in ((700.0, 400.0), (400.0, np.inf)):
        with pytest.raises(InputError, match="limits of a response"):
            band.with_limits(*limits)


def test_cie_1931_gives_the_white_point_of_d65():
    """x = 0.31271, y = 0.32902 (CIE 15); the sum at 1 nm in the standard differs from the integral by under 1e-4."""
    xyz = camera_white(Spectrum.named("D65"), Response.load("cie1931"), 360.0, 830.0)
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), (0.31271, 0.32902), atol=1e-4)


@real_data(MEASURED)  # which may not be copied into the repository
def test_the_stand_in_for_the_eos_300d_follows_its_measurement():
    """Correlation above 0.997 (R), 0.998 (G) and 0.999 (B); each within 0.06 of a curve whose peak is 1."""
    table, own = read_table(DATA / MEASURED), Response.load("canon_eos_300d")
    for channel, (name, least) in enumerate({"R": 0.997, "G": 0.998, "B": 0.999}.items()):
        values = own.curve(channel).at(table["wavelength_nm"])
        assert np.corrcoef(values, table[name])[0, 1] > least
        assert np.abs(values - table[name]).max() < 0.06


def test_measured_cameras_load_by_name():
    nikon = Response.load("Nikon 5100 (NPL)")
    assert nikon.channels == ("R", "G", "B") and nikon.values.max() == 1.0
    assert [int(nikon.wavelengths[i]) for i in nikon.values.argmax(axis=0)] == [595, 530, 460]


def test_a_response_reads_from_any_table_with_wavelengths(tmp_path):
    path = tmp_path / "five_bands.csv"
    path.write_text("wavelength_nm,green\n400,0.1\n500,1.0\n700,0.0\n")
    read = Response.load(path)
    assert read.channels == ("green",) and read.name == "five_bands"
    np.testing.assert_array_equal(read.curve(0).at([400.0, 450.0, 800.0]), [0.1, 0.55, 0.0])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_table_with_limits_is_read_once(tmp_path, monkeypatch, end):
    """Its first line was read from the file once more, which may then be another one."""
    path, opened, read = tmp_path / "near.csv", [], checks.read_bytes
    lines = "# limits_nm = 650, 1000.5", "wavelength_nm,near", "600,0.1", "700,1.0", "1000,0.0", ""
    path.write_bytes(end.join(lines).encode())

    def counted(*args):
        opened.append(args)
        return read(*args)

    for module in (checks, table):
        monkeypatch.setattr(module, "read_bytes", counted)
    assert Response.load(path).limits == (650.0, 1000.5) and len(opened) == 1


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("wavelength_nm\n400\n500\n", "one column per channel"),
        ("wavelength_nm,R\n500,1\n400,1\n", "must increase"),
        ("wavelength_nm,R\n500,1\n600,x\n", "not a finite number"),
        (None, "does not exist"),
    ],
)
def test_a_bad_response_file_is_refused_in_one_line(tmp_path, table, message):
    path = tmp_path / "a.csv"
    if table is not None:
        path.write_text(table)
    with pytest.raises(InputError, match=message) as refused:
        Response.load(path)
    assert "a.csv" in str(refused.value) and "\n" not in str(refused.value)


def test_an_unknown_camera_is_told_the_known_ones():
    with pytest.raises(InputError, match=r"canon_eos_300d.*Nikon 5100 \(NPL\)"):
        Response.load("canon")
    with pytest.raises(InputError, match="name each column"):
        Response([400.0, 500.0], np.ones((2, 2)), ("R", "G", "B"))


def test_a_channel_that_reads_no_light_is_refused():
    """The picture had no finite number."""
    blind = Response([400.0, 700.0], [[1.0, 0.0, 1.0], [1.0, 0.0, 0.0]], name="blind")
    with pytest.raises(InputError, match="channel G has no response to this lamp"):
        srgb_from_camera(blind, Spectrum.named("A"))
