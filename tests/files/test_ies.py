"""IES files: headers of every year, symmetries, and damaged or hostile files, each refused in one line."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.ies import LARGEST_FILE, read_ies

HEADERS = {
    "1986": "A LABEL OF THE LABORATORY\nANOTHER\n",
    "1991": "IESNA91\n[TEST] 7\n[MANUFAC] Lamps & Co\n",
    "1995": "IESNA:LM-63-1995\n[LUMINAIRE] a flood\n[MORE] with a lens\n",
    "2002": "IESNA:LM-63-2002\n[TEST]7\n[ISSUEDATE] 2020\n[LUMINAIRE] a flood\n",
    "2019": "IES:LM-63-2019\r\n[TEST]7\r\n",
}
LATERAL, VERTICAL = (0, 30, 90), (0, 22.5, 60, 90)
CANDELA = np.array([[100, 80, 20, 0], [90, 70, 30, 1], [60, 50, 10, 0.5]])


def ies(header="2002", tilt="TILT=NONE", counts=(4, 3), kind: float = 1, candela=CANDELA, lateral=LATERAL,
        vertical=VERTICAL, multiplier=2.0, ballast=0.5, third=1.0) -> str:  # fmt: skip
    """The text of an IES file, its angles wrapped and parted as real files have them."""
    counted = f"1 1000 {multiplier} {counts[0]} {counts[1]} {kind} 2 0.1, 0.2,0\n{ballast} {third} 50\n"
    angles = "  ".join(map(str, vertical[:2])) + "\n" + ",".join(map(str, vertical[2:])) + "\n"
    rows = "\n".join(" ".join(map(str, row)) for row in np.asarray(candela).tolist())
    return f"{HEADERS[header]}{tilt}\n{counted}{angles}{' '.join(map(str, lateral))}\n{rows}\n"


@pytest.fixture
def written(tmp_path):
    """Writes the text of a file; its path."""

    def write(text: str):
        (tmp_path / "lamp.ies").write_text(text, encoding="latin-1", newline="")
        return tmp_path / "lamp.ies"

    return write


@pytest.mark.parametrize("header", HEADERS)
def test_files_of_every_year_give_their_table(written, header):
    """Candela times multiplier and ballast factor; up to 1995 the third number multiplies, later it does not."""
    table = read_ies(written(ies(header, third=1.1)))
    np.testing.assert_array_equal(table.lateral, LATERAL)
    np.testing.assert_array_equal(table.vertical, VERTICAL)
    factor = 2.0 * 0.5 * (1.1 if header in ("1986", "1991", "1995") else 1.0)
    np.testing.assert_allclose(table.candela, factor * CANDELA, rtol=1e-15)
    if header == "1995":
        assert table.keywords == {"LUMINAIRE": "a flood with a lens"}


def test_a_profile_is_relative_and_knows_its_candela(written, capsys):
    """By hand: 80 cd at γ = 22.5° in the plane of 0°, which is that of 180° too; half way to 30° the mean."""
    path = written(ies(multiplier=3.0))
    profile = hg.LampProfile.from_ies(path)
    assert profile.peak_candela == 150.0 and profile.name == "a flood"
    np.testing.assert_allclose(profile.at([0, 180, 15, 345], 22.5), [0.8, 0.8, 0.75, 0.75], rtol=1e-15)
    assert profile.at(45, 91) == 0.0
    again = hg.LampProfile.load(profile.record())
    np.testing.assert_array_equal(again.intensity, profile.intensity)
    assert again.peak_candela == 150.0
    assert main(["info", str(path)]) == 0
    assert "peak_candela: 150.0" in capsys.readouterr().out


def test_a_tilt_that_changes_nothing_is_read_over(written):
    tilted = ies(tilt="TILT=INCLUDE\n1\n3\n0 90 180\n1 1 1.0")
    np.testing.assert_array_equal(read_ies(written(tilted)).candela, CANDELA)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line TILT="),
        ("IESNA:LM-63-2002\n[TEST] 7\n", "no line TILT="),
        ("TILT=NONE\n1 2 3\n", "has 3 numbers"),
        (ies(kind=2), "type B: only type C"),
        (ies(kind=3), "type A: only type C"),
        (ies(kind=1e300), "type 1e\\+300"),
        (ies(tilt="TILT=other.tlt"), "names another file"),
        (ies(tilt="TILT=INCLUDE\n1\n3\n0 90 180\n1 0.9 0.8"), "changes the light"),
        (ies(tilt="TILT=INCLUDE\n1\n999999 0 1"), "announces 999999 tilt angles"),
        (ies(tilt="TILT=INCLUDE\n1\n-2 0 1"), "-2 tilt angles"),
        (ies(counts=(4, 4)), "announces 4 × 4 values"),
        (ies(counts=(1000000000, 1000000000)), "vertical angles"),
        (ies(counts=(1000000, 1000000)), "announces 1000000 × 1000000 values"),
        (ies(counts=(-4, 3)), "-4 vertical angles"),
        (ies(counts=("nan", 3)), "not finite"),
        (ies(counts=(4.5, 3)), "whole number"),
        (ies(candela=-CANDELA), "negative"),
        (ies(candela=np.full((3, 4), np.inf)), "not finite"),
        (ies(candela=CANDELA * 1e306, multiplier=1e300), "not finite"),
        (ies(candela=0 * CANDELA), "one of them above 0"),
        (ies(multiplier=0), "must be above 0"),
        (ies(ballast=-1), "must be above 0"),
        (ies().replace("22.5", "22.5x"), "stands among the numbers"),
        (ies(vertical=(0, 60, 22.5, 90)), "do not at 22.5"),
        (ies(vertical=(0, 0.001, 60, 90)), "do not at 0.001"),
        (ies(vertical=(-90, 0, 60, 90)), "within 0° to 180°"),
        (ies(lateral=(0, 30, 120)), "go from 0° to 120°"),
        (ies(lateral=(10, 30, 90)), "go from 10° to 90°"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused_in_one_line(written, text, said):
    path = written(text)
    with pytest.raises(InputError, match=said) as refused:
        hg.LampProfile.from_ies(path)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


def test_a_file_that_is_no_text_or_too_large_is_refused(tmp_path, written):
    (tmp_path / "noise.ies").write_bytes(np.random.default_rng(1).bytes(4001))
    (tmp_path / "large.ies").write_bytes(b"TILT=NONE\n")
    with (tmp_path / "large.ies").open("r+b") as file:
        file.truncate(LARGEST_FILE + 1)  # sparse: no such file is written
    for name, said in (("noise.ies", "TILT="), ("large.ies", "bytes"), ("absent.ies", "does not exist")):
        with pytest.raises(InputError, match=said):
            read_ies(tmp_path / name)
    path = written(ies())
    for cut in range(0, path.stat().st_size - 6, 7):  # anywhere before the last number
        (tmp_path / "cut.ies").write_bytes(path.read_bytes()[:cut])
        with pytest.raises(InputError):
            hg.LampProfile.from_ies(tmp_path / "cut.ies")
