"""Structure from motion by COLMAP (Schönberger and Frahm 2016): grey pictures of many views → cameras and points.

COLMAP reads only pictures that we wrote. Features and matches lie in a database in the work folder, one picture after
the other, so work that was cut off goes on there; the search for cameras begins anew. All that chance decides is fixed
by the seed, and matching and bundle adjustment keep to one thread, whose sums have one order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.views.structure import Sightings, Structure
from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import pose_of
from hagoromo.errors import InputError
from hagoromo.files.picture import picture_size
from hagoromo.files.png import write_png
from hagoromo.files.reading import library
from hagoromo.progress import Progress, part_of

LEAST_VIEWS = 3
LENSES = {0: "SIMPLE_PINHOLE", 1: "SIMPLE_RADIAL", 2: "RADIAL"}  # fitted coefficients of distortion → COLMAP's model
FOCAL_GUESS = 1.2  # focal length over the longer side where the photographs do not state it, COLMAP's own
FAINTEST, FAINTEST_IF_THOROUGH = 0.004, 0.002  # contrast of a feature; COLMAP's own is 0.0067
MOST_FEATURES = 4096  # of a picture, the coarsest first
SMALL_MODEL = 10  # cameras; fewer are given up for another start, if there are twice as many photographs
ALL_PAIRS = 120  # photographs up to which all pairs are matched
NEIGHBOURS = 40  # of more, each is matched with so many that follow it by name, around the end
BEGIN = 0.05  # of the progress at which the pictures are written
SHARES = (0.4, 0.85)  # of the progress at which features and matches are done
FEATURES = "features.db"
ADVICE = (
    "take them 5 to 15° apart, sharp, of an object with details; try thorough (--thorough); with an object on a "
    "turntable, add turntable (--turntable) and masks"
)
Pictures = Callable[[int], tuple[NDArray[np.uint8], NDArray[np.bool_] | None]]


@dataclass(frozen=True)
class ViewsSettings:
    """How cameras are found.

    turntable: the object turned before a camera that stood still, so only points on its mask are used. coefficients:
    of radial distortion that are fitted, 0 to 2 (k1, k2). thorough: fainter points are taken, too, and compared as they
    look from other sides (affine shape, many scales, matches guided by the first ones): some five times the work, for
    smooth matter such as plaster. largest: longer side of the pictures in which points are sought [px]. seed: of all
    that chance decides.
    """

    turntable: bool = False
    coefficients: Literal[0, 1, 2] = 1
    thorough: bool = False
    largest: int = 1600
    seed: int = 0

    def __post_init__(self) -> None:
        """Check every figure once."""
        if self.coefficients not in LENSES:
            raise InputError(f"coefficients is {self.coefficients}: of photographs of many views, 0, 1 or 2 are fitted")
        if self.largest < 100:
            raise InputError(f"largest is {self.largest} px: give 100 or more")


@dataclass(frozen=True, eq=False)
class StatedLens:
    """What is known of the lens before. size: (width, height) [px]. focal: as a file states it [px].

    camera: calibrated; it is then kept as it is.
    """

    size: tuple[int, int]
    focal: float | None = None
    camera: Camera | None = None

    def model(self, size: tuple[int, int], coefficients: int) -> tuple[str, list[float]]:
        """COLMAP's name and parameters of it, in pictures of `size` (width, height); of no parameters: all guessed."""
        across, down = size[0] / self.size[0], size[1] / self.size[1]
        if self.camera is not None:
            (fx, fy), (cx, cy), k = self.camera.focal, self.camera.principal, self.camera.distortion
            return "FULL_OPENCV", [fx * across, fy * down, cx * across, cy * down, *k]
        if self.focal is None:
            return LENSES[coefficients], []
        return LENSES[coefficients], [self.focal * across, size[0] / 2, size[1] / 2, *([0.0] * coefficients)]


def colmap() -> Any:
    """The package pycolmap, which then says nothing; `InputError` where it is not installed."""
    package = library("pycolmap")
    package.logging.minloglevel = package.logging.FATAL.value
    return package


def reconstruct(
    pictures: Pictures,
    photographs: Sequence[str],
    lens: StatedLens,
    settings: ViewsSettings,
    work: Path,
    progress: Progress,
) -> None:
    """Write COLMAP's model of the photographs into the folder `work`; what an earlier run left there is continued.

    pictures: number of the photograph → grey picture, and where points may be sought. `InputError` where no two
    photographs share enough points, or fewer than three can be placed.
    """
    search = _Search(colmap(), work, {_name(number): name for number, name in enumerate(photographs)}, lens, settings)
    first, second = SHARES
    search.write_pictures(pictures, part_of(progress, 0.0, BEGIN, "pictures"))
    search.find_features(part_of(progress, BEGIN, first - BEGIN, "features"))
    search.match(part_of(progress, first, second - first, "matches"))
    search.place(part_of(progress, second, 1.0 - second, "cameras")).write_binary(work)
    for left in (*(work / "pictures").iterdir(), *(work / "masks").iterdir(), *work.glob(FEATURES + "*")):
        left.unlink()
    (work / "pictures").rmdir()
    (work / "masks").rmdir()


