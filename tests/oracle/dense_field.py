"""Dense field: all voxels of a volume box at once, brick by brick, as an export writes them part by part."""

import numpy as np

from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import STORED


def dense_field(box: VolumeBox, field: str) -> np.ndarray:
    """(nz, ny, nx[, 3]) float32: density; axis; or the body's linear sRGB under D65, 0 without matter."""
    if field != "colour":
        return box.bricks.dense()[field == "axis"].astype(np.float32)
    full = np.zeros((*(8 * m + 1 for m in box.bricks.lattice), 3), np.float32)
    for number, (z, y, x) in enumerate(box.bricks.corners().tolist()):
        full[z : z + STORED, y : y + STORED, x : x + STORED] = _colours(box, number)
    return full[tuple(slice(n) for n in box.bricks.shape)]


def _colours(box: VolumeBox, number: int) -> np.ndarray:
    """Linear sRGB of the body of each voxel of a brick: (9, 9, 9, 3)."""
    held = {name: values[0] for name, values in box.bricks.read(number, number + 1).items()}
    which = held.get("material", np.zeros(held["density"].shape, np.uint8))
    alpha = np.array([material.alpha for material in box.materials])[which][..., None]
    if "colour" in held:
        basis = np.array([linear_colour(each, Spectrum.named("D65")) for each in box.basis])
        colour = held["colour"][..., : len(basis)].astype(float) @ basis
    else:
        colour = np.array([linear_colour(each.body_colour, Spectrum.named("D65")) for each in box.materials])[which]
    return np.where(held["density"][..., None] > 0, np.pi * alpha * colour, 0.0).astype(np.float32)
