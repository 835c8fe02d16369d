"""The demo runs the paper end to end, says what is true of it, and leaves all or nothing."""

import base64
import io
import pickle
import re
import shutil
from contextlib import contextmanager, redirect_stderr
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from hagoromo.app.progress_bar import step_lines
from hagoromo.camera.response import Response, camera_response, camera_white, srgb_from_camera
from hagoromo.errors import InputError
from hagoromo.files.record import read_json
from hagoromo.image.picture.compare import compare
from hagoromo.image.picture.image import read_image
from hagoromo.light.colour import srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import load_capture
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo_matter.demo import demo as module
from hagoromo_matter.demo import drawn as drawing
from hagoromo_matter.demo.demo import SIZES, demo
from hagoromo_matter.demo.figures import people
from hagoromo_matter.demo.samples import bench, bench_camera, true_reflectances
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.figure import wardrobe
from hagoromo_page.publication.document import script_hash
from tests.judges import intervals_hold


@pytest.fixture(scope="module")
def told():
    """What progress was told."""
    return []


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The folder of a cache."""
    return tmp_path_factory.mktemp("cache") / "kept"


@pytest.fixture(scope="module")
def first_page(tmp_path_factory):
    """Where the folder is copied to once the page is there."""
    return tmp_path_factory.mktemp("first") / "out"


@pytest.fixture(scope="module")
def out(tmp_path_factory, told, kept, first_page):
    """The folder of a tiny demo."""
    folder = tmp_path_factory.mktemp("demo") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAGOROMO_CACHE", str(kept))
        made = demo(
            folder,
            size="tiny",
            progress=lambda share, step="": told.append((share, step)),
            opened=lambda page: shutil.copytree(page.parent, first_page),
        )
    assert made == folder / "report.html"
    return folder


@pytest.fixture(scope="module")
def page(out):
    return (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.nightly
def test_the_truth_is_inside_the_intervals_as_often_as_they_claim(out):
    """28 intervals of 95 %: so few inside have a probability of 1e-3 at least, if all are right (seed fixed)."""
    record = read_json(out / "results.json")
    held = record["coverage"]
    assert held["identifiable"] == held["intervals"] == 28
    assert held["inside"] == sum(row["low"] <= row["true"] <= row["high"] for row in record["table"])
    assert intervals_hold(np.arange(28) < held["inside"], 0.95, significance=1e-3, at_least=True)


def test_estimates_are_near_the_truth(out):
    """What the medians over many captures must keep, 1 % for α and 3 % for β and γ, this one capture keeps too."""
    limit = {"alpha": 0.01, "beta": 0.03, "gamma": 0.03, "n": 0.03}
    for row in read_json(out / "results.json")["table"]:
        assert abs(row["estimate"] / row["true"] - 1) < limit.get(row["parameter"], 0.01), row


def test_a_lamp_that_was_kept_aside_is_predicted_to_the_noise(out):
    """No more than a twentieth worse than the true reflectances are; and compare says the same of the files."""
    relit = read_json(out / "results.json")["relit"]
    assert relit["measured"]["relative_rmse"] < 1.05 * relit["ideal"]["relative_rmse"]
    again = compare(*(out / "relit" / name for name in ("predicted.exr", "photograph.exr", "mask.png"))).record()
    assert again["relative_rmse"] == pytest.approx(relit["measured"]["relative_rmse"], rel=1e-5)
    assert again["pixels"] == relit["measured"]["pixels"]


def test_the_measurement_never_saw_the_lamp_kept_aside(out):
    names = [photograph.name for photograph in load_capture(out / "capture").photographs]
    assert names[-1] == "kept aside" and len(names) == 4
    assert len(list((out / "measure").glob("residual_*.png"))) == 3


def test_the_page_is_self_contained(page):
    """All that it shows is inside: no script but the viewer's own, no link, no image but data; every image decodes."""
    assert "<link" not in page and "@import" not in page and "<iframe" not in page
    assert page.count(f"script-src {script_hash()};") == 1 and page.count("default-src 'none'") == 1
    kinds = re.findall(r"<script([^>]*)>", page)
    assert kinds.count("") == 1 and all(
        re.match(r'( type="(application/json|text/plain)" id="hv-.*)?$', k) for k in kinds
    )
    addresses = set(re.findall(r'https?://[^"\s)]+', page))
    assert all(address.startswith("http://www.w3.org/") for address in addresses), addresses  # names of XML only
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) >= 4 + 7 + 3 + len(SIZES["tiny"].figures) + 3
    for source in sources:
        data = base64.b64decode(source.split(",", 1)[1])
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) is not None
    shown = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert shown.count("<svg") == shown.count("</svg>") == 3 + 2  # two are the viewer's


def test_the_page_says_what_was_measured(out, page):
    record = read_json(out / "results.json")
    held = record["coverage"]
    assert f"{held['inside']} of {held['identifiable']} intervals" in page
    assert page.count('<span class="no">no</span>') == held["identifiable"] - held["inside"]
    for word in ("skin", "cloth", "feather", "dielectric", "ΔE", "What this does not show", *record["versions"]):
        assert word in page
    assert [int(n) for n in re.findall(r"<b>Figure (\d+)\.</b>", page)] == list(range(1, page.count("<b>Figure") + 1))


