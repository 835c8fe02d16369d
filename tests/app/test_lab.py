"""The laboratory without a browser: who gets in, what of the disk is shown, and that what is shown is what is run."""

import http.client
import json
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from glob import glob
from itertools import pairwise
from types import SimpleNamespace
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from hagoromo.app.cli import parsed
from hagoromo.calibration.lamps.ball import Ball, stated
from hagoromo.calibration.lamps.ball_search import OFFERED, PAINT
from hagoromo.errors import InputError
from hagoromo.files.png import read_png, write_png
from hagoromo.photograph.lamp_files import read_lp
from hagoromo_page.lab import job as jobs
from hagoromo_page.lab import pictures
from hagoromo_page.lab.folder import MASK, Folder
from hagoromo_page.lab.laboratory import Exists, Laboratory
from hagoromo_page.lab.messages import LARGEST_BODY
from hagoromo_page.lab.said import DRAW, FILL_IN, LOOK
from hagoromo_page.lab.server import LabServer
from hagoromo_page.lab.steps import STEPS, TABLE
from tests.app.started import STARTED

COUNT, SIZE = 5, (11, 17)  # photographs, of height and width [px]
LAMPS = [f"{k}.png 0.{k} 0.1 1.0" for k in range(COUNT)]
PATIENCE_S = 60.0
BALL = Ball((31.5, 30.5), 11.0, (0.1, 0.1, 0.1), 0.0, np.zeros((0, 2)))


@pytest.fixture
def root(tmp_path):
    """A folder with one of photographs, an .lp above it, and what must stay out of reach."""
    home = tmp_path / "root" / "vase"
    home.mkdir(parents=True)
    for k in range(COUNT):
        write_png(home / f"{k}.png", np.full((*SIZE, 3), 40 * k, np.uint8))
    (home.parent / "dome.lp").write_text("\n".join([str(COUNT), *LAMPS]) + "\n", encoding="utf-8")
    (tmp_path / "secret").mkdir()
    write_png(tmp_path / "secret" / "0.png", np.zeros((*SIZE, 3), np.uint8))
    return home.parent


@pytest.fixture
def laboratory(root):
    """With the photographs chosen."""
    made = Laboratory(root)
    made.do({"do": "open", "folder": "vase"})
    return made


@pytest.fixture
def served(laboratory):
    server = LabServer(laboratory)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.stop()
    thread.join()


def asked(server, path, method="GET", body=None, **headers):
    """Status, headers and text of a request; a header's value None: without it."""
    place = urlsplit(server.address)
    home = f"{place.hostname}:{place.port}"
    cookie = server.admission.cookie(place.port).partition(";")[0]
    sent = {"Host": home, "Origin": f"http://{home}", "Cookie": cookie, **headers}
    with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=30)) as link:
        link.putrequest(method, path, skip_host=True)
        if body is not None and "Content-Length" not in headers:
            sent["Content-Length"] = str(len(body))
        for name, value in sent.items():
            if value is not None:
                link.putheader(name, value)
        link.endheaders(body)
        answer = link.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


def test_only_who_has_the_token_gets_in_and_only_from_this_page_and_machine(served):
    for path in ("/", "/state", "/photograph?name=0.png&size=small", "/?token=x", "/result/lab.json"):
        assert asked(served, path, Cookie=None)[0] == 403
    status, headers, text = asked(served, f"/?{urlsplit(served.address).query}", Cookie=None)
    assert (status, headers["Location"], text) == (302, "/", b"") and "SameSite=Strict" in headers["Set-Cookie"]
    assert asked(served, "/state", Host="attacker.example:80")[0] == 403
    run = json.dumps({"do": "choose", "step": "publish", "option": "title", "value": "Vase"}).encode()
    for wrong in ({"Cookie": None}, {"Origin": None}, {"Origin": "http://attacker.example"}, {"Origin": "null"}):
        assert asked(served, "/do", "POST", run, **wrong)[0] == 403
    assert STEPS["publish"].options[0].value("publish", served.laboratory.folder()) == "vase"
    assert asked(served, "/do", "POST", run)[0] == 200
    assert STEPS["publish"].options[0].value("publish", served.laboratory.folder()) == "Vase"
    status, headers, text = asked(served, "/")
    assert status == 200 and "default-src 'self'" in headers["Content-Security-Policy"] and b"<title>" in text


