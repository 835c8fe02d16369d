"""Report: what the demo did, as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.demo_figures import FIGURES
from hagoromo.app.demo_measurement import Row
from hagoromo.app.demo_relit import Relit
from hagoromo.app.display import exposure, shown, srgb_from_camera
from hagoromo.app.page import Page, image
from hagoromo.app.plots import COLOURS, measured_against_true, residual_histogram, spectra
from hagoromo.camera.response import Response
from hagoromo.image.image import Image
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.measure import Measurement
from hagoromo.reflectance.observations import Pixels, known_shape
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.sight import sight

SYMBOLS = {"alpha": "α [1/sr]", "beta": "β [1/sr]", "gamma": "γ [rad]", "n": "n"}
OTHER_CAMERA = "Nikon 5100 (NPL)"
OTHER_LAMP = "A"
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
    page = Page(
        "From photographs to volume boxes",
        f"The method of {PAPER}, run end to end by Hagoromo {report.record['hagoromo']} on simulated photographs.",
    )
    for part in (_introduction, _capture, _measurement, _relit_view, _figures, _other_light, _settings, _limits):
        part(page, report)
    path.write_text(page.html(), encoding="utf-8")


def _introduction(page: Page, report: Report) -> None:
    held = report.record["coverage"]
    measured = report.relit.measured
    page.section(
        "What this is",
        "A camera photographs samples of four materials under known lamps. From the photographs alone the parameters of "
        "the dichromatic Torrance–Sparrow model are measured: body weight α and body colour c_b, interface weight β, facet "
        "width γ and refractive index n. Volume boxes are then filled with elements of the measured reflectance: spheres "
        "for skin, cylinders for cloth and feathers. They are marched from a camera of the same make under three white "
        "point lamps. As in the paper the photographs are simulated, so the truth is known and every step can be checked.",
        f"In short: {held['inside']} of {held['identifiable']} intervals of 95 % hold the truth; a photograph under a lamp "
        f"that the measurement never saw is predicted with a relative error of {100 * measured['relative_rmse']:.2f} % and "
        f"a mean ΔE<sub>00</sub> of {measured['delta_e_2000']:.2f}. All files lie beside this page.",
    )


def _capture(page: Page, report: Report) -> None:
    camera, sensor = report.capture.photographs[0].camera, report.capture.photographs[0].camera.sensor
    assert sensor is not None
    binning = report.record["size"]["capture_binning"]
    page.section(
        "The capture",
        f"Four smooth balls of 60 mm stand in a row, 0.7 m before a simulated Canon EOS Kiss Digital with a 55 mm lens: "
        f"{camera.width} × {camera.height} pixels, each the mean of {binning} × {binning} pixels of the sensor. Every "
        f"photograph has shot noise, read noise ({sensor.read_noise:.0f} electrons), a full well of "
        f"{sensor.full_well:,.0f} electrons, {sensor.bits} bits and the mosaic {sensor.mosaic}, and is demosaiced by "
        "bilinear interpolation; only values that the sensor measured itself are fitted. One white point lamp "
        "(spectrum D65) is lit in each photograph, 0.9 m from the balls; a fourth photograph is kept aside.".replace(
            ",", " "
        ),
    )
    crop = _around(report.relit.mask)
    pictures = [
        image(_developed(photograph)[crop], f"{photograph.name}")
        for photograph in (*report.capture.photographs, report.aside)
    ]
    page.figure(
        "The photographs: skin, cloth, feather and a plain dielectric, each photograph exposed for itself. The lamp of the "
        "last one is kept aside. Black parts of a ball are not lit: the measurement leaves them out.",
        "".join(pictures),
    )


def _measurement(page: Page, report: Report) -> None:
    held, measurement = report.record["coverage"], report.measurement
    page.section(
        "The measurement",
        "Materials are told apart by their body colour, without being told how many there are: "
        f"{len(measurement.materials)} were found, and {100 * report.record['rightly_labelled']:.2f} % of the labelled "
        "pixels carry the label of the ball they lie on. (Names are given afterwards, for reading.) Each material is then "
        "fitted by robust least squares, every value weighted by its variance. Table 1 holds the estimates against the "
        "truth, each in the same terms: body colours have a mean of 1 over the channels, so α carries the strength.",
        f"Of {held['intervals']} parameters {held['identifiable']} are told by these photographs; of their 95 % intervals "
        f"{held['inside']} hold the truth, where {held['expected']:.1f} are expected. If all intervals were right and "
        f"independent, as few or fewer would be seen with a probability of {held['likelihood']:.2f}. This is one capture "
        f"with the fixed seed {report.record['size']['seed']}, chosen before the result was seen.",
    )
    page.table(
        "Measured against true. c<sub>R</sub>, c<sub>G</sub>, c<sub>B</sub>: body colour as the camera sees it.",
        ("material", "parameter", "true", "measured", "95 % interval", "told", "inside"),
        [_table_row(row, first=row.parameter == "alpha") for row in report.table],
        group=7,
    )
    page.figure(
        "Error of each estimate, in per cent of the truth (the figure under each bar), with its 95 % interval. An open "
        "circle would be a parameter that the photographs do not tell.",
        measured_against_true(report.table),
    )
    lamp = report.capture.photographs[0].lamps[0].spectrum
    albedo = {name: r.body_colour.scaled(np.pi * r.alpha) for name, r in report.truth.items()}
    recovered = {name: r.body_colour.scaled(np.pi * r.alpha) for name, r in report.found.items()}
    page.figure(
        "Body albedo. Three channels tell three numbers: the recovered spectrum (dashed) is the smooth one of three bands "
        "that this camera cannot tell from the true one under this lamp. The dips of haemoglobin are lost, as they must be.",
        spectra(albedo, recovered),
    )
    crop = _around(report.relit.mask)
    matrix = srgb_from_camera(_response(report.capture.photographs[0]), lamp)
    pictures = [image(_labels(measurement)[crop], "labels", lossless=True)]
    for photograph, predicted in zip(report.capture.photographs, measurement.predicted, strict=True):
        scale = exposure(photograph.values @ matrix.T)
        pictures.append(image(shown(np.nan_to_num(predicted), matrix, scale)[crop], f"predicted: {photograph.name}"))
    for k, photograph in enumerate(report.capture.photographs):
        pictures.append(image(_residual(measurement.residuals[k])[crop], f"residual: {photograph.name}"))
    page.figure(
        "Labels by material, the prediction of each photograph by the estimates, and what is left: white where the noise "
        "explains it, red brighter and blue darker than predicted, full colour at 5 standard deviations. At the rims a "
        "pixel holds both ball and background; where light grazes, a pixel holds lit and unlit surface. Both are outside "
        "the fit.",
        "".join(pictures),
    )
    used = _fitted_residuals(report.capture, measurement)
    page.figure(
        f"Residuals of the values that were open to the fit, against the normal law: standard deviation "
        f"{np.std(np.clip(used, -6, 6)):.3f}, {100 * np.mean(np.abs(used) > 3):.2f} % beyond 3 (normal: 0.27 %).",
        residual_histogram(used),
    )
    remarks = [f"{m.name}: {remark}" for m in measurement.materials for remark in m.remarks]
    if remarks:
        page.text("The measurement remarks:")
        page.bullets(remarks)


def _relit_view(page: Page, report: Report) -> None:
    page.section(
        "A lamp it never saw",
        "The samples, rendered with the measured reflectances under the lamp kept aside, beside the photograph taken under "
        "it. The last row of the table renders the true reflectances instead: what then remains is the noise of the "
        "photograph and its demosaicing at the rims, and no measurement can do better.",
    )
    crop = _around(report.relit.mask)
    pictures = report.relit.pictures()
    titles = {"photograph": "photograph", "predicted": "prediction", "difference": "prediction − photograph, ten times"}
    page.figure(
        "Relit view beside the photograph, and their difference enlarged ten times (grey is none).",
        "".join(image(pictures[key][crop], title) for key, title in titles.items()),
    )
    rows = [
        [name, f"{d['psnr']:.2f}", f"{d['ssim']:.4f}", f"{d['delta_e_2000']:.2f}", f"{100 * d['relative_rmse']:.2f} %"]
        for name, d in (("measured reflectances", report.relit.measured), ("true reflectances", report.relit.ideal))
    ]
    page.table(
        f"Difference from the photograph over {report.relit.measured['pixels']:,} pixels, in linear sRGB; 1, the peak of "
        "the PSNR and the white of ΔE<sub>00</sub>, is a white diffuser that faces the lamp. Relative RMSE: over the root "
        "mean square of the photograph. <code>hagoromo compare</code> of the files in <code>relit/</code> repeats "
        "it, with the largest value as the peak.".replace(",", " ", 1),
        ("rendered with", "PSNR [dB]", "SSIM", "mean ΔE<sub>00</sub>", "relative RMSE"),
        rows,
    )


def _figures(page: Page, report: Report) -> None:
    size = report.record["size"]
    page.section(
        "Figures 6 to 8 of the paper",
        "Volume boxes filled with the measured reflectances, under three white point lamps: a key high on the left, a weak "
        "fill on the right and a rim light from behind. The background is a sweep of the measured dielectric. The camera "
        f"is the same, with a binning of {size['figure_binning']}; {size['figure_samples']} rays a pixel; boxes of about "
        f"{size['resolution']} voxels a side. Light is attenuated on its way in and out and scattered once.",
    )
    for name, text in FIGURES.items():
        picture = report.figures[name].display()
        number = name.split("_")[1]
        height, width = picture.shape[:2]
        page.figure(f"{text} (Figure {number} of the paper; {width} × {height} pixels.)", image(picture, ""))


def _other_light(page: Page, report: Report) -> None:
    whole = report.figures["figure_8_whole"]
    lamps = whole.palette.lamps
    canon, nikon = _response(report.aside), Response.load(OTHER_CAMERA)
    warm = [Spectrum.named(OTHER_LAMP)] * len(lamps)
    matrices = {key: srgb_from_camera(*pair) for key, pair in {
        "canon": (canon, lamps[0]), "nikon": (nikon, warm[0])}.items()}  # fmt: skip
    views = [
        ("Canon, D65", whole.expose(canon), matrices["canon"]),
        ("Canon balanced for D65, lamp A", whole.expose(canon, warm), matrices["canon"]),
        ("Nikon D5100 balanced for lamp A, lamp A", whole.expose(nikon, warm), matrices["nikon"]),
    ]
    page.section(
        "One rendering, other light, another camera",
        "A rendering is kept as geometric weights of body and interface colours, so eq. (10) can be evaluated anew for any "
        "lamp spectrum and any camera. These three views come from the same file, <code>figures/figure_8_whole.exr</code>; "
        "nothing was rendered again.",
    )
    page.figure(
        "The whole figure through the Canon under daylight D65; under incandescent light (illuminant A), the camera still "
        "balanced for daylight; and under the same light through a Nikon D5100 (measured sensitivities), balanced for it.",
        *(image(shown(values, m, exposure(values @ m.T, whole.alpha)), title) for title, values, m in views),
    )


def _settings(page: Page, report: Report) -> None:
    record = report.record
    page.section("Settings, versions, times")
    figures = [["size", record["size"]["name"]], ["seed", str(record["size"]["seed"])], ["backend", record["backend"]]]
    figures += [["hagoromo", record["hagoromo"]], *([name, number] for name, number in record["versions"].items())]
    page.table(
        "Settings and versions; all are in <code>results.json</code> and in the headers of the EXR files.",
        ("", ""),
        figures,
    )
    seconds = record["seconds"]
    times = [[name, f"{value:.1f}"] for name, value in seconds.items()] + [["sum", f"{sum(seconds.values()):.1f}"]]
    page.table("Time of each stage on this machine, without start-up and this report.", ("stage", "seconds"), times)


def _limits(page: Page, report: Report) -> None:
    page.section("What this does not show")
    page.bullets([
        "The photographs are simulated by the model that is then fitted. Lamps, lens, spectral response and the shape of "
        "the balls are known exactly. Intervals are therefore as narrow as noise alone makes them; in front of a real "
        "camera the errors of calibration and shape come on top.",
        "The true parameters and spectra are plausible figures written for this demo, not measurements of persons, "
        "textiles or birds.",
        "Three channels do not tell a spectrum. Colours under the lamp of the capture and through this camera are right; "
        "under another lamp they are those of the smooth spectrum, which is one of many.",
        "Light is scattered once. Skin looks harder than it is, folds and feathers darker in their depth.",
        "The reflectance is measured on smooth balls and then given to micro-elements of the same material, as the paper "
        "does; the shapes of the boxes are drawn, not measured.",
        "All lamps are points: shadows have sharp edges.",
    ])  # fmt: skip


def _table_row(row: Row, first: bool) -> list[str]:
    symbol = SYMBOLS.get(row.parameter, f"c<sub>{row.parameter[-1]}</sub>")
    inside = ("yes" if row.inside else '<span class="no">no</span>') if row.identifiable else "–"
    numbers = [f"{row.true:.5f}", f"{row.estimate:.5f}"]
    interval = f"{row.low:.5f} … {row.high:.5f}" if np.isfinite(row.high) else "open"
    return [row.material if first else "", symbol, *numbers, interval, "yes" if row.identifiable else "no", inside]


def _response(photograph: Photograph) -> Response:
    assert photograph.camera.response is not None
    return photograph.camera.response


def _developed(photograph: Photograph) -> NDArray[np.uint8]:
    matrix = srgb_from_camera(_response(photograph), photograph.lamps[0].spectrum)
    return shown(photograph.values, matrix, exposure(photograph.values @ matrix.T))


def _around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of what is true, with a twelfth of its height around it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    edge = (rows[-1] - rows[0]) // 12 + 1
    return slice(max(rows[0] - edge, 0), rows[-1] + edge), slice(max(columns[0] - edge, 0), columns[-1] + edge)


def _labels(measurement: Measurement) -> NDArray[np.uint8]:
    colours = [COLOURS.get(material.name, "#000000") for material in measurement.materials]
    table = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in colours] + [[245, 245, 245]], np.uint8)
    return table[measurement.labels]


def _residual(residual: NDArray) -> NDArray[np.uint8]:
    """Mean residual of the channels: white at 0, red above, blue below, light grey where unknown."""
    mean = residual.mean(axis=2)
    strength = np.clip(np.nan_to_num(mean) / 5.0, -1.0, 1.0)
    fading = 1.0 - np.abs(strength)
    picture = np.stack([np.where(strength > 0, 1.0, fading), fading, np.where(strength < 0, 1.0, fading)], axis=2)
    return np.rint(255.0 * np.where(np.isnan(mean)[..., None], 0.88, picture)).astype(np.uint8)


def _fitted_residuals(capture: Capture, measurement: Measurement) -> NDArray:
    """Residuals (n,) of the values that the sensor measured itself, of pixels lit and seen beyond grazing."""
    pixels, found = Pixels.where(capture, known_shape(capture) & (measurement.labels >= 0)), []
    for photograph, residual in zip(capture.photographs, measurement.residuals, strict=True):
        seen = sight(photograph, pixels.points, pixels.normals)
        at = pixels.rows[seen.fit_to_use], pixels.columns[seen.fit_to_use]
        native = np.ones(residual.shape, bool) if photograph.native is None else photograph.native
        found.append(residual[at][native[at] & np.isfinite(residual[at])])
    return np.concatenate(found)
