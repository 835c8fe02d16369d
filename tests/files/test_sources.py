"""Results state what they were made from: each file by its name and SHA-256."""

import hashlib

import numpy as np

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.png import write_png
from hagoromo.files.record import written_by
from hagoromo.files.sources import digest_of_file
from hagoromo.files.whole import MARK
from tests.ball_scene import ball_scene, lamp


def test_files_and_folders_are_stated_by_name_and_digest(tmp_path):
    photograph, folder, measured = tmp_path / "a.png", tmp_path / "photographs", tmp_path / "measured"
    folder.mkdir(), measured.mkdir()
    photograph.write_bytes(b"one")
    (folder / "b.png").write_bytes(b"two")
    (measured / "materials.json").write_bytes(b"[]")
    (measured / "normals.exr").write_bytes(b"not a record")
    (measured / MARK).touch()
    (folder / "lamps.json").write_bytes(b"{}")
    with hg.made_from([photograph, folder, measured, tmp_path / "absent"]):
        stated = written_by()["sources"]
    expected = {
        "a.png": b"one",
        "photographs/b.png": b"two",
        "photographs/lamps.json": b"{}",
        "measured/materials.json": b"[]",
    }
    assert stated == [{"name": name, "sha256": hashlib.sha256(held).hexdigest()} for name, held in expected.items()]
    assert "sources" not in written_by()


def test_a_file_that_changes_has_another_digest(tmp_path):
    file = tmp_path / "a.png"
    digests = []
    for held in (b"one", b"three"):
        file.write_bytes(held)
        with hg.made_from([file]):
            digests.append(written_by()["sources"][0]["sha256"])
    assert digests == [hashlib.sha256(held).hexdigest() for held in (b"one", b"three")]


def test_a_picture_states_its_scene_and_what_that_names(tmp_path):
    (tmp_path / "grey.csv").write_text("wavelength_nm,value\n400,0.5\n700,0.5\n", encoding="utf-8")
    named = lamp("", 0.5, -2.0, 1.0, intensity='spectrum = "grey.csv"\n')
    (tmp_path / "scene.toml").write_text(ball_scene((8, 8), 12.0, [named]), encoding="utf-8")
    assert main(["render", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out.exr")]) == 0
    stated = hg.read_image(tmp_path / "out.exr").metadata["sources"]
    assert [one["name"] for one in stated] == ["scene.toml", "grey.csv"]
    assert stated[0]["sha256"] == hashlib.sha256((tmp_path / "scene.toml").read_bytes()).hexdigest()


def test_the_chain_leads_from_the_page_to_the_photographs(tmp_path):
    """Each result states the digests of what it was made from: page, measurement, capture, photographs."""
    random = np.random.default_rng(3)
    x, y = np.meshgrid(np.linspace(-1.1, 1.1, 25), np.linspace(1.1, -1.1, 25))
    ball = x**2 + y**2 < 1.0
    normals = np.stack([x, y, np.sqrt(np.clip(1.0 - x**2 - y**2, 0.0, 1.0))], axis=-1)
    lines = []
    for k in range(9):
        angle = 0.7 * k
        to_lamp = np.array([0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.8]) / np.sqrt(0.25 + 0.64)
        shade = np.where(ball, 180.0 * np.clip(normals @ to_lamp, 0.0, 1.0), 0.0) + random.normal(0.0, 0.5, ball.shape)
        write_png(tmp_path / f"{k}.png", np.repeat(np.clip(shade, 0, 255).round().astype(np.uint8)[..., None], 3, 2))
        lines.append(f"{k}.png {' '.join(map(str, to_lamp))}")
    (tmp_path / "dome.lp").write_text("\n".join(["9", *lines]) + "\n", encoding="utf-8")
    write_png(tmp_path / "mask.png", ball.astype(np.uint8) * 255)
    photographs = [tmp_path / f"{k}.png" for k in range(9)]
    capture, measured, page = (str(tmp_path / name) for name in ("capture", "measured", "page.html"))
    words = ["capture", *photographs, "--lamps", tmp_path / "dome.lp", "--mask", tmp_path / "mask.png"]
    assert main([*map(str, words), "--transfer", "linear", "--out", capture]) == 0
    assert main(["measure", capture, "--out", measured]) == 0
    assert main(["publish", measured, "--out", page]) == 0
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in photographs]
    transforms, materials = tmp_path / "capture" / "transforms.json", tmp_path / "measured" / "materials.json"
    assert [one["sha256"] for one in hg.read_json(transforms)["hagoromo"]["sources"]][:9] == digests
    (of_measured,) = hg.read_json(materials)[0]["hagoromo"]["sources"]
    assert of_measured == {"name": "capture/transforms.json", "sha256": digest_of_file(transforms)}
    assert digest_of_file(materials) in (tmp_path / "page.html").read_text(encoding="utf-8")
    shown = hg.info(transforms)["made_from"]
    assert shown["dome.lp"] == digest_of_file(tmp_path / "dome.lp") and len(shown) == 11
