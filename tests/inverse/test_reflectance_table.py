"""A material of a measured BRDF: the truth lies in its intervals, whatever file the values come from."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.format import format_of
from hagoromo_formats.reflectances.merl import directions, read_merl
from studies.goniometer import goniometer
from studies.tables import table_rows, write_merl
from tests.oracle.reflection import fresnel, plane

NOISE = 0.01  # relative
TRUE = {"alpha": 0.13, "beta": 1.3, "gamma": 0.19, "n": 1.48}
BODY = np.array([1.5, 1.0, 0.5])  # mean 1, as a material states it


def brdf(to_lamp: np.ndarray, to_eye: np.ndarray) -> np.ndarray:
    """(N, 3): f of the oracle in float64, which has none of the fit's code, over the cosine of the incidence."""
    alpha, beta, gamma, n = TRUE.values()
    material = hg.Reflectance(alpha, beta, gamma, n, hg.Spectrum.constant(0.5))
    body, interface = plane(material, np.broadcast_to([0.0, 0.0, 1.0], to_lamp.shape), to_lamp, to_eye)
    return (body[:, None] * BODY + interface[:, None]) / to_lamp[:, 2:]


@pytest.fixture(scope="module")
def table() -> hg.ReflectanceTable:
    lamp, eye = goniometer()
    clean = brdf(lamp, eye)
    values = clean * (1.0 + NOISE * np.random.default_rng(7).standard_normal(clean.shape))
    return hg.ReflectanceTable(lamp, eye, values, (NOISE * clean) ** 2, ("R", "G", "B"))


def holds_the_truth(material: hg.MaterialEstimate) -> None:
    assert all(material.identifiable[name] for name in TRUE)
    for name, true in TRUE.items():
        low, high = material.interval_95[name]
        assert low <= true <= high and high - low < 0.2 * true, name


def test_the_truth_of_a_table_lies_in_its_intervals(table):
    holds_the_truth(hg.fit_table(table.to_lamp, table.to_eye, table.values, table.variance))


@pytest.mark.parametrize("columns", ["angles", "vectors"])
def test_a_csv_of_directions_gives_the_material_of_its_rows(tmp_path, table, columns, capsys):
    named = {name: table.values[:, k] for k, name in enumerate("RGB")}
    named |= {f"variance_{name}": table.variance[:, k] for k, name in enumerate("RGB")}  # type: ignore[index]
    for way, vectors in (("lamp", table.to_lamp), ("eye", table.to_eye)):
        if columns == "vectors":
            named |= {f"to_{way}_{axis}": vectors[:, k] for k, axis in enumerate("xyz")}
        else:
            named[f"theta_{way}_deg"] = np.degrees(np.arccos(vectors[:, 2]))
            named[f"phi_{way}_deg"] = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0]))
    hg.write_table(tmp_path / "sample.csv", named)
    assert format_of(tmp_path / "sample.csv").name == "reflectance CSV"
    assert main(["fit", str(tmp_path / "sample.csv"), "--out", str(tmp_path / "materials.json")]) == 0
    (material,) = hg.read_materials(tmp_path / "materials.json")
    assert material.name == "sample"
    holds_the_truth(material)
    assert hg.info(tmp_path / "sample.csv")["directions"] == len(table.values)


def test_merl_bins_are_the_published_ones():
    """The index of Matusik's reader: θ_h by its square root, θ_d, then φ_d; colours one after the other."""
    half, difference, turn = np.radians([3.0]), np.radians([20.0]), np.radians([40.0])
    lamp, eye = directions(half, difference, turn)
    middle = lamp + eye
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert np.allclose(np.arccos(middle[:, 2]), half) and np.allclose(np.arccos((lamp * middle).sum(1)), difference)
    assert np.allclose(np.linalg.norm(eye, axis=1), 1.0)


def test_a_table_of_merl_gives_its_material(tmp_path, capsys):
    """Values at the middle of each bin; what a bin smooths is less than the stated error but near the mirror."""
    write_merl(tmp_path / "paint.binary", brdf)
    assert read_merl(tmp_path / "paint.binary").values.shape[1] == 3
    argv = ["fit", str(tmp_path / "paint.binary"), "--out", str(tmp_path / "a.json"), "--relative-error", "0.005"]
    assert main(argv) == 0 and "states no variance" in capsys.readouterr().out
    (material,) = hg.read_materials(tmp_path / "a.json")
    for name, true in TRUE.items():  # exact values: the error is that of the fit alone
        assert getattr(material, name) == pytest.approx(true, rel=1e-3), name
    (tmp_path / "cut.binary").write_bytes((tmp_path / "paint.binary").read_bytes()[:-8])
    with pytest.raises(hg.InputError, match="is no table of MERL"):
        read_merl(tmp_path / "cut.binary")


