"""Empty voxels: whatever their material number, colour or axis, the light of the matter beside them is the same."""

from pathlib import Path

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import march
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import palette_of

WHITE = Spectrum.constant(1.0)
BLACK = Reflectance(0.0, 0.0, 0.2, 1.5, WHITE)  # the material of number 0
MATTER = Reflectance(0.25, 0.2, 0.3, 1.5, WHITE)
THREAD = Reflectance(0.2, 0.3, 0.3, 1.5, WHITE, element="cylinder")
SHAPE = (19, 23, 21)  # voxels (z, y, x): several bricks, and matter at the borders between them
BAD = {
    "material 0": {"material": 0},
    "colour 0": {"colour": 0.0},
    "a strange colour": {"colour": 700.0},
    "a colour that is no number": {"colour": np.nan},
    "random axes": {"axis": 1.0},
    "axes that are no numbers": {"axis": np.nan},
    "all of it": {"material": 0, "colour": 0.0, "axis": 1.0},
}


def edge(fault: dict, path: Path | None = None) -> hg.VolumeBox:
    """A curved sheet about a voxel thick, of two of three materials; `fault`: what empty voxels hold instead."""
    z, y, x = np.meshgrid(*(np.arange(n) + 0.5 for n in SHAPE), indexing="ij")
    away = np.abs(z - 9.0 - 2.0 * np.sin(0.3 * x) - 0.1 * y)
    density = np.clip(1.2 - away, 0.0, 1.0)
    axis = np.stack([-0.6 * np.cos(0.3 * x), 0.0 * x - 0.1, 0.0 * x - 1.0], axis=-1)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    material = np.where(x > 11.3, 2, 1).astype(np.uint8)
    axis[material == 2] = np.cross(axis[material == 2], (0.0, 1.0, 0.0))
    colour = np.stack([0.4 + 0.02 * x, 0.8 - 0.03 * y], axis=-1)
    rng, empty = np.random.default_rng(3), density == 0
    material[empty] = fault.get("material", material[empty])
    colour[empty] = fault.get("colour", colour[empty])
    if "axis" in fault:
        axis[empty] = fault["axis"] * rng.normal(size=(int(empty.sum()), 3))
    box = hg.VolumeBox.from_arrays(
        density, axis, 1e-3, 900.0, [BLACK, MATTER, THREAD], material, colour,
        basis=(WHITE, Spectrum([400, 700], [0.0, 1.0])),
    )  # fmt: skip
    if path is None:
        return box
    box.save(path)
    return hg.load_box(path)


def light_of(box: hg.VolumeBox, differentiable: bool = False) -> np.ndarray:
    """All weights along rays, without shadows: these see the density alone."""
    camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, 0.0, -1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.3, -0.4, -0.9)),), (box,))
    u, v = np.meshgrid(np.linspace(1e-4, 0.02, 53), np.linspace(1e-4, 0.022, 47), indexing="ij")
    origins = np.stack([u.ravel(), v.ravel(), np.full(u.size, -0.05)], axis=1)
    rays = hg.RayMarch(scene, hg.Settings(shadows="none"), differentiable=differentiable)
    return rays(origins, np.broadcast_to((0.1, 0.02, 1.0), origins.shape)).weights


@pytest.mark.parametrize("name", BAD)
def test_what_empty_voxels_hold_is_not_seen(name):
    """1e-6 of the mean: the same matter is read from the same bits."""
    clean, other = light_of(edge({})), light_of(edge(BAD[name]))
    assert np.abs(other - clean).max() < 1e-6 * clean.mean() > 0


def test_nor_in_a_box_from_disk_or_one_that_is_differentiated(tmp_path):
    clean, bad = light_of(edge({})), edge(BAD["all of it"], tmp_path / "bad.zarr")
    assert np.abs(light_of(bad) - clean).max() < 1e-6 * clean.mean()
    single = [light_of(box, differentiable=True) for box in (edge({}), bad)]
    assert np.abs(single[1] - single[0]).max() < 1e-6 * clean.mean()


