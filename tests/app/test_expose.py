"""`hagoromo expose` changes the lamps of a rendered image; wrong use is one line."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """An image of the lamps key and fill, each with weights of its own."""
    from tests.app.conftest import SCENE

    folder = tmp_path_factory.mktemp("rendered")
    (folder / "scene.toml").write_text(SCENE)
    assert main(["render", str(folder / "scene.toml"), "--out", str(folder / "a.exr"), "--separate-lamps"]) == 0
    return folder / "a.exr"


def test_lamps_are_changed_from_the_command_line(rendered, tmp_path, capsys):
    given = ["--strength", "key=0.5", "fill=2", "--spectrum", "fill=A", "--response", "canon_eos_300d"]
    assert main(["expose", str(rendered), "--out", str(tmp_path / "b.exr"), *given]) == 0
    assert capsys.readouterr().out.split() == ["wrote", f"{tmp_path / 'b.exr'}", "wrote", f"{tmp_path / 'b.png'}"]
    before = hg.read_image(rendered)
    changed = before.with_lamps({"key": 0.5, "fill": 2.0}, {"fill": hg.Spectrum.named("A")})
    assert before.lamp_names == ("key", "fill")
    np.testing.assert_array_equal(hg.read_image(tmp_path / "b.exr").weights, changed.weights)
    channels, _ = hg.read_exr(tmp_path / "b.exr")
    camera = changed.expose(hg.Response.load("canon_eos_300d"))
    np.testing.assert_array_equal(np.stack([channels[c] for c in "RGB"], axis=-1), camera)
    assert main(["info", str(rendered)]) == 0
    assert 'lamps: ["key", "fill"]' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--strength", "key"], "give NAME=VALUE"),
        (["--strength", "key=bright"], "give a factor such as 0.5"),
        (["--strength", "key=-1"], "factor of 0 or more"),
        (["--strength", "moon=1"], "the image has key, fill"),
        (["--spectrum", "key=D64"], "nearest names"),
        (["--response", "no_camera"], "no camera response"),
    ],
)
def test_wrong_use_is_one_line(rendered, tmp_path, capsys, given, said):
    assert main(["expose", str(rendered), "--out", str(tmp_path / "c.exr"), *given]) == 2
    printed = capsys.readouterr()
    assert said in printed.err and printed.err.count("\n") == 1 and not list(tmp_path.iterdir())
