"""Studies are written as a stranger would write them: from `import hagoromo as hg`."""

import ast
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from studies.command import command
from studies.relit_limits import COLUMNS, page
from studies.uw_psm import shrunk

STUDIES = Path(__file__).parents[2] / "studies"
FILES = [path.relative_to(STUDIES).as_posix() for path in sorted(STUDIES.rglob("*.py"))]
INSIDE = {  # modules of the package that a study takes apart, and why no public name serves it
    # a mend with few of the walks of one picture, many times over
    "few_walks.py": {"image.full.mend", "image.full.picture", "image.full.walks", "image.prepared.prepared_scene"},
    # the models that the fits minimise, to predict readings from parameters that no fit has found
    "merl.py": {
        "app.shared_options",
        "measurement.material.material_objective",
        "measurement.material.lack_of_fit",
        "measurement.material.model_choice",
        "measurement.parameters",
        "cluster.cluster",
        # work that is interrupted and goes on
        "files.cache",
        "files.resumable",
    },
    "encoding.py": {"measurement.normals.normals", "measurement.normals.photometric_model"},
    # the fit step by step, each with what is left out of the others
    "highlights.py": {
        "measurement.normals.normals",
        "measurement.normals.photometric_model",
        "measurement.normals.shading",
    },
    "leave_one_out.py": {"measurement.normals.normals"},
    "predicted_photograph.py": {"measurement.normals.photometric_model"},
    # frames beside each other, as sheets of films have them
    "closely.py": {"image.film.film"},
    # exact shapes by signed distances, and light by the law itself, sphere-traced on the device
    "recover_scenes.py": {"backend", "matter", "reflectance.torrance_sparrow"},
    "recovery.py": {"backend"},
    "recovery_scores.py": {
        "backend",
        "image.relight.stage",
        "hagoromo_recovery.field.distance_field",
        "hagoromo_recovery.export",
        "hagoromo_recovery.field.near_surface",
    },
    # β and γ that differ from place to place
    "gloss_recovery.py": {"backend", "hagoromo_recovery.choices"},
    # the surface that stands for a box whose fibres are known
    "fuzzy_recovery.py": {
        "backend",
        "camera.response",
        "image.relight.stage",
        "hagoromo_recovery.choices",
        "hagoromo_recovery.fuzzy_shape",
        "hagoromo_recovery.outline.lattice",
        "hagoromo_recovery.shading.shading",
    },
    # meshes in Mitsuba's own path tracer
    "path_scenes.py": {"backend"},
    # processor seconds of workers, and of the client beside them
    "recovery_workers.py": {"cluster", "cluster.cluster"},
    # matter with fields of its own, and a box of fibres without its recipe's floor
    "fuzzy_scenes.py": {
        "backend",
        "image.relight.stage",
        "matter",
        "reflectance.spectra.body_basis",
        "volume.box_header",
        "volume.store.plan",
    },
    # a pattern on a table, at any point in space, and JPEG files as cameras write them
    "all_around.py": {"backend", "light.colour", "matter"},
    # forms at any point in space, masks that are some pixels off, and files of 8 and 16 bits
    "strange_captures.py": {"files.png", "matter", "hagoromo_recovery.outline.hull"},
    "recover_strangers.py": {"backend"},
    # forms and colours at any point in space, and pictures of what was found
    "drawn_objects.py": {"matter"},
    "recover_random.py": {"backend", "files.png"},
    # shapes at any point in space
    "recovery_materials.py": {"backend", "matter"},
    # photographs beside cameras of another program, read as sRGB, and their masks
    "real_captures.py": {"files.png", "photograph.gather"},
    # the materials of normals that were solved before, many times over
    "object_study.py": {"measurement.normals.gloss_estimate"},
    # stages of one calibration, each judged by itself
    "lamps.py": {
        "calibration.lamps",
        "calibration.lamps.outline",
        "calibration.lamps.uncalibrated",
        "calibration.lamps.uncalibrated.calibrate_from_object",
    },
    # what relight learns, part by part, and its yardstick
    "relit_objects.py": {
        "calibration.rig.calibrate_rig",
        "measurement.lamp_departure",
    },
    "relit_limits.py": {"image.relight.learnt", "measurement.normals.normals"},
    # a prior without the camera that is tested
    "response_bench.py": {
        "calibration.response.calibrate_response",
        "calibration.response.curve_prior",
        "calibration.response.curve_process",
        "calibration.response.published_curves",
    },
    "response_faults.py": {"calibration.response.calibrate_response", "calibration.response.chart_falloff"},
    "response_study.py": {"app.shared_options", "calibration.response.calibrate_response", "cluster.cluster"},
    "response_prior.py": {"calibration.response.curve_process"},
    # the spectra that a prior is made of, so that none that is tested is among them
    "spectra_bench.py": {"reflectance.spectra.prior_spectra"},
    "spectra_cases.py": {"reflectance.spectra.prior_spectra", "reflectance.spectra.reflectance_prior"},
    "spectra_report.py": {"reflectance.spectra.prior_spectra", "files.plot"},
    "spectra_rivals.py": {"reflectance.spectra.prior_spectra"},
    # the skins that a tutorial photographs, from the pigments of the recipe
    "skin.py": {"reflectance.pigment"},
    # a camera that stands nowhere yet, which a tutorial's capture finds
    "dome.py": {"camera.camera"},
    # files of the data are checked as the package checks its own
    "merl_truth.py": {"files.record"},
    # the weave that a recipe names, to draw it
    "gallery/gallery_draft.py": {"files.record"},
    # the steps that a tolerance stands for
    "first_order.py": {"transport.frames"},
    # many tasks of one function, here or on workers, with the options of the commands: a study's own need
    "coverage.py": {"app.shared_options", "cluster.cluster"},
    "near_lamps.py": {"app.shared_options", "cluster.cluster"},
    # workers, before and while they work
    "cluster_bench.py": {"cluster.cluster", "image.render_tiles"},
    # and while they walk: when tasks end, and how many walks an error takes
    "cluster_orders.py": {
        *("cluster.cluster", "files.cache", "image.path.picture", "image.render_tiles", "image.scene_on_worker"),
        *("image.path.walk_sums", "image.walk_tiles"),
    },
    # kernels run on Dr.Jit's types of this machine
    "near_rig.py": {"backend"},
    "gallery/gallery_item.py": {"backend"},
    "faulty_balls.py": {"backend"},
    # the parts of a measurement that errors are stated for, without the rest of it
    "errors_of_normals.py": {"measurement.normals.gloss_estimate", "measurement.surface.depth"},
    "forecasts.py": {
        *("image.relight.forecast", "image.relight.learnt", "measurement.lamp_departure"),
        *("measurement.normals.photometric_model", "measurement.surface.depth"),
    },
}

