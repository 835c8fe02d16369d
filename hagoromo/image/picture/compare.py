"""Compare: how far one image is from another, the reference.

psnr [dB] = 20 log10(peak / rmse) and ssim (Wang et al. 2004, Gaussian window of 1.5 px) of the values as stored;
delta_e_2000: mean CIEDE2000 over the pixels; relative_rmse: rmse over the root mean square of the reference.
Images in 8 or 16 bits are display values, whose peak is 1, the display's white. Images in floats are linear sRGB; the
value of their white, the peak, is the largest value of the reference unless it is given.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_header
from hagoromo.files.png import read_png
from hagoromo.image.picture.any_picture import AnyPicture, picture_of, read_any_picture
from hagoromo.image.picture.image import Image
from hagoromo.light.colour import delta_e_2000, srgb_decode

WINDOW = 11  # px, side of the window of ssim: 3.5 standard deviations of 1.5 px to either side
MAP_WHITE = 10.0  # ΔE00 that a map shows brightest


@dataclass(frozen=True)
class Comparison:
    """psnr [dB] (None: the images are equal), ssim, mean ΔE00, relative rmse; the peak that psnr and ssim refer to;
    the number of pixels compared.
    """

    psnr: float | None
    ssim: float
    delta_e_2000: float
    relative_rmse: float
    peak: float
    pixels: int

    def record(self) -> dict[str, Any]:
        """Plain figures, as `hagoromo compare` prints them."""
        return asdict(self)


def compare(
    a: str | Path | ArrayLike | Image,
    b: str | Path | ArrayLike | Image,
    mask: str | Path | ArrayLike | None = None,
    peak: float | None = None,
) -> Comparison:
    """Differences of image `a` from its reference `b`, where `mask` is not black.

    a, b: files (PNG, JPEG, TIFF, EXR, HDR), arrays (height, width[, 1 or 3]) or `Image`s. mask: a PNG file or an array
    (height, width). peak: of linear images, the value that is white; with it, display values and linear ones are
    compared, as linear. `InputError` for that without a peak, a peak of two images of display values or one that is
    not above 0, sizes that differ, values that are not finite, and an empty mask.

    >>> reference = np.full((16, 16, 3), 0.5)
    >>> difference = hg.compare(1.02 * reference, reference, peak=1.0)
    >>> round(difference.relative_rmse, 4), round(difference.psnr), difference.pixels  # psnr: 20 log10(1/0.01) dB
    (0.02, 40, 256)
    """
    one, other, inside = _alike(a, b, mask, peak)
    return _differences(one.values, other.values, inside, 1.0 if one.displayed else peak, one.displayed)


def delta_e_map(
    a: str | Path | ArrayLike | Image,
    b: str | Path | ArrayLike | Image,
    mask: str | Path | ArrayLike | None = None,
    peak: float | None = None,
) -> NDArray[np.float64]:
    """CIEDE2000 of each pixel of image `a` from its reference `b`: (height, width), 0 outside `mask`; see `compare`.

    >>> reference = np.full((16, 16, 3), 0.5)
    >>> bool((hg.delta_e_map(1.02 * reference, reference, peak=1.0) > 0.3).all())
    True
    """
    one, other, inside = _alike(a, b, mask, peak)
    white = float(other.values[inside].max()) if peak is None else peak
    if not white > 0.0:
        raise InputError("the reference is black: there is nothing to compare with")
    linear = [each.linear if each.displayed else np.clip(each.values / white, 0.0, None) for each in (one, other)]
    linear = [np.where(inside[..., None], each, 0.0) for each in linear]
    return np.asarray(delta_e_2000(*(np.broadcast_to(each, (*inside.shape, 3)) for each in linear)))


def map_picture(map_of: NDArray[np.float64]) -> NDArray[np.uint8]:
    """ΔE00 0 to MAP_WHITE as Matplotlib's colours inferno, black to pale yellow: (height, width, 3)."""
    import matplotlib

    return matplotlib.colormaps["inferno"](np.clip(map_of / MAP_WHITE, 0.0, 1.0), bytes=True)[..., :3]


