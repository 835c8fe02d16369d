"""Any Zarr array of densities is a volume box: of any type and chunks, with axes or without, in memory or to disk."""

from pathlib import Path

import numpy as np
import pytest
import zarr
from numcodecs import Pickle

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import build, build_to
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box
from hagoromo.volume.store.zarr_plan import box_from_zarr

GREY = Reflectance(0.2, 0.1, 0.2, 1.5, Spectrum.constant(0.8))
SHAPE = (67, 71, 73)
RECIPE = """
kind = "volume"
density = "density.zarr"
voxel_mm = 0.5
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }
"""


def a_ball() -> np.ndarray:
    """Density (67, 71, 73) of a ball whose edge is eight voxels wide, around the middle of the lattice."""
    z, y, x = np.indices(SHAPE) - np.reshape(SHAPE, (3, 1, 1, 1)) * 0.5
    return np.clip((26.0 - np.sqrt(x * x + y * y + z * z)) / 8.0, 0.0, 1.0).astype(np.float32)


def voxels(box: VolumeBox) -> dict[str, np.ndarray]:
    return box.bricks.read(0, box.bricks.kept)


def test_density_and_axis_arrays_are_the_box_of_the_same_numbers(tmp_path):
    density, axis = a_ball(), np.random.default_rng(5).normal(size=(*SHAPE, 3)).astype(np.float16)
    zarr.create_array(tmp_path / "density.zarr", data=density, chunks=(11, 71, 37))
    zarr.create_array(tmp_path / "axis.zarr", data=axis, chunks=(64, 64, 64, 3))
    box = box_from_zarr(tmp_path / "density.zarr", 0.1, 1.0, [GREY], axis=tmp_path / "axis.zarr")
    whole = VolumeBox.from_arrays(density, axis, 0.1, 1.0, [GREY])
    assert np.array_equal(box.bricks.places, whole.bricks.places)
    assert all(np.array_equal(voxels(box)[name], values) for name, values in voxels(whole).items())


def test_axes_that_are_not_given_point_down_the_slope_of_the_density(tmp_path):
    """Central differences of a ramp are exact but at its two ends; 2 % of leaning is the bits of an axis and those."""
    zarr.create_array(tmp_path / "density.zarr", data=a_ball(), chunks=(16, 16, 16))
    box = box_from_zarr(tmp_path / "density.zarr", 0.1, 1.0, [GREY])
    density, axis = (values.astype(float) for values in box.bricks.dense())
    outward = np.moveaxis(np.indices(SHAPE)[::-1] - np.reshape(SHAPE[::-1], (3, 1, 1, 1)) * 0.5, 0, -1)
    edge = (density > 0.15) & (density < 0.85)
    lean = (axis * outward).sum(axis=-1)[edge] / np.linalg.norm(outward, axis=-1)[edge]
    assert edge.sum() > 10_000 and lean.min() > 0.98


@pytest.mark.parametrize("zarr_format", [2, 3])
def test_whole_numbers_are_densities_by_their_scale(tmp_path, zarr_format):
    density = np.round(a_ball() * 200).astype(np.uint8)
    zarr.create_array(tmp_path / "density.zarr", data=density, zarr_format=zarr_format)
    box = box_from_zarr(tmp_path / "density.zarr", 0.1, 1.0, [GREY], scale=1 / 200)
    assert np.array_equal(box.bricks.dense()[0], (density * np.float32(1 / 200)).astype(np.float16))


def test_a_recipe_of_a_volume_is_the_same_box_in_memory_and_on_disk(tmp_path):
    """It stands on z = 0 around x = y = 0. Axes on disk went through halves: a step of 10 bits at most."""
    zarr.create_array(tmp_path / "density.zarr", data=a_ball(), chunks=(16, 16, 16))
    (tmp_path / "ball.toml").write_text(RECIPE)
    whole = build(tmp_path / "ball.toml")
    build_to(tmp_path / "ball.toml", tmp_path / "ball.zarr")
    box = load_box(tmp_path / "ball.zarr")
    assert np.array_equal(box.bricks.places, whole.bricks.places)
    assert np.array_equal(voxels(box)["density"], voxels(whole)["density"])
    assert np.abs(voxels(box)["axis"].astype(float) - voxels(whole)["axis"]).max() < 2.0 / 511
    assert np.allclose(whole.corners().mean(axis=0), (0.0, 0.0, 0.5 * SHAPE[0] * 0.0005))


