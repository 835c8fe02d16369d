"""Light that another process solved has the bits of light that is solved here, and is that of this scene or none."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
import hagoromo.image.full.picture as full
from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.files.array_tree import digest_of_tree, read_tree, write_tree
from hagoromo.files.cache import DATA, cache
from hagoromo.image.full.solved_light import FILE, SolvedLight, StoredLight
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.scene import patch_meshes
from hagoromo.image.scene.settings import Settings
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import Element
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.film import pixel_points

WHITE, RED = Spectrum.constant(1.0), Spectrum([360, 400, 700, 830], [0.15, 0.15, 0.85, 0.85])
SOLVED = Settings(walks=0)
PARTS = [("box",), ("floor",), ("box", "floor")]


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    monkeypatch.setattr(patch_meshes, "MOST_PATCHES", 600)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The folder of an empty cache that is in use."""
    monkeypatch.setenv("HAGOROMO_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def paint(element: Element = "plane", colour=RED):
    return hg.Reflectance(0.9 / math.pi, 0.0, 0.3, 1.5, colour, element=element)


def box_of(depth=3.0, colour=RED, mark=1.0):
    """Of 7 × 5 × 11 voxels; mark: density of one of them."""
    density = np.ones((11, 5, 7))
    density[3, 2, 4] = mark
    axes = np.broadcast_to((0.36, -0.48, 0.8), (*density.shape, 3))
    material = paint("sphere", colour)
    return hg.VolumeBox.from_arrays(density, axes, 0.1, 20.0 * depth, [material], extinction="projected")


def scene_of(parts=("box",), box=None, eye=(2.2, -2.4, 1.6), intensity=1.0):
    camera = hg.Camera(13, 11, (15, 15), (6.5, 5.5)).look_at(eye, (0.3, 0.2, 0.5))
    boxes = (box or box_of(),) if "box" in parts else ()
    floors = (hg.Surface.floor(-0.05, 1.0, paint()), hg.Surface.sphere((0.8, 0.8, 0.3), 0.2, paint()))
    lamp = hg.Lamp(to_lamp=(0.48, -0.6, 0.64), intensity=intensity)
    return hg.Scene(camera, (lamp,), boxes, floors if "floor" in parts else ())


def picture(scene, settings=SOLVED, shared=True):
    """By a process that has nothing but the cache on disk."""
    points = pixel_points(settings.samples, settings.seed)
    return full.full_picture(scene, settings, points, SceneCache(cache() if shared else None))


@pytest.fixture
def solving(monkeypatch):
    """Counts what is solved."""
    solved, solve = [], full._Unsolved.solved
    monkeypatch.setattr(full._Unsolved, "solved", lambda self: solved.append(self) or solve(self))
    return solved


@pytest.mark.by_night("box", "box+floor")
@pytest.mark.parametrize("parts", PARTS, ids="+".join)
def test_light_that_is_read_has_the_bits_of_light_that_is_solved(place, solving, parts):
    """Of another camera, too; metadata say the same."""
    other = scene_of(parts, eye=(-2.2, -2.0, 1.5))
    whole, turned = picture(scene_of(parts), shared=False), picture(other, shared=False)
    assert len(solving) == 2 and not place.exists() and whole.weights.max() > 0
    first, again, from_there = picture(scene_of(parts)), picture(scene_of(parts)), picture(other)
    assert len(solving) == 3 and len(list(cache().entries())) == 1
    for image, expected in ((first, whole), (again, whole), (from_there, turned)):
        assert image.weights.tobytes() == expected.weights.tobytes() and image.metadata == expected.metadata


def test_the_next_picture_of_a_scene_file_takes_the_light_of_the_one_before(place, solving, tmp_path):
    """By another camera and more rays; a scene that is no file solves for itself, as studies that take its time do."""
    box_of().save(tmp_path / "box.zarr")
    lines = """
        [camera]
        size = [13, 11]
        focal = [15, 15]
        eye = [{eye}, -2.4, 1.6]
        target = [0.3, 0.2, 0.5]
        [[lamp]]
        to_lamp = [0.48, -0.6, 0.64]
        intensity = 1.0
        [[box]]
        file = "box.zarr"
        """
    pictures, scene = [], tmp_path / "scene.toml"
    for eye in (2.2, -2.2, -2.2):
        scene.write_text(lines.format(eye=eye), encoding="utf-8")
        given = scene if len(pictures) < 2 else hg.load_scene(scene)[0]
        pictures.append(hg.render(given, SOLVED, mode="full"))
    assert len(solving) == 2  # the first and the last
    assert not np.array_equal(pictures[0].weights, pictures[1].weights)
    np.testing.assert_array_equal(pictures[1].weights, pictures[2].weights)


def test_what_light_depends_on_is_solved_anew(place, solving):
    """Another lamp, density of one voxel, colour, place, order of light or seed; a camera and rays do not count."""
    plain, moved = scene_of(), np.eye(4)
    moved[2, 3] = 0.01
    pose = scene_of(box=box_of().with_pose(moved))
    others = [scene_of(intensity=2.0), scene_of(box=box_of(mark=0.5)), scene_of(box=box_of(colour=WHITE)), pose]
    for scene in (plain, *others):
        picture(scene)
    for settings in (replace(SOLVED, orders=2), replace(SOLVED, seed=1), replace(SOLVED, tolerance=0.02)):
        picture(plain, settings)
    assert len(solving) == len(list(cache().entries())) == 8
    named = replace(box_of(), name="another", provenance={"made": "elsewhere"})
    picture(scene_of(box=named, eye=(-2.2, -2.0, 1.5)), replace(SOLVED, samples=2))
    assert len(solving) == 8


def test_light_of_another_program_is_solved_anew(place, solving, monkeypatch):
    picture(scene_of())
    monkeypatch.setattr("hagoromo.files.cache.program", lambda: "another version")
    picture(scene_of())
    assert len(solving) == 2


def stored_of(place):
    (entry,) = (entry for entry, _, _ in cache().entries())
    return read_tree(entry / DATA / FILE, StoredLight)


def changed(record: Any, change: dict[str, Any]) -> Any:
    return replace(record, **change)


@pytest.mark.by_night("box+floor")
@pytest.mark.parametrize("parts", PARTS, ids="+".join)
def test_stored_light_of_wrong_sizes_is_refused(place, parts, monkeypatch):
    """Numbers, cells or channels that do not fit each other, or the scene."""
    readers, again = [], full._Unsolved.again
    monkeypatch.setattr(full._Unsolved, "again", lambda self, stored: readers.append(self) or again(self, stored))
    picture(scene_of(parts))
    picture(scene_of(parts))
    (reader,), right = readers, stored_of(place)
    assert isinstance(again(reader, right), SolvedLight)
    wrong = [StoredLight(None, None)]
    if field := right.field:
        cells = field.cells
        wrong += [
            replace(right, field=changed(field, change))
            for change in (
                {"values": field.values[:-1]},
                {"values": field.values.astype(np.float32)},
                {"scale": (*field.scale, 1.0)},
                {"scale": tuple(math.nan for _ in field.scale)},
                {"cells": replace(cells, filled=cells.filled[:-1])},
                {"cells": replace(cells, known=cells.known[:-1])},
                {"cells": replace(cells, shape=(*cells.shape[:2], 1 << 40))},
                {"cells": replace(cells, shape=(*cells.shape[:2], -1))},
            )
        ]
    if light := right.at_surfaces:
        numbers = light.at_corners
        wrong += [
            replace(right, at_surfaces=changed(light, {"at_corners": each}))
            for each in (numbers[1:], numbers[:, :9], numbers[:, 1:], numbers.astype(np.float64), numbers[0])
        ]
    for number, stored in enumerate(wrong):
        write_tree(place / "light", stored)
        with pytest.raises(InputError):
            again(reader, read_tree(place / "light", StoredLight))
            pytest.fail(f"wrong light {number} was taken")


def test_cells_come_back_with_their_table():
    """Some are not known; none is at the sides of the grid."""
    filled = np.zeros((7, 5, 6), bool)
    filled[2:4, 2, 1:4] = filled[5, 3, 2] = True
    cells = Cells(np.array([0.1, -0.2, 3e5 + 1e-7]), 0.1 + 1e-17, filled)
    known = np.arange(cells.count) % 3 > 0
    cells.without(lookup(arrays().Bool, ~known))
    other = Cells.of(cells.stored())
    assert (other.low == cells.low).all() and other.size == cells.size and other.filled == cells.filled
    assert np.array(other.table).tobytes() == np.array(cells.table).tobytes()
    assert 0 < (np.array(other.table) >= 0).sum() == known.sum()


def test_digests_of_trees_are_those_of_their_values():
    """Not of the places of arrays in memory; a shape, a type, a sign of zero or an order is another value."""
    one = {"a": np.arange(6.0).reshape(2, 3), "b": (1, None, RED)}
    same = {"b": (1, None, Spectrum(RED.wavelengths.copy(), RED.values.copy())), "a": np.arange(6.0).reshape(2, 3)}
    assert digest_of_tree(one) == digest_of_tree(same)
    others = [
        one | {"a": one["a"].reshape(3, 2)}, one | {"a": one["a"].astype(np.float32)}, one | {"b": (1, RED, None)},
        one | {"b": (1.0, None, RED)}, one | {"b": (True, None, RED)}, one | {"b": ("1", None, RED)},
        one | {"b": (1, (None, RED))}, one | {"b": (1, None, WHITE)}, one | {"c": None}, {"a": one["a"]},
        one | {"a": -one["a"]}, one | {"a": one["a"] + 0.0, "b": (1, None, RED, RED)},
    ]  # fmt: skip
    assert len({digest_of_tree(each) for each in [one, *others]}) == 1 + len(others)
    for value in (object(), {1: 2}, np.array([object()]), {3}):
        with pytest.raises(TypeError):
            digest_of_tree(value)
