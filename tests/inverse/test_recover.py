"""Recover, on photographs of an exact shape that shares no line with its march."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image.relight.stage import basis_camera
from hagoromo_recovery.descent.lamp_places import LampPlaces
from hagoromo_recovery.errors import errors_of
from hagoromo_recovery.evidence import Evidence
from hagoromo_recovery.export import conserving
from hagoromo_recovery.field.near_surface import NEAR
from hagoromo_recovery.levels import sides_of
from hagoromo_recovery.outline.silhouettes import views_of
from hagoromo_recovery.recover import halves_of
from hagoromo_recovery.recovered import score
from hagoromo_recovery.surface_shape import SurfaceShape
from studies.recover_scenes import Shots, TrueObject, aligned, around, misplaced, misstated, shots, simulated, standing
from studies.recovery import places_off, strengths_off
from studies.recovery_scores import seen_angles

SETTINGS = hg.RecoverySettings(side=32, steps=80, rays=1 << 14, keep=0, errors=False)
VOXEL = 0.0035  # m, about that of this lattice


@pytest.fixture(scope="module")
def taken():
    return simulated(TrueObject(), shots(16, 5, 60, 1, pixels=64), 1)


@pytest.fixture(scope="module")
def aside():
    """Other views, under other lamps: the second half from the side, as no photograph was taken."""
    return simulated(TrueObject(), shots(4, 5, 60, 2, pixels=64), 2), simulated(
        TrueObject(), shots(4, 80, 110, 3, pixels=64), 3
    )


@pytest.fixture(scope="module")
def recovered(taken):
    return hg.recover(taken.capture, SETTINGS)


def mean_psnr(recovered, simulated):
    scores = []
    for photograph, exact in zip(simulated.capture.photographs, simulated.exact, strict=True):
        whole = replace(photograph, values=exact.astype(np.float32), mask=np.ones(exact.shape[:2], bool))
        scores.append(score(whole, photograph.silhouette, recovered.picture(photograph)[0]).psnr)
    return np.mean(scores)


def test_the_background_behind_a_masked_object_does_not_count():
    camera = hg.Camera(13, 11, (20.0, 20.0), (6.5, 5.5))
    silhouette = np.zeros((11, 13), bool)
    silhouette[3:8, 4:9] = True
    light = np.where(silhouette[..., None], 0.5, 0.0) * np.ones(3)
    scores = []
    for behind in (0.0, 0.9):
        values = np.where(silhouette[..., None], 0.52, behind) * np.ones(3, np.float32)
        photograph = hg.Photograph(
            values, np.full((11, 13, 3), 1e-4), silhouette, camera, silhouette=silhouette
        )  # fmt: skip
        scores.append(score(photograph, silhouette, light))
    assert scores[0] == scores[1] and scores[0].inside == pytest.approx(20.0 * np.log10(0.52 / 0.02))
    spilt = score(photograph, silhouette, light + np.where(silhouette[..., None], 0.0, 0.1))
    assert spilt.psnr < scores[0].psnr - 5.0 and spilt.inside == scores[0].inside


def test_new_views_under_new_lamps_are_predicted(recovered, aside):
    """Unscaled, over all pixels."""
    assert mean_psnr(recovered, aside[0]) > 33.0
    assert mean_psnr(recovered, aside[1]) > 31.0


def test_the_surface_and_its_normals_are_the_true_ones(recovered, aside):
    from hagoromo.backend import arrays

    field, jit = recovered.rendering.field, arrays()
    angles, distances = [], []
    for normals, points in zip(aside[0].normals, aside[0].points, strict=True):
        there = np.isfinite(normals[..., 0])
        places = recovered.lattice.from_world(points[there])
        at = jit.Array3f(np.ascontiguousarray(places.T, np.float32))
        slope = np.array(field.axis_at(at)).T
        cosine = np.einsum("ni,ni->n", slope / np.linalg.norm(slope, axis=1, keepdims=True), normals[there])
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
        distances.append(np.abs(np.array(field.value_at(at))))
    assert np.median(np.concatenate(angles)) < 2.5  # degrees
    assert np.concatenate(distances).mean() < 0.35  # voxel
    assert np.median(seen_angles(recovered, aside[0])) < 2.5  # degrees


def test_the_true_gloss_conserves_energy():
    truth, brightest = TrueObject(), 0.6
    hg.Reflectance(1.0 / np.pi, truth.beta, truth.gamma, truth.n, body_colour=hg.Spectrum.constant(brightest))


def test_the_gloss_is_the_true_one(recovered):
    """β F₀, which light determines; γ; and n, which these lamps do not, stays near what is usual."""
    strength = recovered.beta * ((recovered.n - 1.0) / (recovered.n + 1.0)) ** 2
    assert strength == pytest.approx(2.2 * 0.04, rel=0.35)
    assert recovered.gamma == pytest.approx(0.1, rel=0.12)
    material = recovered.record()["material"]
    assert material["interval_95"]["gamma"][0] < material["gamma"] < material["interval_95"]["gamma"][1]
    assert not material["identifiable"]["n"]


def test_its_box_shows_through_render_what_it_shows_itself(recovered, aside):
    response = basis_camera()
    box, (_, dim) = recovered.box(128), conserving(recovered)
    photograph = aside[0].capture.photographs[1]
    camera = replace(photograph.camera, response=response, sensor=None)
    lamps = tuple(replace(lamp, intensity=lamp.intensity / dim) for lamp in photograph.lamps)
    image = hg.render(hg.Scene(camera, lamps, boxes=(box,)), hg.Settings(samples=4)).expose(response)
    own, _ = recovered.picture(photograph)
    error = np.mean((image - own) ** 2)
    assert 10.0 * np.log10(own.max() ** 2 / error) > 36.0


def test_the_mesh_is_closed_and_looks_outwards(recovered, tmp_path):
    import trimesh

    mesh = recovered.mesh()
    mesh.save(tmp_path / "mesh.ply")
    read = trimesh.load_mesh(tmp_path / "mesh.ply")
    assert read.is_watertight and read.volume > 0.0
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    assert np.linalg.norm(mesh.vertices, axis=1).max() < 0.06  # m


def test_places_that_photographs_show_are_counted(recovered):
    near = np.abs(recovered.distance) < 0.5
    assert (recovered.evidence.photographs[near] > 0).mean() > 0.8
    assert recovered.evidence.photographs[recovered.distance > 4.0].sum() == 0


@pytest.mark.nightly
def test_without_lamps_colours_are_the_light_that_is_sent_out(taken):
    """Fixed light that nobody knows: the light of the object is then its colour, and the result says so."""
    dark = hg.Capture(tuple(replace(p, lamps=()) for p in taken.capture.photographs), "unlit")
    found = hg.recover(dark, replace(SETTINGS, side=16, steps=10))
    assert not found.lit and "unknown" in found.record()["lamps"]
    assert found.box(40).materials[0].beta == 0.0


@pytest.mark.nightly
def test_one_seed_gives_the_same_bits_whatever_the_cores():
    """Gradients are summed in whole numbers, so it does not matter which core adds first."""
    capture = simulated(TrueObject(), shots(6, 5, 60, 1, pixels=32), 1).capture
    cores = dr.thread_count()
    found = []
    for count in (cores, cores, 1):
        dr.set_thread_count(count)
        found.append(hg.recover(capture, hg.RecoverySettings(side=16, steps=6, rays=1 << 12, keep=0, errors=False)))
    dr.set_thread_count(cores)
    for other in found[1:]:
        assert np.array_equal(found[0].distance, other.distance)
        assert np.array_equal(found[0].colours, other.colours)
        assert np.array_equal(found[0].gloss, other.gloss)


@pytest.mark.nightly
def test_errors_of_places_are_about_those_that_there_are(taken, aside):
    """The arms are 3.6 voxels thick, and not found thinner; every pixel that shows one smooth part has an error."""
    found = hg.recover(taken.capture, replace(SETTINGS, steps=30, errors=True))
    errors, near = found.errors, np.abs(found.distance) < NEAR
    assert errors is not None
    assert np.isfinite(errors.position[near]).all() and np.isnan(errors.position[~near]).all()
    angles, stated = [], []
    for photograph, normals in zip(aside[0].capture.photographs, aside[0].normals, strict=True):
        own, opacity = found.normals(photograph)
        there = np.isfinite(normals[..., 0]) & (opacity > 0.9)
        angles.append(np.arccos(np.clip((own * normals)[there].sum(axis=1), -1.0, 1.0)))
        stated.append(errors.normal.ravel()[found.places(photograph)[0][there]])
        whole = np.isfinite(stated[-1])  # but for pixels that show two parts, one behind the other
        assert whole.mean() > 0.99 and whole[~edges(normals)[there]].all()
    ratio = np.sqrt(np.mean(np.concatenate(angles) ** 2) / np.nanmean(np.concatenate(stated) ** 2))
    assert 0.4 < ratio < 2.0
    record = found.record()["errors"]
    assert record["position_m"][0] < record["position_m"][1] < VOXEL and record["never_shown"] < 0.2
    low, high = found.record()["material"]["interval_95"]["gamma"]
    assert low < 0.1 < high  # Truth().gamma


def edges(normals):
    """Where true normals (h, w, 3) turn by more than 45° to one of the eight pixels around, or there is none."""
    around = [np.roll(normals, (down, right), (0, 1)) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    return ~np.all([(each * normals).sum(axis=-1) > np.sqrt(0.5) for each in around], axis=0)


def test_levels_halve_the_voxel_once_at_least():
    """Where sixteen nodes are left: what the last halving changed is an error of the lattice."""
    assert [sides_of(n) for n in (30, 31, 48, 64, 128)] == [[30], [16, 31], [24, 48], [32, 64], [32, 64, 128]]


def test_halves_of_the_photographs_widen_the_gloss():
    """Half of what they differ by is a standard error of the mean of both; the others stay as they were."""
    known = Evidence(np.diag([0.04, 0.01, 0.09]), np.zeros((1, 1, 1), np.int32))
    widened = known.with_halves(np.log([2.0, 0.1, 0.5]), np.log([2.0, 0.1 * np.exp(0.4), 0.5]))
    np.testing.assert_allclose(widened.covariance, np.diag([0.04, 0.01 + 0.2**2, 0.09]))


def test_a_mesh_file_holds_the_errors_of_its_vertices(recovered, tmp_path):
    import trimesh

    mesh = recovered.mesh()
    assert np.isnan(mesh.position_errors).all()  # not asked for
    mesh.save(tmp_path / "a.ply")
    read = trimesh.load(tmp_path / "a.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(read["photographs"].ravel(), mesh.photographs) and mesh.photographs.max() > 3
    assert "position_error" in read.dtype.names and "normal_error" in read.dtype.names


@pytest.mark.nightly
def test_an_interrupt_gives_what_there_is(taken):
    def stop(share, step=""):
        if share > 0.3:
            raise KeyboardInterrupt

    found = hg.recover(taken.capture, replace(SETTINGS, steps=10), stop)
    assert not found.complete and found.evidence is None and not found.record()["complete"]
    assert (found.distance < 0.0).any()


@pytest.mark.by_night("0.75-False")
@pytest.mark.by_night("0.45-True", "0.8-True")
@pytest.mark.parametrize(("at", "lamps"), [(0.45, True), (0.8, True), (0.75, False)])
def test_work_that_goes_on_ends_with_the_same_bits(taken, tmp_path, at, lamps):
    """Interrupted in a level, in a half for the errors, and under unknown light; what is refined goes on, too."""
    capture = taken.capture if lamps else hg.Capture(tuple(replace(p, lamps=()) for p in taken.capture.photographs))
    settings = hg.RecoverySettings(
        side=18, steps=42, rays=1 << 10, keep=0, errors=lamps, light="auto" if lamps else "camera",
        refine="cameras,lamps,exposure,places" if lamps else "turn",
    )  # fmt: skip

    def stop(share, step=""):
        if share > at:
            raise KeyboardInterrupt

    work = tmp_path / "work.npz"
    part = hg.recover(capture, settings, stop, work)
    assert not part.complete and work.exists()
    resumed, whole = hg.recover(capture, settings, work=work), hg.recover(capture, settings)
    assert resumed.complete and not work.exists()
    for name in ("distance", "colours", "gloss"):
        assert np.array_equal(getattr(resumed, name), getattr(whole, name))
    assert resumed.evidence is not None and whole.evidence is not None
    assert np.array_equal(resumed.evidence.covariance, whole.evidence.covariance)
    if lamps:
        assert resumed.errors is not None and whole.errors is not None
        assert np.array_equal(resumed.errors.position, whole.errors.position, equal_nan=True)


@pytest.mark.nightly
def test_work_on_other_photographs_is_refused(taken, tmp_path):
    def stop(share, step=""):
        if share > 0.8:
            raise KeyboardInterrupt

    settings = hg.RecoverySettings(side=16, steps=40, rays=1 << 10, keep=0, errors=False)
    hg.recover(taken.capture, settings, stop, tmp_path / "work.npz")
    with pytest.raises(hg.InputError, match="other photographs or with other settings"):
        hg.recover(taken.capture, replace(settings, seed=1), work=tmp_path / "work.npz")


def with_lamps(photographs, some):
    return [p if k in some else replace(p, lamps=()) for k, p in enumerate(photographs)]


def moved(photographs, number):
    """One photograph whose pose is in other units."""
    pose = photographs[number].camera.world_to_camera.copy()
    pose[:3, 3] *= 1000.0
    pose[0, 3] += 300.0
    away = replace(photographs[number], camera=photographs[number].camera.with_pose(pose), name="the odd one")
    return [away if k == number else p for k, p in enumerate(photographs)]


def lit_by(photographs, lamp):
    return [replace(p, lamps=(lamp,)) for p in photographs]


def cut(photograph):
    """The upper half of it."""
    half = photograph.values.shape[0] // 2
    camera = photograph.camera.resampled(photograph.camera.width, half, (1.0, 1.0))
    parts = {key: getattr(photograph, key)[:half] for key in ("values", "variance", "mask", "silhouette")}
    return replace(photograph, camera=camera, **parts)


BAD = {
    "stands in the object": lambda p: lit_by(p, hg.Lamp(position=(0.0, 0.0, 0.0))),
    "lamps stand in one direction": lambda p: lit_by(p, hg.Lamp(to_lamp=(0.0, -1.0, 0.3))),
    "cut the object at their edge": lambda p: [cut(each) for each in p],
    "has 2 view": lambda p: p[:2],
    "have no lamp": lambda p: with_lamps(p, {0, 1, 2}),
    "only darkness": lambda p: [replace(each, values=0.0 * each.values) for each in p],
    "the odd one disagree": lambda p: moved(p, 4),
    "the mask of photograph 'view 2' is empty": lambda p: [
        replace(each, silhouette=each.silhouette & (k != 2)) for k, each in enumerate(p)
    ],
    "is not dark: give masks": lambda p: [
        replace(each, silhouette=None, values=1.0 + each.values, mask=np.ones_like(each.mask)) for each in p
    ],
    "have 2 channels": lambda p: [
        replace(each, values=each.values[..., :2], variance=each.variance[..., :2]) for each in p
    ],
}


@pytest.mark.parametrize("said", BAD)
def test_bad_photographs_end_in_one_line(taken, said):
    photographs = BAD[said](list(taken.capture.photographs))
    with pytest.raises(hg.InputError, match=said) as error:
        hg.recover(hg.Capture(tuple(photographs), "bad"), SETTINGS)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("key", "value"), [("side", 8), ("side", 4096), ("steps", 0), ("keep", 1), ("rays", 1)])
def test_bad_settings_end_in_one_line(key, value):
    with pytest.raises(hg.InputError, match=f"{key} is {value}"):
        hg.RecoverySettings(**{key: value})


def test_silhouettes_survive_a_file(taken, tmp_path):
    """Pixels that are clipped are no hole of the silhouette."""
    taken.capture.save(tmp_path / "capture")
    read = hg.load_capture(tmp_path / "capture")
    for one, other in zip(read.photographs, taken.capture.photographs, strict=True):
        assert one.silhouette is not None and other.silhouette is not None
        assert np.array_equal(one.silhouette, other.silhouette) and np.array_equal(one.mask, other.mask)


@pytest.mark.nightly
def test_strengths_that_are_wrong_are_refined_and_their_mean_stays(taken):
    wrong = misstated(taken, 0.0, 0.15, 1)
    found = hg.recover(wrong.capture, replace(SETTINGS, side=24, refine="lamps"))
    assert strengths_off(found.photographs, taken) < 0.5 * strengths_off(wrong.capture.photographs, taken)
    assert found.look.strengths is not None
    assert np.mean(found.look.strengths.values) == pytest.approx(0.0, abs=1e-9)
    assert found.record()["strengths"].startswith("each lamp brighter or darker by")


@pytest.mark.nightly
def test_poses_and_strengths_that_are_wrong_are_refined(aside):
    """Half a pixel and 3 %: new views, aligned as nothing else can be known, within 1 dB of exact statements."""
    exact = simulated(TrueObject(), shots(12, 5, 60, 1, lamps=6), 1)
    wrong = misstated(exact, 0.5, 0.03, 1)
    found = hg.recover(wrong.capture, replace(SETTINGS, steps=200, refine="cameras,lamps"))
    assert strengths_off(found.photographs, exact) < 0.5 * strengths_off(wrong.capture.photographs, exact)
    own = aligned(aside[0], wrong.cameras, [p.camera for p in found.photographs])
    assert mean_psnr(found, own) > mean_psnr(hg.recover(exact.capture, replace(SETTINGS, steps=200)), aside[0]) - 1.0
    assert found.record()["cameras"].startswith("each turned")


@pytest.mark.nightly
def test_lamps_that_stand_elsewhere_are_found(aside):
    """Eight lamps around the object, each 2 % of its distance wrong in each axis: the error falls by a third or more,
    and new views are predicted better.
    """
    exact = simulated(TrueObject(), standing(12, 8, 64), 1)
    wrong, settings = misplaced(exact, 0.02, 1).capture, replace(SETTINGS, steps=120)
    found = hg.recover(wrong, replace(settings, refine="places"))
    assert places_off(found.photographs, exact) < 0.67 * places_off(wrong.photographs, exact)
    stated = hg.recover(wrong, settings)
    assert mean_psnr(found, aside[0]) > mean_psnr(stated, aside[0]) + 0.2
    assert found.record()["lamp_places"].startswith("each lamp shifted by")
    assert found.look.places is not None and len(found.look.places.names) == 8


@pytest.mark.nightly
def test_a_flash_that_moves_with_the_camera_has_one_shift():
    """Beside the lens by 3 cm, stated 1.5 cm from there: sideways and upwards it is found to a third of that."""
    from studies.recover_scenes import DISTANCE

    def beside(view):
        side = np.cross(view, [0.0, 0.0, 1.0])
        return (DISTANCE * view + 0.03 * side / np.linalg.norm(side))[None]

    views, off = around(12, turn=0.7), np.array([0.012, -0.009, 0.0])  # right and up
    photographs = simulated(TrueObject(), Shots(views, [beside(view) for view in views], 64), 1).capture.photographs
    wrong = [replace(p, lamps=(p.lamps[0].shifted(p.camera.world_to_camera[:3, :3].T @ off),)) for p in photographs]
    found = hg.recover(hg.Capture(tuple(wrong), "wrong"), replace(SETTINGS, steps=120, refine="places"))
    assert found.look.places is not None and found.look.places.riding == [True]
    assert np.linalg.norm((found.look.places.values[0] + off)[:2]) < 0.33 * np.linalg.norm(off)


def test_a_far_lamp_is_turned_and_a_photograph_without_a_known_shift_stays(taken):
    """The shift of a far lamp is one of its direction."""
    far = tuple(replace(p, lamps=(hg.Lamp(to_lamp=(0, 0, 1)),)) for p in taken.capture.photographs[:2])
    places = LampPlaces(far, {})
    places.values[0] = 0.1, 0.0, 0.0
    turned = np.asarray(places.of(far[0]).lamps[0].to_lamp)
    assert np.tan(np.arccos(turned[2])) == pytest.approx(0.1)
    assert str(places) == "each lamp turned by 5.7° (rms), 5.73 at most"
    near = taken.capture.photographs[0]
    assert np.array_equal(np.asarray(places.of(near).lamps[0].position), np.asarray(near.lamps[0].position))


def test_what_cannot_be_refined_is_one_line(taken):
    with pytest.raises(hg.InputError, match="refine is 'lamp': give auto, none, or a list of turn, cameras, lamps"):
        hg.RecoverySettings(refine="lamp")
    unlit = tuple(replace(p, lamps=()) for p in taken.capture.photographs)
    with pytest.raises(hg.InputError, match="no photograph has a lamp that could be refined"):
        hg.recover(hg.Capture(unlit, "unlit"), replace(SETTINGS, refine="turn,exposure"))


@pytest.mark.nightly
def test_the_mean_factor_by_which_lamps_stand_farther_stays_as_stated(taken):
    """Eight lamps that stand still: whatever pixels say, the mean of shifts outwards over distances is 0."""
    capture = simulated(TrueObject(), standing(6, 8, 32), 1).capture
    found = hg.recover(capture, replace(SETTINGS, side=16, steps=8, refine="places"))
    assert found.look.places is not None
    places = {tuple(p.lamps[0].place): p.lamps[0].place for p in capture.photographs}
    shifted = {
        tuple(p.lamps[0].place): q.lamps[0].place for p, q in zip(capture.photographs, found.photographs, strict=True)
    }
    middle = found.lattice.middle
    outwards = [
        (shifted[key] - place) @ (place - middle) / np.sum((place - middle) ** 2) for key, place in places.items()
    ]
    assert np.abs(outwards).max() > 1e-5
    assert np.mean(outwards) == pytest.approx(0.0, abs=2e-4)  # of another lattice, whose middle is elsewhere


def test_photographs_from_one_pose_are_in_one_half(taken):
    """Of 12 poses with two lamps each; with fewer poses every second photograph is."""
    views = views_of(simulated(TrueObject(flat=True), shots(12, 5, 60, 1, pixels=8, lamps=2), 1).capture.photographs)
    poses = [{v.photograph.camera.world_to_camera.tobytes() for v in half} for half in halves_of(views)]
    assert not poses[0] & poses[1] and [len(each) for each in poses] == [6, 6]
    few = halves_of(views[:22])
    assert {v.photograph.name for v in few[0]} == {v.photograph.name for v in views[:22:2]}


def test_fuzzy_errors_hold_what_the_last_halving_changed(recovered):
    """Of normals and body colours, too; those of a surface do not, and neither do errors without a coarser level."""
    found = SurfaceShape(recovered.lattice, recovered.distance, recovered.colours, recovered.gloss)
    before = replace(found, colours=found.colours + np.float32(0.03))
    surface, fuzzy, single = (
        errors_of(found, [found, found], *how) for how in ((before, False), (before, True), (None, True))
    )
    near = np.isfinite(fuzzy.colour)
    assert np.allclose(fuzzy.colour[near], 0.03, atol=1e-5) and np.allclose(surface.colour[near], 0.0, atol=1e-6)
    assert fuzzy.of_lattice and not single.of_lattice