def test_what_a_user_gave_to_empty_voxels_is_kept(tmp_path):
    """Material numbers and finite colours of stored bricks come back as they were given."""
    box = edge(BAD["a strange colour"] | {"material": 0})
    box.save(tmp_path / "box.zarr")
    first, second = (b.bricks.read(0, b.bricks.kept) for b in (box, hg.load_box(tmp_path / "box.zarr")))
    empty = first["density"] == 0
    assert (first["material"][empty] == 0).all() and (first["colour"][empty][..., :2] == 700.0).all()
    for name in ("material", "colour"):
        assert np.array_equal(first[name], second[name])


def test_colour_that_is_no_number_in_matter_is_refused():
    density, axis = np.ones((3, 3, 3)), np.ones((3, 3, 3, 3)) / 3**0.5
    with pytest.raises(InputError, match="the body colour of a voxel with matter is not finite"):
        hg.VolumeBox.from_arrays(density, axis, 1.0, 1.0, [MATTER], body_colour=np.full((3, 3, 3, 1), np.inf))


def sum_of_light(density: np.ndarray, colour: np.ndarray | None, material: np.ndarray | None, materials) -> float:
    """Light of thin matter of spheres, summed over parallel rays, four a voxel; per voxel of density and colour 1."""
    jit, tau = arrays(), 1e-3
    basis = (WHITE,) if colour is not None else ()
    box = hg.VolumeBox.from_arrays(
        density, np.zeros((*density.shape, 3)), 1.0, tau, materials, material, colour, basis=basis
    )
    lamp = hg.Lamp(to_lamp=(0.0, 0.0, -1.0))
    lighting = Lighting([lamp], Materials(materials, palette_of(materials, basis, [WHITE])), None, [basis])
    _, ny, nx = density.shape
    x, y = np.meshgrid((np.arange(4 * nx) + 0.5) / 4, (np.arange(4 * ny) + 0.5) / 4)
    origin = jit.Array3f(*(np.float32(v.ravel()) for v in (x, y)), -5.0)
    channels, _ = march(
        Medium([box]), lighting, origin, jit.Array3f(0, 0, 1) + 0 * origin, jit.Float(0), jit.Float(dr.inf)
    )
    per_matter = materials[-1].alpha * 2.0 / 3.0  # sphere, seen from the lamp
    return float(np.array(channels[0], float).sum()) / 16 / tau / per_matter


def test_thin_light_is_the_sum_of_density_times_colour():
    """Σ ρ c, if colour is weighed by density; interpolated apart from density the light is half of that."""
    rng = np.random.default_rng(5)
    density, colour = np.zeros((7, 11, 13)), np.zeros((7, 11, 13, 1))
    density[1:-1, 1:-1, 1:-1] = rng.random((5, 9, 11)) ** 4
    colour[...] = np.clip(density[..., None] + 0.05, 0.0, 1.0)
    sphere = Reflectance(0.2, 0.0, 0.2, 1.5, WHITE, element="sphere")
    found = sum_of_light(density, colour, None, [sphere])
    halves = density.astype(np.float16).astype(float), colour[..., 0].astype(np.float16).astype(float)
    assert found == pytest.approx(float((halves[0] * halves[1]).sum()), rel=2e-3)


def test_a_trace_of_another_material_does_not_take_the_light_of_its_neighbour():
    """A voxel of 1 beside voxels of 1e-3 of black: the light is that of the 1, to what is nearer to traces (2 %)."""
    density = np.full((5, 5, 5), 1e-3)
    density[[0, -1]] = density[:, [0, -1]] = density[:, :, [0, -1]] = 0.0
    density[2, 2, 2] = 1.0
    material = (density == 1.0).astype(np.uint8)
    black, sphere = (Reflectance(a, 0.0, 0.2, 1.5, WHITE, element="sphere") for a in (0.0, 0.2))
    assert sum_of_light(density, None, material, [black, sphere]) == pytest.approx(1.0, rel=0.02)