def test_a_message_that_is_too_large_or_states_no_length_is_refused_unread(served):
    large = {"Content-Length": str(LARGEST_BODY + 1)}
    assert asked(served, "/do", "POST", b"{}", **large)[0] == 413
    assert asked(served, "/do", "POST", b"", **{"Content-Length": "-1"})[0] == 411
    assert asked(served, "/do", "POST")[0] == 411
    points = [[0.0, 0.0]] * 5001
    with pytest.raises(InputError, match="points"):
        served.laboratory.do({"do": "stroke", "paints": "object", "radius": 1.0, "points": points})


def test_files_beside_the_photographs_are_offered_where_they_belong(root, laboratory):
    for name in ("rig.json", "my notes.json", "canon.json"):
        (root / "vase" / name).write_text("{}", encoding="utf-8")
    offered = {
        (step, option.name): set(option.choices(laboratory.folder())) - {"", "orthographic"}
        for step in ("capture", "measure", "publish")
        for option in STEPS[step].options
        if option.name in ("camera", "rig", "notes") and option.choices is not None
    }
    assert offered == {
        ("capture", "camera"): {"canon.json"},
        ("measure", "rig"): {"rig.json"},
        ("publish", "notes"): {"my notes.json"},
    }


def test_nothing_outside_of_the_folder_is_shown(served, root, tmp_path):
    (root / "way_out").symlink_to(tmp_path / "secret")
    (root / "vase" / "5.png").symlink_to(tmp_path / "secret" / "0.png")
    for way in ("..", "../secret", "way_out", str(tmp_path / "secret"), "vase/../..", "absent", "vase/0.png"):
        assert asked(served, "/do", "POST", json.dumps({"do": "open", "folder": way}).encode())[0] == 400
    assert served.laboratory.folder().relative == "vase"
    for name in ("5.png", "../dome.lp", "..%2F..%2Fsecret%2F0.png"):
        assert asked(served, f"/photograph?name={name}&size=small")[0] == 400
    (root / "vase" / "lab").mkdir()
    (root / "vase" / "lab" / "page.html").write_text("<script></script>", encoding="utf-8")
    status, headers, _ = asked(served, "/result/lab/page.html")
    assert status == 200 and headers["Content-Security-Policy"] == "sandbox allow-scripts"
    for name in ("../0.png", "%2e%2e/0.png", "lab/../../0.png", "/etc/passwd"):
        assert asked(served, f"/result/{name}")[0] == 400


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"do": "dance"}, "dance"),
        ({"do": "run", "step": "rm"}, "no step 'rm'"),
        ({"do": "swap", "names": ["0.png", "x"]}, "'x' is no photograph"),
        ({"do": "circles", "circles": [[1.0, 2.0, -3.0]]}, "circles"),
        ({"do": "corners", "corners": [[1.0, 2.0]]}, "corners must be four, or none"),
        ({"do": "choose", "step": "capture", "option": "transfer", "value": "--force"}, "not offered"),
        ({"do": "choose", "step": "publish", "option": "title", "value": "--capture"}, "begins with -"),
        ({"do": "choose", "step": "capture", "option": "out", "value": "x"}, "no option 'out'"),
        ([1, 2], "the message"),
    ],
)
def test_a_message_that_is_wrong_is_refused_in_one_line(laboratory, message, said):
    with pytest.raises(InputError, match=said) as refused:
        laboratory.do(message)
    assert "\n" not in str(refused.value)


def expanded(text, folder):
    """The words that a shell makes of a command."""
    return [
        one
        for word in shlex.split(text)
        for one in (sorted(glob(word, root_dir=folder.home)) if "*" in word else [word])
    ]


