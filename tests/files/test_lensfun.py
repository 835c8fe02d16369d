"""Lenses of lensfun: our camera images a point where lensfun's own formulas say, within the residual that is stated."""

import re

import numpy as np
import pytest
from PIL import Image

from hagoromo.app.cli import main
from hagoromo.app.info import info
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.exif import Exif
from hagoromo_formats.cameras.lensfun import camera_by_lensfun
from hagoromo_formats.convert import ConvertOptions, convert

pytest.importorskip("lensfunpy", reason="lenses by name need lensfunpy")

SIZE, CROP, FOCAL = (600, 400), 1.5, 20.0  # px, -, mm
LENSES = {
    "ptlens": {"a": 0.012, "b": -0.035, "c": 0.004},
    "poly3": {"k1": -0.02},
    "poly5": {"k1": -0.03, "k2": 0.008},
}
EXIF = Exif(focal_mm=FOCAL, camera="Acme Acme One", lens="Acme 20mm f/2")


def database(model: str, kind: str = "rectilinear") -> str:
    figures = " ".join(f'{key}="{value}"' for key, value in LENSES[model].items())
    return f"""<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">
<lensdatabase version="1"><mount><name>Acme</name></mount>
<camera><maker>Acme</maker><model>Acme One</model><mount>Acme</mount><cropfactor>{CROP}</cropfactor></camera>
<lens><maker>Acme</maker><model>Acme 20mm f/2</model><mount>Acme</mount><cropfactor>{CROP}</cropfactor>
<type>{kind}</type><calibration><distortion model="{model}" focal="{FOCAL}" {figures}/></calibration></lens>
</lensdatabase>"""


def by_formula(model: str, r: np.ndarray) -> np.ndarray:
    """Distorted radius, both in half the shorter side (lensfun, "The lens correction models")."""
    c = LENSES[model]
    if model == "ptlens":
        return r * (c["a"] * r**3 + c["b"] * r**2 + c["c"] * r + 1.0 - c["a"] - c["b"] - c["c"])
    if model == "poly3":
        return r * (1.0 - c["k1"] + c["k1"] * r**2)
    return r * (1.0 + c["k1"] * r**2 + c["k2"] * r**4)


@pytest.mark.parametrize("model", LENSES)
def test_the_camera_images_a_point_where_lensfun_does(tmp_path, model):
    """poly3 and poly5 have even powers alone and fit to single precision; ptlens to a hundredth of a pixel."""
    (tmp_path / "a.xml").write_text(database(model))
    found = camera_by_lensfun(SIZE, EXIF, database=tmp_path / "a.xml")
    sensor_mm = np.hypot(36.0, 24.0) / CROP * SIZE[0] / np.hypot(*SIZE)
    focal = FOCAL / sensor_mm * SIZE[0]  # px
    half = 0.5 * min(SIZE)
    r = np.linspace(0.0, 0.97 * np.hypot(*SIZE) / 2 / half, 23)[1:]
    turns = np.linspace(0.0, 2.0 * np.pi, 7)[:-1, None]
    points = np.stack([r * np.cos(turns), r * np.sin(turns), np.full((6, 22), focal / half)], axis=-1)
    placed = found.camera.project(points.reshape(-1, 3)) - np.array(SIZE) / 2
    expected = (by_formula(model, r)[None, :, None] * half * points[..., :2] / r[None, :, None]).reshape(-1, 2)
    bound = found.largest + 1e-4
    assert np.hypot(*(placed - expected).T).max() < bound
    assert found.largest < (0.01 if model == "ptlens" else 1e-6) and found.rms <= found.largest
    plain = Camera(*SIZE, (focal, focal), (SIZE[0] / 2, SIZE[1] / 2)).project(points.reshape(-1, 3))
    assert np.hypot(*(plain - np.array(SIZE) / 2 - expected).T).max() > 1.0


