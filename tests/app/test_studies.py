"""Studies are written as a stranger would write them: from `import hagoromo as hg`."""

import ast
from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[2] / "studies"
FILES = [path.relative_to(STUDIES).as_posix() for path in sorted(STUDIES.rglob("*.py"))]
INSIDE = {  # modules of the package that a study takes apart, and why no public name serves it
    # the models that the fits minimise, to predict readings from parameters that no fit has found
    "merl.py": {
        "measurement.material.material_objective",
        "measurement.material.lack_of_fit",
        "measurement.material.model_choice",
        "measurement.parameters",
        "cluster.mapped",
    },
    "encoding.py": {"measurement.normals.normals", "measurement.normals.photometric_model"},
    "leave_one_out.py": {"measurement.normals.normals"},
    "predicted_photograph.py": {"measurement.normals.photometric_model"},
    # the materials of normals that were solved before, many times over
    "object_study.py": {"measurement.normals.gloss_estimate"},
    # stages of one calibration, each judged by itself
    "lamps.py": {
        "calibration.lamps",
        "calibration.lamps.outline",
        "calibration.lamps.uncalibrated",
        "calibration.lamps.uncalibrated.refined",
    },
    # a prior without the camera that is tested
    "response_study.py": {
        "calibration.response.calibrate_response",
        "calibration.response.curve_prior",
        "calibration.response.curve_process",
        "calibration.response.published_curves",
        "cluster.mapped",
    },
    "response_prior.py": {"calibration.response.curve_process"},
    # the spectra that a prior is made of, so that none that is tested is among them
    "spectra_bench.py": {"reflectance.spectra.prior_spectra"},
    "spectra_cases.py": {"reflectance.spectra.prior_spectra", "reflectance.spectra.reflectance_prior"},
    "spectra_report.py": {"reflectance.spectra.prior_spectra"},
    "spectra_rivals.py": {"reflectance.spectra.prior_spectra"},
    # the skins that a tutorial photographs, from the pigments of the recipe
    "skin.py": {"reflectance.pigment"},
    # a camera that stands nowhere yet, which a tutorial's capture finds
    "dome.py": {"camera.unplaced"},
    # files of the data are checked as the package checks its own
    "merl_truth.py": {"files.record"},
    # the steps that a tolerance stands for
    "first_order.py": {"transport.frames"},
    # many tasks of one function, here or on workers: a study's own need
    "coverage.py": {"cluster.mapped"},
    "near_lamps.py": {"cluster.mapped"},
    # workers, before and while they work
    "cluster_bench.py": {"cluster.cluster", "image.render_tiles"},
    # kernels run on Dr.Jit's types of this machine
    "near_rig.py": {"backend"},
    "gallery/gallery_item.py": {"backend"},
}


def modules(path: Path) -> set[str]:
    """The modules of `hagoromo` that a file imports, without the package's name; "" for the package itself."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "hagoromo":
            names |= {f"hagoromo.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return {name.partition(".")[2] for name in names if name.split(".")[0] == "hagoromo"}


@pytest.mark.parametrize("name", FILES)
def test_a_study_imports_public_names_only(name):
    assert modules(STUDIES / name) - {""} == INSIDE.get(name, set())


def test_every_exception_is_a_study():
    assert set(INSIDE) <= set(FILES)
