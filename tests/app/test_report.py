"""Reports: every page escapes names, loads nothing from elsewhere, and says in words what its pictures show."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any, cast

import numpy as np
import pytest

from hagoromo.image.picture.compare import Comparison
from hagoromo.image.relight.prediction import PREDICTIONS, Prediction
from hagoromo.image.relight.relighting import Relighting
from hagoromo.measurement.lamp_departure import LampDeparture
from hagoromo.measurement.measure import measure
from hagoromo_page.publication.document import script_hash
from hagoromo_page.report.contact_sheet import contact_sheet
from hagoromo_page.report.findings import findings, missing
from hagoromo_page.report.measure_report import write_measure_report
from hagoromo_page.report.page import number_columns, page_drawing, page_picture, page_text
from hagoromo_page.report.relight_page import write_relight_report
from tests.app.published_ball import ball
from tests.inverse.simulated_ball import BallMaterial, simulate

HOSTILE = "<script>alert('\"&amp;\"')</script>"
GREY = np.full((5, 7, 3), 128, np.uint8)


class ElementsOfPage(HTMLParser):
    """Tags of a page, with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def assert_harmless(text: str) -> None:
    """No script but the viewer's, which the policy names; nothing loaded, every picture with words; figures from 1."""
    elements = ElementsOfPage(text).found
    policies = [a["content"] for tag, a in elements if tag == "meta" and a.get("http-equiv")]
    assert len(policies) == 1 and f"default-src 'none'; script-src {script_hash()};" in (policies[0] or "")
    scripts = [attributes for tag, attributes in elements if tag == "script"]
    assert all("src" not in attributes for attributes in scripts)
    held = [attributes.get("type") for attributes in scripts]
    assert set(held) <= {None, "application/json", "text/plain"} and held.count(None) == 1
    assert not {"link", "iframe", "object", "embed", "base", "form"} & {tag for tag, _ in elements}
    assert "@import" not in text and "url(http" not in text
    for tag, attributes in elements:
        assert not any(name.startswith("on") for name in attributes)
        if tag == "img":
            assert attributes["alt"] and (attributes["src"] or "").startswith("data:image/")
        if tag == "svg":
            hidden = attributes.get("aria-hidden") == "true"  # of drawings that lie over a picture
            assert hidden or (attributes["role"] in ("img", "application") and attributes["aria-label"])
    numbers = [int(number) for number in re.findall(r"<b>Figure (\d+)\.</b>", text)]
    assert numbers and numbers == list(range(1, len(numbers) + 1))


def test_the_report_of_a_measurement_is_harmless(tmp_path):
    ball = simulate([BallMaterial((0.20, 0.15, 0.10), 0.5, 0.15, 1.5)], 1)
    capture = replace(
        ball, name=HOSTILE, photographs=tuple(replace(photograph, name=HOSTILE) for photograph in ball.photographs)
    )
    measured = measure(capture)
    named = tuple(replace(m, name=HOSTILE, remarks=(HOSTILE,)) for m in measured.materials)
    write_measure_report(tmp_path / "report.html", replace(measured, materials=named))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert_harmless(text)
    assert "&lt;script&gt;" in text and "did not converge" not in text


@pytest.mark.nightly
def test_the_report_of_relit_photographs_is_harmless(tmp_path):
    picture = np.linspace(0.1, 0.9, 13 * 17 * 3).reshape(13, 17, 3)
    figures = Comparison(relative_rmse=0.1, delta_e_2000=1.0, psnr=None, ssim=0.9, peak=1.0, pixels=221)
    capture = replace(simulate([BallMaterial((0.20, 0.15, 0.10), 0.5, 0.15, 1.5)], 1, 41), name=HOSTILE)
    one = Prediction(
        name=HOSTILE,
        source=capture.photographs[0],
        photograph=picture,
        predictions={key: 0.9 * picture for key in PREDICTIONS},
        mask=np.ones((13, 17), bool),
        compared={key: figures for key in PREDICTIONS},
        lamps=(HOSTILE,),
        number=0,
        white=1.0,
        object_pixels=221,
    )
    measured = replace(measure(capture), lamp_departure=LampDeparture(0.04, 0.01, 0.001, (0.04,), True))
    write_relight_report(tmp_path / "report.html", Relighting(measured, cast(Any, None), (one,), 0.03))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert_harmless(text)
    assert text.count("<img") == 1 + 3 * len(PREDICTIONS)
    assert "A photograph under a further lamp is then off by about 5 %" in text
    assert text.index("the volume boxes differ from the photograph by") < text.index("How it was compared")


