"""NIfTI (.nii, .nii.gz), by nibabel: the header's matrix is the world (right, anterior, superior), as it is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.library import library
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo.files.silence import nibabel_silenced
from hagoromo.files.volumes.volume_file import MM, VolumeFile

UNITS = {"mm": MM, "unknown": MM, "meter": 1.0, "micron": 1e-6}
BYTES = 10.0  # of a number: as stored, and scaled to float64 by slope and intercept


def read_nifti(path: str | Path) -> VolumeFile:
    """The volume in a file; whole numbers with a slope are the numbers that these stand for."""
    nibabel = library("nibabel")
    with reading(path, "NIfTI"), nibabel_silenced():
        image: Any = nibabel.Nifti1Image.from_filename(str(existing_file(path)))
        shape = image.shape
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        if len(shape) not in (3, 5) or (len(shape) == 5 and shape[3] != 1):
            raise InputError(f"{path} is an array of {str(image.shape)[:60]}: a volume has three axes")
        if image.get_data_dtype().fields:
            raise InputError(f"{path} holds colours: give a volume of numbers")
        require(BYTES * math.prod(map(float, shape)), str(path))
        values = np.asanyarray(image.dataobj).reshape([n for k, n in enumerate(shape) if k != 3])
        matrix = np.array(image.affine, float)
        matrix[:3] *= UNITS.get(image.header.get_xyzt_units()[0], MM)
        return VolumeFile(np.moveaxis(values, (0, 1, 2), (2, 1, 0)), matrix, str(path))