def test_figures_keep_their_weights(out):
    for name in SIZES["tiny"].figures:
        image = read_image(out / "figures" / f"{name}.exr")
        assert image.alpha.max() == 1.0 and np.isfinite(image.weights).all() and image.weights.max() > 0.0
        assert image.metadata["scene"]["boxes"][0]["materials"][0]["element"] in ("cylinder", "plane", "sphere")
        assert (out / "figures" / f"{name}.png").is_file()


def test_boxes_hold_what_was_measured(out):
    """On plane elements: the scales of a figure's skin reach as deep as light."""
    measured = {material.name: material for material in read_materials(out / "measure" / "materials.json")}
    scene = read_image(out / "figures" / "figure_7_skin.exr").metadata["scene"]
    skin = scene["boxes"][0]["materials"][0]
    assert (skin["alpha"], skin["beta"], skin["element"]) == (measured["skin"].alpha, measured["skin"].beta, "plane")


def test_garments_fall_once(monkeypatch, tmp_path):
    """Another process, or a later run, finds the sheets in the cache, with all their bits."""
    random, sheets = np.random.default_rng(0), []
    for around, shape in enumerate(((5, 6), (4, 9))):
        points, u, v = random.normal(size=(*shape, 3)), random.normal(size=shape), random.normal(size=shape)
        sheets.append(Sheet(points, u, v, float(around)))
    fallen = []
    monkeypatch.setenv("HAGOROMO_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(wardrobe, "garments", lambda *of: fallen.append(of) or {"veil": sheets[:1], "habit": sheets})
    found = []
    for _ in range(2):
        wardrobe.draped.cache_clear()
        found.append(wardrobe.draped("nun", 0.5, 3))
    wardrobe.draped.cache_clear()
    assert fallen == [("nun", wardrobe.COARSEST, 3)]
    for worn in found:
        assert {name: len(parts) for name, parts in worn.items()} == {"veil": 1, "habit": 2}
        for sheet, true in zip([*worn["veil"], *worn["habit"]], [sheets[0], *sheets], strict=True):
            assert sheet.around == true.around
            for key in ("points", "u", "v"):
                np.testing.assert_array_equal(getattr(sheet, key), getattr(true, key))


def test_progress_is_told_by_stage_and_only_rises(told, out):
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[-1] == 1.0
    for stage in ("measurement: photographs", "measurement: materials", "figure 7 skin: rays", "report"):
        assert any(step.startswith(stage) for _, step in told)


def test_an_existing_folder_is_refused_before_any_work(out):
    with pytest.raises(InputError, match=r"out exists: choose another name or add force"):
        demo(out, size="tiny", progress=lambda *_: pytest.fail("work was begun"))


def test_an_interrupt_leaves_nothing(tmp_path):
    def interrupted(share, step=""):
        if step.startswith("measurement: "):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        demo(tmp_path / "new" / "out", size="tiny", progress=interrupted)
    assert [path for path in tmp_path.rglob("*") if path.name != "new"] == []


def test_the_page_begins_with_the_samples_and_what_was_found(page):
    """First what can be lit, then words, then figures; tables of all parameters come later."""
    body = page[page.index("<body>") :]
    order = ['id="hv-canvas"', "<h1>", "What was found", "Figures 6 to 8", "Table 1."]
    places = [body.index(part) for part in order]
    assert places == sorted(places)
    assert [int(n) for n in re.findall(r"<b>Table (\d+)\.</b>", page)] == list(range(1, page.count("<b>Table") + 1))


def test_the_page_is_there_before_the_figures_and_shows_them_as_they_come(out, first_page):
    early = (first_page / "report.html").read_text(encoding="utf-8")
    assert 'id="hv-canvas"' in early and "What was found" in early and "Table 1." in early
    assert 'src="figures.html"' in early and "frame-src 'self' file:" in early
    assert "0 of 1 figures are drawn" in (growing := (first_page / "figures.html").read_text(encoding="utf-8"))
    assert 'http-equiv="refresh"' in growing and read_json(first_page / "results.json")["finished"] is False
    assert list((first_page / "figures").iterdir()) == []
    final = (out / "figures.html").read_text(encoding="utf-8")
    assert "1 of 1 figures are drawn" in final and "refresh" not in final and "<img" in final
    assert read_json(out / "results.json")["finished"] is True


def test_a_second_run_has_the_same_files_and_makes_nothing_again(out, kept, tmp_path, monkeypatch):
    """All but the times that it took."""
    monkeypatch.setenv("HAGOROMO_CACHE", str(kept))
    monkeypatch.setattr(module, "measured", lambda *_: pytest.fail("measured again"))
    monkeypatch.setattr(drawing, "render", lambda *_: pytest.fail("drawn again"))
    demo(tmp_path / "again", size="tiny")
    files = [file.relative_to(out) for file in sorted(out.rglob("*")) if file.is_file()]
    for file in files:
        if file.name not in ("report.html", "figures.html", "results.json"):
            assert (tmp_path / "again" / file).read_bytes() == (out / file).read_bytes(), file
    assert len(files) == len([file for file in (tmp_path / "again").rglob("*") if file.is_file()])


def test_workers_draw_the_same_figures(out, kept, tmp_path, monkeypatch):
    """Their tasks are plain data; this process is the worker."""

    @contextmanager
    def one_worker(scheduler):
        yield SimpleNamespace(
            results=lambda work, tasks: ((k, work(*pickle.loads(pickle.dumps(task)))) for k, task in enumerate(tasks))
        )

    monkeypatch.setenv("HAGOROMO_CACHE", str(kept))
    monkeypatch.setattr(module, "workers_of", one_worker)
    told = []
    demo(tmp_path / "out", "tiny", progress=lambda share, step="": told.append(share), scheduler=1)
    name = "figures/figure_7_skin.exr"
    assert (tmp_path / "out" / name).read_bytes() == (out / name).read_bytes()
    assert told == sorted(told) and told[-1] == 1.0


def test_a_run_that_ends_early_leaves_the_page_and_the_same_command_begins_anew(kept, tmp_path, monkeypatch):
    monkeypatch.setenv("HAGOROMO_CACHE", str(kept))

    def interrupted(share, step=""):
        if step.startswith("figure 7"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="the measurement and 0 of 1 figures; the same command goes on"):
        demo(tmp_path / "out", size="tiny", progress=interrupted)
    assert "What was found" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    demo(tmp_path / "out", size="tiny")
    with pytest.raises(InputError, match="exists"):
        demo(tmp_path / "out", size="tiny")


def test_without_a_terminal_there_is_a_line_a_step():
    """Each with its time; what stands after the first colon is part of a step, and shown where the step is long."""
    times = iter([0.0, 0.0, 1.0, 2.0, 7.5, 63.0, 125.0, 126.0])
    said = io.StringIO()
    with redirect_stderr(said):
        shown = step_lines("demo", lambda: next(times))
        for share, step in (
            (0.0, "one"),
            (0.1, "one: part"),
            (0.2, "two"),
            (0.75, "two: end"),
            (0.8, "two: late"),
            (0.9, "two: later"),
            (1.0, ""),
        ):
            shown(share, step)
    assert said.getvalue().splitlines() == [
        "demo: one took 2.0 s, 2 s in all, 20 %, about 8 s left",
        "demo: 80 %, two: late",
        "demo: 90 %, two: later",
        "demo: two took 124.0 s, 126 s in all, 100 %",
    ]


@pytest.mark.parametrize("size", SIZES)
def test_two_processes_draw_every_figure_once_and_build_no_person_twice(size):
    own, others = module._shared_out(SIZES[size])
    assert sorted((*own, *others, *module._last(SIZES[size]))) == sorted(SIZES[size].figures) and own
    who = [{person for name in part for person in people(name)} for part in (own, others)]
    assert not who[0] & who[1]


def test_an_unknown_size_is_refused(tmp_path):
    with pytest.raises(InputError, match="one of small, full"):
        demo(tmp_path / "out", size="huge")


def test_no_ball_stands_in_the_light_of_another():
    """The line from any ball's middle to any lamp passes every other ball's middle at two radii or more."""
    scene = bench(true_reflectances(camera := bench_camera(SIZES["tiny"].capture_binning)), camera)
    middles = [surface.pose[:3, 3] for surface in scene.surfaces]
    for lamp in scene.lamps:
        for ball in middles:
            to_lamp = np.array(lamp.position) - ball
            to_lamp /= np.linalg.norm(to_lamp)
            for other in middles:
                offset = other - ball
                aside = np.linalg.norm(offset - max(offset @ to_lamp, 0.0) * to_lamp)
                assert other is ball or aside >= 0.06


def test_a_camera_sees_the_chart_nearly_as_people_do():
    """Mean ΔE00 below 1 over the ColorChecker for the stand-in of the Canon, and the lamp's colour exactly white."""
    import colour

    from hagoromo.light.colour import delta_e_2000

    camera, observer, lamp = Response.load("canon_eos_300d"), Response.load("cie1931"), Spectrum.named("D65")
    matrix = srgb_from_camera(camera, lamp)
    np.testing.assert_allclose(matrix @ camera_white(lamp, camera), 1.0, rtol=1e-9)
    different = []
    for patch in colour.SDS_COLOURCHECKERS["BabelColor Average"].values():
        spectrum = Spectrum(patch.wavelengths, patch.values)
        xyz = camera_response(spectrum, lamp, observer) / camera_white(lamp, observer) * (0.95047, 1.0, 1.08883)
        different.append(delta_e_2000(matrix @ camera_response(spectrum, lamp, camera), srgb_from_xyz(xyz)))
    assert np.mean(different) < 1.0
