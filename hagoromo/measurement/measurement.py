"""Measurement: everything that photographs of an object say about its materials and its surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.png import png_data_uri
from hagoromo.files.whole import whole_folder
from hagoromo.measurement.error_files import SharedErrors
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.health.health import Health
from hagoromo.measurement.lamp_departure import LampDeparture
from hagoromo.measurement.material.body_map import BodyMap, Separation
from hagoromo.measurement.photographed import Photographed, photographed
from hagoromo.measurement.photometric.term import TermEstimate
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import Exponent
from hagoromo.photograph.rig import Rig
from hagoromo.reflectance.material.material_estimate import MaterialEstimate, materials_html
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate

if TYPE_CHECKING:
    from hagoromo.measurement.material.lamp_colour import LampColour
    from hagoromo.measurement.normals.normals import NormalMap
    from hagoromo.measurement.surface.own_light import OwnLight
    from hagoromo.measurement.surface.tiles import Fine

NAMES_SHOWN, LONGEST_SHOWN_NAME = 4, 24  # materials, and characters of each name, that `repr` shows
LARGEST_PICTURE_PX = 256  # px, at most, of a side of the picture in a notebook


@dataclass(frozen=True, eq=False, repr=False)
class Measurement:
    """The result of `measure`, of photographs of h × w pixels in C channels.

    materials: by falling number of pixels. labels: (h, w) index into materials, −1 unknown. normals: (h, w, 3) unit,
    world axes, 0 where unknown. points: (h, w, 3) [m], world axes, 0 where unknown.
    predicted: per photograph (h, w, C) values that the materials predict, NaN where they predict nothing. residuals:
    per photograph (h, w, C), values − predicted in stated standard deviations, NaN where nothing is predicted or the
    pixel is invalid.
    body: α c_b of each pixel [1/sr] and, where it varies, the gloss of each pixel. separation: the photograph with the
    largest share of gloss, separated into its diffuse (body) and specular (interface) parts. body_spectra: name of a
    material → spectrum of its body colour, of mean 1 over the channels. lamp_colour: where it was measured.
    normal_variance: (h, w) of the direction of solved normals [rad²]. distance_variance: (h, w) of the distance from
    the camera to solved points [m²]: of all errors. Both are inf where unknown, and None where the shape was given.
    summed_variance: (h, w) own variance of normals [rad²] as it counts in sums over pixels, where normals were
    smoothed, so that errors of neighbours are alike. None: as `normal_variance` less what is shared.
    shared_errors: those of both that all pixels share; None where they were not estimated.
    capture: the photographs that were measured, with their shape. fine: full-size maps of photographs that were solved
    in tiles; all else is then of a small capture of means over squares of pixels. normal_map: the photometric fit of a
    shape that was solved.
    settings: those of `measure`, and seed: of its random numbers. assumptions: what is taken for given, in words.
    linearity: the exponent that the shading asks of the values, 1 if they are linear in light; None: not tested.
    health: what the photographs say of order, lamps, strengths, transfer, motion, blur, mask and calibration.
    lamp_departure: how far the lamps that a solved shape shows depart from the stated ones; None: they were not fitted.
    own_light: the light that a solved surface sends to itself; None where the shape was given.
    rig: the rig by which the photographs were evened, and rig_share: how much of the differences in strength that were
    stated holds for them (`rig` has them so). None: they were not evened.
    terms: what all photographs have in common (`estimate` of `measure`), name → estimate; all else is measured without
    it.
    photographed: camera and lamps, of a measurement that `load` read; `photographed_with` has those of any.
    A measurement that `load` read has no lamp_colour, capture, fine, normal_map and lamp_departure (None), and no
    predicted and residuals (empty).
    """

    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.integer]
    predicted: tuple[NDArray[np.float32], ...]
    residuals: tuple[NDArray[np.float32], ...]
    normals: NDArray[np.float32]
    points: NDArray[np.floating] | None = None
    body: BodyMap | None = None
    separation: Separation | None = None
    body_spectra: Mapping[str, SpectrumEstimate] = field(default_factory=dict)
    lamp_colour: LampColour | None = None
    normal_variance: NDArray[np.float32] | None = None
    distance_variance: NDArray[np.float32] | None = None
    summed_variance: NDArray[np.float32] | None = None
    shared_errors: SharedErrors | None = None
    capture: Capture | None = None
    fine: Fine | None = None
    normal_map: NormalMap | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    assumptions: Mapping[str, str] = field(default_factory=dict)
    linearity: Exponent | None = None
    health: Health | None = None
    lamp_departure: LampDeparture | None = None
    photographed: Photographed | None = None
    own_light: OwnLight | None = None
    rig: Rig | None = None
    rig_share: float = 1.0
    terms: Mapping[str, TermEstimate] = field(default_factory=dict)

    @property
    def gloss(self) -> GlossMap | None:
        """β and γ of each pixel, where the gloss varies over a material."""
        return None if self.body is None else self.body.gloss

    @property
    def photographed_with(self) -> Photographed | None:
        """Camera and lamps, the camera of the size of the full-size maps; None in files of version 0.2."""
        if self.capture is None:
            return self.photographed
        height, width = (self if self.fine is None else self.fine).labels.shape
        return photographed(self.capture, (width, height))

    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write the data files to `folder`, whole or not at all; see `write_into` for the files.

        `InputError` when the folder exists and is not empty without `force`, or holds files of another program.
        """
        with whole_folder(folder, force) as home:
            self.write_into(home)
        return Path(folder)

    def write_into(self, folder: str | Path) -> None:
        """Write the data files into an existing folder.

        materials.json; labels.png (0 unknown, 1 the first material, …); normals.exr (N.X, N.Y, N.Z); points.exr (P.X,
        P.Y, P.Z); body.exr (α c_b and its standard error `error.*` where known); gloss.exr (β, γ and their standard
        errors) where gloss varies; variance.exr (normal, distance, and of each what is its pixel's own) where
        the shape was solved, shared_errors.exr: what all pixels share; body_spectra.json where
        lamp and response are known; separation_NN.exr and pictures of both parts; residual_NN.png: white within the
        noise, red brighter and blue darker than predicted, full colour at 5 standard deviations, grey unknown;
        own_light.exr and own_light.json: the share of the light that a solved surface sends to itself; health.json: the
        checks of the photographs;
        camera.json, response.csv and lamps.json: what the photographs were taken with; rig.json: the rig;
        terms.json: what was estimated of all photographs together.
        """
        from hagoromo.measurement.measurement_files import write_measurement

        write_measurement(self, Path(folder))

    @classmethod
    def load(cls, folder: str | Path) -> Measurement:
        """Read what `save`, or the command `measure`, wrote to `folder`.

        Maps are single precision. Of photographs that were solved in tiles the maps are the full-size ones. predicted
        and residuals are empty; lamp_colour, capture, fine, and each map without a file are None.
        `InputError` for files that are missing, damaged or do not go together.
        """
        from hagoromo.measurement.measurement_files import read_measurement

        return read_measurement(Path(folder))

    def __repr__(self) -> str:
        shown = [_shortened(material.name) for material in self.materials[:NAMES_SHOWN]]
        names = ", ".join([*shown, *(["…"] if len(self.materials) > NAMES_SHOWN else [])])
        return f"Measurement({self._summary()}: {names})"

    def _repr_html_(self) -> str:
        uri = png_data_uri(self._picture())
        picture = f'<figure><img alt="normals" src="{uri}"><figcaption>normals</figcaption></figure>'
        return f"<p>{escape(self._summary())}</p>{materials_html(self.materials)}{picture}"

    def _summary(self) -> str:
        """`'ball', 97 × 89 px, 2 materials`."""
        height, width = self.labels.shape if self.fine is None else self.fine.labels.shape
        name = "" if self.capture is None or not self.capture.name else f"{_shortened(self.capture.name)!r}, "
        count = len(self.materials)
        return f"{name}{width} × {height} px, {count} material{'' if count == 1 else 's'}"

    def _picture(self) -> NDArray[np.uint8]:
        """The normals as colours: −1 … 1 on each world axis as 0 … 255, white where unknown."""
        step = max(-(-max(self.normals.shape[:2]) // LARGEST_PICTURE_PX), 1)
        normals = self.normals[::step, ::step]
        known = np.linalg.norm(normals, axis=2, keepdims=True) > 0.5
        return np.where(known, np.rint(127.5 * (normals + 1.0)), 255).astype(np.uint8)


def _shortened(name: str) -> str:
    return name if len(name) <= LONGEST_SHOWN_NAME else name[: LONGEST_SHOWN_NAME - 1] + "…"