def test_every_step_shows_the_command_that_it_runs_and_the_command_line_takes_it(laboratory):
    laboratory.do({"do": "circles", "circles": [[5.0, 6.0, 3.25]]})
    laboratory.do({"do": "choose", "step": "export", "option": "to", "value": "png ptm"})
    laboratory.do({"do": "choose", "step": "archive", "option": "inventory", "value": "18 'x'; rm -rf *"[:15]})
    (laboratory.folder().home / "chart.tif").touch()
    laboratory.do({"do": "corners", "corners": [[1.0, 2.0], [9.0, 2.0], [9.0, 8.0], [1.5, 8.0]]})
    for source, chart in (("../dome.lp", "chart.tif"), ("ball", "")):
        laboratory.do({"do": "choose", "step": "lamps", "option": "from", "value": source})
        kept = laboratory.folder().record.corners
        laboratory.do({"do": "choose", "step": "response", "option": "chart", "value": chart})
        laboratory.do({"do": "corners", "corners": kept})
        folder = laboratory.folder()
        for step in TABLE:
            words = step.words(folder)
            assert expanded(step.shown(folder), folder) == ["hagoromo", *words]
            assert step.makes in words and "--force" not in words
            parsed(words)
        chain = [step.name for step in STEPS["health"].chain(folder)]
        assert chain == (["develop", "response", "capture", "health"] if chart else ["lamps", "capture", "health"])
        assert ("--response lab/response.csv --spectrum D65" in STEPS["capture"].shown(folder)) == bool(chart)
    assert "--corners 1 2 9 2 9 8 1.5 8 --lamp D65" in STEPS["response"].shown(folder)
    assert "*.png" in STEPS["capture"].shown(folder) and "--ball 5,6,3.25" in STEPS["capture"].shown(folder)
    (folder.home / "lab" / "health.json").write_text("{}", encoding="utf-8")
    assert STEPS["health"].shown(folder).endswith("--force")


def test_photographs_are_listed_one_by_one_where_a_shell_might_order_them_in_another_way(laboratory):
    shown = STEPS["capture"].shown(laboratory.folder())
    assert "*.png" in shown
    write_png(laboratory.folder().home / "10.png", np.zeros((*SIZE, 3), np.uint8))
    folder = laboratory.folder()
    assert " 4.png 10.png " in STEPS["capture"].shown(folder)
    assert expanded(STEPS["capture"].shown(folder), folder) == ["hagoromo", *STEPS["capture"].words(folder)]


def test_names_and_texts_of_others_are_no_options_of_a_command(laboratory):
    """A folder from elsewhere may hold files, and choices kept, that look like options."""
    home = laboratory.folder().home
    for name in ("--allow=a.json", "--force.png", "-1.lp"):
        (home / name).touch()
    (home / "lab").mkdir()
    kept = {"publish.title": "--allow=/", "capture.camera": "--allow=a.json", "lamps.from": "-1.lp"}
    (home / "lab" / "lab.json").write_text(json.dumps({"options": kept}), encoding="utf-8")
    folder = laboratory.folder()
    assert folder.lamps_from == "-1.lp"
    for step in TABLE:
        words = step.words(folder)
        assert not [word for word in words if word.startswith(("--allow", "--force", "-1"))]
    assert {"./--force.png", "./-1.lp"} <= set(STEPS["capture"].words(folder))


def wait(job):
    end = time.monotonic() + PATIENCE_S
    while job.status is None:
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def stood_in(monkeypatch):
    """Programs that stand for commands: each writes its result; lists their words."""
    ran = []
    program = "import sys, pathlib; print('capture: 40 %, 1.png', flush=True); pathlib.Path(sys.argv[1]).touch()"

    def started(words, folder):
        ran.append((list(words), folder))
        out = words[words.index("--out") + 1]
        (folder / "lab").mkdir(exist_ok=True)
        return subprocess.Popen(
            [sys.executable, "-S", "-c", program, out], cwd=folder, stdout=subprocess.PIPE, encoding="utf-8"
        )

    monkeypatch.setattr(jobs, "started", started)
    return ran


