"""Expose: image → image under other lamps; image → Photograph, through response (eq. 10) and sensor (MODEL §6)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import develop_raw, expose_raw, native_channels
from hagoromo.errors import InputError
from hagoromo.files.finite import check_finite
from hagoromo.image.picture.image import Image, StrengthOfLamp, read_image
from hagoromo.image.scene.scene import Scene
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.photograph import Photograph

LEAST_LIT_SHARE = 0.05  # share of a picture


def expose(
    image: Image | str | Path,
    strength: StrengthOfLamp | None = None,
    spectrum: Mapping[Any, Any] | None = None,
) -> Image:
    """An image with the strengths and spectra of lamps changed, without a new rendering; see `Image.with_lamps`.

    image: or the path of an EXR that `Image.save` wrote. strength: factor on the intensity of a lamp, by its name or
    its number from 0. spectrum: likewise, what `Spectrum.load` takes, such as the name of an illuminant or a CSV file.
    `InputError` as `read_image`, `Spectrum.load` and `Image.with_lamps`.

        hg.expose("scene.exr", strength={"key": 2.0}, spectrum={"fill": "A"}).save("warm.exr")
    """
    taken = image if isinstance(image, Image) else read_image(image)
    return taken.with_lamps(strength, {name: Spectrum.load(source) for name, source in (spectrum or {}).items()})


def photograph(image: Image, scene: Scene, seed: int = 0, name: str = "", percentile: float = 99.5) -> Photograph:
    """The photograph that the scene's camera takes of `image`: noise, mosaic and bits, developed with its variance.

    The sensor is metered so that the light at `percentile` fills four fifths of its range (100: nothing is clipped); of
    a picture that is nearly black, as if LEAST_LIT_SHARE of it were lit.
    """
    camera = scene.camera
    if camera.response is None or camera.sensor is None:
        raise InputError(f"camera {camera.name!r} has no response or no sensor: a photograph needs both")
    signal = image.expose(camera.response)
    check_finite({"its light": signal}, f"photograph {name!r}", "values")
    sensor = camera.sensor.metered(max(_metered(signal, percentile), 1e-30))
    developed = develop_raw(expose_raw(signal, sensor, seed), sensor)
    return Photograph(
        values=developed.values,
        variance=developed.variance,
        mask=developed.valid,
        camera=camera,
        lamps=scene.lamps,
        name=name,
        native=native_channels(sensor, camera.height, camera.width),
    )


def _metered(signal: NDArray, percentile: float) -> float:
    """The light at `percentile`."""
    lit = signal[signal > 0.0]
    if not 0 < lit.size < LEAST_LIT_SHARE * signal.size:
        return float(np.percentile(signal, percentile))
    return float(np.percentile(lit, max(100.0 - (100.0 - percentile) / LEAST_LIT_SHARE, 0.0)))
