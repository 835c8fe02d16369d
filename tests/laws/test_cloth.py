"""Drafts are what weavers mean by their names, WIF files say the same, and a built cloth has the draft's yarns."""

from itertools import pairwise

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo_matter.cloth.draft import Draft, herringbone, jacquard, on_loom, plain, satin, twill
from hagoromo_matter.cloth.wif import cloth_of, read_wif
from hagoromo_matter.cloth.yarn import Yarn

WIF = """
[WIF]
Version=1.1
[PRIVATE NONSENSE]
anything=goes
[CONTENTS]
WEAVING=true
[WEAVING]
Shafts=4
Treadles=4
Rising Shed=true
[WARP]
Threads=4
Units=centimeters
Spacing=0.05
Thickness=0.03
Color=1
[WEFT]
Threads=4
Color=2
Spacing=0.0625
[COLOR PALETTE]
Range=0,999
Entries=3
[COLOR TABLE]
1=999,999,999
2=0,0,333
3=999,0,0
[WARP COLORS]
2=3
[THREADING] ; straight
1=1
2=2
3=3
4=4
[TIEUP]
1=1,2
2=2,3
3=3,4
4=4,1
[TREADLING]
1=1
2=2
3=3
4=4
"""
LIFTED = "[LIFTPLAN]\n1=1,2\n2=2,3\n3=3,4\n4=4,1\n"


def wif(tmp_path, text: str):
    (tmp_path / "a.wif").write_text(text)
    return read_wif(tmp_path / "a.wif")


@pytest.mark.parametrize("draft", [plain(), twill(2, 2), twill(3, 1), twill(1, 4)])
def test_a_twill_shifts_by_one(draft):
    down = draft.drawdown
    assert all((right == np.roll(left, 1)).all() for left, right in pairwise(down.T))


@pytest.mark.parametrize(("ends", "step"), [(5, 2), (5, 3), (7, 0), (8, 3), (8, 5)])
@pytest.mark.parametrize("warp_faced", [True, False])
def test_a_satin_is_a_permutation_without_neighbours(ends, step, warp_faced):
    """Each end is bound once and each pick once, and bindings touch not even at corners."""
    down = satin(ends, step, warp_faced).drawdown
    bound = down != warp_faced
    assert (bound.sum(axis=0) == 1).all()
    assert (bound.sum(axis=1) == 1).all()
    place = bound.argmax(axis=1)
    moved = (np.roll(place, -1) - place) % ends
    assert not set(moved.tolist()) & {0, 1, ends - 1}


def test_a_herringbone_is_a_twill_that_turns():
    down = herringbone(2, 2, 8).drawdown
    assert (down[:, :4] == twill(2, 2).drawdown).all()
    assert all((right == np.roll(left, 1)).all() for left, right in pairwise(down.T[:8]))
    assert all((right == np.roll(left, -1)).all() for left, right in pairwise(down.T[8:]))
    assert (down[:, 7] != down[:, 8]).all()  # the break: no float of more than two picks


def test_a_jacquard_shows_its_figure():
    """Figure and ground are a weft-faced and a warp-faced satin: one crossing in five, and four in five, are up."""
    pattern = ("01", "11")
    down = jacquard(pattern, 5).drawdown
    blocks = down.reshape(2, 5, 2, 5).mean(axis=(1, 3))
    assert blocks[::-1] == pytest.approx(np.array([[0.8, 0.2], [0.2, 0.2]]))


def test_the_smallest_repeat_is_found():
    tiled = Draft(np.tile(twill(3, 1).drawdown, (3, 5)))
    assert (tiled.smallest().drawdown == twill(3, 1).drawdown).all()


def test_a_loom_weaves_its_draft():
    tie_up = twill(2, 2).drawdown
    assert (on_loom([0, 1, 2, 3], tie_up, [0, 1, 2, 3]).drawdown == tie_up).all()
    pointed = on_loom([0, 1, 2, 3, 2, 1], tie_up, [0, 1, 2, 3]).drawdown
    assert (pointed[:, 1:] == pointed[:, :0:-1]).all()


def test_a_wif_gives_the_drawdown_of_its_draft(tmp_path):
    """By tie-up, by lift plan, and with a sinking shed, where what is tied goes down."""
    tied = wif(tmp_path, WIF).draft.drawdown
    expected = on_loom([0, 1, 2, 3], np.array([[k in (n, (n + 1) % 4) for k in range(4)] for n in range(4)]), range(4))
    assert (tied == expected.drawdown).all()
    assert (wif(tmp_path, WIF.split("[TIEUP]")[0] + LIFTED).draft.drawdown == tied).all()
    assert (wif(tmp_path, WIF.replace("Shed=true", "Shed=0")).draft.drawdown == ~tied).all()


