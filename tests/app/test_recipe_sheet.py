"""Contact sheets of recipes: each cell is the picture of its own box; wrong keys and values are one line."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import BAD_INPUT, DONE, main
from hagoromo.errors import InputError
from hagoromo.image import recipe_sheet as module
from hagoromo.image.recipe_sheet import recipe_sheet, varied_keys

RECIPE = """
kind = "solid"
shape = {form = "sphere", radius_mm = 2.0}
voxel_mm = 0.25
seed = 7
[material]
alpha = 0.1
beta = 0.0
gamma = 0.2
n = 1.5
body_colour = "colour.csv"
"""


@pytest.fixture
def recipe(tmp_path):
    (tmp_path / "colour.csv").write_text("wavelength,value\n400,0.5\n700,0.5\n")
    (tmp_path / "ball.toml").write_text(RECIPE)
    return tmp_path / "ball.toml"


def sheet_of(recipe, vary):
    return recipe_sheet(recipe, vary, side=97)


def test_cells_are_to_one_scale_and_one_exposure(recipe):
    """A ball of twice the radius covers four times the pixels; of twice the alpha, one is twice as bright (eq. 2)."""
    sheet = sheet_of(recipe, {"shape.radius_mm": (2.0, 4.0), "material.alpha": (0.1, 0.2)})
    light = hg.srgb_decode(sheet.pictures).mean(axis=-1)
    assert light.shape == (2, 2, 97, 97)
    small, large = (light[1] > 0.0).sum(axis=(1, 2))
    assert large / small == pytest.approx(4.0, rel=0.2)  # edges are two voxels wide: an eighth of the smaller radius
    dim, bright = light[0, 1], light[1, 1]
    there = bright > 0.1
    assert bright[there] / dim[there] == pytest.approx(2.0, rel=0.04)  # a step of 8 bits is 0.9 % at 0.1, 1.6 % at 0.05


def test_a_cell_is_the_picture_of_its_own_box(recipe):
    """The box that `build` makes of a recipe with that value, by the camera and under the lamp of the sheet."""
    sheet = sheet_of(recipe, {"shape.radius_mm": (3.0,)})
    recipe.with_name("own.toml").write_text(RECIPE.replace("2.0", "3.0"))
    box = hg.build(recipe.with_name("own.toml"))
    from hagoromo.image.box_camera import TO_KEY, box_camera

    lamp = hg.Lamp(to_lamp=TO_KEY, spectrum=hg.Spectrum.named("D65"))
    image = hg.render(hg.Scene(box_camera(box, 97), (lamp,), (box,)), hg.Settings(samples=4))
    assert np.array_equal(sheet.pictures[0, 0], image.display())
    assert sheet.labels() == [[""]] and "seed 7" in sheet.title and "radius_mm = 3" in sheet.title


def test_equal_values_give_equal_cells(recipe):
    """All cells have one seed."""
    first, second = sheet_of(recipe, {"material.gamma": (0.3, 0.3)}).pictures[0]
    assert np.array_equal(first, second)


def test_the_sheet_is_written_with_its_labels(recipe, tmp_path, capsys):
    """Cells keep their pixels in the PNG; --vary may be given twice; units stand behind values that have none yet."""
    out, words = tmp_path / "sheet.png", ["--vary", "shape.radius_mm=2,3,4", "--vary", "material.beta=0,0.1"]
    assert main(["build", str(recipe), *words, "--cell", "200", "--out", str(out)]) == DONE
    assert capsys.readouterr().out == f"wrote {out}\n"
    picture = hg.read_png(out)
    assert picture.shape[1] == 3 * 208 + 8
    sheet = recipe_sheet(recipe, varied_keys(words[1::2]), side=200)
    assert np.array_equal(picture[-(200 + 8 + 2 * 16 + 8) :][:200, 8:208], sheet.pictures[1, 0])
    assert sheet.labels()[1][2] == "shape.radius_mm = 4\nmaterial.beta = 0.1 /sr"


@pytest.mark.parametrize(
    ("kind", "key", "values", "said"),
    [
        ("cloth", "warp.twist_per_cm", (2.0, 100.0), "with warp.twist_per_cm = 100: .* packing limit"),
        ("knit", "yarn.flatness", (1.0, 7.0), "with yarn.flatness = 7: .* from 1 \\(round\\) to 2"),
    ],
)
def test_a_value_that_its_matter_refuses_is_known_before_any_box_is_built(recipe, monkeypatch, kind, key, values, said):
    """Planning a cloth takes half a minute: of ten cells the last one would be refused after five."""
    monkeypatch.setattr(module, "build", lambda *_, **__: pytest.fail("a box was built"))
    cloth = recipe.with_name("cloth.toml")
    text = RECIPE.replace('shape = {form = "sphere", radius_mm = 2.0}\n', "").replace('"solid"', f'"{kind}"')
    cloth.write_text(text)
    with pytest.raises(InputError, match=said):
        recipe_sheet(cloth, {key: values})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["shape.radus_mm=2,3"], "has the unknown key 'radus_mm': known are form, radius_mm"),
        (["yarn.twist=2,3"], "has the unknown key 'yarn': known are format_version, kind, material"),
        (["voxel_mm.x=2,3"], "voxel_mm is no table"),
        (["material.beta=0.1,x"], "beta must be a finite number: given 'x'"),
        (["voxel_mm=0.25,-1"], "voxel_mm must be a number above 0"),
        (["material.alpha=0.1,9"], "with material.alpha = 9 /sr"),
        (["kind=solid,skin"], "kind cannot vary"),
        (["seed"], "does not say what varies"),
        (["seed=1,2", "seed=3"], "seed varies twice"),
        (["seed=1,2", "voxel_mm=1,2", "material.beta=0,1"], "give several to two keys at most"),
        (["seed=" + ",".join(map(str, range(101)))], "101 cells"),
    ],
)
def test_wrong_use_is_one_line(recipe, tmp_path, capsys, words, said):
    """Exit status 2, the keys that there are, and no file."""
    out = tmp_path / "sheet.png"
    assert (
        main(["build", str(recipe), *(f"--vary={word}" for word in words), "--cell", "64", "--out", str(out)])
        == BAD_INPUT
    )
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--vary", "seed=1,2", "--out", "sheet.zarr"], "no PNG name"),
        (["--vary", "seed=1,2", "--across-mm", "0", "--out", "sheet.png"], "a width above 0"),
        (["--vary", "seed=1,2", "--cell", "9", "--out", "sheet.png"], "64 to 2048"),
        (["--vary", "seed=1,2", "--scheduler", "2", "--out", "sheet.png"], "leave --scheduler out"),
        (["--cell", "90", "--out", "ball.zarr"], "give --vary"),
    ],
)
def test_wrong_options_are_one_line(recipe, monkeypatch, tmp_path, capsys, words, said):
    """Before any box is built."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "build", None)
    assert main(["build", str(recipe), *words]) == BAD_INPUT
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_boxes_are_built_once(recipe, monkeypatch, tmp_path):
    """An interrupted sheet writes nothing; the next one builds what is left; all is built anew for another colour."""
    monkeypatch.setenv("HAGOROMO_CACHE", str(tmp_path / "cache"))
    built, build, stop_at = [], module.build, [2]

    def counted(tables, **given):
        if len(built) + 1 == stop_at[0]:
            raise KeyboardInterrupt
        built.append(tables["shape"]["radius_mm"])
        return build(tables, **given)

    monkeypatch.setattr(module, "build", counted)
    words = ["build", str(recipe), "--vary", "shape.radius_mm=2,3", "--cell", "64", "--out", str(tmp_path / "s.png")]
    assert main(words) == 130 and not (tmp_path / "s.png").exists()
    stop_at[0] = 0
    assert main(words) == DONE and built == [2, 3]
    assert main([*words, "--force"]) == DONE and built == [2, 3]
    (tmp_path / "colour.csv").write_text("wavelength,value\n400,0.4\n700,0.5\n")
    assert main([*words, "--force"]) == DONE and built == [2, 3, 2, 3]