def test_a_step_runs_what_it_shows_after_those_before_it_and_asks_before_it_replaces(laboratory, stood_in):
    folder = laboratory.folder()
    shown = [STEPS[name].shown(folder) for name in ("capture", "health")]
    laboratory.do({"do": "run", "step": "health"})
    with pytest.raises(InputError, match="a command runs"):
        laboratory.do({"do": "run", "step": "health"})
    wait(laboratory.job)
    folder = laboratory.folder()
    assert [expanded(one, folder)[1:] for one in shown] == [words for words, _ in stood_in]
    assert laboratory.job.share == 0.4 and laboratory.job.said == "1.png"
    assert [STEPS[name].state(folder) for name in ("capture", "health", "measure")] == ["done", "done", "to do"]

    laboratory.do({"do": "swap", "names": ["1.png", "3.png"]})
    folder = laboratory.folder()
    assert [STEPS[name].state(folder) for name in ("capture", "health")] == ["out of date", "out of date"]
    with pytest.raises(Exists) as asks:
        laboratory.do({"do": "run", "step": "health"})
    assert asks.value.names == ["lab/capture", "lab/health.json"] and len(stood_in) == 2
    laboratory.do({"do": "run", "step": "health", "replace": True})
    wait(laboratory.job)
    assert [words[-1] for words, _ in stood_in[2:]] == ["--force", "--force"]
    assert "lab/ordered.lp" in stood_in[2][0]
    assert STEPS["health"].state(laboratory.folder()) == "done"


def standing_in(program):
    """What starts a program in place of a command."""
    command = [sys.executable, "-S", "-c", program]
    return lambda words, folder: subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8")


def test_a_step_that_fails_ends_the_chain_and_cancel_begins_no_other(laboratory, monkeypatch):
    monkeypatch.setattr(jobs, "started", standing_in("print('hagoromo: no'); raise SystemExit(2)"))
    laboratory.do({"do": "run", "step": "health"})
    wait(laboratory.job)
    assert laboratory.job.status == 2 and laboratory.job.now == 0 and laboratory.job.lines[-1] == "hagoromo: no"
    monkeypatch.setattr(jobs, "started", standing_in("import time; time.sleep(600)"))
    laboratory.do({"do": "run", "step": "health"})
    laboratory.do({"do": "cancel"})
    wait(laboratory.job)
    assert laboratory.job.cancelled and laboratory.job.now == 0 and laboratory.job.status != 0


@pytest.mark.parametrize(
    ("step", "line", "text", "circle"),
    [
        ("lamps", f"no ball (perhaps): {OFFERED} ({stated(BALL)}), else {PAINT}", f"no ball (perhaps): {LOOK}", BALL),
        ("lamps", f"no ball: {PAINT}", f"no ball: {DRAW}", None),
        (
            "capture",
            "state transfer (--transfer), or give --bracket",
            "state transfer (Transfer), or give --bracket",
            None,
        ),
        ("measure", "measure a rig (hagoromo calibrate rig) and give --rig", "measure a rig and give Rig", None),
        ("archive", "no profile x.toml, and no terminal to ask at: write one", f"no profile x.toml{FILL_IN}", None),
    ],
)
def test_a_refusal_is_in_the_words_of_the_window_and_offers_what_may_be_the_ball(
    laboratory, monkeypatch, step, line, text, circle
):
    monkeypatch.setattr(jobs, "started", standing_in(f"print({line!r}); raise SystemExit(2)"))
    laboratory.job = jobs.CommandRun(laboratory.folder, [STEPS[step]])
    laboratory.job.start()
    wait(laboratory.job)
    progress = laboratory.progress()
    assert progress["refused"] == text and progress["lines"][-1] == line
    assert progress["circle"] == (None if circle is None else pytest.approx((*circle.centre, circle.radius), abs=0.1))


def test_an_archive_without_an_inventory_number_is_refused_before_anything_runs(laboratory, stood_in):
    with pytest.raises(InputError, match="fill in Inventory number first"):
        laboratory.do({"do": "run", "step": "archive"})
    assert not stood_in


def test_the_page_says_what_the_archive_does(laboratory):
    laboratory.do({"do": "choose", "step": "archive", "option": "inventory", "value": "1889.12"})
    laboratory.do({"do": "profile", "values": {"creator": "Ada", "licence": "CC-BY-4.0", "camera": "R5"}})
    words = STEPS["publish"].words(laboratory.folder())
    facts = [word for mark, word in pairwise(words) if mark == "--fact"]
    assert facts == ["Inventory number=1889.12", "Made by=Ada", "Licence=CC-BY-4.0"]
    (laboratory.folder().home / "lab" / "archive.toml").write_text("spoilt", encoding="utf-8")
    state = laboratory.state()
    assert len(state["faults"]) == 1 and "archive.toml" in state["faults"][0]


