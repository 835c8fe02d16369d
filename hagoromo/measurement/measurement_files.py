"""The files of a Measurement: writing them into a folder, and reading them back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, of_folder
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.png import read_png, write_png
from hagoromo.files.record import ForeignRecord, about, decode, read_json, write_json, written_by
from hagoromo.measurement.error_files import (
    SHARED_ERRORS,
    SUMMED,
    UNKNOWN_VARIANCE,
    VARIANCE,
    read_shared_errors,
    write_errors,
)
from hagoromo.measurement.gloss.gloss_map import GLOSS_CHANNELS, TAIL_CHANNELS, gloss_from_channels, with_tails
from hagoromo.measurement.health.health import Health
from hagoromo.measurement.material.body_map import BodyMap, Separation, write_separation
from hagoromo.measurement.material.body_spectra import read_body_spectra, write_body_spectra
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.photographed import read_photographed, write_photographed
from hagoromo.measurement.photometric.term import TermEstimate
from hagoromo.measurement.surface.own_light import OwnLight
from hagoromo.photograph.pixels import default_channels, read_points, write_points
from hagoromo.photograph.rig import Rig
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import MaterialRecord, read_materials, write_materials

FULL_COLOUR_DEVIATIONS = 5.0  # standard deviations at which the picture of a residual is fully red or blue
VARIANCE_CHANNELS = ("normal", "distance")  # of all errors, in variance.exr
ASSUMPTIONS, RIG, HEALTH = "assumptions.json", "rig.json", "health.json"
Map = NDArray[np.floating]
NAME = "terms.json"
ERROR_PREFIX = "error."  # prefix of the channels of standard errors


def write_measurement(measurement: Measurement, home: Path) -> None:
    """Write the files that `Measurement.write_into` lists."""
    channels = len(measurement.materials[0].body_colour)
    write_materials(measurement.materials, home / "materials.json", True, measurement.settings, measurement.seed)
    if measurement.assumptions:
        found = {} if measurement.linearity is None else measurement.linearity.record()
        write_json(
            home / ASSUMPTIONS, {"hagoromo": written_by(), "assumptions": dict(measurement.assumptions), **found}
        )
    if measurement.health is not None:
        write_json(home / HEALTH, {"hagoromo": written_by(), **measurement.health.record()})
    write_terms(home, measurement.terms)
    if measurement.fine is None:
        _write_surface(home, measurement.labels, measurement.normals, measurement.points)
        variances = measurement.normal_variance, measurement.distance_variance
        write_errors(home, variances, measurement.shared_errors, measurement.summed_variance)
        if measurement.body is not None:
            write_exr(home / "body.exr", _body_channels(measurement.body, measurement.normal_variance is not None))
    else:
        fine = measurement.fine
        _write_surface(home, fine.labels, fine.normals, fine.points)
        write_errors(home, (fine.variance, fine.depth_variance), measurement.shared_errors, fine.summed)
        write_exr(home / "body.exr", dict(zip(_solved_names(channels), np.moveaxis(fine.body, 2, 0), strict=True)))
    if measurement.gloss is not None:
        maps = measurement.gloss
        if measurement.fine is not None:
            maps = maps.of_size(*measurement.fine.labels.shape)
        write_exr(home / "gloss.exr", maps.channels())
    if measurement.own_light is not None:
        write_exr(home / "own_light.exr", {"share": measurement.own_light.share, "most": measurement.own_light.most})
        write_json(home / "own_light.json", {"hagoromo": written_by(), "own_light": measurement.own_light.record()})
    if measurement.separation is not None:
        write_separation(measurement.separation, default_channels(channels), home)
    for i, residual in enumerate(measurement.residuals):
        write_png(home / f"residual_{i:02d}.png", residual_picture(residual))
    taken = measurement.photographed_with
    if taken is not None:
        write_photographed(home, taken)
    if measurement.rig is not None:
        write_json(home / RIG, measurement.rig.record())
    if measurement.body_spectra:
        write_body_spectra(home / "body_spectra.json", measurement.body_spectra)


class Estimate(ForeignRecord, frozen=True, kw_only=True):
    """A number and its standard error; null where they are not known."""

    value: Annotated[float | None, about("the number")] = None
    standard_error: Annotated[float | None, about("its standard error")] = None
    separate: Annotated[bool, about("whether it is known apart from the light of the object")] = False


class OwnLightRecord(ForeignRecord, frozen=True, kw_only=True):
    """The light that an object sends to itself."""

    unit: Annotated[Estimate, about("light in shadows over the light expected there")]
    albedo: Annotated[float, about("of the body, in its brightest channel")]
    subtracted: Annotated[bool, about("whether normals and colours are without it")]
    light_of_the_room: Annotated[Estimate, about("share that is the same in all photographs")] = Estimate()


class OwnLightFile(ForeignRecord, frozen=True, kw_only=True):
    """own_light.json."""

    own_light: Annotated[OwnLightRecord, about("the light that the object sends to itself")]


def read_measurement(home: Path) -> Measurement:
    """The measurement in the folder `home`; see `Measurement.load`."""
    surface = read_surface(home)
    stored = read_maps(inside(home, VARIANCE), VARIANCE_CHANNELS, surface)
    summed = read_maps(inside(home, VARIANCE), (SUMMED,), surface, optional=True) or ()
    variances = [np.where(one < UNKNOWN_VARIANCE, one, np.inf) for one in (stored or ())]
    spectra = inside(home, "body_spectra.json")
    writer = decode(read_json(inside(home, "materials.json"))[0], MaterialRecord, "materials.json").hagoromo
    return Measurement(
        surface.materials,
        surface.labels,
        (),
        (),
        surface.normals,
        surface.points,
        _read_body(home, surface),
        _read_separation(home),
        read_body_spectra(spectra) if spectra.is_file() else {},
        normal_variance=variances[0] if variances else None,
        distance_variance=variances[1] if variances else None,
        summed_variance=np.where(summed[0] < UNKNOWN_VARIANCE, summed[0], np.inf) if summed else None,
        shared_errors=read_shared_errors(inside(home, SHARED_ERRORS), surface.labels.shape),
        settings=writer.settings,
        assumptions=_read_assumptions(inside(home, ASSUMPTIONS)),
        health=_read_health(inside(home, HEALTH)),
        seed=writer.seed,
        photographed=read_photographed(home),
        own_light=_read_own_light(home, surface),
        rig=Rig.load(home / RIG) if inside(home, RIG).is_file() else None,
        terms=read_terms(home),
    )


def residual_picture(residual: Map) -> NDArray[np.uint8]:
    """The mean residual (h, w, C) of the channels: white at 0, red above, blue below, grey where unknown."""
    mean = residual.mean(axis=2)
    strength = np.clip(np.nan_to_num(mean) / FULL_COLOUR_DEVIATIONS, -1.0, 1.0)
    fading = 1.0 - np.abs(strength)
    picture = np.stack([np.where(strength > 0, 1.0, fading), fading, np.where(strength < 0, 1.0, fading)], axis=2)
    return np.rint(255.0 * np.where(np.isnan(mean)[..., None], 0.5, picture)).astype(np.uint8)


def _write_surface(home: Path, labels: NDArray[np.integer], normals: Map, points: Map | None) -> None:
    write_png(home / "labels.png", (labels + 1).astype(np.uint8))
    write_exr(home / "normals.exr", dict(zip(("N.X", "N.Y", "N.Z"), np.moveaxis(normals, 2, 0), strict=True)))
    if points is not None:
        write_points(home / "points.exr", points)


def _body_channels(body: BodyMap, solved: bool) -> dict[str, NDArray[np.float32]]:
    count = body.value.shape[2]
    return body.channels(default_channels(count) if body.error is not None and not solved else _solved_names(count))


def _solved_names(count: int) -> tuple[str, ...]:
    """Names of the channels of body colours that were solved together with the shape."""
    return tuple("RGB") if count == 3 else tuple(map(str, range(count)))


def _read_assumptions(path: Path) -> dict[str, str]:
    record = read_json(path) if path.is_file() else {}
    said = record.get("assumptions", {}) if isinstance(record, dict) else None
    if not isinstance(said, dict):
        raise InputError(f"{path} has no table of assumptions: measure the capture again")
    return {str(what): str(why) for what, why in said.items()}


def _read_health(path: Path) -> Health | None:
    return Health.from_record(read_json(path), str(path)) if path.is_file() else None


def _read_body(home: Path, surface: MeasuredSurface) -> BodyMap | None:
    """Body colours, NaN where unknown, with the gloss of each pixel where gloss.exr exists."""
    if surface.body is None:
        return None
    known = (surface.body != 0.0).any(axis=2, keepdims=True)
    value = np.where(known, surface.body, np.nan).astype(np.float64)
    error = None if surface.body_error is None else np.where(known, surface.body_error, np.nan).astype(np.float64)
    maps = read_maps(inside(home, "gloss.exr"), GLOSS_CHANNELS, surface)
    gloss = None
    if maps is not None:
        tails = read_maps(inside(home, "gloss.exr"), TAIL_CHANNELS, surface, optional=True)
        gloss = gloss_from_channels(maps, tails, value, error)
        if tails is None:
            gloss = with_tails(gloss, surface.materials, surface.labels)
    return BodyMap(value, error, surface.materials, surface.labels, gloss=gloss)


def _read_own_light(home: Path, surface: MeasuredSurface) -> OwnLight | None:
    """Share of the light that comes from the object, its largest, and their record; None where there is none."""
    path = inside(home, "own_light.json")
    maps = read_maps(inside(home, "own_light.exr"), ("share", "most"), surface) if path.is_file() else None
    if maps is None:
        return None
    share, most = maps
    stated = decode(read_json(path), OwnLightFile, str(path)).own_light
    room = stated.light_of_the_room
    return OwnLight(
        share,
        most,
        stated.unit.value or 0.0,
        _or_unknown(stated.unit.standard_error),
        stated.albedo,
        stated.subtracted,
        room.value or 0.0,
        _or_unknown(room.standard_error),
        room.separate,
    )


def _or_unknown(error: float | None) -> float:
    return np.inf if error is None else error


def _read_separation(home: Path) -> Separation | None:
    """The parts in separation_NN.exr, NaN where unknown."""
    path = next(iter(sorted(home.glob("separation_*.exr"))), None)
    if path is None:
        return None
    layers, _ = read_exr(inside(home, path.name))
    names = colour_channels({name.removeprefix("body.") for name in layers if name.startswith("body.")})
    number = path.stem.removeprefix("separation_")
    if not (number.isdecimal() and names and {f"interface.{name}" for name in names} <= set(layers)):
        raise InputError(f"{path} must have the channels body.* and interface.*: measure again")
    body, interface = (np.stack([layers[f"{part}.{name}"] for name in names], axis=2) for part in ("body", "interface"))
    known = ((body != 0.0) | (interface != 0.0)).any(axis=2, keepdims=True)
    parts = (np.where(known, part, np.nan).astype(np.float64) for part in (body, interface))
    return Separation(int(number), *parts)


def read_maps(
    path: Path, names: tuple[str, ...], surface: MeasuredSurface, optional: bool = False
) -> tuple[NDArray[np.float32], ...] | None:
    """Channels of an EXR of the size of the surface; None where there is no file, or none of `optional` channels."""
    if not path.is_file():
        return None
    layers, _ = read_exr(path)
    if optional and not set(names) & set(layers):
        return None
    if not set(names) <= set(layers) or layers[names[0]].shape != surface.labels.shape:
        raise InputError(f"{path} must have the channels {', '.join(names)} in the size of labels.png: measure again")
    return tuple(layers[name] for name in names)


class TermsFile(ForeignRecord, frozen=True, kw_only=True):
    """terms.json."""

    terms: Annotated[dict[str, TermEstimate], about("name of each term of the model → its estimate")]


def write_terms(home: Path, estimates: Mapping[str, TermEstimate]) -> None:
    """Write the file into the folder `home`; nothing where nothing was estimated."""
    if estimates:
        each = {name: asdict(estimate) for name, estimate in estimates.items()}
        write_json(home / NAME, {"hagoromo": written_by(), "terms": each})


def read_terms(home: Path) -> dict[str, TermEstimate]:
    """What `write_terms` wrote into the folder."""
    path = inside(home, NAME)
    return decode(read_json(path), TermsFile, str(path)).terms if path.is_file() else {}


@dataclass(frozen=True, eq=False)
class MeasuredSurface:
    """A surface of h × w pixels in C channels, as its files have it.

    materials; labels: (h, w) index into them, −1 unknown. normals: (h, w, 3) unit, world axes. points: (h, w, 3) [m].
    body: (h, w, C) α c_b of each pixel [1/sr]; body_error: its standard error. Vectors and colours are 0 where unknown;
    points, body and body_error are None where the folder does not have them.
    """

    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.int64]
    normals: NDArray[np.float32]
    points: NDArray[np.floating] | None
    body: NDArray[np.float32] | None
    body_error: NDArray[np.float32] | None


def read_surface(folder: str | Path) -> MeasuredSurface:
    """The surface in materials.json, labels.png, normals.exr and, where they exist, points.exr and body.exr.

    Channels of body.exr are in the order R, G, B, or else in that of their names ("0", "1", …).
    `InputError` where a file is missing or damaged, or the files do not go together.
    """
    home = Path(folder)
    materials = read_materials(of_folder(home, "materials.json", "a folder that `hagoromo measure` wrote"))
    labels = read_png(inside(home, "labels.png")).astype(np.int64) - 1
    if labels.ndim != 2 or labels.max() >= len(materials):
        raise InputError(f"{home / 'labels.png'} has labels up to {labels.max() + 1}: materials are {len(materials)}")
    at_points, at_body = inside(home, "points.exr"), inside(home, "body.exr")
    normals = _normals(inside(home, "normals.exr"))
    points = read_points(at_points) if at_points.is_file() else None
    body, body_error = _body(at_body) if at_body.is_file() else (None, None)
    surface = MeasuredSurface(materials, labels, normals, points, body, body_error)
    channels = {"normals": 3, "points": 3, "body": len(materials[0].body_colour), "body_error": 0} if materials else {}
    for name in channels:
        part = getattr(surface, name)
        if part is not None and (part.shape[:2] != labels.shape or part.shape[2] != (channels[name] or part.shape[2])):
            raise InputError(f"{home}: {name} of shape {part.shape} for labels of {labels.shape}: measure again")
    return surface


def colour_channels(names: set[str]) -> tuple[str, ...]:
    """`names` of the channels of a colour, in order."""
    return tuple("RGB") if names == set("RGB") else tuple(sorted(names, key=lambda name: (len(name), name)))


def _body(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Values and, where there are any, their standard errors."""
    layers, _ = read_exr(path)
    names = colour_channels({name for name in layers if "." not in name})
    if not names:
        raise InputError(f"{path} has no channel of a colour: it has {', '.join(layers)}: measure again")
    values = np.stack([layers[name] for name in names], axis=2)
    errors = [layers[ERROR_PREFIX + name] for name in names if ERROR_PREFIX + name in layers]
    return values, np.stack(errors, axis=2) if len(errors) == len(names) else None


def _normals(path: Path) -> NDArray[np.float32]:
    layers, _ = read_exr(path)
    names = [f"N.{axis}" for axis in "XYZ"]
    if not set(names) <= set(layers):
        raise InputError(f"{path} must have the channels {', '.join(names)}: it has {', '.join(layers)}")
    return np.stack([layers[name] for name in names], axis=2)
