"""Report: what the demo did, as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.app.display import exposure, shown, srgb_from_camera
from hagoromo.app.page import Page, image
from hagoromo.camera.response import Response
from hagoromo.image.image import Image
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.known_shape import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_figures.demo.figures import FIGURES
from hagoromo_figures.demo.measurement import Row
from hagoromo_figures.demo.plots import measured_against_true, residual_histogram, spectra
from hagoromo_figures.demo.relit import RIM, Relit
from hagoromo_figures.demo.report_pictures import around, developed, fitted_residuals, labels, residual, response_of
from hagoromo_figures.demo.samples import DISTANCE, ISO, RADIUS

SYMBOLS = {"alpha": "α [1/sr]", "beta": "β [1/sr]", "gamma": "γ [rad]", "n": "n"}
OTHER_CAMERA, OTHER_LAMP = "Nikon 5100 (NPL)", "A"
PAPER = "N. Tanaka, “A Rendering Method of Volume Data Based on Machine Vision”"


@dataclass(frozen=True, eq=False)
class Report:
    """What the demo made. record: results.json; capture: the photographs measured; aside: the one kept aside."""

    record: Mapping[str, Any]
    capture: Capture
    aside: Photograph
    measurement: Measurement
    table: Sequence[Row]
    truth: Mapping[str, Reflectance]
    found: Mapping[str, Reflectance]
    relit: Relit
    figures: Mapping[str, Image]


def write_report(path: Path, report: Report) -> None:
    """Write the page to `path`."""
    lead = f"The method of {PAPER}, run end to end by Hagoromo {report.record['hagoromo']} on simulated photographs."
    page = Page("From photographs to volume boxes", lead)
    for part in (_introduction, _capture, _measurement, _relit_view, _figures, _other_light, _settings, _limits):
        part(page, report)
    path.write_text(page.html(), encoding="utf-8")


def _introduction(page: Page, report: Report) -> None:
    held, measured, ideal = report.record["coverage"], report.relit.measured, report.relit.ideal
    page.section(
        "What this is",
        "A camera photographs samples of four materials under known lamps. From the photographs alone the parameters "
        "of the dichromatic Torrance–Sparrow model are measured: body weight α, body colour c<sub>b</sub>, interface "
        "weight β, facet width γ and refractive index n. Volume boxes are then filled with micro-elements of the "
        "measured reflectance – spheres for skin, cylinders for cloth and feathers – and marched from a camera of the "
        "same make under three white point lamps. As in the paper the photographs are simulated: the truth is known, "
        "and every step can be checked.",
        f"In short: {held['inside']} of {held['identifiable']} intervals of 95 % hold the truth, and a photograph "
        "under a lamp that the measurement never saw is predicted with a relative error of "
        f"{100 * measured['relative_rmse']:.2f} % and a mean ΔE<sub>00</sub> of {measured['delta_e_2000']:.2f}. (The "
        f"true reflectances give {100 * ideal['relative_rmse']:.2f} % and {ideal['delta_e_2000']:.2f}: it is the noise "
        "of the photograph.) All files lie beside this page.",
    )


def _capture(page: Page, report: Report) -> None:
    camera = report.capture.photographs[0].camera
    sensor, binning = camera.sensor, report.record["size"]["capture_binning"]
    assert sensor is not None
    page.section(
        "The capture",
        f"Four smooth balls of {2000 * RADIUS:.0f} mm stand in a row, {DISTANCE:.1f} m before a simulated Canon EOS "
        f"Kiss Digital with a 55 mm lens at ISO {ISO:.0f}: {camera.width} × {camera.height} pixels, each the mean of "
        f"{binning} × {binning} pixels of the sensor. The photographs have shot noise, read noise "
        f"({sensor.read_noise:.0f} electrons), a full well of {_thousands(sensor.full_well)} electrons, {sensor.bits} "
        f"bits and the mosaic {sensor.mosaic}; they are exposed so that no highlight is clipped, and demosaiced by "
        "bilinear interpolation. Only values that the sensor measured itself are fitted. In each photograph one white "
        "point lamp is lit (spectrum D65), 0.9 m from the balls; the fourth photograph is kept aside.",
    )
    crop = around(report.relit.mask)
    page.grid(
        "The photographs: skin, cloth, feather and a plain dielectric, each photograph shown at its own exposure. The "
        "lamp of the last one is kept aside.",
        *(image(developed(taken)[crop], f"lamp {taken.name}") for taken in (*report.capture.photographs, report.aside)),
    )


def _measurement(page: Page, report: Report) -> None:
    held, measurement = report.record["coverage"], report.measurement
    page.section(
        "The measurement",
        "Materials are told apart by their body colour, without being told how many there are: "
        f"{len(measurement.materials)} were found, and {100 * report.record['rightly_labelled']:.2f} % of the labelled "
        "pixels carry the label of the ball they lie on (names are given afterwards, for reading). Each material is "
        "fitted by robust least squares, every value weighted by its variance. Table 1 holds the estimates against the "
        "truth in the same terms: body colours have a mean of 1 over the channels, and α carries the strength.",
        f"Of {held['intervals']} parameters these photographs tell {held['identifiable']}; of their 95 % intervals "
        f"{held['inside']} hold the truth, where {held['expected']:.1f} are expected. Were all intervals right and "
        f"independent, so few or fewer would be seen with a probability of {held['likelihood']:.2f}. This is one "
        f"capture, of the fixed seed {report.record['size']['seed']}: it illustrates the intervals and does not prove "
        "them.",
    )
    page.table(
        "Measured against true. c<sub>R</sub>, c<sub>G</sub>, c<sub>B</sub>: body colour as the camera sees it.",
        ("material", "parameter", "true", "measured", "95 % interval", "told", "holds the truth"),
        [_table_row(row) for row in report.table],
        group=7,
    )
    page.figure(
        "Error of each estimate in per cent of the truth, with its 95 % interval. The figure below is the true value; "
        "an open circle is a parameter that the photographs do not tell.",
        measured_against_true(report.table),
    )
    page.figure(
        "Body albedo. Three channels tell three numbers: the recovered spectrum is the smooth one, of three bands, "
        "that this camera cannot tell from the true one under this lamp. The dips of haemoglobin are lost, as they "
        "must be.",
        spectra(*({name: r.body_colour.scaled(math.pi * r.alpha) for name, r in reflectances.items()}
                  for reflectances in (report.truth, report.found))),
    )  # fmt: skip
    _residuals(page, report)


def _residuals(page: Page, report: Report) -> None:
    measurement, crop = report.measurement, around(report.relit.mask)
    pictures = []
    for taken, predicted, left in zip(
        report.capture.photographs, measurement.predicted, measurement.residuals, strict=True
    ):
        pictures.append(image(developed(taken, predicted)[crop], f"predicted, lamp {taken.name}"))
        pictures.append(image(residual(left)[crop], f"residual, lamp {taken.name}", lossless=True))
    page.grid(
        "The estimates' prediction of each photograph, and what is left: white where noise explains it, red brighter "
        "and blue darker than predicted, full colour at 5 standard deviations. Where light or view graze, a pixel "
        "holds lit and unlit surface, or ball and background: the red lines are outside the fit.",
        *pictures,
        image(labels(measurement)[crop], "materials found", lossless=True),
    )
    used = fitted_residuals(report.capture, measurement)
    page.figure(
        f"Residuals of the values that were open to the fit against the normal law: standard deviation "
        f"{np.std(np.clip(used, -6, 6)):.3f}; {100 * np.mean(np.abs(used) > 3):.2f} % lie beyond 3 (normal: 0.27 %).",
        residual_histogram(used),
    )
    remarks = [f"{m.name}: {remark}" for m in measurement.materials for remark in m.remarks]
    if remarks:
        page.text("The measurement remarks:")
        page.bullets(remarks)


def _relit_view(page: Page, report: Report) -> None:
    view, crop = report.relit, around(report.relit.mask)
    page.section(
        "A lamp it never saw",
        "The samples, rendered with the measured reflectances under the lamp kept aside, beside the photograph that "
        "was taken under it. The second row of the table renders the true reflectances instead: what remains then is "
        "the noise of the photograph and its demosaicing, and no measurement can do better.",
    )
    titles = {"photograph": "photograph", "predicted": "prediction", "difference": "prediction − photograph, × 10"}
    pictures = view.pictures()
    page.stack(
        "Relit view beside the photograph, and their difference enlarged ten times (grey is none).",
        *(image(pictures[key][crop], title) for key, title in titles.items()),
    )
    page.table(
        f"Difference from the photograph over the {_thousands(view.measured['pixels'])} pixels that lie {RIM} or more "
        "inside the rims, in linear sRGB. A white diffuser that faces the lamp is 1: the peak of the PSNR and the "
        "white of ΔE<sub>00</sub>. Relative RMSE is over the root mean square of the photograph. The files are in "
        "<code>relit/</code>.",
        ("rendered with", "PSNR [dB]", "SSIM", "mean ΔE<sub>00</sub>", "relative RMSE"),
        [
            [
                name,
                f"{d['psnr']:.2f}",
                f"{d['ssim']:.4f}",
                f"{d['delta_e_2000']:.2f}",
                f"{100 * d['relative_rmse']:.2f} %",
            ]
            for name, d in (("measured reflectances", view.measured), ("true reflectances", view.ideal))
        ],
    )


def _figures(page: Page, report: Report) -> None:
    size = report.record["size"]
    page.section(
        "Figures 6 to 8 of the paper",
        "Volume boxes filled with the measured reflectances, under three white point lamps: a key high on the left, a "
        "weak fill beside the camera and a rim light from behind. The ground is the measured dielectric. The camera is "
        f"the same, with a binning of {size['figure_binning']} and {size['figure_samples']} rays a pixel. Light is "
        "attenuated on its way in and on its way out, and scattered once. The pictures show what the CIE 1931 observer "
        "sees; the EXR files beside them hold the camera's values and the weights.",
    )
    for name, found in report.figures.items():
        shot, picture = FIGURES[name], found.display()
        height, width = picture.shape[:2]
        note = f"Figure {name.split('_')[1]} of the paper; {width} × {height} pixels."
        page.figure(f"{shot.caption} <i>{note}</i>", image(picture))


def _other_light(page: Page, report: Report) -> None:
    name = list(report.figures)[-1]
    whole = report.figures[name]
    daylight, warm = whole.palette.lamps, [Spectrum.named(OTHER_LAMP)] * len(whole.palette.lamps)
    canon, nikon = response_of(report.aside), Response.load(OTHER_CAMERA)
    views = [
        ("Canon, daylight", canon, daylight, daylight),
        ("Canon set to daylight, incandescent light", canon, warm, daylight),
        ("Nikon set to incandescent light, incandescent light", nikon, warm, warm),
    ]
    page.section(
        "One rendering, other light, another camera",
        "A rendering is kept as geometric weights of body and interface colours, so eq. (10) can be evaluated anew for "
        "any lamp spectrum and any camera. These three views come from one file, "
        f"<code>figures/{name}.exr</code>: nothing was rendered again.",
    )
    pictures = []
    for title, response, lamps, balance in views:
        matrix, values = srgb_from_camera(response, balance[0]), whole.expose(response, lamps)
        pictures.append(image(shown(values, matrix, exposure(values @ matrix.T, whole.alpha)), title))
    page.figure(
        "The same figure through the Canon under D65; under illuminant A, the camera still balanced for D65; and "
        "under illuminant A through a Nikon D5100 (sensitivities measured by NPL), balanced for it.",
        *pictures,
    )


def _settings(page: Page, report: Report) -> None:
    record = report.record
    page.section("Settings, versions, times")
    settings = [["size", record["size"]["name"]], ["seed", str(record["size"]["seed"])], ["backend", record["backend"]]]
    settings += [["hagoromo", record["hagoromo"]], *([name, number] for name, number in record["versions"].items())]
    page.table("Settings and versions. All are in <code>results.json</code>.", ("", ""), settings)
    times = [[name, f"{value:.1f}"] for name, value in record["seconds"].items()]
    times.append(["sum", f"{sum(record['seconds'].values()):.1f}"])
    page.table("Time of each stage on this machine, without start-up and this report.", ("stage", "seconds"), times)


def _limits(page: Page, report: Report) -> None:
    page.section("What this does not show")
    page.bullets([
        "The photographs are simulated by the model that is then fitted, and lamps, lens, spectral response and the "
        "shape of the balls are known exactly. The intervals are therefore as narrow as noise alone makes them. "
        "Before a real camera, errors of calibration and shape come on top and will outweigh the noise.",
        "The true parameters and spectra are plausible figures written for this demo, not measurements of persons, "
        "textiles or birds.",
        "Three channels do not tell a spectrum. Colours are right under the lamp of the capture through this camera; "
        "under another lamp they are those of one smooth spectrum out of many.",
        "Light is scattered once: skin looks harder than it is, and folds and feathers darker in their depth.",
        "The reflectance is measured on smooth balls and then given to micro-elements, as the paper does: a volume of "
        "cylinders or spheres does not reflect as the smooth ball did. The shapes of the boxes are drawn, not "
        "measured.",
        "All lamps are points, so shadows have sharp edges.",
    ])  # fmt: skip


def _table_row(row: Row) -> list[str]:
    """Cells of Table 1, with as many digits as the interval makes sense of."""
    symbol = SYMBOLS.get(row.parameter, f"c<sub>{row.parameter[-1]}</sub>")
    closed = math.isfinite(row.high) and row.high > row.low
    digits = min(max(1 - math.floor(math.log10(0.5 * (row.high - row.low))), 2), 6) if closed else 3
    interval = f"{row.low:.{digits}f} … {row.high:.{digits}f}" if closed else "open"
    holds = ("yes" if row.inside else '<span class="no">no</span>') if row.identifiable else "–"
    first = row.material if row.parameter == "alpha" else ""
    told = "yes" if row.identifiable else "no"
    return [first, symbol, f"{row.true:.{digits}f}", f"{row.estimate:.{digits}f}", interval, told, holds]


def _thousands(number: float) -> str:
    return f"{number:,.0f}".replace(",", "\u202f")
