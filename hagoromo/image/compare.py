"""Compare: how far one image is from another, the reference, in the measures of HOUSE.md.

psnr [dB] = 20 log10(peak / rmse) and ssim (Wang et al. 2004, Gaussian window of 1.5 px) of the values as stored;
delta_e_2000: mean CIEDE2000 over the pixels; relative_rmse: rmse over the root mean square of the reference.
The peak is 1, the display's white, for PNG, and the largest value of the reference for EXR unless it is told; an EXR's
R, G, B are taken as linear sRGB with that peak as white.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.png import read_png
from hagoromo.light.colour import delta_e_2000, srgb_decode

WINDOW = 11  # px, side of the window of ssim: 3.5 standard deviations of 1.5 px to either side
RGB = ("R", "G", "B")


def compare(a: str | Path, b: str | Path, mask: str | Path | None = None, peak: float | None = None) -> dict[str, Any]:
    """Differences of image `a` from its reference `b`, both PNG or both EXR, where the PNG `mask` is not black.

    peak: of EXR files, the value that is white. Returns psnr, ssim, delta_e_2000, relative_rmse, the peak that they
    refer to and the number of pixels compared. `InputError` for files of two kinds, a peak of PNG files or one that is
    not above 0, sizes that differ, values that are not finite and an empty mask.
    """
    kinds = {Path(path).suffix.lower() for path in (a, b)}
    if kinds not in ({".exr"}, {".png"}):
        raise InputError(f"{a} and {b} cannot be compared: give two PNG or two EXR files")
    if peak is not None and (kinds == {".png"} or not 0.0 < peak < np.inf):
        raise InputError(f"the peak is {peak}: give a number above 0, for EXR files (a PNG's is the display's white)")
    one, other = _read(a), _read(b)
    if one.shape != other.shape:
        raise InputError(f"{a} is {_size(one)} and {b} {_size(other)} (width × height × channels): give equal sizes")
    inside = np.ones(one.shape[:2], bool) if mask is None else _read_mask(mask, one.shape[:2])
    for path, image in ((a, one), (b, other)):
        if not np.isfinite(image[inside]).all():
            raise InputError(f"{path} has values that are not finite: mask them")
    return differences(one, other, inside, 1.0 if kinds == {".png"} else peak, displayed=kinds == {".png"})


def differences(
    image: ArrayLike, reference: ArrayLike, mask: ArrayLike, peak: float | None = None, displayed: bool = False
) -> dict[str, Any]:
    """`compare` for arrays (height, width, 1 or 3): linear, or display values in 0…1 where `displayed`.

    mask: (height, width), true where compared. peak: None takes the largest value of the reference there.
    """
    from skimage.metrics import structural_similarity

    mask = np.asarray(mask, bool)
    if not mask.any() or min(mask.shape) < WINDOW:
        raise InputError(f"{mask.sum()} pixels of {_size(mask)} to compare: give more, at least {WINDOW} a side")
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    near = tuple(slice(max(at[0] - WINDOW, 0), at[-1] + WINDOW + 1) for at in (rows, columns))
    mask = mask[near]
    a, b = (
        np.where(mask[..., None], np.asarray(values)[near], 0.0).astype(np.float64) for values in (image, reference)
    )
    peak = float(b.max()) if peak is None else peak
    rmse, size = (float(np.sqrt(np.mean(values[mask] ** 2))) for values in (a - b, b))
    if not (peak > 0.0 and size > 0.0):
        raise InputError("the reference is black: there is nothing to compare with")
    settings: dict[str, Any] = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    found: Any = structural_similarity(a, b, data_range=peak, channel_axis=2, full=True, **settings)
    colours = [np.broadcast_to(values[mask], (*values[mask].shape[:-1], 3)) for values in (a, b)]
    linear = [srgb_decode(255.0 * values) if displayed else np.clip(values / peak, 0.0, None) for values in colours]
    return {
        "psnr": 20.0 * float(np.log10(peak / rmse)) if rmse > 0.0 else None,
        "ssim": float(found[1][mask].mean()),
        "delta_e_2000": float(delta_e_2000(*linear).mean()),
        "relative_rmse": rmse / size,
        "peak": peak,
        "pixels": int(mask.sum()),
    }


def _read(path: str | Path) -> NDArray[np.float64]:
    """Values (height, width, 1 or 3): of an EXR its R, G, B or its only channel; of a PNG its colours over 0…1."""
    if Path(path).suffix.lower() == ".png":
        image = read_png(path)
        values = image.astype(np.float64) / np.iinfo(image.dtype).max
        return values[..., None] if values.ndim == 2 else values[..., :3]
    layers, _ = read_exr(path)
    names = RGB if set(RGB) <= set(layers) else tuple(layers)
    if len(names) not in (1, 3):
        raise InputError(
            f"{path} has the channels {', '.join(layers)}: give an EXR with R, G and B, or with one channel"
        )
    return np.stack([layers[name] for name in names], axis=2).astype(np.float64)


def _read_mask(path: str | Path, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = read_png(path)
    if mask.shape[:2] != shape:
        raise InputError(f"{path} is {_size(mask)} and the images are {shape[1]} × {shape[0]}: give equal sizes")
    return np.asarray(mask > 0 if mask.ndim == 2 else (mask[..., :3] > 0).any(axis=2), np.bool_)


def _size(image: NDArray) -> str:
    return " × ".join(str(n) for n in (image.shape[1], image.shape[0], *image.shape[2:]))
