"""Every example runs as it stands and says what it promises."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SAID = {
    "01_measure_a_ball.py": ["alpha", "beta", "gamma", "95 % interval"],
    "02_render_a_scene.py": ["image.exr", "image.png"],
    "03_through_another_camera.py": ["canon_eos_300d", "Nikon", "R/G"],
    "04_preview.py": ["pixels after", "100% of the work", "preview.exr"],
    "05_recover.py": ["Recovered('figure'", "gamma", "view 17", "dB"],
}


@pytest.mark.parametrize("name", SAID)
def test_an_example_uses_public_names_only(name):
    tree = ast.parse((EXAMPLES / name).read_text(encoding="utf-8"))
    modules = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    modules += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert [module for module in modules if module.startswith("hagoromo")] == ["hagoromo"]


def test_every_example_is_run():
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(SAID)


@pytest.mark.nightly
@pytest.mark.parametrize("name", SAID)
def test_an_example_runs(name, tmp_path):
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert all(word in run.stdout for word in SAID[name]), run.stdout
