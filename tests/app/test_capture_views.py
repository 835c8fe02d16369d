"""hagoromo capture --views: what it writes, what it says, how it goes on, and how it refuses. COLMAP is imitated."""

import json
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.calibration.views import capture_views as calls
from hagoromo.errors import InputError
from hagoromo.files.png import write_png
from tests.inverse.simulated_views import BoardMarks, mask, ring, structure

VIEWS = ring(5, width=60, height=44)
SIZE = 3.0  # units of the imitated structure per metre
LEFT = "view04.png"


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    home = tmp_path_factory.mktemp("views")
    (home / "masks").mkdir()
    random = np.random.default_rng(1)
    for name, view in VIEWS.items():
        there = mask(view)
        light = np.where(there[..., None], random.integers(90, 200, (*there.shape, 3)), 12)
        write_png(home / name, light.astype(np.uint8))
        write_png(home / "masks" / name, there.astype(np.uint8) * 255)
    return home


@pytest.fixture
def imitated(monkeypatch):
    """COLMAP, which places all photographs but one; the list has the names of each search."""
    searches: list[list[str]] = []

    def reconstruct(pictures, names, lens, settings, work, progress):
        searches.append(list(names))
        grey, allowed = pictures(0)
        assert grey.shape == (44, 60) and (allowed is not None) == settings.turntable
        (work / "cameras.bin").write_bytes(b"model")

    def read_structure(folder, names, lens):
        placed = {name: view for name, view in VIEWS.items() if name in names and name != LEFT}
        found = structure(placed, SIZE)
        return replace(found, left_out={name: "too few points" for name in names if name not in placed})

    monkeypatch.setattr(calls, "colmap", lambda: None)
    monkeypatch.setattr(calls, "reconstruct", reconstruct)
    monkeypatch.setattr(calls, "read_structure", read_structure)
    return searches


def command(home, out, *more, names=tuple(VIEWS)):
    files = [str(home / name) for name in names]
    return ["capture", "--views", *files, "--out", str(out), "--transfer", "srgb", *more]


def stated_marks():
    known = BoardMarks()
    entries = [",".join([name, *(f"{x:.4f}" for x in known.seen_by(VIEWS[name]))]) for name in list(VIEWS)[:4]]
    return ["--length", f"{known.length:.8f}", "--length-between", *entries]


def test_a_capture_of_many_views_has_poses_masks_lamps_and_a_scale(photographs, imitated, tmp_path, capsys):
    out = tmp_path / "capture"
    more = ["--mask", str(photographs / "masks"), "--lamp", "flash", "--flash-offset", "0.03", "0", "0"]
    assert main(command(photographs, out, *more, "--intensity", "2", *stated_marks())) == 0
    said = capsys.readouterr().out
    assert "view04.png: left out, too few points" in said and "view00.png: " in said
    assert "by a length of" in said and "4 of 5 photographs placed" in said
    capture = hg.load_capture(out)
    assert [one.name for one in capture.photographs] == [name[:-4] for name in VIEWS if name != LEFT]
    places = np.stack([one.camera.position for one in capture.photographs])
    true = np.stack([view.position for name, view in VIEWS.items() if name != LEFT])
    far, true_far = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (places, true))
    np.testing.assert_allclose(far, true_far, rtol=1e-3, atol=1e-6)  # metres
    for one in capture.photographs:
        (lamp,) = one.lamps
        assert np.linalg.norm(lamp.place - one.camera.position) == pytest.approx(0.03) and lamp.intensity == 2.0
        assert one.silhouette is not None and (one.silhouette == mask(VIEWS[f"{one.name}.png"])).all()
        assert one.camera.distortion[0] == pytest.approx(-0.12)
    record = json.loads((out / "views.json").read_text())
    assert record["left_out"] == {LEFT: "too few points"} and record["hagoromo"]["seed"] == 0
    assert record["scale"]["metres"] > 0.0 and record["scale"]["error"] > 0.0
    assert all(one["points"] > 0 and 0.0 < one["rms_px"] < 2.0 for one in record["photographs"].values())
    import trimesh

    cloud = trimesh.load(out / "points.ply")
    assert len(cloud.vertices) == record["points"]  # type: ignore[missing-attribute]