def rgl_file(path, spectra: str, side: int = 96, changed: dict[str, np.ndarray] | None = None) -> None:
    """A table of RGL of `brdf`: its facets are taken as even, so that its grid is that of half angles alone.

    changed: arrays in place of its own.
    """
    angles = np.linspace(0.0, np.radians(85.0), side)
    polar, turn = np.linspace(0.0, 1.0, side) ** 2 * np.pi / 2, np.linspace(-np.pi, np.pi, side)
    lamp = np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)], 1)[:, None, None]
    half = np.stack(
        [
            np.sin(polar) * np.cos(turn)[:, None],
            np.sin(polar) * np.sin(turn)[:, None],
            np.cos(polar) + 0.0 * turn[:, None],
        ],
        -1,
    )
    lamp, half = (vectors.reshape(-1, 3) for vectors in np.broadcast_arrays(lamp, half))
    eye = 2.0 * np.einsum("ni,ni->n", lamp, half)[:, None] * half - lamp
    values = np.zeros((len(lamp), 3), np.float32)
    above = (lamp[:, 2] > 1e-3) & (eye[:, 2] > 1e-3)
    values[above] = brdf(lamp[above], eye[above]) * eye[above, 2:]
    even = np.ones((1, angles.size, side, side), np.float32)
    table = values.reshape(1, angles.size, side, side, 3).transpose(0, 1, 4, 2, 3)
    fields = {
        "description": np.frombuffer(b"paint", np.uint8), "phi_i": np.zeros(1, np.float32),
        "theta_i": angles.astype(np.float32), "ndf": even[0, 0], "sigma": even[0, 0], "vndf": even,
        "luminance": even, spectra: table, "jacobian": np.zeros(1, np.uint8),
    }  # fmt: skip
    if spectra == "spectra":
        fields["wavelengths"] = np.array([420.0, 560.0, 700.0], np.float32)
    fields |= changed or {}
    place = 18 + sum(13 + len(name) + 8 * array.ndim for name, array in fields.items())
    head, body = b"tensor_file\0\1\0" + len(fields).to_bytes(4, "little"), b""
    for name, array in fields.items():
        kind = {np.dtype(np.uint8): 1, np.dtype(np.float32): 10}[array.dtype]
        head += len(name).to_bytes(2, "little") + name.encode() + array.ndim.to_bytes(2, "little") + bytes([kind])
        head += np.array([place + len(body), *array.shape], "<u8").tobytes()
        body += array.tobytes()
    path.write_bytes(head + body)


