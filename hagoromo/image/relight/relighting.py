"""Relighting: the measured object as volume boxes, and the photographs that these predict."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

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
MEASURED_FOLDER = "measured"  # folder of the measurement


@dataclass(frozen=True, eq=False, repr=False)
class Relighting:
    """The result of `relight`.

    measurement: of the photographs that were not held out. stage: its surface as a recipe of a volume box.
    predictions: one for each photograph that was held out.
    """

    measurement: Measurement
    stage: Stage
    predictions: tuple[Prediction, ...]

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
        held = [one.name for one in self.predictions]
        stated = written_by({**self.measurement.settings, "held_out": held}, self.measurement.seed)
        write_json(home / "relit.json", [one.record() | {"hagoromo": stated} for one in self.predictions])

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