def read_structure(folder: Path, photographs: Sequence[str], lens: StatedLens) -> Structure:
    """The structure of the model in `folder`, in photographs of the lens' size. photographs: names of all of them."""
    model = colmap().Reconstruction(folder)
    numbers = sorted(model.points3D)
    index = {number: k for k, number in enumerate(numbers)}
    points = np.array([model.points3D[number].xyz for number in numbers]).reshape(-1, 3)
    views, sightings = {}, {}
    for image in sorted((one for one in model.images.values() if one.has_pose), key=lambda one: one.name):
        name, camera = photographs[int(Path(image.name).stem)], _camera(image.camera, lens)
        pose = image.cam_from_world()
        views[name] = camera.with_pose(pose_of(pose.rotation.matrix(), pose.translation))
        seen = [one for one in image.points2D if one.has_point3D()]
        at = np.array([one.xy for one in seen]).reshape(-1, 2)
        at *= np.array(lens.size) / (image.camera.width, image.camera.height)
        sightings[name] = Sightings(np.array([index[one.point3D_id] for one in seen], np.int64), at)
    why = "it shares too few points with the others; thorough (--thorough) finds more"
    found = Structure(views, points, sightings, {name: why for name in photographs if name not in views})
    known = lens.camera is not None
    return found if known else replace(found, lens_error=_lens_error(model, lens, found.rms_of_all))


