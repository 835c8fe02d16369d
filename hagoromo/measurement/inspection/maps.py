"""Maps: curvature, occlusion and decorrelation stretch of a measured surface, and their files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.record import written_by
from hagoromo.files.whole import whole_folder
from hagoromo.measurement.inspection.curvature import WIDTH, Curvature, curvature
from hagoromo.measurement.inspection.occlusion import DIRECTIONS, occlusion
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.inspection.stretch import By, Stretch, decorrelation_stretch
from hagoromo.measurement.measurement import Measurement
from hagoromo.progress import Progress, part_of, silent

CURVATURE_SHARE = 0.2  # approximate, of the time
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class InspectionMaps:
    """Maps of a surface of h × w pixels.

    known: (h, w) of the object. curvature: see `Curvature`. occlusion: (h, w) open share of the sky. stretch: of the
    body colours; None where they have none. pitch: width of a pixel on the object [mm], None without a scale. remarks:
    what is missing, and why.
    """

    known: NDArray[np.bool_]
    curvature: Curvature
    occlusion: Array
    stretch: Stretch | None
    pitch: float | None
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        height, width = self.known.shape
        return f"InspectionMaps({width} × {height} px: {'; '.join(self.sentences)})"

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is found, a line for each map."""
        bent = self.curvature.value[np.isfinite(self.curvature.value)]
        said = [f"no pixel has {2 * int(np.ceil(3 * self.curvature.width)) + 1} known ones on each side: no curvature"]
        if len(bent):
            low, high = np.percentile(bent, (1.0, 99.0))
            said = [f"curvature {low:.2g} to {high:.2g} 1/{self.curvature.unit} in 98 % of the pixels"]
            if self.curvature.error is not None:
                said[0] += f", known to ± {1.96 * np.nanmedian(self.curvature.error):.2g} (95 %, the median)"
        least = 100.0 * float(np.nanpercentile(self.occlusion, 1.0))
        said.append(f"a hundredth of the pixels sees less than {least:.0f} % of the sky")
        if self.stretch is not None:
            spread, noise = self.stretch.deviations, self.stretch.noise
            last = f"the faintest colours are amplified {spread[0] / spread[-1]:.3g} times more than the strongest"
            said.append(
                last if noise is None else f"{last}; {100 * min(noise[-1], 1.0):.0f} % of their variance is noise"
            )
        return tuple(said)

    def record(self) -> dict[str, Any]:
        """As maps.json has it."""
        stretch, error = self.stretch, self.curvature.error
        found: dict[str, Any] = {
            "hagoromo": written_by({"width": self.curvature.width, "stretch": None if stretch is None else stretch.by}),
            "pixel_mm": self.pitch,
            "curvature": {
                "unit": f"1/{self.curvature.unit}",
                "gaussian_px": self.curvature.width,
                "median_standard_error": None if error is None else float(np.nanmedian(error)),
            },
            "occlusion": {"unit": "share of the sky that is open", "directions": DIRECTIONS},
            "remarks": list(self.remarks),
        }
        if stretch is not None:
            found["stretch"] = {
                "unit": "standard deviations",
                "by": stretch.by,
                "mean": stretch.mean.tolist(),
                "matrix": stretch.matrix.tolist(),
                "deviations_of_components": stretch.deviations.tolist(),
                "noise_of_components": None if stretch.noise is None else stretch.noise.tolist(),
            }
        return found

    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write the files to `folder`, whole or not at all; see `write_into`."""
        with whole_folder(folder, force) as home:
            self.write_into(home)
        return Path(folder)

    def write_into(self, folder: str | Path) -> None:
        """Write the files into an existing folder.

        curvature.exr (`curvature`, `error.curvature`, `known`), occlusion.exr (`occlusion`, `known`), stretch.exr
        (R, G, B or 0, 1, …, and `known`): 0 where `known` is 0. curvature.png, occlusion.png, stretch.png: the same to
        look at, with a scale below the picture. maps.json: units, settings, numbers.
        """
        from hagoromo.measurement.inspection.map_files import write_maps

        write_maps(self, Path(folder))


def inspection_maps(
    measurement: Measurement | SeenSurface | str | Path,
    *,
    width: float = WIDTH,
    by: By = "correlation",
    progress: Progress = silent,
) -> InspectionMaps:
    """Mean curvature, occlusion and decorrelation stretch of a measured surface.

    measurement: a Measurement, or the folder that `measure` wrote. width: of the Gaussian under which normals are
    differentiated [px]. by: whether the channels of the stretch count alike ("correlation") or as they vary
    ("covariance"). `InputError` for a measurement without depth, and a bad width.
    """
    loaded = Measurement.load(measurement) if isinstance(measurement, (str, Path)) else measurement
    surface = loaded if isinstance(loaded, SeenSurface) else seen_surface(loaded)
    progress(0.0, "curvature")
    bent = curvature(surface, width)
    open_share = occlusion(surface, progress=part_of(progress, CURVATURE_SHARE, 1.0 - CURVATURE_SHARE))
    stretch, remarks = None, []
    if surface.body is None:
        remarks.append("no stretch: the measurement has no body colours")
    else:
        try:
            stretch = decorrelation_stretch(surface.body, surface.known, by, surface.body_error)
        except InputError as error:
            remarks.append(f"no stretch: {error}")
    if not surface.in_metres:
        remarks.append("the photographs have no scale: lengths are pixels")
    if bent.error is None:
        remarks.append("curvature has no error: the shape was given without one")
    pitch = 1e3 * surface.pitch if surface.in_metres else None
    return InspectionMaps(surface.known, bent, open_share, stretch, pitch, tuple(remarks))
