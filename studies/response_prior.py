"""What published cameras have in common: mean curve, principal components and roughness, per channel.

    python -m studies.response_prior ../shared/data > hagoromo/calibration/response/published_curves.py

The mean is that of camspec's 28 and rawtoaces' 11 cameras; the components are those of rawtoaces' (Apache-2.0). No
curve of a camera can be had from them. The other figures maximise the likelihood of camspec's curves.
"""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

from hagoromo.calibration.response.curve_process import KNEE, NODES, PublishedCurve, published_process
from studies.command import command
from studies.spectra_bench import CAMERAS, OTHERS, read_cameras, read_rawtoaces

MEASURED_NM = (400.0, 720.0)  # of camspec's curves, and the range over which a curve has mean 1
DARKEST = 1e-3  # curves below are noise
COUNT = 4  # of components
Array = NDArray[np.float64]


def published_curves(folder: str | Path) -> tuple[dict[str, Array], dict[str, Array]]:
    """Camera → z (3, nodes) of camspec's (NaN outside 400–720 nm) and of rawtoaces' cameras."""
    sets = []
    for cameras in (read_cameras(Path(folder) / CAMERAS), read_rawtoaces(Path(folder) / OTHERS)):
        curves = {}
        for name, camera in cameras.items():
            each = np.array([camera.curve(c).at(NODES) for c in range(3)])
            inside = (NODES >= MEASURED_NM[0]) & (NODES <= MEASURED_NM[1])
            curves[name] = latent(each / each[:, inside].mean(axis=1, keepdims=True))
            if camera.wavelengths[-1] < NODES[-1]:
                curves[name][:, ~inside] = np.nan
        sets.append(curves)
    return sets[0], sets[1]


def latent(curve: Array) -> Array:
    """z of a curve: the inverse of `positive`."""
    share = np.maximum(curve, DARKEST) / KNEE
    return KNEE * (share + np.log1p(-np.exp(-share)))


def learnt(measured: list[Array], others: list[Array]) -> tuple[PublishedCurve, Array]:
    """Figures and components of one channel from z (nodes,) of camspec's and of rawtoaces' cameras."""
    from scipy.optimize import minimize

    inside = (NODES >= MEASURED_NM[0]) & (NODES <= MEASURED_NM[1])
    mean = np.nanmean(np.array([*measured, *others]), axis=0)
    off = np.array(others) - np.mean(others, axis=0)
    _, scale, directions = np.linalg.svd(off, full_matrices=False)
    components = scale[:COUNT, None] * directions[:COUNT] / np.sqrt(len(others) - 1)
    seen = np.array([z[inside] for z in measured])

    def figures(parameters: Array) -> PublishedCurve:
        share, dark, light, length, rough_dark, rough_light = np.exp(parameters)
        return PublishedCurve(tuple(mean), float(share), (dark, light), (rough_dark, rough_light), float(length))

    def cost(parameters: Array) -> float:
        at, kernel = published_process(NODES[inside], mean, components, figures(parameters))
        root = np.linalg.cholesky(kernel)
        return float(
            (0.5 * (np.linalg.solve(root, (seen - at).T) ** 2).sum(axis=0) + np.log(np.diag(root)).sum()).mean()
        )

    start = np.log([0.7, 0.3, 0.3, 40.0, 0.02, 0.08])
    found = minimize(cost, start, method="Nelder-Mead", options={"maxfev": 600, "xatol": 0.03, "fatol": 0.01})
    return figures(found.x), components


def written(folder: str | Path) -> str:
    """The module `published_curves`."""
    measured, others = published_curves(folder)
    means, components = [], []
    for channel, name in enumerate("RGB"):
        figures, parts = learnt([z[channel] for z in measured.values()], [z[channel] for z in others.values()])
        one = figures._replace(
            mean=tuple(round(float(v), 2) for v in figures.mean), share=round(figures.share, 2),
            smooth=tuple(round(float(v), 3) for v in figures.smooth),
            rough=tuple(round(float(v), 3) for v in figures.rough), length=round(figures.length, 1),
        )  # fmt: skip
        means.append(f'    "{name}": {one!r},')
        rows = [tuple(round(float(v), 2) for v in part) for part in parts]
        components.append(f'    "{name}": (' + ", ".join(map(repr, rows)) + "),")
    lines = ["MEANS = {", *means, "}", "COMPONENTS = {", *components, "}"]
    return HEAD + "\n".join(fill(line, 118, subsequent_indent=" " * 8) for line in lines) + "\n"


HEAD = '''"""What 39 published cameras have in common, per channel: made by `python -m studies.response_prior`.

z of the mean curve, R = κ log(1 + exp(z/κ)) of mean 1 over 400–720 nm, at `NODES`: the mean of the cameras of Jiang et
al. 2013, "What is the space of spectral sensitivity functions for digital color cameras?" (28 cameras, 400–720 nm), and
of rawtoaces (11 cameras, Apache-2.0). Components: of rawtoaces' cameras alone, each times its standard deviation.
"""

from hagoromo.calibration.response.curve_process import PublishedCurve

# fmt: off
'''


def main(folder: Positional[Path]) -> None:
    """Write the module of what the cameras in FOLDER have in common to standard output."""
    print(written(folder), end="")


if __name__ == "__main__":
    command(main)