def _lens_error(model: Any, lens: StatedLens, rms: float) -> dict[str, float]:
    """Standard errors of focal length [px] and distortion, whatever the poses and points are; none where they fail.

    rms: of the length of the residuals [px]; COLMAP's own errors are those of residuals of 1 px a direction.
    """
    package, config = colmap(), colmap().BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        config.add_image(number)
    config.fix_gauge(package.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = package.BundleAdjustmentOptions()
    options.print_summary = False
    adjuster = package.create_default_ceres_bundle_adjuster(options, config, model)
    found = package.estimate_ba_covariance(package.BACovarianceOptions(), model, adjuster)
    camera = next(iter(model.cameras.values()))
    across = lens.size[0] / camera.width
    covariance = None if found is None else found.get_other_params_cov(camera.params)
    if covariance is None:
        return {}
    errors = np.sqrt(np.diag(covariance)) * rms / across / np.sqrt(2.0)
    terms = [float(error) for error in errors[len(errors) - len(camera.extra_params_idxs()) :]]
    return {"fl_x": float(errors[0]) * across, **{f"k{n + 1}": error for n, error in enumerate(terms)}}


def _name(number: int) -> str:
    return f"{number:06d}.png"


@dataclass(frozen=True, eq=False)
class _Search:
    """One search for cameras. names: file of the picture → name of the photograph."""

    package: Any
    work: Path
    names: Mapping[str, str]
    lens: StatedLens
    settings: ViewsSettings

    @property
    def base(self) -> Path:
        """The database."""
        return self.work / FEATURES

    def write_pictures(self, pictures: Pictures, progress: Progress) -> None:
        """Write the pictures and masks that are not there yet."""
        for folder in ("pictures", "masks"):
            (self.work / folder).mkdir(exist_ok=True)
        for number, (name, photograph) in enumerate(self.names.items()):
            progress(number / len(self.names), photograph)
            if not (self.work / "pictures" / name).exists():
                grey, allowed = pictures(number)
                if allowed is not None:
                    write_png(self.work / "masks" / f"{name}.png", allowed.astype(np.uint8) * 255)
                write_png(self.work / "pictures" / name, grey)

    def find_features(self, progress: Progress) -> None:
        """Find the features of the pictures that have none yet."""
        package, home = self.package, self.work / "pictures"
        height, width = picture_size(home / _name(0))
        reader, extraction = package.ImageReaderOptions(), package.FeatureExtractionOptions()
        reader.camera_model, figures = self.lens.model((width, height), self.settings.coefficients)
        reader.camera_params = ",".join(f"{figure:.17g}" for figure in figures)
        reader.default_focal_length_factor = FOCAL_GUESS
        extraction.use_gpu, extraction.num_threads = False, 1
        thorough = self.settings.thorough
        extraction.sift.peak_threshold = FAINTEST_IF_THOROUGH if thorough else FAINTEST
        extraction.sift.max_num_features = MOST_FEATURES
        extraction.sift.estimate_affine_shape = extraction.sift.domain_size_pooling = thorough
        if any((self.work / "masks").iterdir()):
            reader.mask_path = self.work / "masks"
        if not self.base.exists():
            partial = self.work / (FEATURES + ".partial")
            package.Database.open(partial).close()
            package.import_images(partial, home, package.CameraMode.SINGLE, list(self.names), reader)
            partial.replace(self.base)
        for number, (name, photograph) in enumerate(self.names.items()):
            progress(number / len(self.names), photograph)
            single, cpu = package.CameraMode.SINGLE, package.Device.cpu
            package.extract_features(self.base, home, [name], single, reader, extraction, cpu)

    def match(self, progress: Progress) -> None:
        """Match the pairs that are not matched yet; `InputError` where no pair agrees."""
        package, pairs = self.package, pairs_of(len(self.names))
        matching, pairing = package.FeatureMatchingOptions(), package.ImportedPairingOptions()
        geometry = package.TwoViewGeometryOptions()
        matching.use_gpu, matching.num_threads, matching.guided_matching = False, 1, self.settings.thorough
        geometry.ransac.random_seed, geometry.ransac.num_threads = self.settings.seed, 1
        pairing.match_list_path = self.work / "pairs.txt"
        partners: dict[int, list[int]] = {}
        for first, second in pairs:
            partners.setdefault(first, []).append(second)
        for done, (first, others) in enumerate(partners.items()):
            progress(done / len(partners), self.names[_name(first)])
            listed = "".join(f"{_name(first)} {_name(other)}\n" for other in others)
            pairing.match_list_path.write_text(listed, encoding="utf-8")
            package.set_random_seed(self.settings.seed)  # anew, so that work which goes on ends as work not cut off
            package.match_image_pairs(self.base, matching, pairing, geometry, package.Device.cpu)
        pairing.match_list_path.unlink(missing_ok=True)
        with _opened(package, self.base) as database:
            _, inliers = database.read_two_view_geometry_num_inliers()
        agreeing = sum(count >= geometry.min_num_inliers for count in inliers)
        if agreeing < LEAST_VIEWS - 1:
            raise InputError(f"{agreeing} of {len(pairs)} pairs of photographs share enough points: {ADVICE}")

    def place(self, progress: Progress) -> Any:
        """The largest model of cameras and points; `InputError` where it places fewer than three photographs."""
        package, options, count = self.package, self._mapping(), len(self.names)
        package.set_random_seed(self.settings.seed)
        placed, stopped, token = [0], [], package.CancellationToken()

        def another() -> None:
            placed[0] += 1
            try:
                progress(min(placed[0] / count, 1.0), f"{placed[0]} placed")
            except BaseException as error:  # which must not pass through compiled code
                stopped.append(error)
                token.cancel()

        models = package.incremental_mapping(
            self.base, self.work / "pictures", self.work, options, "", another, another, token
        )
        if stopped:
            raise stopped[0]
        for folder in (self.work / str(number) for number in models):
            _remove_model(folder)
        largest = max(models.values(), key=lambda model: (model.num_reg_images(), model.num_points3D()), default=None)
        if largest is None or largest.num_reg_images() < LEAST_VIEWS:
            found = 0 if largest is None else largest.num_reg_images()
            raise InputError(f"{found} of {count} photographs can be placed by the points that they share: {ADVICE}")
        return largest

    def _mapping(self) -> Any:
        options, fitted = self.package.IncrementalPipelineOptions(), self.lens.camera is None
        options.num_threads, options.random_seed = 1, self.settings.seed
        # a first pair that leads to few cameras only is given up, and another one tried
        options.min_model_size = max(LEAST_VIEWS, min(SMALL_MODEL, len(self.names) // 2))
        options.mapper.num_threads, options.mapper.random_seed = 1, self.settings.seed
        options.triangulation.random_seed = self.settings.seed
        options.extract_colors = False
        options.ba_refine_focal_length = options.ba_refine_extra_params = fitted
        options.mapper.abs_pose_refine_focal_length = options.mapper.abs_pose_refine_extra_params = fitted
        return options


def pairs_of(count: int) -> list[tuple[int, int]]:
    """The pairs of photographs that are matched: all, or of many each with those that follow it, around the end."""
    if count <= ALL_PAIRS:
        return list(combinations(range(count), 2))
    near = {tuple(sorted((k, (k + step) % count))) for k in range(count) for step in range(1, NEIGHBOURS + 1)}
    return sorted((int(first), int(second)) for first, second in near)


def _remove_model(folder: Path) -> None:
    """Remove the files of a model that COLMAP wrote, and its folder."""
    if folder.is_dir():
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()


def _camera(found: Any, lens: StatedLens) -> Camera:
    """The camera in photographs of the lens' size, at the world's origin."""
    if lens.camera is not None:
        return replace(lens.camera, name="")
    focal, cx, cy, *k = (float(figure) for figure in found.params)
    across, down = lens.size[0] / found.width, lens.size[1] / found.height
    distortion = (*k, *([0.0] * (4 - len(k))))
    return Camera(*lens.size, (focal * across, focal * down), (cx * across, cy * down), distortion)


@contextmanager
def _opened(package: Any, base: Path) -> Iterator[Any]:
    database = package.Database.open(base)
    try:
        yield database
    finally:
        database.close()
