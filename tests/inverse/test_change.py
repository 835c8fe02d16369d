"""Campaigns compared: nothing where nothing has changed, what has changed where it did, and what cannot be compared."""

import csv
import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.camera.pose import pose_of, turned_about_axes
from hagoromo.files.exr import read_exr
from hagoromo.light.colour import delta_e_2000
from hagoromo.measurement.photographed import Photographed
from hagoromo_campaigns.significance import WIDTHS
from tests.inverse.simulated_relief import SimulatedRelief, dome, relief_camera, relief_capture, relief_measurement

SIZE = 48
ELSEWHERE = pose_of(turned_about_axes((12.0, -30.0, 75.0)), (0.3, -0.1, 0.05))  # another world of the second date
FADED, FLAKED, POLISHED = (0.006, 0.004, 0.004), (-0.006, 0.003, 0.0035), (-0.004, -0.006, 0.004)
BEFORE = relief_camera(SIZE)
AFTER = relief_camera(SIZE + 5, eye=(0.03, -0.02, 0.42), roll=12.0, target=(0.001, 0.0005, 0.0))


def _changed(relief, seed=1, patina=0.0):
    """The change from the relief that nothing happened to, in another world and under another camera."""
    before = relief_measurement(SimulatedRelief(patina=patina), BEFORE, seed)
    return hg.change(before, relief_measurement(relief, AFTER, seed + 100, ELSEWHERE))


def _inside(change, quantity, disc):
    """Which of the significant pixels lie in a disc of the relief, and which of the disc's are significant."""
    points = change.before.points[..., :2]
    inside = np.hypot(points[..., 0] - disc[0], points[..., 1] - disc[1]) < disc[2]
    found, compared = change[quantity].significance.found, change[quantity].compared
    return inside[found].mean() if found.any() else 0.0, found[inside & compared].mean()


def test_the_same_object_in_another_world_shows_nothing():
    change = _changed(SimulatedRelief())
    assert not change.regions and not change.remarks[1:]
    # the truth: the relief was moved as a whole; registered to some thousandths of a pixel, in the error that is stated
    errors = np.linalg.norm(
        change.after.camera.project(change.registration.to_after.points(change.before.points[change.compared]))
        - change.after.camera.project(change.before.points[change.compared] @ ELSEWHERE[:3, :3].T + ELSEWHERE[:3, 3]),
        axis=1,
    )
    assert np.sqrt((errors**2).mean()) < 3.0 * change.registration.error_px < 0.1
    assert change["shape"].unit == "µm" and max(change["colour"].significance.widening) < 1.5


CHANGED = SimulatedRelief(patina=0.4, fade={FADED: (1.042, 1.042, 1.042)}, flake={FLAKED: 1e-4}, polish={POLISHED: 2.0})


@pytest.fixture(scope="module")
def changed():
    """ΔE00 of 1 by the truth, 0.1 mm of matter, and a polished spot, at one go."""
    return _changed(CHANGED, patina=0.4)


@pytest.mark.parametrize(
    ("quantity", "disc", "truth"), [("colour", FADED, 1.0), ("shape", FLAKED, -100.0), ("gloss", POLISHED, 100.0)]
)
def test_what_changed_is_found_where_it_did(changed, quantity, disc, truth):
    pitch = changed.before.pitch
    right, _ = _inside(changed, quantity, (*disc[:2], disc[2] + WIDTHS[-1] * pitch))
    _, complete = _inside(changed, quantity, (*disc[:2], disc[2] - pitch))
    assert right > 0.95 and complete > 0.9  # places are tested with their neighbours
    (region,) = [one for one in changed.regions if one.quantity == quantity and one.number == 1]
    assert abs(region.most) > 0.6 * abs(truth) and np.sign(region.mean) == np.sign(truth)
    assert region.low < region.mean < region.high and region.area_unit == "mm²"
    middle = changed.before.points[int(region.y_px), int(region.x_px), :2]
    assert np.hypot(*(middle - disc[:2])) < 2.0 * pitch


@pytest.mark.by_night("0.0012-2e-05", "0.0035-0.0001")
@pytest.mark.parametrize(("radius", "depth"), [(0.0012, 1e-4), (0.0012, 2e-5), (0.0035, 1e-4)])
def test_a_region_is_as_large_as_its_flake(radius, depth):
    """Neighbours help to decide, but do not differ themselves. The flake's edge is 0.3 mm wide, pixels are 0.4 mm."""
    (region,) = [
        one
        for one in _changed(SimulatedRelief(flake={(*FLAKED[:2], radius): depth})).regions
        if one.quantity == "shape" and one.number == 1
    ]
    assert np.pi * (1e3 * radius - 0.2) ** 2 < region.area < np.pi * (1e3 * radius + 0.4) ** 2
    assert -1e6 * depth < region.mean < -0.7e6 * depth


