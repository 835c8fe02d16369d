"""OpenMATERIAL 3D: what its schemas and checker rules ask of a file, and values against the written-out formula."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_formats.relightable.openmaterial import write_openmaterial
from tests.app.published_ball import ball, estimate
from tests.inverse.simulated_ball import BallMaterial
from tests.oracle.reflection import plane

WAVELENGTHS = np.arange(380.0, 781.0, 10.0)
VALUES = 1.0 + 0.5 * np.sin(WAVELENGTHS / 70.0)
SPECTRUM = SpectrumEstimate(WAVELENGTHS, VALUES, 1e-4 * np.eye(41), {}, {})
SILK = estimate("silk, red", BallMaterial((0.12, 0.09, 0.06), 0.9, 0.05, 1.5))
UUID = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}")
LIMITS = np.array([[1e-9, 0.0, 0.0, 0.0, 0.0], [17.16e-3, 1.570796, 1.570796, 6.283185, np.inf]])  # of the columns


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    home = tmp_path_factory.mktemp("openmaterial")
    files = write_openmaterial(home, [SILK], {SILK.name: SPECTRUM}, None)
    assert files == ["m0_silk_red.xomp", "m0_silk_red_brdf.xompt"] and sorted(files) == sorted(
        p.name for p in home.iterdir()
    )
    return home, [json.loads((home / name).read_text()) for name in files]


def test_files_have_what_their_schemas_require(written):
    home, (material, table) = written
    for record, schema in ((material, "material_schema"), (table, "material_brdf_schema")):
        about = record["metadata"]
        assert {"name", "uuid", "materialVersion", "openMaterial3dVersion", "license"} <= about.keys()
        assert UUID.fullmatch(about["uuid"]) and about["openMaterial3dVersion"] == "1.1.0"
        assert re.fullmatch(r"\d+\.\d+\.\d+", about["materialVersion"])
        assert all(about[key] and all(isinstance(one, str) for one in about[key]) for key in ("copyrights", "authors"))
        assert record["$schema"].endswith(f"/v1.1.0/schemas/{schema}.json")
    assert material["metadata"]["uuid"] != table["metadata"]["uuid"] and isinstance(table["metadata"]["sources"], str)
    (uri,) = material["materialProperties"]["brdfUris"]
    assert uri.endswith("_brdf.xompt") and (home / uri).is_file()
    for name in ("m0_silk_red.xomp", uri):
        assert '"$schema"' in (home / name).read_text().splitlines()[1]  # a rule of its checker


def test_the_table_is_sorted_within_its_limits_and_has_the_wavelengths_it_states(written):
    _, (_, table) = written
    rows = table["brdf"]["lookupTable"]
    assert rows == sorted(rows) and len({tuple(row[:4]) for row in rows}) == len(rows)
    array = np.array(rows)
    assert array.shape[1] == 5 and (array >= LIMITS[0]).all() and (array <= LIMITS[1]).all()
    stated = table["brdf"]["wavelengths"]
    assert stated == sorted(set(array[:, 0])) and np.allclose(stated, 1e-9 * np.arange(380, 781, 20))


def test_its_values_are_those_of_the_reflectance(written):
    """Oracle: the written-out formula in float64, at the angles of the file; azimuth π is the mirror direction."""
    _, (_, table) = written
    rows = np.array(table["brdf"]["lookupTable"])[::7]
    lamp, eye = (np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], 1) for t, p in
                 ((rows[:, 1], 0.0 * rows[:, 1]), (rows[:, 2], rows[:, 3])))  # fmt: skip
    made = hg.Reflectance(SILK.alpha, SILK.beta, SILK.gamma, SILK.n, hg.Spectrum.constant(0.5))
    body, gloss = plane(made, np.broadcast_to([0.0, 0.0, 1.0], lamp.shape), lamp, eye)
    colour = np.interp(1e9 * rows[:, 0], WAVELENGTHS, VALUES)
    np.testing.assert_allclose(rows[:, 4], (body * colour + gloss) / lamp[:, 2], rtol=2e-3)
    mirror = rows[np.abs(rows[:, 1] - rows[:, 2]) < 1e-4]
    brightest = mirror[mirror[:, 4].argmax()]
    assert brightest[3] == pytest.approx(np.pi, abs=1e-5)


def test_parameters_and_covariance_stand_among_its_own_properties(written):
    _, (material, _) = written
    known = material["materialProperties"]["customProperties"]["hagoromo"]
    assert known["parameters"] == ["alpha", "beta", "gamma", "n"] and len(known["covariance"]) == 4
    assert len(known["body_spectrum"]["covariance"]) == 41


def test_an_object_without_spectra_is_refused_and_one_with_them_is_exported(tmp_path):
    _, measured = ball()
    with pytest.raises(hg.InputError, match="the spectrum of material 'material 0' is not known"):
        hg.export(measured, ["openmaterial"], tmp_path / "out")
    known = replace(measured, materials=measured.materials[:1], labels=np.minimum(measured.labels, 0))
    known = replace(known, body_spectra={known.materials[0].name: SPECTRUM})
    record = hg.export(known, ["openmaterial"], tmp_path / "out")["formats"]["openmaterial"]
    assert len(record["files"]) == 2 and "license and authors" in record["lost"]
