"""Tables of RGL: a measured BRDF on a grid that follows the material's own highlight, in spectra or in RGB.

Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering" (2018). Mitsuba, whose
authors made the format, evaluates the file, in a process apart.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import Arrays, read_apart
from hagoromo.files.checks import sized_file
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.measurement.reflectance_table import ReflectanceTable
from hagoromo_formats.reflectances.merl import FARTHEST, sampled_directions

LARGEST = 1 << 30  # bytes of a file
WAVELENGTHS = np.arange(400.0, 701.0, 20.0)  # [nm] of which the nearest in the file are read
TURNS = np.radians([0.0, 45.0, 90.0, 135.0])  # about the normal, of each pair, where the sample is not isotropic
TOGETHER = 1 << 16  # pairs in one evaluation
NEEDED = ("description", "phi_i", "theta_i", "ndf", "sigma", "vndf", "luminance", "jacobian")
Array = NDArray[np.float64]


def read_rgl(path: str | Path) -> ReflectanceTable:
    """The table in a .bsdf: more pairs of directions near the mirror direction than elsewhere. It states no variance.

    Channels are every 20 nm from 400 to 700 nm, or R, G and B. A material that is not isotropic is read in four
    turns about its normal. `InputError` for a file of another kind, and one without values above 0.
    """
    file = sized_file(path, LARGEST, "a table of RGL")
    require(8.0 * file.stat().st_size, str(file))
    found = read_apart(values_by_mitsuba, file, "a table of RGL")
    lamp, eye, values = found["to_lamp"], found["to_eye"], found["values"]
    known = (values > 0.0).all(axis=1) & np.isfinite(values).all(axis=1)
    if not known.any():
        raise InputError(f"{file} has no value above 0: it is damaged, or no table of RGL")
    wavelengths = found["wavelengths"].tolist()
    channels = tuple(f"{one:.4g} nm" for one in wavelengths) or ("R", "G", "B")
    return ReflectanceTable(lamp[known], eye[known], values[known], channels=channels)


def values_by_mitsuba(path: Path) -> Arrays:
    """to_lamp, to_eye (N, 3), values (N, C) [1/sr], wavelengths (C,) [nm], none of RGB; run by `read_apart`."""
    import mitsuba as mi

    before, tensor_io = mi.variant(), cast(Any, mi.tensor_io)
    mi.set_variant("llvm_ad_spectral")
    try:
        with reading(path, "a table of RGL"):
            tensors = tensor_io.read(str(path))
        kept, wavelengths = _chosen(path, tensors)
        lamp, eye = _pairs(path, kept)
        asked = np.asarray(kept["wavelengths"], np.float64)
        with tempfile.TemporaryDirectory() as folder, reading(path, "a table of RGL"):
            tensor_io.write(f"{folder}/chosen.bsdf", **kept)
            bsdf = mi.load_dict({"type": "measured", "filename": f"{folder}/chosen.bsdf"})
            parts = [
                _values(bsdf, lamp[first : first + TOGETHER], eye[first : first + TOGETHER], asked)
                for first in range(0, len(lamp), TOGETHER)
            ]
            del bsdf
    finally:
        if before is not None:
            mi.set_variant(before)
    return {"to_lamp": lamp, "to_eye": eye, "values": np.concatenate(parts), "wavelengths": wavelengths}


def _chosen(path: Path, tensors: dict[str, NDArray[Any]]) -> tuple[dict[str, NDArray[Any]], Array]:
    """The arrays for Mitsuba with the wavelengths that are read, and what these are: none of RGB.

    Mitsuba takes spectra alone: red, green and blue stand at wavelengths. `InputError` for a file that lacks an array,
    whose grids do not rise, or that has no spectra in the visible.
    """
    missing = [name for name in NEEDED if name not in tensors]
    if missing or not ("rgb" in tensors or {"spectra", "wavelengths"} <= tensors.keys()):
        lacks = ", ".join(missing) or "spectra and rgb"
        raise InputError(f"{path} is no table of RGL: it lacks {lacks}: give a _spec.bsdf or an _rgb.bsdf")
    kept = {name: tensors[name] for name in NEEDED}
    if "wavelengths" not in tensors:
        kept |= {"spectra": tensors["rgb"], "wavelengths": np.array([400.0, 500.0, 600.0], np.float32)}
        wavelengths = np.zeros(0)
    else:
        stored = np.asarray(tensors["wavelengths"], np.float64).ravel()
        wanted = WAVELENGTHS[(stored.min(initial=np.inf) <= WAVELENGTHS) & (stored.max(initial=0.0) >= WAVELENGTHS)]
        if not wanted.size or tensors["spectra"].ndim != 5 or tensors["spectra"].shape[2] != stored.size:
            raise InputError(f"{path} has no spectra from 400 to 700 nm: no material is fitted to it")
        nearest = np.unique(np.abs(stored[:, None] - wanted).argmin(axis=0))
        kept |= {"spectra": tensors["spectra"][:, :, nearest], "wavelengths": stored[nearest].astype(np.float32)}
        wavelengths = stored[nearest]
    for name in ("phi_i", "theta_i", "wavelengths"):
        grid = kept[name]
        if grid.ndim != 1 or not grid.size or not (np.isfinite(grid).all() and (np.diff(grid) > 0.0).all()):
            raise InputError(f"{path} is damaged: {name} must be a list of numbers that rise")
    return kept, wavelengths


def _pairs(path: Path, tensors: dict[str, NDArray[Any]]) -> tuple[Array, Array]:
    """Directions to lamp and eye (N, 3) within what was measured."""
    lamp, eye = sampled_directions()
    farthest = max(FARTHEST, float(np.cos(tensors["theta_i"].max(initial=0.0))))
    known = (lamp[:, 2] >= farthest) & (eye[:, 2] > FARTHEST)
    if not known.any():
        raise InputError(f"{path} is damaged: its largest theta_i is {tensors['theta_i'].max():.3g} rad")
    lamp, eye = lamp[known], eye[known]
    if tensors["phi_i"].size <= 2:
        return lamp, eye
    return np.concatenate([_turned(lamp, by) for by in TURNS]), np.concatenate([_turned(eye, by) for by in TURNS])


def _turned(directions: Array, angle: float) -> Array:
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = directions.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], 1)


def _values(bsdf: Any, lamp: Array, eye: Array, wavelengths: Array) -> Array:
    """The BRDF (N, C) [1/sr]. Mitsuba's has the cosine to its wo, which is the eye here: the lamp is wi, as at RGL."""
    import drjit as dr
    import mitsuba as mi

    values = np.empty((len(lamp), wavelengths.size))
    interaction = dr.zeros(mi.SurfaceInteraction3f, len(lamp))
    interaction.wi = mi.Vector3f(*lamp.T.astype(np.float32))
    out, context = mi.Vector3f(*eye.T.astype(np.float32)), mi.BSDFContext()
    for first in range(0, wavelengths.size, 4):
        part = np.resize(wavelengths[first : first + 4], 4)
        interaction.wavelengths = mi.Spectrum(*map(float, part))
        found = np.array(bsdf.eval(context, interaction, out))[: wavelengths.size - first]
        values[:, first : first + 4] = found.T
    return values / eye[:, 2:]
