"""Lensfun: the distortion of a lens by its name, from the database of lensfun or a file of it, as our camera's.

Lensfun's polynomials have odd powers of the radius, ours even ones: the camera is fitted to what lensfun does with a
picture, and says by how much it is off. A factor at the centre becomes a part of the focal length. Vignetting and
colour fringes of the database are not kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.exif import Exif
from hagoromo.files.format import short, start_of
from hagoromo.files.reading import library, reading

BUNDLED = Path("the database of lensfunpy")
LARGEST_FILE = 1 << 24  # bytes of XML
FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)  # mm, of the film that crop factors refer to
SAMPLED_SIDE = 500  # px of the picture that lensfun distorts
ASPECTS = (3 / 2, 4 / 3, 16 / 9, 5 / 4, 1.0)  # of pictures
MOST_OFF = 0.5  # px of that picture
SAMPLES = 500  # radii of the fit
LONGEST_NAME, LEAST_CROP = 200, 1e-3
MODELS = {"ptlens": ("a", "b", "c"), "poly3": ("k1",), "poly5": ("k1", "k2")}
TYPES = (
    "rectilinear", "fisheye", "panoramic", "equirectangular", "orthographic", "stereographic", "equisolid",
    "fisheye_thoby",
)  # fmt: skip
MOST_NAMED = 5  # in messages
STARTS = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))  # of k4, k5, k6
LOST = "vignetting and colour fringes of the database are not kept"


class LensCamera(NamedTuple):
    """camera: at the origin. lens: its name. rms, largest: how far the fit is off lensfun's distortion [px]."""

    camera: Camera
    lens: str
    rms: float
    largest: float


def camera_by_lensfun(
    size: tuple[int, int], exif: Exif, lens: str = "", database: str | Path | None = None
) -> LensCamera:
    """The camera of a photograph of `size` (width, height) [px] whose EXIF names the camera and the focal length.

    lens: its name or a part of it (default: the EXIF's). database: a file of lensfun's XML (default: the one that comes
    with lensfunpy). `InputError` where camera or lens is unknown or ambiguous, or is no rectilinear lens.
    """
    library("lensfunpy")
    wanted = (lens or exif.lens)[:LONGEST_NAME]
    if exif.focal_mm is None or not exif.camera:
        raise InputError(
            "the photograph does not say its camera and focal length (EXIF): give one as the camera wrote it"
        )
    if not wanted:
        raise InputError("the photograph does not name its lens (EXIF): give it by --lens")
    given = [list(size), exif.camera[:LONGEST_NAME], exif.focal_mm, wanted]
    fit = read_apart(fit_by_lensfun, _checked_file(database), "a lensfun database", *given)
    focal, name = float(fit["focal"]), str(fit["lens"])
    principal = (0.5 * size[0], 0.5 * size[1])
    camera = Camera(*size, (focal, focal), principal, tuple(fit["coefficients"].tolist()), name=name)
    return LensCamera(camera, name, float(fit["rms"]), float(fit["largest"]))


def names_in_lensfun(file: str | Path) -> tuple[list[str], list[str]]:
    """Cameras and lenses of a file of lensfun's XML, by maker and model."""
    library("lensfunpy")
    names = read_apart(names_by_lensfun, _checked_file(file), "a lensfun database")
    return names["cameras"].tolist(), names["lenses"].tolist()


def names_by_lensfun(file: Path) -> dict[str, NDArray[Any]]:
    """cameras and lenses, as of `names_in_lensfun`, by which it is run apart."""
    held = _database(library("lensfunpy"), file)
    cameras = [f"{each.maker} {each.model}" for each in held.cameras]
    return {"cameras": np.array(cameras, str), "lenses": np.array([each.model for each in held.lenses], str)}


def fit_by_lensfun(
    file: Path, size: tuple[int, int], camera: str, focal_mm: float, wanted: str
) -> dict[str, NDArray[Any]]:
    """The camera of a lens, as of `camera_by_lensfun`, by which it is run apart."""
    lensfun = library("lensfunpy")
    held = _database(lensfun, file)
    body = _one([each for each in held.cameras if _named(each, camera)], camera, "camera")
    named = [each for each in held.lenses if each.model.lower() == wanted.lower()]
    found = held.find_lenses(body, None, wanted) or named  # the best first; it takes "20mm" in names at its word
    glass = _one([each for each in found if each.score == found[0].score][:1], wanted, "lens")
    if glass.type != lensfun.LensType.RECTILINEAR or glass.center_x or glass.center_y:
        raise InputError(
            f"{glass.model} is a fisheye or is off its axis: cameras here have rectilinear lenses on theirs"
        )
    return _fitted(lensfun, glass, body.crop_factor, focal_mm, (size[0], size[1]))