def test_a_wif_tells_colours_and_sizes(tmp_path):
    found = wif(tmp_path, WIF)
    assert found.warp.colours == ((1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert found.weft.colours == ((0.0, 0.0, pytest.approx(1 / 3)),) * 4
    assert found.warp[1:] == (pytest.approx(0.5), pytest.approx(0.3))
    assert found.weft[1:] == (pytest.approx(0.625), None)


def test_a_wif_becomes_a_cloth(tmp_path):
    """Threads per cm are 1 / spacing; white and red warp on a blue weft are three populations."""
    cloth, colours = cloth_of(wif(tmp_path, WIF.replace("Thickness=0.03", "Thickness=0.04")), Yarn(), Yarn())
    assert (cloth.warp_per_cm, cloth.weft_per_cm) == (pytest.approx(20.0), pytest.approx(16.0))
    assert (cloth.warp.diameter_mm, cloth.weft.diameter_mm) == (pytest.approx(0.4), Yarn().diameter_mm)
    assert (cloth.warp_colours, cloth.weft_colours) == ((0, 1, 0, 0), (2,))
    assert colours == ((1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, pytest.approx(1 / 3)))
    assert cloth.palette == ((0, 0), (1, 2), (0, 1))


def test_a_recipe_takes_from_a_wif_what_it_does_not_tell_itself(tmp_path, few_match_points):
    """Four yarns 0.5 and 0.625 mm apart repeat; white and red warp, blue weft, unless [[colour]] tells colours."""
    wif(tmp_path, WIF)
    material = {"alpha": 0.25, "beta": 0.1, "gamma": 0.4, "n": 1.5, "body_colour": 0.5}
    recipe = {"kind": "cloth", "width_mm": 4.0, "height_mm": 4.0, "resolution": 0.3, "material": material}
    recipe |= {"variants": 1, "draft": {"file": str(tmp_path / "a.wif")}, "warp": {"fibres": 20}}
    box = build(recipe)
    at = lambda nm: [round(float(m.body_colour.at(nm)), 3) for m in box.materials]  # noqa: E731
    assert [at(650), at(430)] == [[0.85, 0.0, 0.85], [0.85, pytest.approx(0.077, abs=0.001), 0.0]]
    assert box.texel is not None
    yarns = np.array(box.texel.period) / [5e-4, 6.25e-4]
    assert np.allclose(yarns, np.round(yarns / 4) * 4)
    sparser = build(recipe | {"warp_per_cm": 12.5, "colour": [{}], "weft_colours": [0]})
    assert sparser.texel is not None and [m.body_colour.at(650) for m in sparser.materials] == [0.5] * 3
    assert round(sparser.texel.period[0] / 8e-4) % 4 == 0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[THREADING]", "[THREAD]", r"lacks the section \[THREADING\]"),
        ("Shafts=4\n", "", r"\[WEAVING\] lacks the key 'shafts'"),
        ("Shafts=4", "Shafts=1e9", r"\[WEAVING\] shafts: given '1e9', give a whole number"),
        ("Shafts=4", "Shafts=-4", r"\[WEAVING\] shafts: given '-4'"),
        ("Threads=4\nUnits", "Threads=999999999\nUnits", r"\[WARP\] threads: given '999999999'"),
        ("Threads=4\nUnits", "Threads=4000000\nUnits", "more than 4000000 crossings"),
        ("4=4\n[TIEUP]", "4=5\n[TIEUP]", r"\[THREADING\] 4: given '5', give a whole number from 1 to 4"),
        ("4=4\n[TIEUP]", "9=1\n[TIEUP]", r"\[THREADING\] 9: given '9'"),
        ("3=3\n4=4\n[TIEUP]", "[TIEUP]", "end 3 of the draft stays on one side of all yarns"),
        ("Rising Shed=true", "Rising Shed=maybe", r"\[WEAVING\] rising shed: given 'maybe', give true or false"),
        ("Units=centimeters", "Units=ells", r"\[WARP\] units: given 'ells'"),
        ("Spacing=0.05", "Spacing=nan", r"\[WARP\] spacing: given 'nan'"),
        ("Range=0,999", "Range=9,9", r"\[COLOR PALETTE\] range"),
        ("2=0,0,333", "2=0,0", r"\[COLOR TABLE\] 2: given '0,0', give 3 numbers"),
        ("2=3\n", "2=7\n", r"\[COLOR TABLE\] lacks the key '7'"),
        ("[WIF]", "WIF", "is not a valid WIF file"),
    ],
)
def test_bad_wif_files_are_refused_in_one_line(tmp_path, old, new, message):
    assert old in WIF
    with pytest.raises(InputError, match=message) as refused:
        wif(tmp_path, WIF.replace(old, new, 1))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "make",
    [
        lambda: twill(0, 2),
        lambda: satin(6),
        lambda: satin(8, 2),
        lambda: herringbone(2, 2, 3),
        lambda: jacquard(("01", "1")),
        lambda: on_loom([0, 4], np.eye(4, dtype=bool), [0]),
        lambda: Draft(np.ones((2, 2), bool)),
        lambda: Draft(np.zeros((0, 2), bool)),
    ],
)
def test_drafts_that_do_not_hold_are_refused_in_one_line(make):
    with pytest.raises(InputError) as refused:
        make()
    assert "\n" not in str(refused.value)