def _pickled(path: Path) -> None:
    zarr.create_array(path, data=np.ones((5, 5, 5)), zarr_format=2, filters=[Pickle()], compressors=None)  # pyrefly: ignore[bad-argument-type]


def _linked(path: Path) -> None:
    zarr.create_array(path.with_name("elsewhere"), data=a_ball())
    path.mkdir()
    for file in path.with_name("elsewhere").iterdir():
        (path / file.name).symlink_to(file)


REFUSED = {
    "nothing": (lambda path: None, "does not exist"),
    "an empty folder": (lambda path: path.mkdir(), "cannot be read as Zarr"),
    "a group": (lambda path: zarr.create_group(path), "cannot be read as Zarr"),
    "two axes": (lambda path: zarr.create_array(path, data=np.ones((5, 5))), "three numbers"),
    "one layer": (lambda path: zarr.create_array(path, data=np.ones((1, 5, 5))), "three numbers"),
    "NaN": (lambda path: zarr.create_array(path, data=np.full((5, 5, 5), np.nan)), "finite numbers"),
    "below 0": (lambda path: zarr.create_array(path, data=-np.ones((5, 5, 5))), "from 0"),
    "above a half": (
        lambda path: zarr.create_array(path, data=np.full((5, 5, 5), 65000, np.uint16)),
        "from 0 to 60000",
    ),
    "times": (
        lambda path: zarr.create_array(path, data=np.ones((5, 5, 5), "M8[s]"), zarr_format=2),
        "array of numbers",
    ),
    "pickled objects": (_pickled, "'pickle'"),
    "links": (_linked, "is a link"),
}


@pytest.mark.filterwarnings("ignore:.*Zarr V3 specification")
@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_density_is_refused_in_one_line(tmp_path, name):
    make, said = REFUSED[name]
    make(tmp_path / "density.zarr")
    with pytest.raises(InputError) as refused:
        box_from_zarr(tmp_path / "density.zarr", 0.1, 1.0, [GREY], scale=1.0)
    assert said in str(refused.value) and "\n" not in str(refused.value) and "density.zarr" in str(refused.value)


def test_a_volume_outside_the_folder_of_its_recipe_is_refused(tmp_path):
    (tmp_path / "ball.toml").write_text(RECIPE.replace("density.zarr", "../density.zarr"))
    with pytest.raises(InputError, match="points outside"):
        build(tmp_path / "ball.toml")


@pytest.mark.parametrize("kind", [np.float16, np.float32])
def test_a_density_too_thin_to_be_kept_is_said(tmp_path, kind):
    """Half numbers keep 6.1e-5 and more; the rest was lost without a word."""
    axis = np.zeros((*SHAPE, 3), np.float16)
    for peak, what in ((5e-5, "refused"), (0.02, "warned"), (1.0, "kept")):
        density = (a_ball() * peak).astype(kind)
        zarr.create_array(tmp_path / f"{what}.zarr", data=density, chunks=(32, 32, 32))
        for make in (
            lambda density=density: VolumeBox.from_arrays(density, axis, 0.1, 1.0, [GREY]),
            lambda what=what: box_from_zarr(tmp_path / f"{what}.zarr", 0.1, 1.0, [GREY]),
        ):
            if what == "refused":
                with pytest.raises(InputError, match=r"density is 5\S* at most, .* counts as empty: .* divide tau"):
                    make()
            elif what == "warned":
                with pytest.warns(UserWarning, match="density is 0.02 at most"):
                    make()
            else:
                make()  # a warning is an error here