def is_lensfun(path: Path) -> bool:
    """Whether an .xml is lensfun's, by its first bytes."""
    return path.is_file() and path.suffix.lower() == ".xml" and b"<lensdatabase" in start_of(path)


def lens_facts(path: Path) -> dict[str, Any]:
    """The names in a file of lensfun, for `info`."""
    cameras, lenses = names_in_lensfun(path)
    return {"kind": "lenses", "cameras": short(cameras), "lenses": short(lenses)}


def _checked_file(file: str | Path | None) -> Path:
    return BUNDLED if file is None else sized_file(file, LARGEST_FILE, "a lensfun database")


def _database(lensfun: Any, file: Path) -> Any:
    if file == BUNDLED:
        return lensfun.Database(load_common=False)
    with reading(file, "a lensfun database"):
        tree = ElementTree.fromstring(read_bytes(file))
        if tree.tag != "lensdatabase":
            raise InputError(f"{file} is no lensfun database: give XML with <lensdatabase>")
        return lensfun.Database(xml=_plain(tree), load_common=False, load_bundled=False)


def _plain(tree: ElementTree.Element) -> str:
    """Of a database the names, mounts, crops and distortions alone, checked: lensfun prints what it does not know, and
    ends the process at a lens without a maker. Entries stand side by side: what is nested in another one is not read.
    """
    kept = ElementTree.Element("lensdatabase", version="1")
    for body in tree.findall("camera"):
        _copied(body, kept)
    for glass in tree.findall("lens"):
        calibration = ElementTree.SubElement(_copied(glass, kept), "calibration")
        for each in glass.findall("calibration/distortion"):
            model, focal = each.get("model", ""), float(each.get("focal", ""))
            figures = {key: f"{float(each.get(key, '0')):.9g}" for key in MODELS.get(model, ())}
            if model in MODELS and all(map(math.isfinite, map(float, (focal, *figures.values())))) and focal > 0.0:
                ElementTree.SubElement(calibration, "distortion", {"model": model, "focal": f"{focal:.9g}", **figures})
    return ElementTree.tostring(kept, "unicode")


def _copied(entry: ElementTree.Element, to: ElementTree.Element) -> ElementTree.Element:
    made = ElementTree.SubElement(to, entry.tag)
    for key in ("maker", "model", "mount", "cropfactor", "type"):
        texts = [(found.text or "").strip()[:LONGEST_NAME] for found in entry.findall(key) if not found.attrib]
        if key != "type" and not any(texts):  # with an attribute it is a name in another language
            raise ValueError(f"a {entry.tag} has no {key}")
        for text in texts:
            if key == "cropfactor" and not LEAST_CROP < float(text) < 1.0 / LEAST_CROP:
                raise ValueError(f"a crop factor is {text}")
            if key == "type" and text not in TYPES:
                raise ValueError(f"a lens is of type {text}")
            ElementTree.SubElement(made, key).text = text
    return made


def _named(body: Any, camera: str) -> bool:
    """Whether EXIF means a camera of the database; the maker may stand twice, or be longer ("NIKON CORPORATION")."""
    words, model = camera.lower().split(), body.model.lower().split()
    maker = body.maker.lower().split()[:1]
    return words[-len(model) :] == model and maker[0] in words if model and maker else False


def _one(found: Sequence[Any], name: str, what: str) -> Any:
    if not found:
        raise InputError(f"lensfun knows no {what} {name!r:.80}: name another (--lens), or give its XML (--lensfun)")
    if len({(each.maker, each.model, each.crop_factor) for each in found}) > 1:
        names = ", ".join(sorted({each.model for each in found})[:MOST_NAMED])
        raise InputError(f"{what} {name!r:.80} may be {names:.300}: name one")
    return found[0]


