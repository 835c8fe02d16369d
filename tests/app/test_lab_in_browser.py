"""The laboratory in Chromium: from the first click to the published page, on a small simulated dome.

Commands that the window showed are then run as they stand there, and give the same bits.
"""

import os
import shutil
import subprocess
import sys
import threading
from hashlib import sha256

import numpy as np
import pytest

from hagoromo.files.png import read_png
from hagoromo.files.record import read_json
from hagoromo_page.lab.folder import MASK
from hagoromo_page.lab.laboratory import Laboratory
from hagoromo_page.lab.server import LabServer
from studies.dome import dome

LAMPS, WIDTH = 8, 120
PATIENCE_MS = 300_000.0
SHORT_MS = 20_000.0


class Window:
    """The window of a laboratory in Chromium, and what its page complained about."""

    def __init__(self, chromium, root):
        self.laboratory = Laboratory(root)
        self.server = LabServer(self.laboratory)
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True)
        self.thread.start()
        self.faults, self.asked, self.shown = [], [], []
        self.page = chromium.new_page(viewport={"width": 1200, "height": 800})
        self.page.set_default_timeout(SHORT_MS)
        self.page.on("pageerror", lambda one: self.faults.append(str(one)))
        self.page.on("request", lambda one: self.asked.append(one.url))
        self.page.goto(self.server.address)

    def close(self):
        self.page.close()
        self.server.shutdown()
        self.server.stop()
        self.thread.join()

    def section(self, name):
        self.page.click(f"#section-{name} > h2 button")

    def run(self, step, replaces=False):
        """Press a button, agree to what it replaces, and wait for its end; the last line."""
        self.begin(step, replaces)
        self.page.wait_for_selector("#running", state="hidden", timeout=PATIENCE_MS)
        return self.page.inner_text("#last")

    def begin(self, step, replaces=False):
        self.page.click(f"#run-{step}")
        if replaces:
            self.page.click("#ask[open] button[value=yes]")
        self.page.wait_for_selector("#running", state="visible")

    def on_picture(self, x, y):
        """Where in the window a pixel of the photographs is."""
        box = self.page.locator("#drawing").bounding_box()
        width, height = self.laboratory.state()["size"]
        return box["x"] + box["width"] * x / width, box["y"] + box["height"] * y / height

    def drag(self, *places):
        with self.page.expect_response(lambda answer: answer.url.endswith("/do")):
            self.draw(*places)

    def draw(self, *places):
        """Drag what is sent later, or not at all."""
        self.page.mouse.move(*self.on_picture(*places[0]))
        self.page.mouse.down()
        for place in places[1:]:
            self.page.mouse.move(*self.on_picture(*place), steps=4)
        self.page.mouse.up()


@pytest.fixture
def home(tmp_path):
    """A folder of folders: a dome with its .lp, and the same photographs without."""
    made = dome(tmp_path / "made", LAMPS, WIDTH)
    root = tmp_path / "objects"
    shutil.copytree(made / "photographs", root / "dome")
    shutil.copy(made / "dome.lp", root / "dome")
    shutil.copytree(made / "photographs", root / "ball" / "in_it")
    return root


@pytest.fixture
def window(browser, home):
    opened = Window(browser, home)
    yield opened
    opened.close()


