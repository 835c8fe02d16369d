"""Photographs of one view that contradict each other are refused in one line, and nothing is left behind."""

import numpy as np
import pytest
from PIL import Image

from hagoromo.app.cli import main
from hagoromo.files.png import write_png
from tests.inverse.simulated_bracket import numbers, scene, write_dng

EXPOSURE, ISO, F_NUMBER, FOCAL, FILM, MODEL = 0x829A, 0x8827, 0x829D, 0x920A, 0xA405, 0x0110
SHUTTER, RESOLUTION, UNIT, PIXELS = 0x9201, 0xA20E, 0xA210, 0xA002


def jpeg(path, size=(31, 23), **tags):
    """A JPEG of a bright disc; tags of its EXIF by name."""
    y, x = np.mgrid[: size[1], : size[0]]
    disc = np.hypot(x - size[0] / 2, y - size[1] / 2) < 0.3 * size[1]
    picture = Image.fromarray(np.where(disc, 180, 12).astype(np.uint8)[..., None].repeat(3, axis=2))
    exif = Image.Exif()
    exif[MODEL] = tags.pop("model", "One")
    exif.get_ifd(0x8769).update({globals()[name.upper()]: value for name, value in tags.items()})
    picture.save(path, quality=95, exif=exif)
    return path


@pytest.fixture
def dome(tmp_path):
    """Writes the photographs a, b, c with these tags of each, and dome.lp; gives the arguments of `capture`."""

    def write(*tags, lp="3\na.jpg 0 0.5 1\nb.jpg 0.5 -0.3 1\nc.jpg -0.5 -0.3 1\n", **sizes):
        for name, own in zip("abc", tags or ({}, {}, {}), strict=True):
            jpeg(tmp_path / f"{name}.jpg", sizes.get(name, (31, 23)), **own)
        (tmp_path / "dome.lp").write_text(lp)
        files = [tmp_path / f"{name}.jpg" for name in "abc"]
        return ("capture", *files, "--lamps", tmp_path / "dome.lp", "--out", tmp_path / "capture", "--transfer", "srgb")

    return write


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        (({"focal": 50.0}, {"focal": 50.0}, {"focal": 55.0}), "a.jpg has a focal length of 50 mm and c.jpg"),
        (({"f_number": 8.0}, {"f_number": 5.6}, {"f_number": 8.0}), "the aperture f/8 and b.jpg the aperture f/5.6"),
        (({"model": "One"}, {"model": "Two"}, {"model": "One"}), "taken by One and b.jpg by Two"),
        (({"exposure": 0.1}, {}, {"exposure": 0.1}), "a.jpg states its exposure time and b.jpg does not"),
        (
            ({"exposure": 0.1, "shutter": 6.0},) * 3,
            "contradicts itself: its exposure time is 0.1 s by one tag and 0.0156",
        ),
        (
            ({"focal": 50.0, "film": 50, "resolution": 100.0, "unit": 4, "pixels": 2230},) * 3,
            "contradicts itself: its sensor is 22.3 mm wide by its resolution and 36 mm",
        ),
    ],
)
def test_exif_that_contradicts_itself_or_others_is_refused(refused, dome, tags, said):
    assert said in refused(*dome(*tags))


