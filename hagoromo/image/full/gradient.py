"""The derivative of a picture of mode full by the colours of its matter, by the adjoint of its sweeps.

Enters: a scene, and the derivative of any loss by the weights of its picture. Leaves: that by the colours of the
palette, in all bands at once. It costs about as much as the picture, whatever the number of colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import Array3f, Float, arrays, lookup
from hagoromo.errors import InputError
from hagoromo.image.full.picture import (
    bands_of_scene,
    batches_of,
    warn_if_deep,
)
from hagoromo.image.prepared.higher_orders import check_matter
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import palette_of_scene, reflectances_of
from hagoromo.image.scene.settings import Settings, check_mode
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.field.adjoint import Adjoint
from hagoromo.transport.field.band_colours import ColoursAndShares
from hagoromo.transport.field.cell_size import cell_size
from hagoromo.transport.field.field import Field
from hagoromo.transport.field.look_up_back import LookUpBack
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.field.sent_back import ByColour
from hagoromo.transport.field.solve import Solver
from hagoromo.transport.film import Film, pixel_points, tile_place, tiled
from hagoromo.transport.palette import distinct
from hagoromo.transport.path.bands import Bands


class ColourGradient(NamedTuple):
    """Of a loss, the derivative (colours, bands) by the value of each of the `colours` of the picture's palette at each
    of the `wavelengths` [nm] of its bands. With one band it is that by the colour at all wavelengths.
    """

    values: NDArray[np.float64]
    colours: tuple[Spectrum, ...]
    wavelengths: NDArray[np.float64]


def full_gradient(scene: Scene, by_weights: ArrayLike, settings: Settings | None = None) -> ColourGradient:
    """The derivative of a loss of a picture of mode full by the colours of the scene's matter.

        ∂loss/∂c_jb = Σ by_weights · ∂weights/∂c_jb

    by_weights: the derivative of the loss by `weights` of `hg.render(scene, settings, mode="full")` with `walks=0`, of
    their shape (height, width, channels); of a loss that is linear, its weights. c_jb: the value of colour j of the
    palette (bodies, interfaces, transmitted ones) in band b. First-order weights do not depend on it; light of higher
    orders does. Held fixed are density, axes, the shapes of lobes and the cells.

    The field is solved anew, and the adjoint of its sweeps follows the same rays. The result is the derivative of the
    discrete solution, with its residual of 0.2 %. Memory: that of the picture, an adjoint as large as the solution, and
    sums of 8 bytes a cell and channel for each direction that is swept back together: 32 MiB at most, or those of one.
    `InputError` for another shape, surfaces, no boxes, or `orders`.
    """
    settings = settings or Settings()
    check_mode(settings, "full")
    if scene.surfaces or not scene.boxes:
        raise InputError("full_gradient is of light in volume boxes alone: give a scene of boxes, without surfaces")
    if settings.orders is not None:
        raise InputError(f"orders is {settings.orders}: full_gradient is of all orders, leave it out")
    for box in scene.boxes:
        check_matter(box)
    lit, _ = lit_by_points(scene, settings)
    bands = bands_of_scene(lit, distinct([lamp.spectrum for lamp in lit.lamps]))
    palette, camera = palette_of_scene(lit, settings), scene.camera
    channels = len(palette.colours) + bands.count
    shape = camera.height, camera.width, len(palette.lamps) * channels
    try:
        given = np.asarray(by_weights, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"by_weights holds what is no number: give numbers, {shape}") from error
    if given.shape != shape or not np.isfinite(given).all():
        raise InputError(f"by_weights of shape {given.shape}: give finite numbers, {shape} as the picture's weights")
    of_groups = given.reshape(*shape[:2], len(palette.lamps), channels)[..., len(palette.colours) :]
    total = np.zeros((len(palette.colours), bands.count))
    for batch in batches_of(lit.lamps, bands.count, settings.separate_lamps):
        groups = list(dict.fromkeys(palette.lamp_groups[lamp] for lamp in batch))  # in the order of the part's own
        part = replace(lit, lamps=tuple(lit.lamps[lamp] for lamp in batch))
        total += _of_batch(part, settings, bands, np.ascontiguousarray(of_groups[:, :, groups]))
    return ColourGradient(total, palette.colours, bands.wavelengths)


def _of_batch(scene: Scene, settings: Settings, bands: Bands, by_light: NDArray[np.float64]) -> NDArray[np.float64]:
    """The derivative (colours, bands) from that by the light of higher orders, (height, width, groups, bands)."""
    prepared = PreparedScene(scene, settings, SceneCache(), by_camera=False)
    assert prepared.medium is not None
    palette, colours = prepared.palette, ColoursAndShares(bands, prepared.palette)
    size = cell_size(prepared.medium.boxes, len(palette.lamps) * bands.count)
    warn_if_deep(size, prepared.medium.boxes)
    solver = Solver(prepared.medium, prepared.lighting, colours, ScatteringTables(reflectances_of(scene)), size)
    solution = solver.solved(settings.seed, None)
    flat, samples = by_light.reshape(-1, len(palette.lamps) * bands.count), settings.samples
    back = LookUpBack(Field.solved(solver, solution, colours), palette.parts, float(np.abs(flat).max()) / samples)
    prepared.lighting.field = back
    film = Film(prepared.camera, back.of_colours, 1, prepared.ahead)
    seen = _Seen(prepared, back, flat / samples)
    for point in pixel_points(samples, settings.seed):
        film.add(seen, point)
    direct = (film.mean()[0].reshape(len(flat), -1, flat.shape[1]).astype(np.float64) * flat[:, None]).sum(axis=0)
    adjoint = Adjoint(solver, solution, prepared.lighting, ByColour(palette.parts, bands.count), settings.seed)
    return direct.reshape(len(palette.parts), -1, bands.count).sum(axis=1) + adjoint.by_colours(back.by_field())


class _Seen:
    """The march along rays of a film, which adds to the derivative by the field what each ray sees of it."""

    def __init__(self, prepared: PreparedScene, back: LookUpBack, by_light: NDArray[np.float64]) -> None:
        """`by_light`: of every pixel and channel, of one sample."""
        self.prepared, self.back, self.first = prepared, back, 0
        self.by_light = [lookup(arrays().Float, column.astype(np.float32)) for column in by_light.T]

    def __call__(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """Of every ray, in the order of the film, the derivative of its light by every colour and channel."""
        jit, camera, count = arrays(), self.prepared.camera, dr.width(direction)
        width, height = (dr.opaque(jit.UInt, size) for size in (camera.width, camera.height))
        column, row = tile_place(dr.arange(jit.UInt, count) + dr.opaque(jit.UInt, self.first), width)
        inside = (column < width) & (row < height)
        by_ray: Any = [dr.gather(jit.Float, one, row * width + column, inside) for one in self.by_light]
        self.back.by_ray = by_ray
        self.first = (self.first + count) % tiled(camera.width, camera.height)
        channels, alpha = self.prepared.camera_radiance(origin, direction, phase)
        own: Sequence[Float] = channels[-self.back.of_colours :]
        dr.eval(own, alpha, self.back.sums.sums)
        return list(own), alpha