def photograph(path, lens: str = "Acme 20mm f/2") -> None:
    exif = Image.Exif()
    exif[0x010F], exif[0x0110] = "Acme", "Acme One"
    exif.get_ifd(0x8769).update({0x920A: FOCAL, 0xA434: lens})
    Image.fromarray(np.zeros((*SIZE[::-1], 3), np.uint8)).save(path, exif=exif)


def test_convert_makes_a_camera_of_a_photograph(tmp_path, capsys):
    photograph(tmp_path / "a.jpg")
    (tmp_path / "a.xml").write_text(database("poly3"))
    words = ["convert", str(tmp_path / "a.jpg"), "--lens", "auto", "--lensfun", str(tmp_path / "a.xml")]
    for name in ("camera.json", "camera.yml"):
        assert main([*words, "--out", str(tmp_path / name)]) == 0
        said = capsys.readouterr()
        assert "Acme 20mm f/2: fitted to" in said.out + said.err and "vignetting" in said.out + said.err
        camera = read_camera(tmp_path / name)
        assert (camera.width, camera.height) == SIZE and camera.distortion[0] != 0.0
    facts = info(tmp_path / "a.xml")
    assert facts["cameras"] == ["Acme Acme One"] and facts["lenses"] == ["Acme 20mm f/2"]


def test_what_lensfun_does_not_know_is_refused(tmp_path):
    photograph(tmp_path / "a.jpg", "")
    (tmp_path / "a.xml").write_text(database("poly3"))
    (tmp_path / "fish.xml").write_text(database("poly3", "fisheye"))
    (tmp_path / "cut.xml").write_text(database("poly3")[:300])
    (tmp_path / "other.xml").write_text("<a/>")
    for xml, lens, said in (
        ("a.xml", "", "does not name its lens"),
        ("a.xml", "Zeiss Otus", "knows no lens"),
        ("fish.xml", "Acme 20mm", "fisheye"),
        ("cut.xml", "Acme 20mm", "cut.xml"),
        ("other.xml", "Acme 20mm", "no lensfun database"),
    ):
        with pytest.raises(InputError, match=said):
            convert(tmp_path / "a.jpg", tmp_path / "b.json", options=ConvertOptions(lens=lens, lensfun=tmp_path / xml))
    with pytest.raises(InputError, match="knows no camera 'Acme Two'"):
        camera_by_lensfun(SIZE, Exif(focal_mm=FOCAL, camera="Acme Two", lens="a"), database=tmp_path / "a.xml")


@pytest.mark.parametrize("lost", ["maker", "model", "mount", "cropfactor"])
@pytest.mark.parametrize("entry", ["camera", "lens"])
def test_an_entry_that_lacks_a_name_is_refused(tmp_path, entry, lost):
    """Lensfun ends the process at a lens without a maker."""
    before, found, after = database("poly3").replace("Acme 20mm f/2", "A" * 125).partition(f"<{entry}>")
    (tmp_path / "a.xml").write_text(before + found + re.sub(f"<{lost}>.*?</{lost}>", "", after, count=1))
    with pytest.raises(InputError, match=f"a {entry} has no {lost}"):
        info(tmp_path / "a.xml")


def test_what_is_nested_or_long_takes_no_time(tmp_path):
    """Work in steps of the size of the file, not of its square."""
    (tmp_path / "a.xml").write_text(f"<lensdatabase>{'<lens>' * 200_000}{'</lens>' * 200_000}</lensdatabase>")
    with pytest.raises(InputError, match="a lens has no maker"):
        info(tmp_path / "a.xml")
    (tmp_path / "a.xml").write_text(database("poly3"))
    with pytest.raises(InputError, match="knows no lens"):
        camera_by_lensfun(SIZE, EXIF, "1" * 100_000, tmp_path / "a.xml")


def test_the_database_that_comes_with_it_knows_a_common_lens():
    exif = Exif(focal_mm=50.0, camera="Canon Canon EOS 5D Mark II", lens="EF 24-70mm f/2.8L USM")
    found = camera_by_lensfun((1500, 1000), exif)
    assert found.lens == "Canon EF 24-70mm f/2.8L USM" and found.largest < 0.1