def test_without_a_scale_the_result_says_how_to_give_one(photographs, imitated, tmp_path, capsys):
    out = tmp_path / "capture"
    assert main(command(photographs, out, "--lamp", "unknown")) == 0
    assert "scale: none: the unit of length is" in capsys.readouterr().out
    capture = hg.load_capture(out)
    assert "--length" in capture.assumptions["scale"] and all(one.lamps == () for one in capture.photographs)
    assert np.linalg.norm([p.camera.position for p in capture.photographs], axis=1).mean() == pytest.approx(1.0)
    assert json.loads((out / "views.json").read_text())["scale"] is None


def test_cameras_are_found_once_for_the_same_photographs_and_settings(photographs, imitated, tmp_path, capsys):
    out = tmp_path / "capture"
    assert main(command(photographs, out, "--lamp", "unknown")) == 0
    assert main(command(photographs, out, "--lamp", "unknown")) == 2  # the capture is there
    (tmp_path / "capture").rename(tmp_path / "first")
    masks = ["--mask", str(photographs / "masks")]
    assert main(command(photographs, out, "--lamp", "flash", *masks)) == 0 and len(imitated) == 1
    (tmp_path / "capture").rename(tmp_path / "second")
    capsys.readouterr()
    assert main(command(photographs, out, "--lamp", "flash", "--coefficients", "2")) == 2
    assert "capture.views is of other photographs or settings" in capsys.readouterr().err
    assert main(command(photographs, out, "--lamp", "flash", "--coefficients", "2", "--force")) == 0
    assert len(imitated) == 2


def test_work_that_was_interrupted_is_kept_and_said(photographs, imitated, tmp_path, capsys, monkeypatch):
    def interrupted(pictures, names, lens, settings, work, progress):
        (work / "features.db").write_bytes(b"half")
        raise KeyboardInterrupt

    out = tmp_path / "capture"
    whole = calls.reconstruct
    monkeypatch.setattr(calls, "reconstruct", interrupted)
    assert main(command(photographs, out, "--lamp", "unknown")) == 130
    assert "the same command resumes it" in capsys.readouterr().err and not out.exists()

    def goes_on(pictures, names, lens, settings, work, progress):
        assert (work / "features.db").read_bytes() == b"half"
        whole(pictures, names, lens, settings, work, progress)

    monkeypatch.setattr(calls, "reconstruct", goes_on)
    assert main(command(photographs, out, "--lamp", "unknown")) == 0


def test_the_object_is_found_in_each_photograph(photographs, imitated, tmp_path):
    capture = hg.capture_views(
        [photographs / name for name in VIEWS], tmp_path / "capture", masks="auto", settings=hg.ViewsSettings(True),
        developing=hg.Developing(transfer="srgb"),
    )  # fmt: skip
    for one in hg.load_capture(capture.folder).photographs:
        true = mask(VIEWS[f"{one.name}.png"])
        assert one.silhouette is not None
        assert (one.silhouette & true).sum() > 0.8 * (one.silhouette | true).sum()


def test_a_copy_is_left_out_and_named(photographs, imitated, tmp_path, capsys):
    copy = tmp_path / "copy.png"
    copy.write_bytes((photographs / "view01.png").read_bytes())
    names = [*(photographs / name for name in VIEWS), copy]
    written = hg.capture_views(names, tmp_path / "capture", developing=hg.Developing(transfer="srgb"))
    assert "copy.png: left out, it is a copy of view01.png" in written.lines()
    assert imitated[0] == list(VIEWS)