def digests(folder):
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_from_the_first_click_to_the_published_page(window, home):
    page, lab = window.page, home / "dome" / "lab"
    page.click(".folders button:text-is('dome')")
    page.click("#next")
    assert page.locator("#strip button").count() == LAMPS and page.locator(".dome circle.lamp").count() == LAMPS

    page.click("#tool-swap")  # wrong on purpose
    for name in ("02.jpg", "05.jpg"):
        page.click(f"#strip [data-name='{name}']")
    page.wait_for_selector("#as-named")
    assert window.run("health").startswith("Done: ")
    assert "02 and 05 exchanged" in page.inner_text("#health") and page.locator("#section-photographs.old").count()

    page.click("#as-named")  # right again
    page.wait_for_selector("#as-named", state="detached")
    page.click("#tool-background")  # the ball is no part of the object
    window.drag((24, 22), (24, 48), (34, 30), (16, 30), (24, 22))
    page.click("#tool-object")
    window.drag((80, 40), (90, 40))
    page.click("#tool-as-found")
    window.drag((80, 40), (90, 40))
    painted = read_png(home / "dome" / MASK)
    assert painted.shape == (2 * WIDTH // 3, WIDTH) and painted[30, 24] == 0 and painted[40, 85] == 128
    shown = page.inner_text("#shown").splitlines()
    assert window.run("health", replaces=True).startswith("Done: ")
    assert read_png(lab / "capture" / "masks" / "object.png")[30, 24] == 0
    assert "exchanged" not in page.inner_text("#health")

    page.click("#tool-scale")  # 80 px are known to be 40 mm long, so that the 120 px of the longer side show 60 mm
    window.draw((20, 40), (100, 40))
    page.fill("#length", "40")
    page.keyboard.press("Enter")
    page.wait_for_selector("#across:text-is('The longer side shows 60 mm')")
    window.section("measure")
    assert page.input_value("#measure-across") == "0.06"
    shown += page.inner_text("#shown").splitlines()
    window.begin("measure")
    page.click("#cancel")
    page.wait_for_selector("#running", state="hidden", timeout=PATIENCE_MS)
    assert page.inner_text("#last").startswith("Cancelled")
    assert not (lab / "measured").exists() and not list(lab.glob(".*writing*")), "a cancelled command left some"
    assert window.run("measure").startswith("Done: ")
    page.wait_for_function("() => { const one = document.getElementById('picture'); return one && one.naturalWidth; }")
    page.click("#tools button:text-is('Report')")
    page.frame_locator("iframe").get_by_text("What was taken for given").first.wait_for()

    before = page.url, page.inner_text("#steps")
    page.reload()
    page.wait_for_selector("#section-measure.open")
    assert (page.url, page.inner_text("#steps")) == before

    window.section("share")
    page.fill("#publish-title", "Ball of a dome")
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.getElementById('shown').innerText.includes('Ball of a dome')")
    shown += page.inner_text("#shown").splitlines()[:1]
    assert window.run("publish").startswith("Done: ")
    page.frame_locator("iframe").get_by_role("heading", name="Ball of a dome").wait_for()

    for name, text in {"inventory": "1889.12", "title": "Ball"}.items():
        page.fill(f"#archive-{name}", text)
        page.keyboard.press("Tab")
    for name in ("creator", "institution", "licence"):
        page.fill(f"#profile-{name}", f"Some {name}")
        page.keyboard.press("Tab")
        page.wait_for_function(f"() => document.getElementById('profile-{name}').value === 'Some {name}'")
    assert window.run("archive").startswith("Done: ")
    assert "Some creator" in (lab / "bag" / "bag-info.txt").read_text(encoding="utf-8")
    assert window.run("export").startswith("Done: ")
    assert {path.suffix for path in (lab / "export").iterdir()} >= {".png", ".glb", ".json"}

    assert not window.faults
    assert {url.split("?")[0].rsplit(":", 1)[0] for url in window.asked if url.startswith("http")} == {
        "http://127.0.0.1"
    }
    run_in_a_terminal(home / "dome", shown)


def run_in_a_terminal(folder, shown):
    """The commands that were shown, in a shell, in a copy of the folder without results: all have the same bits."""
    results = ("capture", "health.json", "measured", "page.html")
    other = folder.parent / "other" / "dome"  # of the same name: the page is called so without a title
    shutil.copytree(folder, other)
    for name in results:
        path = other / "lab" / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    program = f'hagoromo() {{ "{sys.executable}" -m hagoromo "$@"; }}\n'
    commands = [line.removeprefix("$ ").removesuffix(" --force") for line in shown]
    assert len(commands) == 4 and all(line.startswith("hagoromo ") for line in commands), commands
    subprocess.run(["bash", "-ec", program + "\n".join(commands)], cwd=other, env={**os.environ}, check=True)
    for name in results:
        mine, theirs = folder / "lab" / name, other / "lab" / name
        same = digests(mine) == digests(theirs) if mine.is_dir() else mine.read_bytes() == theirs.read_bytes()
        assert same, name


def test_a_ball_that_is_dragged_off_is_refused_and_one_that_is_drawn_gives_the_lamps(window, home):
    page, folder = window.page, home / "ball" / "in_it"
    page.click(".folders button:text-is('ball')")
    page.click(".folders button:text-is('in_it')")
    page.click("#next")
    assert "there is no .lp" in page.inner_text("#notes")
    page.click("#run-health")
    page.wait_for_selector("#running", state="visible")
    page.wait_for_selector("#running", state="hidden", timeout=PATIENCE_MS)
    assert page.locator(".dome circle.lamp").count() == LAMPS
    x, y = read_json(folder / "lab" / "lamps.json")["balls"][0]["centre_px"]
    page.click("#tool-ball")
    window.drag((x, y), (x + 3, y + 1))
    circle = window.laboratory.folder().record.circles[0]
    assert np.allclose(circle[:2], (x + 3, y + 1), atol=1.0)
    said = window.run("health", replaces=True)
    assert "the mask is not where the photographs show the ball" in said
    assert (folder / "lab" / "capture" / "transforms.json").exists(), "a command that was refused took away a result"
    window.drag((x + 3, y + 1), (x, y))
    assert window.run("health", replaces=True).startswith("Done: ")
    assert not window.faults
