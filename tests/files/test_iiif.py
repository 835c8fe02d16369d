"""IIIF of an archive: a walk from the manifest to each tile, as a viewer of level 0 takes it, gives the pictures."""

from urllib.parse import quote, unquote

import numpy as np
import pytest
from PIL import Image

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json
from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo_formats.archive.measured_maps import height_over_plane, map_pictures
from hagoromo_formats.archive.pictures import pictures_of
from hagoromo_page.publication.notes import Note, read_notes, selector
from tests.inverse.simulated_relief import SimulatedRelief, places, relief_camera, relief_measurement

ADDRESS = "https://museum.org/iiif/1"
JPEG, JPEG_OF_WIDE = 6.0, 4.0  # of 255: root mean square of what JPEG changes in the pictures here, at most
WIDE = "raking 1"  # of several tiles a side
MEASURED = {"body", "normals", "body_error", "points_height", "points_error", "variance_normal_error", "gloss_beta",
            "gloss_beta_error", "gloss_gamma", "gloss_gamma_error"}  # fmt: skip
OF_MAPS = {"curvature", "occlusion", "stretch"}


NOTES = (
    Note(((7.25, 9.5),), "a spot"),
    Note(((1.0, 2.0), (9.5, 3.0)), "a crack <deep>"),
    Note(((11.0, 2.0), (19.5, 3.0), (15.0, 8.0)), "a loss", closed=True),
)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """An archive of a measured relief with gloss, its maps, and a picture of several tiles a side."""
    home = tmp_path_factory.mktemp("iiif")
    measured = relief_measurement(SimulatedRelief(seed=1, patina=0.2), relief_camera(), 1)
    measured.save(home / "measured")
    hg.inspection_maps(measured).save(home / "maps")
    y, x = np.mgrid[0:1101, 0:1187]
    write_png(home / "raking 1.png", np.stack([x // 5, y // 5, (x + y) // 9], axis=2).astype(np.uint8), srgb=True)
    who = hg.ArchiveProfile(creator="Ada Müller", institution="Museum of Robes", licence="CC-BY-4.0")
    results = [home / "measured", home / "maps", home / "raking 1.png"]
    write_json(
        home / "notes.json",
        {"items": [{"body": {"value": one.text}, "target": {"selector": selector(one)}} for one in NOTES]},
    )
    hg.archive(results, home / "bag", who, inventory="1889.12", iiif=ADDRESS, notes=home / "notes.json")
    return home / "bag" / "data"


def of_address(data, address):
    """The file at an address."""
    assert address.startswith(f"{ADDRESS}/")
    return data / "iiif" / unquote(address.removeprefix(f"{ADDRESS}/"))


def canvases(data):
    """Label of each canvas → it."""
    return {one["label"]["none"][0]: one for one in hg.read_json(data / "iiif" / "manifest.json")["items"]}


def tile(data, info, region, size):
    """A tile (h, w, C), at the address that viewers ask for; of the right size."""
    x, y, width, height = region
    whole = (x, y, width, height) == (0, 0, info["width"], info["height"])
    called = "full" if whole else f"{x},{y},{width},{height}"
    sized = "max" if whole and size == (width, height) else f"{size[0]},{size[1]}"
    with Image.open(of_address(data, f"{info['id']}/{called}/{sized}/0/default.jpg")) as image:
        assert image.size == size
        return np.asarray(image, float).reshape(size[1], size[0], -1)


def put_together(data, info, factor):
    """The picture (h, w, C) that the tiles of a scale factor make."""
    width, height, side = info["width"], info["height"], info["tiles"][0]["width"]
    rows = []
    for y in range(0, height, side * factor):
        row = []
        for x in range(0, width, side * factor):
            w, h = min(side * factor, width - x), min(side * factor, height - y)
            row.append(tile(data, info, (x, y, w, h), (-(-w // factor), -(-h // factor))))
        rows.append(np.concatenate(row, axis=1))
    return np.concatenate(rows, axis=0)


def test_each_map_and_picture_is_a_canvas(data):
    expected = {f"measured/{one}" for one in MEASURED} | {f"maps/{one}" for one in OF_MAPS} | {WIDE}
    assert set(canvases(data)) == expected
    assert len({one["id"] for one in canvases(data).values()}) == len(expected)


def test_pictures_of_the_measurement_carry_the_notes(data):
    for name, canvas in canvases(data).items():
        if name not in {f"measured/{one}" for one in MEASURED}:
            assert "annotations" not in canvas
            continue
        ((page,), size) = canvas["annotations"], (canvas["width"], canvas["height"])
        assert page["type"] == "AnnotationPage" and all(
            one["target"]["source"] == canvas["id"] for one in page["items"]
        )
        path = data.parent / "read.json"
        write_json(path, page)
        assert read_notes(path, size) == NOTES
        path.unlink()
    assert hg.read_json(data / "notes.json")["items"][1]["body"]["value"] == NOTES[1].text


def test_notes_need_one_measurement_and_lie_on_it(data, tmp_path):
    who = hg.ArchiveProfile(creator="A", institution="B", licence="CC0-1.0")
    write_json(tmp_path / "notes.json", {"items": [{"body": {"value": "a"}, "target": "#xywh=9000,1,0,0"}]})
    for results, said in (
        ([data / "raking 1.png"], "hold 0 measurements: give one"),
        ([data / "measured"], "the photographs are"),
    ):
        with pytest.raises(InputError, match=said):
            hg.archive(results, tmp_path / "bag", who, inventory="1", notes=tmp_path / "notes.json")
        assert not (tmp_path / "bag").exists()


def test_the_tiles_of_each_canvas_are_its_picture(data):
    """At each scale, up to what JPEG changes; the sizes that info.json states are there, too."""
    for name, canvas in canvases(data).items():
        body = canvas["items"][0]["items"][0]["body"]
        info = hg.read_json(of_address(data, body["service"][0]["id"]) / "info.json")
        assert info["id"] == body["service"][0]["id"] == f"{ADDRESS}/{quote(name)}" and info["profile"] == "level0"
        size = info["width"], info["height"]
        assert size == (canvas["width"], canvas["height"]) == (body["width"], body["height"])
        with Image.open(data / "pictures" / f"{name}.png") as source, Image.open(of_address(data, body["id"])) as full:
            assert source.size == full.size == size
            for factor in info["tiles"][0]["scaleFactors"]:
                shown = put_together(data, info, factor)
                small = source.resize((shown.shape[1], shown.shape[0]), Image.Resampling.LANCZOS)
                whole = np.asarray(small, float).reshape(*shown.shape[:2], -1)
                assert shown.shape == whole.shape
                error = float(np.sqrt(np.mean((shown - whole) ** 2)))
                assert error < JPEG, (name, factor)
                if name == WIDE:
                    means = np.asarray(source, float)[: shown.shape[0] * factor, : shown.shape[1] * factor].mean((0, 1))
                    assert np.abs(shown.mean((0, 1)) - means).max() < 1.0
                    assert factor > 1 or error < JPEG_OF_WIDE
        for one in info["sizes"]:
            tile(data, info, (0, 0, *size), (one["width"], one["height"]))
        factors = info["tiles"][0]["scaleFactors"]
        assert max(size) <= factors[-1] * info["tiles"][0]["width"], "the coarsest scale is one tile"
        assert factors == [2**k for k in range(len(factors))] and len(info["sizes"]) == len(factors)


def test_heights_are_those_over_the_mean_plane():
    """Against least squares in the axes of the world; the camera looks down, so that what bulges is above 0."""
    camera = relief_camera(37)
    rows, columns = np.mgrid[:37, :37] + 0.5
    points, normals, inside = places(SimulatedRelief(seed=1), camera, rows, columns)
    points[..., 2] += 0.1 * points[..., 0]
    seen = SeenSurface(camera, inside, points, normals, None, None, None, None, None, True)
    x, y, z = points[inside].T
    found = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=1), z)[0]
    above = (z - found[0] * x - found[1] * y - found[2]) / np.sqrt(1.0 + found[0] ** 2 + found[1] ** 2)
    height = height_over_plane(seen)
    assert np.isnan(height[~inside]).all()
    np.testing.assert_allclose(height[inside], 1e3 * above, atol=1e-6)


def test_unknown_pixels_of_a_map_are_grey_and_a_map_without_known_ones_is_none(tmp_path):
    error = np.full((480, 482), 1e-4, np.float32)
    error[0] = np.finfo(np.float32).max
    write_exr(tmp_path / "variance.exr", {"normal": error, "distance": error})
    ((name, pixels),) = map_pictures(tmp_path / "variance.exr")
    assert name == "normal_error" and pixels[0, 7].tolist() == [217, 217, 212] and pixels[1, 7].tolist() != [217] * 3
    write_exr(tmp_path / "variance.exr", {"normal": np.full_like(error, np.finfo(np.float32).max)})
    assert not list(map_pictures(tmp_path / "variance.exr"))


@pytest.mark.parametrize("materials", [None, "[]", "{}"])
def test_points_without_their_measurement_are_no_picture(data, tmp_path, materials):
    for name in ("points.exr", "labels.png", "normals.exr"):
        (tmp_path / name).write_bytes((data / "measured" / name).read_bytes())
    if materials is not None:
        (tmp_path / "materials.json").write_text(materials, encoding="utf-8")
    assert not list(pictures_of(["points.exr"], tmp_path))