BAD = [
    (["--lamp", "unknown", "--undistorted"], "--undistorted is for photographs of one view"),
    ([], "say where the light came from"),
    (["--lamp", "flash", "--lamps", "lamps.json"], "say where the light came from, once"),
    (["--lamp", "flash", "--flash-offset", "0.1", "0", "0"], "nothing gives the photographs a scale"),
    (["--lamp", "unknown", "--flash-offset", "0.1", "0", "0"], "add --lamp flash"),
    (["--lamp", "unknown", "--length", "0.1"], "--length and --length-between go together"),
    (["--lamp", "unknown", "--board", "9x6"], "--board and --square go together"),
    (["--lamp", "unknown", "--board", "nine", "--square", "0.02"], "columns x rows"),
    (["--lamp", "unknown", "--board", "9x6", "--square", "0.02"], "was found in 0 of 4"),
    (["--lamp", "unknown", "--board", "9x6", "--square", "0.02", *stated_marks()], "give the scale twice"),
    (["--lamp", "unknown", "--length", "-1", "--length-between", "a,1,2,3,4"], "above 0"),
    (["--lamp", "unknown", "--ball", "auto", "--radius", "0.02"], "PHOTOGRAPH,x,y,radius"),
    (["--lamp", "unknown", "--turntable"], "needs masks"),
    (["--lamp", "unknown", "--largest", "3"], "give 100 or more"),
    (["--lamp", "unknown", "--camera", "canon.json"], "canon.json"),
]


@pytest.mark.parametrize(("more", "said"), BAD, ids=[" ".join(more)[:50] or "nothing" for more, _ in BAD])
def test_bad_use_is_one_line(photographs, imitated, tmp_path, capsys, more, said):
    out = tmp_path / "capture"
    assert main(command(photographs, out, *more)) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and said in lines[0] and not out.exists()


def test_options_of_views_are_of_views(photographs, capsys, tmp_path):
    files = [str(photographs / name) for name in VIEWS]
    assert main(["capture", *files, "--out", str(tmp_path / "c"), "--lamp", "flash"]) == 2
    assert "--lamp is for photographs of many views: add --views" in capsys.readouterr().err


def test_photographs_that_do_not_go_together_are_refused(photographs, imitated, tmp_path):
    paths, out = [photographs / name for name in VIEWS], tmp_path / "capture"
    developing = hg.Developing(transfer="srgb")
    with pytest.raises(InputError, match="2 photographs are given: views need 3"):
        hg.capture_views(paths[:2], out, developing=developing)
    twin = tmp_path / "twin.png"
    twin.write_bytes(paths[0].read_bytes())
    with pytest.raises(InputError, match="3 photographs are given, 1 of them copies"):
        hg.capture_views([*paths[:2], twin], out, developing=developing)
    write_png(tmp_path / "tall.png", np.zeros((60, 44, 3), np.uint8))
    with pytest.raises(InputError, match=r"view00.png is 60 × 44 px and tall.png 44 × 60"):
        _grey_of_last([*paths, tmp_path / "tall.png"])
    with pytest.raises(InputError, match=r"has no mask of view00.png: add view00.png"):
        hg.capture_views(paths, out, masks=tmp_path, developing=developing)
    with pytest.raises(InputError, match="2 masks for 5 photographs"):
        hg.capture_views(paths, out, masks=paths[:2], developing=developing)
    with pytest.raises(InputError, match="not estimated"):
        hg.capture_views(paths, out, developing=hg.Developing(transfer="estimate"))
    assert not out.exists()


def test_photographs_that_cannot_be_developed_are_refused_before_the_search(photographs, imitated, tmp_path):
    with pytest.raises(InputError, match="8 bits, which are rarely linear"):
        hg.capture_views([photographs / name for name in VIEWS], tmp_path / "capture")
    assert not imitated


def _grey_of_last(paths):
    from hagoromo.calibration.views.view_photographs import view_photographs

    given = view_photographs(paths)
    return given.grey(given.names[-1], given.size(), 1600)


def test_without_pycolmap_one_line_says_what_to_install(photographs, tmp_path, capsys, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pycolmap", None)
    assert main(command(photographs, tmp_path / "capture", "--lamp", "unknown")) == 2
    assert "pip install 'hagoromo[views]'" in capsys.readouterr().err
