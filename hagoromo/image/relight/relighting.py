"""Relighting: the measured object as volume boxes, and the photographs that these predict."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.files.png import png_data_uri
from hagoromo.files.record import write_json, written_by
from hagoromo.files.whole import whole_folder
from hagoromo.image.relight.prediction import PREDICTIONS, Prediction
from hagoromo.image.relight.stage import Stage
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.measurement import Measurement

FIGURE_TITLES = ("photograph", "prediction", "relative rmse", "ΔE00, mean", "PSNR [dB]", "SSIM")
LARGEST_PICTURE_PX = 256  # px, at most, of a side of a picture in a notebook
LEAST_ADVISED = 0.1  # of the error: advice that brings less is not given
MEASURED_FOLDER = "measured"  # folder of the measurement


@dataclass(frozen=True, eq=False, repr=False)
class Relighting:
    """The result of `relight`.

    measurement: of the photographs that were not held out. stage: its surface as a recipe of a volume box.
    predictions: one for each photograph that was held out. left_out: relative error with which the boxes, with what was
    learnt, predict the photographs that were measured, each left out in turn, its lamp as the others show it; None
    where nothing was learnt.
    """

    measurement: Measurement
    stage: Stage
    predictions: tuple[Prediction, ...]
    left_out: float | None = None

    @property
    def expected(self) -> tuple[float, float] | None:
        """Relative error of a photograph under a further lamp of the measured view, and that if the lamp were known.

        None where the shape was given, or nothing was learnt.
        """
        departure = self.measurement.lamp_departure
        if departure is None or self.left_out is None:
            return None
        return float(np.hypot(self.left_out, departure.photograph)), self.left_out

    @property
    def advice(self) -> str | None:
        """How far off a photograph under a further lamp is, and what would bring it nearer, where its lamp matters.

        None where the photographs do not show that the lamps depart from the stated ones, or it matters little.
        """
        departure = self.measurement.lamp_departure
        if departure is None or self.expected is None or not departure.significant:
            return None
        expected, known = self.expected
        if known > (1.0 - LEAST_ADVISED) * expected:
            return None
        what = (
            "measure the lamps on a white card or on other objects (hagoromo calibrate rig) and give --rig"
            if self.measurement.rig is None
            else "measure the rig on more objects, as high as this one"
        )
        return (
            f"{departure.sentence[0].upper()}{departure.sentence[1:]}. A photograph under a further lamp is then off "
            f"by about {100 * expected:.2g} %, by {100 * known:.2g} % if that lamp were known: {what}"
        )

    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write the data files to `folder`, whole or not at all; see `write_into` for the files.

        `InputError` when the folder exists and is not empty without `force`, or holds files of another program.
        """
        with whole_folder(folder, force) as home:
            self.write_into(home)
        return Path(folder)

    def write_into(self, folder: str | Path) -> None:
        """Write the data files into an existing folder.

        measured: the files of `Measurement.write_into`; relief.toml, camera.json and response.csv: the recipe of the
        volume box, for `build`; for each photograph scene_NN.toml with response_NN.csv, for `render`; photograph_NN,
        predicted_NN, predicted_learnt_NN, normals_NN, learnt_NN and lambert_NN as EXR and PNG and mask_NN.png, for
        `compare`; relit.json: the figures.
        """
        home = Path(folder)
        (home / MEASURED_FOLDER).mkdir()
        self.measurement.write_into(home / MEASURED_FOLDER)
        self.stage.write_into(home)
        for one in self.predictions:
            self.stage.write_scene(one.source, one.number, home)
            one.write_into(home)
        write_json(home / "relit.json", self.records())

    def records(self) -> list[dict[str, Any]]:
        """The entries of relit.json: one for each photograph that was predicted."""
        held = [one.name for one in self.predictions]
        stated = written_by({**self.measurement.settings, "held_out": held}, self.measurement.seed)
        found = self.measurement.linearity
        shared = {"linearity": None if found is None else found.record(), "hagoromo": stated}
        return [one.record() | shared for one in self.predictions]

    def __repr__(self) -> str:
        shown = ", ".join(map(repr, self.predictions[:3]))
        return f"Relighting({shown}{', …' if len(self.predictions) > 3 else ''})"

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{cell}</th>" for cell in FIGURE_TITLES)
        body = "".join(_rows(one) for one in self.predictions)
        pictures = "".join(_pictures(one) for one in self.predictions)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{pictures}"


def _rows(one: Prediction) -> str:
    rows = []
    for key, figures in one.compared.items():
        psnr = "∞" if figures.psnr is None else f"{figures.psnr:.1f}"
        error, colour = f"{100 * figures.relative_rmse:.1f} %", f"{figures.delta_e_2000:.2f}"
        cells = (escape(one.name), PREDICTIONS[key], error, colour, psnr, f"{figures.ssim:.3f}")
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "".join(rows)


def _pictures(one: Prediction) -> str:
    """Photograph and rendered boxes side by side, small."""
    step = max(-(-max(one.mask.shape) // LARGEST_PICTURE_PX), 1)
    both = [one.photograph[::step, ::step], one.predictions[one.of_boxes][::step, ::step]]
    caption = f"{escape(one.name)}: photograph and prediction"
    uri = png_data_uri(srgb_encode(np.concatenate(both, axis=1)))
    return f'<figure><img alt="{caption}" src="{uri}"><figcaption>{caption}</figcaption></figure>'
