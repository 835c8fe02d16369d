"""A measured body colour becomes a spectrum where one lamp's spectrum and one response are known, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import read_json
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.material.body_spectra import body_spectra, read_body_spectra, write_body_spectra
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, surfaces
from hagoromo.reflectance.spectra.spectrum_estimate import reading_matrix

RESPONSE, LAMP = Response.load("Nikon 5100 (NPL)"), Spectrum.named("D65")
ERROR = 0.004


def estimate(body: np.ndarray, error: tuple | None) -> MaterialEstimate:
    """A material of the given body colour; its other parameters do not matter here."""
    return MaterialEstimate(
        "leaf", 7, tuple(body), (1.0,) * 3, 0.2, 0.1, 0.2, 1.5, 0.02, {"body_colour": error}, {}, (), {}, 1.0
    )


def capture(response: Response | None, *lamps: Spectrum) -> Capture:
    camera = Camera(7, 5, (9.0, 9.0), (3.5, 2.5), response=response)
    values, mask = np.ones((5, 7, 3), np.float32), np.ones((5, 7), bool)
    lit = [Lamp(to_lamp=(0.0, 0.0, 1.0), intensity=1.0, spectrum=spectrum) for spectrum in lamps]
    return Capture(
        tuple(Photograph(values, values, mask, camera, (lamp,), f"{k}") for k, lamp in enumerate(lit)), "one"
    )


def test_body_spectrum_holds_the_truth(tmp_path):
    """The truth, scaled as the colour is, lies within 4 standard errors at each wavelength: 31 at once."""
    truth = surfaces()[20]
    body = reading_matrix(LAMP, RESPONSE) @ truth
    path = tmp_path / "body_spectra.json"
    material = estimate(body / body.mean(), (ERROR,) * 3)
    write_body_spectra(path, body_spectra(capture(RESPONSE, LAMP, LAMP.scaled(2.0)), [material]))
    (record,) = read_json(path)
    np.testing.assert_array_equal(record["wavelengths"], WAVELENGTHS)
    off = np.array(record["values"]) - truth / body.mean()
    assert (np.abs(off) < 4.0 * np.array(record["standard_error"])).all()
    np.testing.assert_allclose(np.sqrt(np.diag(record["covariance"])), record["standard_error"])
    spectrum = read_body_spectra(path)["leaf"]
    np.testing.assert_array_equal(spectrum.values, record["values"])
    np.testing.assert_array_equal(spectrum.standard_error, record["standard_error"])


@pytest.mark.parametrize(
    "seen",
    [capture(None, LAMP), capture(RESPONSE, LAMP, Spectrum.named("A")), capture(RESPONSE, Spectrum.constant(1.0))],
    ids=["no response", "two lamps", "lamp unstated"],
)
def test_no_spectrum_is_made_up(seen):
    material = estimate(np.ones(3), (ERROR,) * 3)
    assert body_spectra(seen, [material]) == {}
    unknown = replace(material, standard_error={"body_colour": None})
    assert body_spectra(capture(RESPONSE, LAMP), [unknown]) == {}


def test_a_response_with_curves_alike_is_refused_in_one_line():
    """It was accepted, or ended in a traceback of linear algebra, as rounding had it."""
    alike = Response([400.0, 550.0, 700.0], np.column_stack([[0.2, 1.0, 0.3]] * 3), name="alike")
    with pytest.raises(InputError, match=r"response 'alike' does not separate three colours"):
        estimate(np.array([1.2, 1.0, 0.8]), None).reflectance(alike, LAMP)