def _fitted(lensfun: Any, glass: Any, crop: float, focal_mm: float, size: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """Focal length and k1 … k6 by least squares over the whole picture."""
    from scipy.optimize import least_squares

    sensor_mm = FULL_FRAME_DIAGONAL / crop * size[0] / math.hypot(*size)
    focal = focal_mm / sensor_mm * size[0]  # px
    # as many radii in each part of the picture, from the axis to the corner
    r = 0.5 * math.hypot(*size) / focal * np.sqrt(np.linspace(0.0, 1.0, SAMPLES + 1)[1:])
    far = _imaged(lensfun, glass, crop, focal_mm, size, r * focal) / focal
    even = np.stack([r, r**3, r**5, r**7], axis=1)
    first = np.linalg.lstsq(even, far, rcond=None)[0]

    def off(figures: NDArray[np.float64]) -> NDArray[np.float64]:
        s = r * r
        over = 1.0 + s * (figures[1] + s * (figures[2] + s * figures[3]))
        under = 1.0 + s * (figures[4] + s * (figures[5] + s * figures[6]))
        return focal * (figures[0] * r * over / under - far)

    tried = [least_squares(off, [first[0], *(first[1:] / first[0]), *start], x_scale="jac") for start in STARTS]
    best = min((each for each in tried if each.success), key=lambda each: each.cost, default=None)
    if best is None:
        raise InputError(f"the distortion of {glass.model} does not fit our camera: measure it by calibrate camera")
    scale, k1, k2, k3, k4, k5, k6 = best.x
    residual = off(best.x)
    return {
        "focal": np.array(focal * scale), "coefficients": np.array([k1, k2, 0.0, 0.0, k3, k4, k5, k6]),
        "lens": np.array(glass.model), "rms": np.sqrt(np.mean(residual**2)), "largest": np.abs(residual).max(),
    }  # fmt: skip


def _imaged(
    lensfun: Any, glass: Any, crop: float, focal_mm: float, size: tuple[int, int], r: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance from the axis [px] at which a lens images what is at r [px] without distortion.

    By lensfun's polynomials, whose unit of length hangs on the aspect ratio of the pictures of the calibration. That is
    the one by which lensfun's own picture agrees best; the picture itself is off by some 5e-4 of the displacements.
    """
    held = glass.interpolate_distortion(focal_mm)
    width, height = (max(2, round(n * min(1.0, SAMPLED_SIDE / max(size)))) for n in size)
    modifier = lensfun.Modifier(glass, crop, width, height)
    modifier.initialize(focal_mm, 8.0, 1000.0, scale=1.0, flags=lensfun.ModifyFlags.DISTORTION)
    placed = modifier.apply_geometry_distortion()
    if held is None or placed is None:
        return r
    polynomial = _polynomial(held, glass.model)
    half = 0.5 * np.array([width - 1, height - 1])
    near = np.hypot(*(np.stack(np.meshgrid(np.arange(width), np.arange(height))).reshape(2, -1) - half[:, None]))
    far = np.hypot(*(placed.reshape(-1, 2).astype(float) - half).T)

    def unit(aspect: float, diagonal: float) -> float:
        return crop / glass.crop_factor * diagonal / math.hypot(aspect, 1.0)

    def off(aspect: float) -> float:
        length = unit(aspect, math.hypot(*half))
        return float(np.sqrt(np.mean((polynomial(near / length) * length - far) ** 2)))

    aspect = min(ASPECTS, key=off)
    if off(aspect) > MOST_OFF:
        raise InputError(f"the distortion of {glass.model} is not that of its polynomial: measure it yourself")
    length = unit(aspect, 0.5 * math.hypot(*size))
    return polynomial(r / length) * length


def _polynomial(held: Any, name: str) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Distorted radius of the undistorted one (lensfun, "The lens correction models")."""
    a, b, c = (*map(float, held.terms), 0.0, 0.0, 0.0)[:3]
    kind = str(held.model).rpartition(".")[2]
    if kind == "PTLENS":
        return lambda r: r * (a * r**3 + b * r**2 + c * r + 1.0 - a - b - c)
    if kind == "POLY3":
        return lambda r: r * (1.0 - a + a * r**2)
    if kind == "POLY5":
        return lambda r: r * (1.0 + a * r**2 + b * r**4)
    raise InputError(f"the distortion of {name} is of model {kind}: ptlens, poly3 and poly5 are read")