def test_what_a_dome_lacks_is_said(refused, dome, tmp_path):
    assert "b.jpg is 30 × 23 px and a.jpg 31 × 23" in refused(*dome(b=(30, 23)))
    assert "states 4 photographs and lists 3" in refused(*dome(lp="4\na 0 0 1\nb 0 1 1\nc 1 0 1\n"))
    assert "3 photographs and 2 lamps (c.jpg without its match)" in refused(*dome(lp="2\na 0 0 1\nb 0 1 1\n"))
    assert "no lamp has the name of c.jpg" in refused(*dome(lp="3\na 0 0 1\nb 0 1 1\nd 1 0 1\n"))
    assert "every lamp is behind" in refused(*dome(lp="3\na 0 1 -1\nb 0 0 -1\nc 1 0 -1\n"))
    write_png(tmp_path / "black.png", np.zeros((23, 31), np.uint8))
    assert "black.png is black everywhere" in refused(*dome(), "--mask", tmp_path / "black.png")
    write_png(tmp_path / "other.png", np.zeros((24, 31), np.uint8))
    assert "resize the mask" in refused(*dome(), "--mask", tmp_path / "other.png")
    assert "does not exist" in refused(*dome(), "--mask", tmp_path / "none.png")
    assert "are rarely linear" in refused(*dome()[:-2])
    assert "no transfer curve is called 'log'" in refused(*dome()[:-1], "log")
    assert "2 exposures for 3 photographs" in refused(*dome(), "--exposures", "1", "2")
    assert "go together" in refused(*dome(), "--gain", "1")


def test_a_raw_file_of_an_unknown_maker_leaves_nothing(refused, tmp_path):
    """Also where others were already developed when it came."""
    write_dng(tmp_path / "a.dng", numbers(scene(1), 0.2, 1), 0.2)
    (tmp_path / "b.cr2").write_bytes(b"II*\0\x10\0\0\0CR\x02\0 and no more")
    (tmp_path / "dome.lp").write_text("2\na.dng 0 0.5 1\nb.cr2 0 -0.5 1\n")
    arguments = ("--lamps", tmp_path / "dome.lp", "--exposures", "0.2", "--out", tmp_path / "capture")
    said = refused("capture", tmp_path / "a.dng", tmp_path / "b.cr2", *arguments)
    assert "b.cr2 cannot be read as camera RAW" in said


@pytest.mark.filterwarnings("always")
def test_two_objects_and_lamps_on_one_side_are_warned_of(dome, tmp_path, capsys):
    arguments = dome(lp="3\na.jpg 0 0.5 1\nb.jpg 0.4 0.3 1\nc.jpg -0.4 0.3 1\n")
    two = np.zeros((23, 31), np.uint8)
    two[4:12, 3:12] = two[6:15, 18:27] = 255
    write_png(tmp_path / "two.png", two)
    assert main([str(argument) for argument in (*arguments, "--mask", tmp_path / "two.png")]) == 0
    said = capsys.readouterr()
    assert said.err.count("\n") == 2 and "two.png has 2 parts of similar size" in said.err
    assert "all 3 lamps are on one side: none lights the object from the bottom" in said.err
    for what in ("transfer: srgb, as stated", "mask: by hand: two.png", "lamps: 3 from dome.lp, matched by name"):
        assert what in said.out
    assert "camera: orthographic" in said.out and "exposure: the same for all" in said.out


def test_a_wrong_kind_of_file_is_named_as_such(refused, dome, tmp_path):
    """What a stranger gives in place of a list of lamps, of photographs, of a capture, of a measurement."""
    arguments, empty = dome(), tmp_path / "empty"
    empty.mkdir()
    (tmp_path / "lamps.csv").write_text("x,y,z\n0,0,1\n")
    out = "--out", tmp_path / "result"
    assert "is no list of lamps" in refused("capture", *arguments[1:4], "--lamps", tmp_path / "lamps.csv", *out)
    assert "empty has no photographs: give a folder of RAW" in refused(
        "capture", empty, "--lamps", tmp_path / "dome.lp", *out
    )
    for verb in ("measure", "relight"):
        assert "empty has no transforms.json: give a capture" in refused(verb, empty, *out)
    for verb, *more in (("publish",), ("export", "--to", "png")):
        assert "has no materials.json: give a folder that `hagoromo measure` wrote" in refused(verb, empty, *more, *out)
    assert "none.exr2 does not exist" in refused("view", tmp_path / "none.exr2")
    assert "a.jpg cannot be viewed: give a scene" in refused("view", arguments[1])
