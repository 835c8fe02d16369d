"""A simulated session with skin: three photographs of a forearm beside a colour chart, each under another lamp.

    python -m studies.skin --out skin

Output: daylight.png, halogen.png, tube.png (16-bit, linear, one exposure each), and truth.csv, the spectra of three
places of the arm. Their pigments are those of `hagoromo.reflectance.pigment` with a dye that the model does not have.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.reflectance.pigment import Pigment, skin_colour
from studies.command import command

LAMPS = {"daylight": "D65", "halogen": "A", "tube": "FL11"}
CAMERA = "Nikon 5100 (NPL)"
PLACES = {  # pigments, rectangle x y width height on a picture of 480 x 400
    "forearm": (Pigment(0.02, 0.012, 0.75), (20, 12, 120, 70)),
    "flushed": (Pigment(0.02, 0.045, 0.9), (180, 12, 120, 70)),
    "tanned": (Pigment(0.07, 0.02, 0.7), (340, 12, 120, 70)),
}
GLARE = 0.02  # reflection of the surface, alike at all wavelengths
NOISE, WHITE = 0.004, 0.85  # relative noise of a pixel at white, and white's share of the range
SIZE = (400, 480)
CHART = (60, 125, 60)  # left, top, distance of patches [px]
GAP = 6  # [px] between patches


def places() -> dict[str, hg.Spectrum]:
    """Name → reflectance: the model of skin, glare, and 3 % of a yellow dye (carotene) that it does not have."""
    spectra = {}
    for name, (pigment, _) in PLACES.items():
        skin = skin_colour(pigment)
        dye = 1.0 - 0.03 * np.exp(-0.5 * ((skin.wavelengths - 470.0) / 25.0) ** 2)
        spectra[name] = hg.Spectrum(skin.wavelengths, skin.values * dye + GLARE)
    return spectra


def skin(out: str | Path, seed: int = 0, force: bool = False) -> Path:
    """Photograph the arm beside the chart under each lamp, and write the pictures to the folder `out`."""
    random, camera = np.random.default_rng(seed), hg.Response.load(CAMERA)
    with hg.whole_folder(out, force) as home:
        for name, lamp in LAMPS.items():
            light = hg.Spectrum.named(lamp)
            white = hg.camera_white(light, camera)
            picture = _picture(light, camera) * WHITE / white.max()
            picture += NOISE * np.sqrt(np.maximum(picture, 0.01)) * random.standard_normal(picture.shape)
            hg.write_png(home / f"{name}.png", np.rint(65535.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint16))
        wavelengths = np.arange(400.0, 701.0, 10.0)
        columns = {name: spectrum.at(wavelengths) for name, spectrum in places().items()}
        hg.write_table(home / "truth.csv", {"wavelength_nm": wavelengths, **columns})
    return Path(out)


def _picture(light: hg.Spectrum, camera: hg.Response) -> NDArray[np.float64]:
    """(h, w, 3) ρ of the table, the chart on its black card, and the places of the arm."""
    picture = np.full((*SIZE, 3), 0.25) * hg.camera_white(light, camera)
    left, top, side = CHART
    picture[top - GAP : top + 4 * side, left - GAP : left + 6 * side] *= 0.1
    for number, patch in enumerate(hg.chart_spectra()):
        y, x = top + number // 6 * side, left + number % 6 * side
        picture[y : y + side - GAP, x : x + side - GAP] = hg.camera_response(patch, light, camera)
    for (_, (x, y, width, height)), spectrum in zip(PLACES.values(), places().values(), strict=True):
        picture[y : y + height, x : x + width] = hg.camera_response(spectrum, light, camera)
    return picture


def main(out: Path, seed: int = 0, force: bool = False) -> None:
    """Simulate the session.

    Args:
        out: folder to write.
        seed: of the noise.
        force: replace an existing folder.
    """
    print(f"wrote {skin(out, seed, force)}")


if __name__ == "__main__":
    command(main)