@pytest.mark.nightly
@pytest.mark.parametrize("spectra", ["spectra", "rgb"])
def test_a_table_of_rgl_gives_its_material(tmp_path, spectra):
    """Values on a grid as fine as those of the published tables; between its places Mitsuba interpolates."""
    path = tmp_path / "paint.bsdf"
    rgl_file(path, spectra)
    assert format_of(path).name == "RGL BRDF"
    table = format_of(path).read(path)
    assert table.channels == (("420 nm", "560 nm", "700 nm") if spectra == "spectra" else ("R", "G", "B"))
    expected = brdf(table.to_lamp, table.to_eye)
    assert np.median(np.abs(table.values / expected - 1.0)) < 2e-3
    material = table.with_relative_error(0.01).fit()
    for name, true in TRUE.items():
        assert getattr(material, name) == pytest.approx(true, rel=0.01), name
    path.write_bytes(path.read_bytes()[:-400_000])
    with pytest.raises(hg.InputError, match="cannot be read as a table of RGL, it may be cut off or damaged"):
        format_of(path).read(path)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"theta_i": np.linspace(1.5, 0.0, 8, dtype=np.float32)}, "theta_i must be a list of numbers that rise"),
        ({"phi_i": np.zeros(0, np.float32)}, "phi_i must be a list of numbers that rise"),
        ({"theta_i": np.linspace(0.0, 1e-4, 8, dtype=np.float32)}, "its largest theta_i is 0.0001 rad"),
        ({"vndf": np.ones((1, 5, 8, 8), np.float32)}, "cannot be read as a table of RGL"),
        ({"jacobian": np.zeros(0, np.uint8)}, "cannot be read as a table of RGL"),
        ({"spectra": np.zeros((1, 8, 3, 8, 8), np.float32)}, "no value above 0"),
    ],
)
def test_a_damaged_table_of_rgl_ends_in_one_line(tmp_path, capsys, changed, said):
    rgl_file(tmp_path / "a.bsdf", "spectra", 8, changed)
    assert main(["fit", str(tmp_path / "a.bsdf"), "--out", str(tmp_path / "a.json")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not (tmp_path / "a.json").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"to_lamp": np.zeros((4, 3))}, "of row 0 has the length 0"),
        ({"values": np.full((4, 2), np.nan)}, "not finite"),
        ({"variance": np.zeros((4, 2))}, "variance above 0"),
        ({"values": np.ones(4)}, "values .N, C."),
    ],
)
def test_a_table_that_is_none_is_refused(change, said):
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    with pytest.raises(hg.InputError, match=said):
        hg.fit_table(**{"to_lamp": up, "to_eye": up, "values": np.ones((4, 2)), "variance": np.ones((4, 2))} | change)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("theta_lamp_deg,phi_lamp_deg,theta_eye_deg,phi_eye_deg\n0,0,0,0\n", "the channels none"),
        ("theta_lamp_deg,phi_lamp_deg,theta_eye_deg,phi_eye_deg,R,G,variance_R\n0,0,0,0,1,1,1\n", "for all of them"),
        ("theta_lamp_deg,phi_lamp_deg,theta_eye_deg,phi_eye_deg,R\n0,0,0,0,1\n", "too few"),
        ("wavelength_nm,R\n400,1\n", "no table of reflectances"),
    ],
)
def test_a_csv_that_holds_no_brdf_ends_in_one_line(tmp_path, capsys, text, said):
    (tmp_path / "a.csv").write_text(text)
    assert main(["fit", str(tmp_path / "a.csv"), "--out", str(tmp_path / "a.json")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not (tmp_path / "a.json").exists()


@pytest.mark.nightly
def test_the_study_of_tables_finds_a_truth_of_our_own_in_both_layouts(tmp_path):
    """A rival that is a tenth too bright is a tenth off; ours is within the noise, which 8000 values make small."""

    def truth(cosines: hg.Cosines) -> np.ndarray:
        alpha, beta, gamma, n = TRUE.values()
        facets = beta * np.exp(-np.log(2.0) * (np.arccos(np.clip(cosines.half, -1, 1)) / gamma) ** 2)
        masking = np.minimum(1.0, 2.0 * cosines.half * np.minimum(cosines.view, cosines.incidence) / cosines.deviation)
        gloss = facets * fresnel(cosines.deviation, n) * masking / cosines.view
        return alpha * cosines.incidence * BODY + gloss

    rows = table_rows("ours", "paint", truth, lambda at: 1.1 * truth(at), tmp_path, np.random.default_rng(3))
    assert [row.file for row in rows] == ["MERL", "RGL"]
    for row in rows:
        assert row.ours < 0.003 and row.other == pytest.approx(0.1, rel=1e-6) and 0.001 < row.layout < 0.01


def test_an_index_that_no_fit_takes_is_refused():
    """It was taken for 3, the nearest that is admissible, without a word."""
    ways = np.tile([[0.0, 0.0, 1.0]], (40, 1))
    table = hg.ReflectanceTable(ways, ways, np.full((40, 3), 0.1)).with_relative_error(0.01)
    with pytest.raises(hg.InputError, match=r"n is 12: give a refractive index from 1\.05 to 10"):
        table.fit(n=12)


def conductor(cosine: np.ndarray, eta: float, k: float) -> np.ndarray:
    """Reflectance of unpolarised light by a metal of the complex index η + i k, exact (Born & Wolf, §14.2)."""
    index = np.sqrt((eta + 1j * k) ** 2 - 1.0 + cosine**2)
    across = np.abs((cosine - index) / (cosine + index)) ** 2
    along = np.abs(((eta + 1j * k) ** 2 * cosine - index) / ((eta + 1j * k) ** 2 * cosine + index)) ** 2
    return 0.5 * (across + along)


@pytest.mark.parametrize("eta, k", [((1.3, 0.96, 0.7), (7.5, 6.7, 5.6)), ((3.1, 3.2, 2.3), (3.3, 3.3, 3.1))])
def test_metals_are_fitted_to_their_noise(eta, k):
    """Aluminium and chromium. With an index of 3 at most, residuals were 1.7 and 1.9 times their noise, as reflectance
    then rises towards grazing light more than that of a metal. The metal has no n; width and body are true.
    """
    lamp, eye = goniometer()
    cosines = hg.ReflectanceTable(lamp, eye, np.zeros((len(lamp), 3))).cosines
    incidence, view, half, deviation = (one[:, 0] for one in cosines)
    masking = np.minimum(1.0, 2.0 * half * np.minimum(incidence, view) / deviation)
    facets = 0.8 * np.exp2(-((np.arccos(half) / 0.18) ** 2)) * masking / (incidence * view)
    clean = 0.002 + facets[:, None] * np.stack([conductor(deviation, *pair) for pair in zip(eta, k, strict=True)], 1)
    values = clean * (1.0 + NOISE * np.random.default_rng(11).standard_normal(clean.shape))
    metal = hg.fit_table(lamp, eye, values, (NOISE * clean) ** 2)
    assert not any("incomplete" in remark for remark in metal.remarks) and 3.0 < metal.n < 10.0
    for name, true in (("gamma", 0.18), ("alpha", 0.002)):
        low, high = metal.interval_95[name]
        assert low <= true <= high and high - low < 0.1 * true, name
