"""Files of `spectra`: spectra.json, spectra.csv, spectra.png and, of whole images, spectra.exr."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.files.exr import write_exr
from hagoromo.files.record import write_json, written_by
from hagoromo.files.table import write_table
from hagoromo.image.spectra.spectra import RegionSpectra
from hagoromo.image.spectra.spectra_plot import spectra_plot
from hagoromo.image.spectra.spectrum_colour import spectrum_colour, spectrum_difference
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate


def write_spectra(
    home: Path, found: RegionSpectra, lamps: Mapping[str, Spectrum], reference: str | Spectrum | None = None
) -> None:
    """Write the files to the folder `home`. lamps: name → spectrum, under which colours are stated.

    reference: name of a region, or a spectrum, to which ΔE00 is stated.
    """
    write_json(home / "spectra.json", spectra_record(found, lamps, reference))
    columns: dict[str, Any] = {"wavelength_nm": next(iter(found.estimates.values())).wavelengths}
    for name, estimate in found.estimates.items():
        low, high = estimate.band_95
        columns |= {name: estimate.values, f"{name} low": low, f"{name} high": high}
    write_table(home / "spectra.csv", columns)
    (home / "spectra.png").write_bytes(spectra_plot(found.estimates))
    if found.image is not None:
        image = found.image
        # Fichet, Pacanowski and Wilkie 2021: "T.NNN,NNnm" is a channel of reflectance or transmittance
        channels = {
            f"T.{nm:.2f}nm".replace(".", ",").replace("T,", "T."): image.values[..., k] for k, nm in _bands(image)
        }
        errors = {f"error.{nm:g}nm": image.standard_error[..., k] for k, nm in _bands(image)}
        more = {"explained": image.explained.astype(np.float32), "limited": image.limited.astype(np.float32)}
        layers = {name: np.nan_to_num(layer) for name, layer in (channels | errors | more).items()}
        write_exr(home / "spectra.exr", layers, {"spectralLayoutVersion": "1.0"})


def _bands(image: Any) -> list[tuple[int, float]]:
    return list(enumerate(image.wavelengths))


def spectra_record(
    found: RegionSpectra, lamps: Mapping[str, Spectrum], reference: str | Spectrum | None = None
) -> dict[str, Any]:
    """What spectra.json holds: per region its spectrum with the band, the evidence of priors, colours, remarks."""
    against = found.estimates[reference] if isinstance(reference, str) else reference
    regions = []
    for name, estimate in found.estimates.items():
        low, high = estimate.band_95
        entry: dict[str, Any] = {
            "name": name,
            "pixels": found.pixels[name],
            "wavelengths": estimate.wavelengths.tolist(),
            "values": estimate.values.tolist(),
            "interval_95": np.stack([low, high], axis=1).tolist(),
            "standard_error": estimate.standard_error.tolist(),
            "covariance": estimate.covariance.tolist(),
            "probability": dict(estimate.probability),
            "chi_square": estimate.chi_square,
            "readings": estimate.readings,
            "explained": estimate.explained,
            "remarks": list(estimate.remarks()),
            "colours": {lamp: _colour(estimate, spectrum) for lamp, spectrum in lamps.items()},
        }
        if against is not None and against is not estimate:
            entry["delta_e_2000"] = {
                lamp: dict(zip(("value", "low", "high"), spectrum_difference(estimate, against, spectrum), strict=True))
                for lamp, spectrum in lamps.items()
            }
        regions.append(entry)
    said = {"remarks": list(found.remarks), "assumptions": list(found.assumptions)}
    return {"regions": regions, **said, "hagoromo": written_by()}


def _colour(estimate: SpectrumEstimate, lamp: Spectrum) -> dict[str, Any]:
    colour = spectrum_colour(estimate, lamp)
    longer, shorter, angle = colour.ellipse
    return {
        "lab": colour.lab.tolist(),
        "covariance": colour.covariance.tolist(),
        "ellipse_95": {"longer": longer, "shorter": shorter, "angle_deg": angle},
        "delta_e_2000_95": colour.delta_e_95,
    }


def spectra_table(estimates: Mapping[str, SpectrumEstimate]) -> list[tuple[str, ...]]:
    """Rows of a table for people: name, mean reflectance, widest half band, likeliest prior, ΔE00 within (D65)."""
    lamp = Spectrum.named("D65")
    rows: list[tuple[str, ...]] = []
    for name, estimate in estimates.items():
        low, high = estimate.band_95
        likely = max(estimate.probability, key=lambda key: estimate.probability[key], default="")
        share = f"{likely} ({100 * estimate.probability[likely]:.0f} %)" if likely else ""
        within = spectrum_colour(estimate, lamp).delta_e_95
        rows.append((name, f"{estimate.values.mean():.3f}", f"{(high - low).max() / 2:.3f}", share, f"{within:.2f}"))
    return rows