def test_the_brightest_of_all_photographs_is_lifted_out_of_the_dark(laboratory):
    """One photograph is dark but for a faint disc that another one shows half of."""
    folder = laboratory.folder()
    for k in range(COUNT):
        picture = np.full((*SIZE, 3), 2, np.uint8)
        picture[3:6, 4 + k : 5 + k] = 12
        write_png(folder.home / f"{k}.png", picture)
    data = np.frombuffer(laboratory.pictures.brightest(folder), np.uint8)
    shown = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
    assert shown.shape == SIZE and shown[4, 4:9].min() > shown[8, 5] + 60
    write_png(folder.home / "4.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InputError, match="another size"):
        laboratory.pictures.brightest(laboratory.folder())


def test_no_module_is_taken_from_the_folder_of_the_photographs(root):
    """`python -m` looks for modules in the working directory first."""
    (root / "vase" / "numpy.py").write_text("raise SystemExit('taken')", encoding="utf-8")
    process = jobs.started(["--version"], root / "vase")
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and said.startswith("hagoromo ")


def test_photographs_are_swapped_by_their_lamps_and_reversed_and_as_named_again(laboratory):
    laboratory.do({"do": "swap", "names": ["0.png", "4.png"]})
    folder = laboratory.folder()
    lamps = {lamp.name: np.array(lamp.to_lamp) for lamp in read_lp(folder.file(folder.lamp_file))}
    before = {lamp.name: np.array(lamp.to_lamp) for lamp in read_lp(folder.file("../dome.lp"))}
    assert np.allclose(lamps["0.png"], before["4.png"]) and np.allclose(lamps["4.png"], before["0.png"])
    assert np.allclose(lamps["2.png"], before["2.png"])
    assert folder.ordered == ("4.png", "1.png", "2.png", "3.png", "0.png")
    laboratory.do({"do": "reverse"})
    assert laboratory.folder().ordered == ("0.png", "3.png", "2.png", "1.png", "4.png")
    laboratory.do({"do": "as named"})
    assert laboratory.folder().lamp_file == "../dome.lp"
    laboratory.do({"do": "choose", "step": "lamps", "option": "from", "value": "ball"})
    with pytest.raises(InputError, match="each photograph has its own"):
        laboratory.do({"do": "reverse"})


def test_strokes_paint_a_mask_in_pixels_of_the_photographs_and_the_eraser_takes_them_back(laboratory):
    stroke = {"do": "stroke", "radius": 1.5, "points": [[3.0, 2.0], [12.0, 2.0]]}
    laboratory.do({**stroke, "paints": "object"})
    laboratory.do({**stroke, "paints": "background", "points": [[5.0, 8.0]]})
    mask = read_png(laboratory.folder().home / MASK)
    assert mask.shape == SIZE and (mask[2, 3:13] == 255).all() and mask[8, 5] == 0 and mask[10, 15] == 128
    assert f"--mask auto {MASK}" in STEPS["capture"].shown(laboratory.folder())
    laboratory.do({**stroke, "paints": "as found", "radius": 40.0})
    assert not (laboratory.folder().home / MASK).exists()
    assert MASK not in STEPS["capture"].shown(laboratory.folder())


def test_all_that_is_shown_is_read_from_files(laboratory, root):
    laboratory.do({"do": "swap", "names": ["0.png", "1.png"]})
    laboratory.do({"do": "choose", "step": "capture", "option": "transfer", "value": "linear"})
    laboratory.do({"do": "circles", "circles": [[5.0, 6.0, 3.0]]})
    laboratory.do({"do": "profile", "values": {"creator": "Ada", "place": " "}})
    other = Laboratory(root)
    other.do({"do": "open", "folder": "vase"})
    assert other.state() == laboratory.state()
    state = json.loads(json.dumps(other.state()))
    assert state["faults"] == [] and state["size"] == [SIZE[1], SIZE[0]] and len(state["lamps"]) == COUNT
    assert state["profile"] == {"creator": "Ada"} and state["order"][:2] == ["1.png", "0.png"]


def said_of(root, name):
    laboratory = Laboratory(root)
    laboratory.do({"do": "open", "folder": name})
    state = laboratory.state()
    return SimpleNamespace(lines=[*state["advice"], *state["faults"]], laboratory=laboratory)


def test_a_folder_that_cannot_be_measured_says_so_in_one_line(root):
    for name in ("empty", "letters", "one", "lampless", "torn"):
        (root / name).mkdir()
    (root / "letters" / "a.txt").write_text("a", encoding="utf-8")
    write_png(root / "one" / "a.png", np.zeros((*SIZE, 3), np.uint8))
    for name, line in {"empty": "empty is empty: choose", "letters": "letters has no photographs: choose"}.items():
        found = said_of(root, name)
        assert len(found.lines) == 1 and found.lines[0].startswith(line)
        with pytest.raises(InputError, match="choose a folder"):
            found.laboratory.do({"do": "run", "step": "measure"})
    assert any("one has one photograph: a shape needs 4 or more" in line for line in said_of(root, "one").lines)
    assert "1 photographs and 5 lamps: give one photograph per lamp" in "".join(said_of(root, "one").lines)
    (root / "dome.lp").unlink()
    lines = said_of(root, "vase").lines
    assert len(lines) == 1 and "there is no .lp" in lines[0] and "put the dome's .lp here" in lines[0]
    (root / "vase" / "0.png").write_bytes(b"\x89PNG\r\n\x1a\ntorn")
    assert any("0.png" in line for line in said_of(root, "vase").lines)
    (root / "vase" / "lab").mkdir()
    (root / "vase" / "lab" / "lab.json").write_text('{"order": 3}', encoding="utf-8")
    assert any("lab.json" in line for line in said_of(root, "vase").lines)


def test_a_folder_or_port_that_cannot_be_served_is_refused_in_one_line(refused, tmp_path):
    assert "does not exist" in refused("lab", tmp_path / "absent", "--no-browser")
    (tmp_path / "a.jpg").touch()
    assert "is a file" in refused("lab", tmp_path / "a.jpg", "--no-browser")
    assert "port is 99999" in refused("lab", tmp_path, "--no-browser", "--port", "99999")
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        assert f"port {port}" in refused("lab", tmp_path, "--no-browser", "--port", port)


@pytest.mark.nightly
def test_the_command_serves_until_it_is_interrupted(root):
    command = [sys.executable, "-c", STARTED, "lab", str(root), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        place = urlsplit(process.stdout.readline().removeprefix("open ").strip())
        assert place.hostname == "127.0.0.1"
        with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=30)) as link:
            link.request("GET", f"/?{place.query}")
            assert link.getresponse().status == 302
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130 and said.splitlines() == ["hagoromo: interrupted: nothing was written"]


