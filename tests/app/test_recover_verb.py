"""The command `recover`: what it writes, and how it refuses."""

import json

import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from studies.recover_scenes import TrueObject, shots, simulated

QUICK = ["--side", "24", "--steps", "6"]


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    home = tmp_path_factory.mktemp("recover") / "capture"
    simulated(TrueObject(flat=True), shots(9, 5, 60, 1, pixels=40), 1).capture.save(home)
    return home


@pytest.fixture(scope="module")
def written(capture):
    out = capture.parent / "object.zarr"
    assert main(["recover", str(capture), "--out", str(out), *QUICK]) == 0
    return out


def test_it_writes_a_box_a_mesh_what_was_found_and_a_report(written):
    import trimesh

    box = hg.VolumeBox.load(written)
    assert box.extinction == "projected" and box.bricks.kept > 0
    assert len(trimesh.load_mesh(written.with_suffix(".ply")).faces) > 50
    record = json.loads(written.with_suffix(".json").read_text())
    assert record["photographs"] == 8 and len(record["kept_aside"]) == 1 and record["complete"]
    assert record["hagoromo"]["seed"] == 0 and record["hagoromo"]["settings"]["side"] == 24
    assert {"beta", "gamma", "n"} <= record["material"].keys()
    body = written.with_suffix(".html").read_text().split("<body")[1]
    assert "kept aside" in body and "PSNR" in body
    assert "http:" not in body and "https:" not in body  # pictures in base64 may hold the four letters


def test_a_box_is_a_scene_for_render(written, tmp_path):
    scene = written.parent / "scene.toml"
    scene.write_text(
        "[camera]\nsize = [24, 24]\nfocal = [120.0, 120.0]\nprincipal = [12.0, 12.0]\neye = [0.0, -0.6, 0.0]\n"
        f'target = [0.0, 0.0, 0.0]\n[[lamp]]\nto_lamp = [0.0, -1.0, 0.5]\n[[box]]\nfile = "{written.name}"\n'
    )
    assert main(["render", str(scene), "--out", str(tmp_path / "scene.exr")]) == 0
    assert hg.read_image(tmp_path / "scene.exr").alpha.max() > 0.9


def test_an_interrupt_writes_what_there_is_and_says_so(capture, tmp_path, monkeypatch, capsys):
    from hagoromo_recovery.descent.descent import Descent

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(Descent, "step", interrupted)
    out = tmp_path / "part.zarr"
    assert main(["recover", str(capture), "--out", str(out), *QUICK]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert hg.VolumeBox.load(out).bricks.kept > 0
    assert not json.loads(out.with_suffix(".json").read_text())["complete"]


@pytest.mark.nightly
def test_work_goes_on_where_it_was_interrupted(capture, tmp_path, monkeypatch, capsys):
    out, many = tmp_path / "part.zarr", ["--side", "16", "--steps", "40", "--no-errors"]
    with monkeypatch.context() as patch:
        from hagoromo_recovery.descent.descent import Descent

        patch.setattr(Descent, "choose", interrupting(Descent.choose, 2))
        assert main(["recover", str(capture), "--out", str(out), *many]) == 130
    checkpoint = out.with_suffix(".checkpoint.npz")
    assert checkpoint.exists()
    assert main(["recover", str(capture), "--out", str(out), *many]) == 2
    assert "give --resume to go on" in capsys.readouterr().err
    assert main(["recover", str(capture), "--out", str(out), *many, "--resume"]) == 0
    assert json.loads(out.with_suffix(".json").read_text())["complete"] and not checkpoint.exists()
    assert main(["recover", str(capture), "--out", str(out), *many, "--resume"]) == 2
    assert "leave --resume out" in capsys.readouterr().err


def interrupting(method, call):
    """The method, which is interrupted at its `call`-th call."""
    calls = []

    def called(self):
        calls.append(None)
        if len(calls) == call:
            raise KeyboardInterrupt
        return method(self)

    return called


@pytest.mark.nightly
def test_fuzzy_matter_is_written_as_a_box_of_fibres(capture, tmp_path):
    import trimesh

    out = tmp_path / "fuzzy.zarr"
    words = ["--side", "16", "--steps", "2", "--matter", "fuzzy"]
    assert main(["recover", str(capture), "--out", str(out), *words]) == 0
    box = hg.VolumeBox.load(out)
    assert box.extinction == "isotropic" and box.materials[0].element == "cylinder" and box.bricks.kept > 0
    assert len(trimesh.load_mesh(out.with_suffix(".ply")).faces) > 50
    record = json.loads(out.with_suffix(".json").read_text())
    assert record["matter"] == "fuzzy" and record["matter_tried_db"] == {} and record["complete"]
    assert 0.0 < record["errors"]["position_m"][0] < 0.02 and record["material"]["interval_95"]
    assert "Axes of fibres" in out.with_suffix(".html").read_text()


def test_nothing_that_is_there_is_replaced_without_force(capture, written, capsys):
    assert main(["recover", str(capture), "--out", str(written), *QUICK]) == 2
    assert "object.zarr" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "box.toml"], "ends in .zarr"),
        (["--out", "new.zarr", "--side", "9000"], "side is 9000"),
        (["--out", "new.zarr", "--keep", "1"], "keep is 1"),
    ],
)
def test_wrong_words_end_in_one_line(capture, capsys, words, said):
    words = [str(capture.parent / word) if "." in word else word for word in words]
    assert main(["recover", str(capture), *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (capture.parent / "new.zarr").exists()


def test_the_page_says_what_was_taken_for_given_and_that_there_is_no_scale(tmp_path):
    from dataclasses import replace

    taken = simulated(TrueObject(flat=True), shots(5, 5, 60, 1, pixels=24), 1).capture
    said = {"scale": "none: the unit is no metre", "mask": "as <b>given</b>"}
    found = hg.recover(replace(taken, assumptions=said), hg.RecoverySettings(side=16, steps=1, keep=0))
    hg.write_recovery_report(tmp_path / "page.html", found, found.record())
    page = (tmp_path / "page.html").read_text()
    assert "mask: as &lt;b&gt;given&lt;/b&gt;" in page and "not real millimetres" in page
