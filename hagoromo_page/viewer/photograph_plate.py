"""Photograph plate: a photograph of a capture, its pixels' errors, and the likely spectrum of what it shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.camera.response import Response, camera_white, srgb_from_camera
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate, estimate_spectrum, reading_matrix
from hagoromo_page.viewer.plates import (
    LARGEST_NOISE,
    NOISE_LAYER,
    Picture,
    PlateLight,
    grey,
    in_colours,
    shrunk,
    three_channels,
)
from hagoromo_page.viewer.probe import NOISE_OF_95, WAVELENGTHS, Probe, with_spectrum
from hagoromo_page.viewer.view_state import ViewTransform


class PhotographPlate:
    """A photograph of a capture, in camera values, and its pixels' standard errors."""

    lamps: tuple[str, ...] = ()
    turns = False

    def __init__(self, photograph: Photograph, values: Picture, variance: Picture, valid: Picture) -> None:
        """`values`, `variance`, `valid`: of the photograph, or of a part of it."""
        self.photograph, self.values, self.variance, self.valid = photograph, values, variance, valid
        self.size = (values.shape[1], values.shape[0])
        self.layers: tuple[str, ...] = ("picture", NOISE_LAYER, "valid")

    @property
    def cover(self) -> Picture:
        """See `Plate`."""
        return self.valid.astype(np.float32)

    def part(self, rows: slice, columns: slice, size: tuple[int, int]) -> PhotographPlate:
        """See `Plate`."""
        cut = rows, columns
        share = self.values[cut].shape[0] * self.values[cut].shape[1] / (size[0] * size[1])
        valid = shrunk(self.valid[cut].astype(np.float32), size) > 0.5
        variance = shrunk(self.variance[cut], size) / np.float32(share)
        return PhotographPlate(self.photograph, shrunk(self.values[cut], size), variance, valid)

    def linear(self, layer: str, light: PlateLight, development: ViewTransform) -> Picture | None:
        """See `Plate`. A camera of unknown response has its own colours."""
        if layer != "picture":
            return None
        values = three_channels(np.nan_to_num(self.values.astype(np.float64)))
        response = self.response
        if response is None:
            return values
        return values @ srgb_from_camera(response, self._white(development)).T

    def coded(self, layer: str) -> Picture:
        """See `Plate`. Uncertainty: of a pixel, relative, black 0 to bright LARGEST_NOISE."""
        if layer == "valid":
            return grey(self.valid)
        mean = self.values.mean(axis=2)
        noise = np.sqrt(self.variance.mean(axis=2))
        return in_colours(np.divide(noise, mean, out=np.ones_like(mean), where=mean > 0.0) / LARGEST_NOISE, self.valid)

    def probe(self, x: float, y: float, light: PlateLight) -> Probe:
        """See `Plate`. The spectrum is the likely share of a white's light, with its 95 % band, where the response of
        the camera and the lamp's spectrum are known.
        """
        column, row = int(x * self.size[0]), int(y * self.size[1])
        values, error = self.values[row, column].astype(np.float64), np.sqrt(self.variance[row, column])
        said = [
            "camera values "
            + " ".join(f"{one:.4f} ± {NOISE_OF_95 * off:.4f}" for one, off in zip(values, error, strict=True))
        ]
        pixel = np.nan_to_num(three_channels(values))
        response, lamps = self.response, self.photograph.lamps
        known = None
        if response is not None:
            pixel = srgb_from_camera(response, self._white(ViewTransform())) @ pixel
            if lamps and self.valid[row, column] and values.mean() > 0.0:
                known = likely_spectrum(values, error, lamps[0].spectrum, response)
        found = Probe(column, row, self.size, np.full(len(WAVELENGTHS), np.nan), pixel, float(self.valid[row, column]))
        if known is None:
            why = "the camera's response" if response is None else "a lamp" if not lamps else "a valid pixel"
            return replace(found, said=(*said, f"no spectrum: {why} is missing"))
        return replace(with_spectrum(found, known), said=(*said, "spectrum: likely reflectance × light, 95 % band"))

    @property
    def response(self) -> Response | None:
        """That of the camera, if it is known and has three channels."""
        response = self.photograph.camera.response
        return response if response is not None and len(response.channels) == 3 == self.values.shape[-1] else None

    def _white(self, development: ViewTransform) -> Spectrum:
        lamps = self.photograph.lamps
        if development.white != "first lamp":
            return Spectrum.named(development.white)
        return lamps[0].spectrum if lamps else Spectrum.constant(1.0)


def likely_spectrum(values: Picture, error: Picture, lamp: Spectrum, response: Response) -> SpectrumEstimate:
    """The likely spectrum that camera values ρ are of, relative to a white which faces the lamp; it may shine."""
    white = camera_white(lamp, response)
    priors = [ReflectancePrior.load(name) for name in ("surfaces", "smooth")]
    covariance = np.diag((error / white) ** 2)
    return estimate_spectrum(reading_matrix(lamp, response), values / white, covariance, priors, np.inf)
