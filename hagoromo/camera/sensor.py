"""The sensor behind the lens (MODEL §6): electrons = exposure · ρ_c, noise, and the numbers (DN) that a raw file holds.

`expose` makes raw numbers of light, `develop_raw` makes of them the light again, with the variance of every pixel.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError

MOSAICS = ("", "RGGB", "BGGR", "GRBG", "GBRG")
Demosaic = Literal["bilinear", "menon2007"]
PAD = 8  # pixels of mirror image around a mosaic so that its border is demosaiced like its middle; even
# Bilinear demosaicing: weights of the samples of one colour around a pixel.
CROSS, SQUARE = np.array([[[0, 1, 0], [1, 4, 1], [0, 1, 0]], [[1, 2, 1], [2, 4, 2], [1, 2, 1]]]) / 4.0
BILINEAR = {"R": SQUARE, "G": CROSS, "B": SQUARE}
# Menon (2007) chooses its filter by the picture: variance of an interpolated value over the mean raw variance around
# it, measured on flat and sloping fields of white noise (both within 0.02).
MENON_VARIANCE = {"R": 1.02, "G": 0.84, "B": 1.02}
DEMOSAIC_REACH = {"bilinear": 1, "menon2007": 3}  # pixels around a saturated sample whose interpolated values it spoils
LEAST = {"gain": 1e-9, "exposure": 1e-30, "full_well": 1e-9}  # figures beyond which single precision has no variances
MOST = {"gain": 1e12, "exposure": 1e30, "full_well": 1e15, "read_noise": 1e9}
SATURATION_MARGIN = 4.0  # read noises below full well from which a sample counts as saturated


@dataclass(frozen=True)
class Sensor:
    """Figures of a sensor; `InputError` when they make none.

    exposure: electrons per unit of ρ. full_well: electrons a pixel holds. read_noise: standard deviation [e⁻].
    gain: electrons per DN. black_level: DN of no light. bits: of a DN, 1–16.
    mosaic: colours of the first 2 × 2 pixels by rows ("RGGB", ...), "" for a sensor that measures every channel.

    >>> sensor = hg.Sensor(exposure=1000, full_well=30_000, read_noise=5, gain=2, black_level=64, bits=14)
    >>> sensor.white_level  # DN: the well is full at 64 + 30,000/2, below 2¹⁴ − 1
    15064.0
    """

    exposure: float
    full_well: float
    read_noise: float
    gain: float
    black_level: float
    bits: int
    mosaic: str = ""

    def __post_init__(self) -> None:
        """Check every figure once."""
        for name in ("exposure", "full_well", "gain", "read_noise", "black_level", "bits"):
            figure, least = getattr(self, name), "at least" if name in ("read_noise", "black_level") else "above"
            if not np.isfinite(figure) or figure < 0.0 or (figure == 0.0 and least == "above"):
                raise InputError(f"the sensor's {name} is {figure}: it must be finite and {least} 0")
            if figure > MOST.get(name, np.inf) or 0.0 < figure < LEAST.get(name, 0.0):
                bounds = f"{LEAST.get(name, 0.0):g} to {MOST[name]:g}"
                raise InputError(f"the sensor's {name} is {figure:g}: it must be from {bounds}")
        if int(self.bits) != self.bits or self.bits > 16 or self.black_level >= self.largest:
            raise InputError(f"{self.bits} bits with black level {self.black_level}: give 1–16 bits, black below white")
        if self.mosaic not in MOSAICS:
            raise InputError(f"mosaic {self.mosaic!r} is unknown: choose one of {', '.join(map(repr, MOSAICS))}")

    @property
    def largest(self) -> int:
        """The largest DN that fits in `bits`."""
        return 2 ** int(self.bits) - 1

    @property
    def white_level(self) -> float:
        """DN at saturation: full well or the largest DN, whichever comes first."""
        return min(float(self.largest), self.black_level + self.full_well / self.gain)

    def metered(self, brightest: float, share: float = 0.8) -> Sensor:
        """The sensor exposed so that the light `brightest` (in units of ρ) fills `share` of its range."""
        if not np.isfinite(brightest) or brightest <= 0.0:
            raise InputError(f"the brightest light is {brightest}: nothing to expose for")
        return replace(self, exposure=share * (self.white_level - self.black_level) * self.gain / float(brightest))

    def binned(self, k: int) -> Sensor:
        """The sensor whose DN are means over k × k pixels: k² times the electrons, k times the read noise."""
        return replace(
            self,
            exposure=self.exposure * k**2,
            full_well=self.full_well * k**2,
            gain=self.gain * k**2,
            read_noise=self.read_noise * k,
        )


# 12 bits and RGGB are the camera's; well, noise and black level are round figures usual for sensors of its generation.
# The exposure lets ρ = 1 fill the well: meter it for the scene.
CANON_EOS_300D = Sensor(
    exposure=45_000.0, full_well=45_000.0, read_noise=15.0, gain=11.4, black_level=128.0, bits=12, mosaic="RGGB"
)


class Developed(NamedTuple):
    """Linear values (height, width, channels) in units of ρ, their variance, and valid (height, width)."""

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    valid: NDArray[np.bool_]


def expose_raw(signal: ArrayLike, sensor: Sensor, seed: int) -> NDArray[np.uint16]:
    """Raw DN of one exposure to `signal` (height, width, channels), in units of ρ; the same seed gives the same DN.

    Shot noise (Poisson), full well, read noise, black level, gain, rounding and clipping, in this order.
    Returns (height, width) behind a mosaic, else (height, width, channels). `InputError` for light that is negative
    or not finite.
    """
    signal = np.asarray(signal, np.float64)
    if signal.ndim != 3 or (sensor.mosaic and signal.shape[2] != 3):
        raise InputError(f"light of shape {signal.shape}: give (height, width, {3 if sensor.mosaic else 'channels'})")
    if not np.isfinite(signal).all() or signal.min(initial=0.0) < 0.0:
        raise InputError("the light on the sensor is negative or not finite: mend the image first")
    if sensor.mosaic:
        signal = np.take_along_axis(signal, _colours(sensor.mosaic, signal.shape[:2])[..., None], axis=2)[..., 0]
    random = np.random.default_rng(seed)
    expected = np.minimum(sensor.exposure * signal, 2.0 * sensor.full_well + 1000.0)  # all of these fill the well
    electrons = np.minimum(random.poisson(expected), sensor.full_well)
    electrons = electrons + random.normal(0.0, sensor.read_noise, electrons.shape)
    return np.clip(np.rint(sensor.black_level + electrons / sensor.gain), 0, sensor.largest).astype(np.uint16)


def develop_raw(raw: ArrayLike, sensor: Sensor, demosaic: Demosaic = "bilinear") -> Developed:
    """Light in units of ρ from raw DN (height, width) behind a mosaic, else (height, width, channels).

    The variance is shot + read + rounding, from the signal itself; one electron is added to it, as the score interval
    of a Poisson count has it, so that dark pixels keep honest intervals. Through "bilinear" it propagates exactly; for
    "menon2007", which chooses its filter by the picture, by the measured mean factors MENON_VARIANCE. Interpolated
    values are correlated with their neighbours and miss detail: `native_channels` says which are samples.
    A pixel is invalid when one of the samples that it is made of is saturated.
    """
    raw = np.asarray(raw, np.float64)
    if raw.ndim != (2 if sensor.mosaic else 3) or not np.isfinite(raw).all():
        wanted = "(height, width)" if sensor.mosaic else "(height, width, channels)"
        raise InputError(f"raw numbers of shape {raw.shape}: give finite numbers of shape {wanted}")
    electrons = (raw - sensor.black_level) * sensor.gain
    variance = np.maximum(electrons, 0.0) + 1.0 + sensor.read_noise**2 + sensor.gain**2 / 12.0
    full = min(sensor.largest, sensor.white_level - SATURATION_MARGIN * sensor.read_noise / sensor.gain - 1.0)
    saturated = raw >= full
    if sensor.mosaic:
        electrons, variance, saturated = demosaiced(electrons, variance, saturated, sensor.mosaic, demosaic)
    else:
        saturated = np.any(saturated, axis=2)
    values, spread = electrons / sensor.exposure, variance / sensor.exposure**2
    with np.errstate(over="ignore"):
        values, spread = values.astype(np.float32), spread.astype(np.float32)
    if not (np.isfinite(values).all() and np.isfinite(spread).all()):
        raise InputError(f"the light is beyond single precision: correct the sensor's exposure, {sensor.exposure:.3g}")
    return Developed(values, spread, ~saturated)


def native_channels(sensor: Sensor, height: int, width: int) -> NDArray[np.bool_] | None:
    """(height, width, 3), true where the sensor measured the channel itself; None when it measured all of them."""
    return native_of(sensor.mosaic, height, width) if sensor.mosaic else None


def native_of(mosaic: str, height: int, width: int) -> NDArray[np.bool_]:
    """(height, width, 3), true where a sample of `mosaic` is of the channel."""
    return _colours(mosaic, (height, width))[..., None] == np.arange(3)


def _colours(mosaic: str, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """(height, width) index of the channel that each pixel measures."""
    pattern = np.array(["RGB".index(colour) for colour in mosaic]).reshape(2, 2)
    return np.tile(pattern, (shape[0] // 2 + 1, shape[1] // 2 + 1))[: shape[0], : shape[1]]


def demosaiced(
    electrons: NDArray[np.float64], variance: NDArray[np.float64], saturated: NDArray, mosaic: str, demosaic: Demosaic
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Values and variance (height, width, 3), and what `saturated` samples have spoilt (height, width)."""
    from scipy.ndimage import binary_dilation, convolve

    algorithm = _algorithm(demosaic)
    colours, spread = _colours(mosaic, electrons.shape), []
    for channel, colour in enumerate("RGB"):
        native = colours == channel
        if demosaic == "bilinear":
            spread.append(convolve(variance * native, BILINEAR[colour] ** 2, mode="mirror"))
        else:
            around = convolve(variance, np.full((3, 3), 1.0 / 9.0), mode="mirror")
            spread.append(np.where(native, variance, MENON_VARIANCE[colour] * around))
    reach, inner = 2 * DEMOSAIC_REACH[demosaic] + 1, slice(PAD, -PAD)
    full = np.asarray(algorithm(np.pad(electrons, PAD, mode="reflect"), mosaic), np.float64)[inner, inner]
    return full, np.stack(spread, axis=2), np.asarray(binary_dilation(saturated, np.ones((reach, reach))), np.bool_)


def _algorithm(demosaic: Demosaic) -> Callable[..., ArrayLike]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # colour-demosaicing 0.2.7 imports a deprecated name of SciPy
        import colour_demosaicing as demosaicing
    if demosaic == "bilinear":
        return demosaicing.demosaicing_CFA_Bayer_bilinear
    if demosaic == "menon2007":
        return demosaicing.demosaicing_CFA_Bayer_Menon2007
    raise InputError(f"demosaicing {demosaic!r} is unknown: choose bilinear or menon2007")