def test_the_photographs_are_those_of_the_format_that_most_have_in_the_order_people_count(tmp_path):
    for name in ("2.JPG", "10.JPG", "1.JPG", "mask.png", "notes.txt", ".hidden.JPG"):
        (tmp_path / name).touch()
    folder = Folder(tmp_path)
    assert folder.photographs == ("1.JPG", "2.JPG", "10.JPG") and folder.left_out == ("mask.png",)
    for name in ("1.NEF", "2.NEF", "10.NEF"):
        (tmp_path / name).touch()
    assert Folder(tmp_path).photographs == ("1.NEF", "2.NEF", "10.NEF")


def test_pictures_are_made_one_at_a_time_and_each_once(laboratory, monkeypatch):
    """A browser asks for six thumbnails at once; six photographs of 24 megapixels would take more than a gigabyte."""
    making, most, made = [], [], []

    def small(path):
        making.append(path)
        most.append(len(making))
        time.sleep(0.01)
        made.append(making.pop())
        return (4, 4), {"small": path.name.encode(), "large": b""}

    monkeypatch.setattr(pictures, "_small", small)
    kept, folder = pictures.Pictures(), laboratory.folder()
    names = 4 * list(folder.photographs)
    with ThreadPoolExecutor(6) as pool:
        got = list(pool.map(lambda name: kept.photograph(folder, name, "small"), names))
    assert got == [name.encode() for name in names]
    assert max(most) == 1 and len(made) == COUNT
