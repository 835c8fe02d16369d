"""Building or opening a second box compiles nothing, wherever its numbers lie in memory and whatever its size."""

import shutil

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import aligned, name
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store import brick_writer
from hagoromo.volume.store.box_store import load_box, save_box

GREY = Reflectance(0.2, 0.3, 0.2, 1.5, Spectrum.constant(0.8))


def off(values: np.ndarray, offset: int) -> np.ndarray:
    """A copy that begins `offset` bytes (< 64) behind what Dr.Jit aligns memory to."""
    memory = aligned(values.nbytes + 64, np.uint8)
    moved = memory[offset : offset + values.nbytes].view(values.dtype).reshape(values.shape)
    moved[...] = values
    return moved


def a_box(shape: tuple[int, int, int], offset: int = 0, kind: str = "float32") -> VolumeBox:
    rng = np.random.default_rng(offset)
    density, axis = rng.uniform(0.1, 1.0, shape).astype(kind), rng.uniform(-0.5, 0.5, (*shape, 3)).astype(kind)
    colour, material = rng.random((*shape, 4)).astype(kind), rng.integers(0, 2, shape).astype(np.uint8)
    density, axis, colour = (off(values, offset) for values in (density, axis, colour))
    basis = (Spectrum.constant(1.0),) * 4
    return VolumeBox.from_arrays(density, axis, 0.001, 300.0, [GREY, GREY], material, colour, basis=basis)


def compiled(work) -> int:
    """Kernels that `work` compiles, or reads from the disk's cache of compiled ones."""
    dr.kernel_history_clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        work()
        history = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    return sum(not kernel["cache_hit"] or kernel["cache_disk"] for kernel in history)


@pytest.mark.parametrize("kind", ["float32", "float64", "float16"])
def test_a_second_box_from_arrays_compiles_nothing(kind):
    a_box((17, 25, 33), 0, kind)
    for shape, offset in (((17, 25, 33), 8), ((17, 25, 33), 24), ((41, 19, 11), 40), ((9, 9, 9), 0)):
        assert compiled(lambda s=shape, o=offset: a_box(s, o, kind)) == 0, (shape, offset)


@pytest.mark.parametrize("packed", [True, False])
def test_a_second_box_opened_from_disk_compiles_nothing(tmp_path, packed):
    shapes = ((17, 25, 33), (66, 19, 11), (9, 9, 9))
    for k, shape in enumerate(shapes):
        save_box(a_box(shape), tmp_path / f"{k}.zarr")
        if not packed:
            shutil.rmtree(tmp_path / f"{k}.zarr" / "packed")
    load_box(tmp_path / "0.zarr")
    for k in (0, 1, 2):
        assert compiled(lambda k=k: load_box(tmp_path / f"{k}.zarr")) == 0, shapes[k]


def test_the_count_sees_what_alignment_compiles(monkeypatch):
    """The count is not blind: the same numbers off the alignment are read by other kernels."""
    if name() != "llvm":
        pytest.skip("a GPU copies arrays of NumPy: their alignment does not matter")
    a_box((17, 25, 33))
    monkeypatch.setattr(brick_writer, "aligned", lambda count, kind: off(np.empty(count, kind), 4))
    assert compiled(lambda: a_box((17, 25, 33))) > 0