TYPES = "image.scene.modes"  # of choices, for type checkers
OTHERS = ("hagoromo_campaigns", "hagoromo_recovery")


def modules(path: Path) -> set[str]:
    """The modules that a file imports: of the core without its name ("" for the core itself), and of OTHERS."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "hagoromo":
            names |= {f"hagoromo.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    core = {name.partition(".")[2] for name in names if name.split(".")[0] == "hagoromo"}
    return core | {name for name in names if name.split(".")[0] in OTHERS}


@pytest.mark.parametrize("name", FILES)
def test_a_study_imports_public_names_only(name):
    assert modules(STUDIES / name) - {"", TYPES} == INSIDE.get(name, set())


def test_every_exception_is_a_study():
    assert set(INSIDE) <= set(FILES)


def test_photographs_are_averaged_over_squares_that_are_valid_throughout():
    """Of 7 × 5 pixels 3 × 2 squares are left; the variance of a mean is that of a value over their number."""
    camera = hg.Camera(5, 7, (100.0, 100.0), (2.5, 3.5))
    values = np.arange(105, dtype=np.float32).reshape(7, 5, 3)
    mask = np.ones((7, 5), bool)
    mask[0, 3] = False
    photograph = hg.Photograph(
        values, np.full_like(values, 0.4), mask, camera, (hg.Lamp(to_lamp=(0.0, 0.0, 1.0)),), "a"
    )
    (small,) = shrunk(hg.Capture((photograph,), "of one"), 2).photographs
    assert small.mask.tolist() == [[True, False], [True, True], [True, True]]
    np.testing.assert_allclose(small.values[1, 0], values[2:4, :2].mean(axis=(0, 1)), rtol=1e-6)
    np.testing.assert_allclose(small.variance[small.mask], 0.1, rtol=1e-6)
    assert (small.camera.width, small.camera.height, small.camera.focal) == (2, 3, (50.0, 50.0))


def test_the_table_of_limits_has_less_error_than_lambert_in_brackets():
    errors = {key: [0.05, 0.07] for key in COLUMNS} | {"lambert": [0.10, 0.14], "lambert_rig": [0.08, 0.08]}
    row = page({"vase": errors}, 4).splitlines()[-1]
    assert row.split(" | ")[1:3] == ["12.0", "6.0 (+50)"] and "8.0 (+33)" in row and "6.0 (+25)" in row


def test_bad_input_of_a_study_is_one_line_and_status_2(monkeypatch, capsys):
    def study(lamps: int = 6) -> None:
        raise hg.InputError(f"a study of {lamps} lamps needs more of them: give 12")

    monkeypatch.setattr("sys.argv", ["study", "--lamps", "3"])
    with pytest.raises(SystemExit) as ended:
        command(study)
    assert ended.value.code == 2
    assert capsys.readouterr().err == "a study of 3 lamps needs more of them: give 12\n"
