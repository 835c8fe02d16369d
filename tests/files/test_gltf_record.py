"""The JSON of a glTF is checked once: each number is one, names an entry that there is, and extensions are heeded."""

import copy
import json

import pytest

from fuzz import gltf_scenes
from fuzz.trees import nodes_of, with_node
from hagoromo.errors import InputError
from hagoromo.files.gltf_record import checked
from hagoromo.files.mesh import read_mesh, read_parts

UNREAD = {("cameras", 0, "perspective", "znear"), ("accessors", 1, "max"), ("accessors", 1, "min")}


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "scene.gltf"
    gltf_scenes.scene(path)
    return json.loads(path.read_text())


def refused(record) -> str:
    with pytest.raises(InputError) as error:
        checked(json.dumps(record).encode(), "a.gltf")
    assert str(error.value).startswith("a.gltf") and "\n" not in str(error.value)
    return str(error.value)


def test_the_sample_has_what_is_read(record):
    assert checked(json.dumps(record).encode(), "a.gltf") == record
    assert len(list(nodes_of(record))) > 150


def test_true_is_no_number_anywhere(record):
    """`"children": [false]` was node 0, `"ior": true` 1."""
    numbers = [
        path
        for path, value in nodes_of(record)
        if isinstance(value, (int, float)) and path not in UNREAD and path[:-1] not in UNREAD
    ]
    assert len(numbers) > 70
    for path in numbers:
        for value in (False, True):
            assert "given" in refused(with_node(record, path, value)), path


def test_numbers_of_entries_that_there_are_not_are_refused(record):
    """Each list that others name is emptied, and each number is set beyond all lists."""
    for kind in (
        "nodes",
        "meshes",
        "accessors",
        "bufferViews",
        "buffers",
        "materials",
        "textures",
        "images",
        "cameras",
    ):
        assert f"of {kind}, of which there are 0: mend it" in refused(record | {kind: []})
    said = refused(with_node(record, ("nodes", 0, "children", 0), 99))
    assert "a child of node 0 is number 99 of nodes, of which there are 2" in said


def test_a_file_that_needs_what_is_not_read_is_refused_in_one_line(tmp_path, record):
    """Draco and meshopt pack the arrays; without their numbers all corners would lie at 0."""
    for name in ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"):
        made = record | {"extensionsUsed": [name], "extensionsRequired": [name]}
        assert f"needs the extension {name}, which is not read" in refused(made)
        (tmp_path / "a.gltf").write_text(json.dumps(made))
        for read in (read_mesh, read_parts):
            with pytest.raises(InputError, match=f"needs the extension {name}"):
                read(tmp_path / "a.gltf")
    for name in ("KHR_lights_punctual", "KHR_materials_ior", "KHR_texture_transform"):
        assert checked(json.dumps(record | {"extensionsRequired": [name]}).encode(), "a.gltf")


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("accessors", 1, "sparse"), {"count": 1}, "accessor 1 is sparse, or packed by an extension"),
        (("accessors", 1, "count"), 10**9, "accessor 1 states 1000000000 VEC3 and does not hold them"),
        (("accessors", 1, "byteOffset"), 4, "accessor 1 states 4 VEC3 and does not hold them"),
        (("bufferViews", 1, "byteStride"), 4, "accessor 1 states 4 VEC3 and does not hold them"),
        (("bufferViews", 0, "byteOffset"), 10**6, "accessor 0 states 12 SCALAR and does not hold them"),
        (("accessors", 0, "componentType"), 5124, "accessor 0 states 12 SCALAR and does not hold them"),
        (("accessors", 1, "type"), "VEC9", "accessor 1 states 4 VEC9 and does not hold them"),
    ],
)
def test_an_array_that_is_not_where_it_says_is_refused(record, path, value, said):
    made = copy.deepcopy(record)
    at = made
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    assert said in refused(made)


def test_fractions_in_whole_numbers_are_refused(record):
    """They would be taken for the whole numbers: a mesh 65,535 times too large."""
    made = with_node(with_node(record, ("accessors", 1, "componentType"), 5123), ("accessors", 1, "count"), 3)
    assert checked(json.dumps(made).encode(), "a.gltf")
    made["accessors"][1] |= {"normalized": True}
    assert "accessor 1 has whole numbers for fractions" in refused(made)