def test_what_is_not_determined_says_why_and_which_photograph_would_help(tmp_path):
    """Under three lamps on one side n is not identifiable; the page says so in a sentence, once."""
    _, measured = ball()
    found = [findings(material, 2000) for material in measured.materials]
    (sentence,) = missing(found)
    assert sentence.startswith("The refractive index n is not determined by these photographs: ")
    assert "A photograph that would: " in sentence and "told" not in sentence
    assert "half its height" in " ".join(found[0].sentences) and "50 %" in found[0].sentences[0]


def test_a_body_brighter_than_white_says_that_the_lamps_are_of_unknown_strength():
    """No body scatters more than it gets: 1000 % is a statement about the lamps, and so is any share of light."""
    dim, bright = (
        " ".join(findings(replace(ball()[1].materials[0], alpha=alpha), 2000).sentences) for alpha in (0.3, 3.3)
    )
    assert "scatters 94" in dim and "of light that comes straight on" in dim and "strength of the lamps" not in dim
    assert "because the strength of the lamps is not" in bright
    assert "scatters 1" not in bright and "straight on" not in bright and "half its height" in bright


def test_lambert_is_contradicted_only_beyond_the_error():
    material = ball()[1].materials[0]
    errors = {**material.standard_error, "epsilon": 0.003, "sigma": 0.003}
    near, far = (
        " ".join(findings(replace(material, epsilon=value, standard_error=errors), 2000).sentences)
        for value in (0.002, 0.1)
    )
    assert "Lambert" in far and "Lambert" not in near


@pytest.mark.nightly
def test_a_report_of_many_photographs_stays_small(tmp_path):
    """48 photographs of noise, which no JPEG likes, within 5 MB; one of them within what it takes."""
    capture, measured = ball()
    random = np.random.default_rng(5)
    noisy = [
        replace(shot, values=random.uniform(0.1, 1.0, shot.values.shape).astype(np.float32), name=f"{shot.name} {k}")
        for k in range(16)
        for shot in capture.photographs
    ]
    maps = tuple(np.asarray(one.values) for one in noisy)
    many = replace(measured, capture=replace(capture, photographs=tuple(noisy)), predicted=maps, residuals=maps)
    sheet = contact_sheet(many, lambda _, values: (255 * np.clip(values, 0, 1)).astype(np.uint8), 600_000)
    assert len(sheet) == 48 and sum(len(one) for frame in sheet for one in frame.pictures) < 2 * 600_000
    write_measure_report(tmp_path / "report.html", many)
    assert (tmp_path / "report.html").stat().st_size < 5e6


def test_words_of_pictures_are_escaped():
    assert "<script" not in page_picture(GREY, HOSTILE, HOSTILE) and "<script" not in page_drawing(
        "<svg></svg>", HOSTILE
    )


def test_a_fit_that_did_not_converge_has_its_line():
    empty: dict[str, Any] = {
        key: [] for key in ("head", "rows", "remarks", "findings", "missing", "maps", "spectra", "sheet")
    }
    values = {"name": "", "parameters": 4, "separation": None, "gloss": None, "viewer": "", "viewer_head": ""}
    text = page_text("measure.html.j2", unconverged=["skin: 40 steps"], **empty, **values)
    assert "Fits that did not converge" in text and "<li>skin: 40 steps</li>" in text


@pytest.mark.parametrize(
    ("column", "numeric"),
    [(["1.5", "−3 %", "–"], True), (["∞", ""], True), (["skin", "1"], False), (["", ""], False), (["0.1 … 0.2"], True)],
)
def test_columns_of_numbers_are_recognised(column, numeric):
    assert number_columns([[cell] for cell in column]) == [numeric]