def _alike(
    a: Any, b: Any, mask: str | Path | ArrayLike | None, peak: float | None
) -> tuple[AnyPicture, AnyPicture, NDArray[np.bool_]]:
    """Both pictures, of one size and both linear or both display values, and where they are compared."""
    one, other = _read(a, "the first image"), _read(b, "the second image")
    if one.displayed != other.displayed:
        if peak is None:
            raise InputError(
                f"{one.name} and {other.name} cannot be compared: give two PNG or two EXR files, or the linear value "
                f"that is white, the peak (--peak)"
            )
        if not 0.0 < peak < np.inf:
            raise InputError(f"the peak is {peak}: give a number above 0")
        one, other = (
            AnyPicture(each.name, each.linear * (peak if each.displayed else 1.0), False) for each in (one, other)
        )
    if peak is not None and (one.displayed or not 0.0 < peak < np.inf):
        raise InputError(f"the peak is {peak}: give a number above 0, for EXR files (a PNG's is the display's white)")
    if one.values.shape != other.values.shape:
        sizes = f"{one.name} is {_size(one.values)} and {other.name} {_size(other.values)}"
        raise InputError(f"{sizes} (width × height × channels): give equal sizes")
    inside = _read_mask(mask, one.values.shape[:2])
    for picture in (one, other):
        if not np.isfinite(picture.values[inside]).all():
            raise InputError(f"{picture.name} has values that are not finite: mask them")
    return one, other, inside


def _differences(
    image: NDArray, reference: NDArray, mask: NDArray[np.bool_], peak: float | None, displayed: bool
) -> Comparison:
    """The measures over the pixels of `mask`. peak: None takes the largest value of the reference there."""
    from skimage.metrics import structural_similarity

    if not mask.any() or min(mask.shape) < WINDOW:
        raise InputError(f"{mask.sum()} pixels of {_size(mask)} to compare: give more, at least {WINDOW} a side")
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    window = tuple(slice(max(line[0] - WINDOW, 0), line[-1] + WINDOW + 1) for line in (rows, columns))
    mask = mask[window]
    a, b = (np.where(mask[..., None], values[window], 0.0).astype(np.float64) for values in (image, reference))
    peak = float(b.max()) if peak is None else peak
    rmse, size = (float(np.sqrt(np.mean(values[mask] ** 2))) for values in (a - b, b))
    if not (peak > 0.0 and size > 0.0):
        raise InputError("the reference is black: there is nothing to compare with")
    settings: dict[str, Any] = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    similarity: Any = structural_similarity(a, b, data_range=peak, channel_axis=2, full=True, **settings)
    colours = [np.broadcast_to(values[mask], (*values[mask].shape[:-1], 3)) for values in (a, b)]
    linear = [srgb_decode(255.0 * values) if displayed else np.clip(values / peak, 0.0, None) for values in colours]
    return Comparison(
        psnr=20.0 * float(np.log10(peak / rmse)) if rmse > 0.0 else None,
        ssim=float(similarity[1][mask].mean()),
        delta_e_2000=float(delta_e_2000(*linear).mean()),
        relative_rmse=rmse / size,
        peak=peak,
        pixels=int(mask.sum()),
    )


def _read(source: str | Path | ArrayLike | Image, unnamed: str) -> AnyPicture:
    if isinstance(source, Image):
        return AnyPicture(unnamed, source.linear_srgb().astype(np.float64), False)
    if not isinstance(source, (str, Path)):
        return picture_of(unnamed, np.asarray(source))
    if Path(source).suffix.lower() == ".exr" and "denoised" in read_header(source):
        raise InputError(f"{source} was denoised, so that its noise is guessed away: compare the picture without")
    return read_any_picture(source)


def _read_mask(mask: str | Path | ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    if mask is None:
        return np.ones(shape, np.bool_)
    values = read_png(mask) if isinstance(mask, (str, Path)) else np.asarray(mask)
    if values.shape[:2] != shape:
        name = mask if isinstance(mask, (str, Path)) else "the mask"
        raise InputError(f"{name} is {_size(values)} and the images are {shape[1]} × {shape[0]}: give equal sizes")
    return np.asarray(values > 0 if values.ndim == 2 else (values[..., :3] > 0).any(axis=2), np.bool_)


def _size(image: NDArray) -> str:
    return " × ".join(str(n) for n in (image.shape[1], image.shape[0], *image.shape[2:]))
