"""The command `hagoromo spectra`."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional, UseAppendAction

import hagoromo as hg
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.errors import InputError
from hagoromo.files.whole import whole_folder


@verb(verbs)
def spectra(
    photographs: Positional[tuple[Path, ...]],
    out: Out,
    lamp: UseAppendAction[tuple[str, ...]] = (),
    response: str | None = None,
    chart: UseAppendAction[tuple[Path, ...]] = (),
    patches: str = "BabelColor Average",
    corners: tuple[float, ...] = (),
    white: str | None = None,
    white_reflectance: float = 0.99,
    region: UseAppendAction[tuple[str, ...]] = (),
    labels: Path | None = None,
    measured: Path | None = None,
    prior: UseAppendAction[tuple[str, ...]] = (),
    under: UseAppendAction[tuple[str, ...]] = (),
    against: str | None = None,
    upper: float = 1.0,
    illumination: float = 0.01,
    whole_image: bool = False,
    force: Force = False,
) -> None:
    """Photographs of one view, with a chart or a white → reflectance spectra of marked regions with 95 % bands.

    Writes spectra.png (plot), spectra.csv, spectra.json (with covariance, colours, ΔE00, evidence of the priors) and
    with --whole-image spectra.exr. What a chart shows to be wrong with the photographs (clipped, not linear in light,
    off in the dark, unevenly lit, lamps in the wrong order) is said and, where it can be, corrected. Regions whose
    readings no likely reflectance explains are named and flagged.

    Args:
        photographs: linear photographs from one place, one per lamp: developed EXR, or 16-bit PNG or TIFF.
        lamp: spectrum of the lamp of each photograph: a name such as D65, or a CSV; once per photograph.
        response: response of the camera: a name or a CSV (default: calibrated from the chart).
        chart: photograph of the chart under the lamp of each photograph, same exposure (default: the chart is in the
            photographs themselves).
        patches: spectra of the chart's patches: a chart of colour-science, or a CSV with a column per patch.
        corners: x y of the chart's corners in each photograph of it [px], clockwise from the dark skin patch, if it is
            not detected.
        white: name of the region that is a white patch, instead of a chart; needs --response.
        white_reflectance: reflectance of that patch.
        region: NAME=x,y,width,height of a rectangle [px]; may be repeated.
        labels: PNG of one channel: 0 unmarked, every other value a region.
        measured: folder of `measure` with pictures of the same view: its materials are the regions.
        prior: surfaces, smooth, skin, textile, pigment, auto, or a CSV of spectra; may be repeated, then weighed by
            evidence (default: auto, all of the named ones).
        under: lamp under which colours and ΔE00 are stated, a name or a CSV; may be repeated (default: D65, A, FL11).
        against: a region, or a CSV of one spectrum, to which ΔE00 is stated.
        upper: largest reflectance; above 1 for gloss or fluorescence.
        illumination: relative standard deviation between the light on a region and that on the white.
        whole_image: also the spectrum of every pixel.
    """
    import numpy as np

    if corners and len(corners) != 8 * len(photographs):
        asked = f"{len(photographs)} photographs have {8 * len(photographs)}"
        raise InputError(f"--corners has {len(corners)} numbers: {asked}, give x and y of four corners for each")
    places = [np.reshape(corners[8 * k : 8 * k + 8], (4, 2)) for k in range(len(corners) // 8)] or None
    marks = hg.Marks(region, labels, measured, white, white_reflectance, places)
    camera = None if response is None else hg.Response.load(response)
    names = [name for name in prior if name != "auto"]
    priors = [hg.ReflectancePrior.load(name) for name in names] if names and "auto" not in prior else None
    with whole_folder(out, force) as home:
        found = hg.spectra(photographs, lamp, marks, camera, chart, patches, priors, upper, illumination, whole_image)
        under_lamps = {Path(name).stem: hg.Spectrum.load(name) for name in under or ("D65", "A", "FL11")}
        reference: str | hg.Spectrum | None = against
        if against is not None and against not in found.estimates:
            if not against.lower().endswith(".csv"):
                raise InputError(f"no region is called {against!r}: the regions are {', '.join(found.estimates)}")
            reference = hg.Spectrum.from_csv(against)
        from hagoromo.image.spectra.spectra_files import write_spectra

        write_spectra(home, found, under_lamps, reference)
    for name, mean, half, likely, within in hg.spectra_table(found.estimates):
        say(f"{name}: mean reflectance {mean}, band up to ±{half}, {likely}, colour to ΔE00 {within} (D65, 95 %)")
    say(*found.remarks)
    for name, estimate in found.estimates.items():
        say(*(f"{name}: {remark}" for remark in estimate.remarks()))
    wrote(out / "spectra.png", out / "spectra.csv", out / "spectra.json")
