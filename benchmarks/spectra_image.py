"""Reflectance spectra of a whole image: pixels a CPU second of one thread, under one lamp and under two.

    OPENBLAS_NUM_THREADS=1 python benchmarks/spectra_image.py [--pixels 100000] [--rounds 3]

An image of 24 measured surfaces, in half to full light, each mixed with up to 30 % of another one, with shot and read
noise. Read by canon_eos_300d, estimated with all priors that
`hagoromo spectra` weighs. The least CPU times of rounds in turn go to out/bench/spectra_image.json;
`benchmarks/page.py` puts them into docs/performance.md.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from turns import options, record

import hagoromo as hg
from hagoromo.reflectance.spectra.prior_spectra import surfaces
from hagoromo.reflectance.spectra.reflectance_prior import PRIORS

LAMPS = {"D65": ("D65",), "D65 and A": ("D65", "A")}
SURFACES, DRIFT = 24, 0.3  # of the image; largest share of another surface in one
SHOT, READ = 0.005, 0.001  # noise of a reading of white, and of black [white]
Array = NDArray[np.float64]


def main() -> None:
    """Estimate the images in turn, and record the least times."""
    parser = options(__doc__, 3)
    parser.add_argument("--pixels", type=int, default=100_000)
    asked = parser.parse_args()
    camera = hg.Response.load("canon_eos_300d")
    priors = [hg.ReflectancePrior.load(name) for name in PRIORS]
    reflectances = image(asked.pixels)
    cases = {}
    for name, lamps in LAMPS.items():
        matrix = np.concatenate([hg.reading_matrix(hg.Spectrum.named(lamp), camera) for lamp in lamps])
        cases[name] = matrix, *read(matrix, reflectances)
    times: dict[str, list[float]] = {name: [] for name in cases}
    explained = {}
    for _ in range(asked.rounds):
        for name, (matrix, values, errors) in cases.items():
            start = time.process_time()
            spectra = hg.estimate_spectra(matrix, values, errors, priors)
            times[name].append(time.process_time() - start)
            explained[name] = float(spectra.explained.mean())
    rows = [
        {"lamps": name, "pixels": asked.pixels, "cpu_s": min(taken), "pixels_per_s": asked.pixels / min(taken),
         "explained": explained[name]}
        for name, taken in times.items()
    ]  # fmt: skip
    for row in rows:
        print(row)
    record("spectra_image", rows)


def image(pixels: int, seed: int = 0) -> Array:
    """(pixels, wavelengths): reflectance, times the share of the light, of every pixel."""
    random = np.random.default_rng(seed)
    every = surfaces()
    chosen, others = every[random.choice(len(every), (2, SURFACES), replace=False)]
    which, place = random.integers(0, SURFACES, pixels), random.uniform(0.0, DRIFT, (pixels, 1))
    return random.uniform(0.5, 1.0, (pixels, 1)) * ((1.0 - place) * chosen[which] + place * others[which])


def read(matrix: Array, reflectances: Array, seed: int = 1) -> tuple[Array, Array]:
    """(pixels, m) readings of surfaces, relative to white, and their standard errors."""
    exact = reflectances @ matrix.T
    errors = np.sqrt(SHOT**2 * exact + READ**2)
    return exact + errors * np.random.default_rng(seed).standard_normal(exact.shape), errors


if __name__ == "__main__":
    main()