def test_the_map_of_colours_holds_the_true_difference(changed):
    points = changed.before.points
    core = np.hypot(points[..., 0] - FADED[0], points[..., 1] - FADED[1]) < FADED[2] - 2.0 * changed.before.pitch
    painted = np.pi * SimulatedRelief().paint(points[core][:, 0], points[core][:, 1])
    truth = delta_e_2000(painted, 1.042 * painted)
    ((label, value),) = changed["colour"].value.items()
    error = changed["colour"].error[label][core]
    assert 0.9 < truth.mean() < 1.1 and error.mean() < 0.5
    # the mean of n pixels errs by 1/√n of one; three of these errors
    assert abs(value[core].mean() - truth.mean()) < 3.0 * error.mean() / np.sqrt(core.sum())


def test_files_hold_what_python_gives(changed, tmp_path):
    changed.save(tmp_path / "out")
    maps, _ = read_exr(tmp_path / "out" / "change.exr")
    found, compared = changed["shape"].significance.found, changed["shape"].compared
    np.testing.assert_array_equal(maps["significant.shape"] > 0, found)
    np.testing.assert_allclose(maps["shape"][compared], changed["shape"].value[""][compared], rtol=1e-6)
    with open(tmp_path / "out" / "regions.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    record = json.loads((tmp_path / "out" / "change.json").read_text(encoding="utf-8"))
    assert [float(row["mean"]) for row in rows] == [one["mean"] for one in record["regions"]]
    assert len(rows) == len(changed.regions) > 0 and record["found"] == changed.sentence


@pytest.mark.nightly
def test_the_page_has_maps_of_all_quantities(changed, tmp_path):
    hg.write_change_report(tmp_path / "report.html", changed)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == 2 + 2 * len(changed.quantities) and "Grey: not significant" in page


@pytest.mark.nightly
def test_errors_that_are_stated_hold_over_many_seeds():
    """Of 30 pairs without a change at most 5 may show one: the binomial's 99.6 % quantile at a rate of 5 %."""
    some = [bool(_changed(SimulatedRelief(), seed).regions) for seed in range(2, 32)]
    assert sum(some) <= 5


def _refusal(before, after, **settings):
    with pytest.raises(hg.InputError) as refusal:
        hg.change(before, after, **settings)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


@pytest.mark.nightly
def test_the_command_reads_what_measure_wrote(tmp_path, capsys):
    folders = [tmp_path / name for name in ("first", "second")]
    relief_measurement(SimulatedRelief(), BEFORE, 1).save(folders[0])
    relief_measurement(SimulatedRelief(flake={FLAKED: 1e-4}), AFTER, 2, ELSEWHERE).save(folders[1])
    assert main(["change", *map(str, folders), "--out", str(tmp_path / "out")]) == 0
    assert "regions that changed" in (said := capsys.readouterr().out) and "µm" in said
    assert main(["change", str(folders[0]), str(tmp_path), "--out", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "none").exists()
    assert hg.change(*folders)["shape"].significance.found.any()


@pytest.mark.nightly
def test_two_objects_are_refused():
    other = relief_measurement(SimulatedRelief(seed=9), AFTER, 2)
    assert "two different objects" in _refusal(relief_measurement(SimulatedRelief(), BEFORE, 1), other)


def test_measurements_that_cannot_be_compared_are_refused():
    before = relief_measurement(SimulatedRelief(), BEFORE, 1)
    assert "states no errors" in _refusal(before, relief_measurement(SimulatedRelief(), AFTER, 2, errors=False))
    assert "number between 0 and 1" in _refusal(before, before, rate=0.0)
    assert "response of the cameras is not known" in _refusal(before, before, lamps=("A",))
    assert "points.exr" in _refusal(replace(before, points=None), before)


@pytest.mark.nightly
def test_parts_that_do_not_overlap_are_refused():
    before = relief_measurement(SimulatedRelief(), BEFORE, 1)
    aside = relief_camera(SIZE, eye=(0.012, 0.0, 0.1), target=(0.012, 0.0, 0.0))
    assert before.points is not None
    left = replace(before, labels=np.where(before.points[..., 0] < -0.004, before.labels, -1))
    assert "overlap" in _refusal(left, relief_measurement(SimulatedRelief(), aside, 3))


MENDED = SimulatedRelief(fade={(0.01, 0.0, 0.012): (0.7, 0.8, 0.9)})  # nearly half of it was painted over


def test_an_object_that_was_mended_between_is_doubted():
    said = _refusal(relief_measurement(SimulatedRelief(), BEFORE, 1), relief_measurement(MENDED, AFTER, 2))
    assert "mended" in said and "colour differs in most places" in said and "--doubted" in said


@pytest.mark.nightly
def test_a_doubted_comparison_says_what_is_doubted():
    change = hg.change(
        relief_measurement(SimulatedRelief(), BEFORE, 1), relief_measurement(MENDED, AFTER, 2), doubted=True
    )
    assert change.remarks[0].startswith("doubted") and "colour" in {one.quantity for one in change.regions}


@pytest.mark.nightly
def test_without_a_scale_lengths_are_pixels():
    """A measurement whose camera stands at the world's origin, without a stated distance, has no metres."""
    to_camera = BEFORE.world_to_camera
    before = relief_measurement(SimulatedRelief(), BEFORE, 1, to_camera)
    after = relief_measurement(SimulatedRelief(flake={FLAKED: 1e-4}), AFTER, 2, AFTER.world_to_camera)
    change = hg.change(before, after)
    assert change["shape"].unit == "px" and "pixels" in change.assumptions[-1]
    (region,) = [one for one in change.regions if one.quantity == "shape" and one.number == 1]
    pitch = 1000.0 * change.before.pitch  # mm
    # splines swing beyond a step by a tenth of it
    assert -0.12 < region.most * pitch < -0.07 and region.area_unit == "px²"


@pytest.mark.nightly
def test_known_spectra_are_compared_under_any_lamp():
    """Through another camera and under another lamp the same paint has other channels, and the same colour."""
    change = hg.change(*_seen_by_two_cameras(), lamps=("D65", "A"))
    assert set(change["colour"].value) == {"D65", "A"} and "differ" in change.assumptions[0]
    assert not change.regions and not [one for one in change.common if one.significant]


def _seen_by_two_cameras():
    """Greys of spectra that are flat, so that no metamerism is between the cameras."""
    measurements = []
    for name, lamp, seed in (("canon_eos_300d", "D65", 1), ("Nikon 5100 (NPL)", "A", 2)):
        made = relief_measurement(SimulatedRelief(), BEFORE if seed == 1 else AFTER, seed)
        assert made.body is not None and made.photographed is not None
        response, spectrum = hg.Response.load(name), hg.Spectrum.named(lamp)
        grey = np.repeat(np.asarray(made.body.value, np.float64)[..., 1:2], 3, axis=2)  # of each channel's white
        camera = replace(made.photographed.camera, response=response)
        lamps = tuple(replace(one, spectrum=spectrum) for one in made.photographed.lamps)
        made = replace(made, body=replace(made.body, value=grey, error=0.006 * grey))
        measurements.append(replace(made, photographed=Photographed(camera, lamps)))
    return measurements


def _measured(capture):
    """Without its warnings: a broad highlight looks to the check of linearity like a curve of the values."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return hg.measure(capture)


@pytest.mark.nightly
def test_what_measure_gives_of_two_dates():
    """From photographs, with other lamps, another camera, other noise: nothing; then a faded spot and a flake."""
    before = _measured(relief_capture(SimulatedRelief(), relief_camera(), dome(), 1, gloss=False))
    camera, lamps = relief_camera(eye=(0.03, -0.02, 0.42), roll=12.0, target=(0.001, 0.0005, 0.0)), dome(14, 9.0)
    same = hg.change(before, _measured(relief_capture(SimulatedRelief(), camera, lamps, 2, gloss=False)))
    assert not same.regions
    relief = SimulatedRelief(fade={FADED: (1.042, 1.042, 1.042)}, flake={FLAKED: 1e-4})
    change = hg.change(before, _measured(relief_capture(relief, camera, lamps, 3, gloss=False)))
    reach = WIDTHS[-1] * change.before.pitch
    right = {disc: _inside(change, "colour", (*disc[:2], disc[2] + reach))[0] for disc in (FADED, FLAKED)}
    assert sum(right.values()) > 0.95 and right[FADED] > 0.7  # pixels at the edge of a flake mix slopes: colours err
    assert _inside(change, "shape", (*FLAKED[:2], FLAKED[2] + reach))[0] > 0.95
    for quantity, disc in (("colour", FADED), ("shape", FLAKED)):
        assert _inside(change, quantity, (*disc[:2], disc[2] - change.before.pitch))[1] > 0.9
    assert min(one.most for one in change.regions if one.quantity == "shape") < -80.0


@pytest.mark.nightly
def test_a_polished_spot_of_a_patina_is_found_from_photographs():
    before = _measured(relief_capture(SimulatedRelief(patina=0.4), relief_camera(), dome(), 1))
    camera, lamps = relief_camera(eye=(0.03, -0.02, 0.42), roll=12.0, target=(0.001, 0.0005, 0.0)), dome(14, 9.0)
    after = _measured(relief_capture(SimulatedRelief(patina=0.4, polish={POLISHED: 2.0}), camera, lamps, 5))
    change = hg.change(before, after)
    pitch = change.before.pitch
    assert _inside(change, "gloss", (*POLISHED[:2], POLISHED[2] + WIDTHS[-1] * pitch))[0] > 0.95
    assert _inside(change, "gloss", (*POLISHED[:2], POLISHED[2] - pitch))[1] > 0.9
