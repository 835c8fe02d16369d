"""Every recipe that ships builds as it stands, the same bits for the same seed, and refuses what cannot be."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box
from studies.gallery.gallery_items import ITEMS

FOLDER = Path(__file__).parents[2] / "examples" / "recipes"
RECIPES = sorted(path.stem for path in FOLDER.glob("*.toml"))
LINE = re.compile(r"^(\w+) = (.+?)(\s+#.*)?$")
QUICK = ("hair", "linen", "primary", "skin", "solid", "stockinette")  # one of each kind, but for the wing: a minute
BY_NIGHT = [name if name in QUICK else pytest.param(name, marks=pytest.mark.nightly) for name in RECIPES]
SIGNED = {"bow_mm", "arch_mm", "camber_mm", "parting_mm"}  # these may be below 0
COARSE = {"skin": 0.3, "solid": 0.5}  # resolution of a quick build


def coarse(name: str) -> str:
    """The text of a recipe for a quick build: coarse, small where a size is told, of one variant of a texel."""
    text = re.sub(r"^((?:width|height|size)_mm) = .*", r"\1 = 5.0", (FOLDER / f"{name}.toml").read_text(), flags=re.M)
    text = re.sub(r"^(hairs|locks) = .*", r"\1 = 50", text, flags=re.M)
    text = re.sub(r"^(resolution|variants) = .*\n", "", text, flags=re.M)
    few = "variants = 1\n" if re.search(r'^kind = "(cloth|knit)"', text, flags=re.M) else ""
    return f"resolution = {COARSE.get(name, 0.35)}\n{few}{text}"


def same_bits(one: VolumeBox, other: VolumeBox) -> bool:
    """All bricks and, where there is one, all levels of the texel."""
    if not all(np.array_equal(a, b) for a, b in zip(one.bricks.dense(), other.bricks.dense(), strict=True)):
        return False
    if one.texel is None or other.texel is None:
        return one.texel is other.texel
    levels = zip(one.texel.levels, other.texel.levels, strict=True)
    return all(np.array_equal(getattr(a, k), getattr(b, k)) for a, b in levels for k in ("density", "axis", "scale"))


def test_every_recipe_is_in_the_gallery():
    assert {item.recipe for item in ITEMS.values()} == set(RECIPES)


@pytest.mark.by_night("hair", "stockinette", "primary")
@pytest.mark.parametrize("name", BY_NIGHT)
def test_a_recipe_builds(name, tmp_path, capsys, few_match_points):
    """By the command line, to a box that loads with matter in it; in memory, twice, with the same bits.

    A box with a texel is built in memory by the command, too. The kernels that fill blocks of other boxes on disk round
    otherwise: by half a bit of a half, and here and there at a threshold.
    """
    (tmp_path / "matter.toml").write_text(coarse(name))
    assert main(["build", str(tmp_path / "matter.toml"), "--out", str(tmp_path / "matter.zarr")]) == 0
    assert "of them hold matter" in capsys.readouterr().out
    box = load_box(tmp_path / "matter.zarr")
    assert len(box.bricks.places) > 0
    assert box.name == tomllib.loads(coarse(name))["name"]
    built = build(tmp_path / "matter.toml")
    again = box if box.texel else build(tmp_path / "matter.toml")
    on_disk, in_memory = (each.bricks.dense()[0].astype(float) for each in (box, built))
    assert np.abs(on_disk - in_memory).sum() < 1e-3 * in_memory.sum()
    assert same_bits(built, again)


def spoiled(value: str) -> list[str]:
    """What no key takes that holds `value`: another type, no number, a number below 0."""
    if value.startswith('"'):
        return ["7", "nan", '"no such thing"']
    if value.startswith("["):
        return ["7", '"wide"', "[nan]"]
    if value.startswith("{"):
        return ["nan", '"no such thing"', "{nonsense = 1}"]
    return ['"wide"', "nan", "inf", "-1.5", "true", "[1]"]


def bad_lines() -> list[tuple[str, int, str]]:
    """Every key of every recipe with what it does not take: name, number of the line, the line in its place."""
    found = []
    for name in RECIPES:
        for number, line in enumerate((FOLDER / f"{name}.toml").read_text().splitlines()):
            told = LINE.match(line)
            if told and told[1] != "name":
                bad = [value for value in spoiled(told[2]) if not (told[1] in SIGNED and value == "-1.5")]
                found += [(name, number, f"{told[1]} = {value}") for value in bad]
            elif line.startswith("["):
                found.append((name, number, f"{line}\nnonsense = 1"))
    return found


def refused(text: str, folder: Path, capsys) -> str:
    """The line that says why the recipe of `text` is refused."""
    (folder / "matter.toml").write_text(text)
    assert main(["build", str(folder / "matter.toml"), "--out", str(folder / "matter.zarr")]) == 2, text
    said = capsys.readouterr().err
    assert said.startswith("hagoromo: ") and said.count("\n") == 1 and "Traceback" not in said
    assert "matter.toml" in said
    assert not (folder / "matter.zarr").exists()
    return said


@pytest.mark.parametrize("name", BY_NIGHT)
def test_every_key_refuses_what_it_does_not_take(name, tmp_path, capsys):
    """Other types, NaN, infinity, numbers below 0 and unknown keys, for every line of the file."""
    lines = (FOLDER / f"{name}.toml").read_text().splitlines()
    for recipe, number, bad in bad_lines():
        if recipe == name:
            (tmp_path / "matter.toml").write_text("\n".join([*lines[:number], bad, *lines[number + 1 :]]))
            with pytest.raises(InputError, match=r"\A.*matter\.toml.*\Z"):  # one line: . is no end of a line
                build(tmp_path / "matter.toml")
    assert "known are" in refused("nonsense = 1\n" + "\n".join(lines), tmp_path, capsys)


@pytest.mark.parametrize(
    ("name", "key", "value", "said"),
    [
        ("linen", "diameter_mm", "-0.3", "diameter_mm"),
        ("linen", "diameter_mm", "2.0", "packing limit"),
        ("linen", "fibres", "900", "fibres"),
        ("linen", "twist_per_cm", "60.0", "packing limit"),
        ("linen", "warp_per_cm", "80.0", "do not fit"),
        ("linen", "weave", '"felt"', "one of plain"),
        ("linen", "voxel_mm", "1e-5", "too fine"),
        ("linen", "lay", '"rolled"', "one of flat"),
        ("twill", "over", "0", "over must be"),
        ("twill", "plies", "40", "plies"),
        ("satin", "step", "4", "satin"),
        ("herringbone", "width", "2", "herringbone"),
        ("jacquard", "pattern", '["01", "0"]', "rows of equal length"),
        ("stockinette", "wales_per_cm", "40.0", "does not fit 40 wales"),
        ("primary", "quill", "1.5", "quill"),
        ("primary", "per_mm", "40.0", "do not fit"),
        ("primary", "rachis_mm", "30.0", "rachis_mm"),
        ("covert", "edge_mm", "-1", "edge_mm"),
        ("skin", "granule_mm", "0.0", "granule_mm"),
        ("skin", "body_colour", "{melanin = 1.5}", "melanin"),
        ("solid", "radii_mm", "[1.0, 0.0, 1.0]", "above 0"),
        ("solid", "alpha", "0.9", "energy conservation"),
    ],
)
def test_what_cannot_be_made_is_refused(name, key, value, said, tmp_path, capsys):
    text, count = re.subn(
        rf"^{key} = .*", f"{key} = {value}", (FOLDER / f"{name}.toml").read_text(), count=1, flags=re.M
    )
    assert count == 1
    assert said in refused(text, tmp_path, capsys)
