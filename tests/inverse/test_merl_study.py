"""The study of MERL goes on where it was interrupted, and its result is that of one run."""

import json

import numpy as np
import pytest

import hagoromo as hg
from studies import merl

NAMES = tuple("abcde")


@pytest.fixture
def study(monkeypatch, tmp_path):
    """The study of five materials whose rows are drawn; gives what starts it and the list of materials fitted."""
    fitted: list[str] = []

    def row(kind, name, truth, random):
        if fitted.count("stop"):
            fitted.remove("stop")
            raise KeyboardInterrupt
        fitted.append(name)
        if name == "c" and fitted.count("c") == 1 and stop:
            fitted.append("stop")
        error = {method: float(random.random()) for method in merl.METHODS}
        return merl.MerlRow(kind, name, error, False, 0.5, 0.01, None, tuple(random.random(3).tolist()))

    stop: list[bool] = []
    monkeypatch.setattr(merl, "study", row)
    monkeypatch.setattr(merl, "read_truths", lambda folder: {"sgd": dict.fromkeys(NAMES)})
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "merl_sgd.json").write_text("[]")

    def run(out, interrupted=False):
        stop[:] = [True] if interrupted else []
        return merl.merl_study(tmp_path / "truth", tmp_path / out)

    return run, fitted


def test_an_interrupted_study_fits_no_material_twice(study, tmp_path):
    run, fitted = study
    whole = run("whole")
    assert fitted == [*NAMES]
    fitted.clear()
    with pytest.raises(KeyboardInterrupt, match="resumes"):
        run("again", interrupted=True)
    assert fitted == ["a", "b", "c"] and not (tmp_path / "again").exists()
    assert run("again") == whole and fitted == [*NAMES]
    assert json.loads((tmp_path / "again" / "results.json").read_text()) == hg.read_json(
        tmp_path / "whole" / "results.json"
    )
    assert not (tmp_path / ".again.building").exists()
    assert np.isfinite([row["error"][merl.METHODS[0]] for row in whole["rows"]]).all()


def test_rows_of_other_truths_are_not_taken(study, tmp_path):
    run, fitted = study
    with pytest.raises(KeyboardInterrupt):
        run("again", interrupted=True)
    fitted.clear()
    (tmp_path / "truth" / "merl_sgd.json").write_text("[ ]")
    with pytest.warns(UserWarning, match="was removed"):
        run("again")
    assert fitted == [*NAMES]
