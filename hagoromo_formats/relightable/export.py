"""Export: a measured object → the files of other programs, with a record of what each of them loses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json, written_by
from hagoromo.files.table import write_table
from hagoromo.files.whole import whole_folder
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo.reflectance.parameters import EVIDENCE, EXPORTS, PICTURES, PLANES, losses
from hagoromo_formats.relightable.materialx import LOSS, write_materialx, write_openpbr
from hagoromo_formats.relightable.measured_brdf import COVARIANCE, measured_brdf, write_measured_brdfs
from hagoromo_formats.relightable.mesh import albedo_map, roughness, triangles, write_mesh
from hagoromo_formats.relightable.openmaterial import write_openmaterial
from hagoromo_formats.relightable.rti import BASES, WRITERS, fitted
from hagoromo_page.publication.lit import Array, colour_factor, hemisphere, reflected, shown, white_level
from hagoromo_page.publication.publish import page_source
from hagoromo_page.publication.surface_maps import SurfaceMaps

LAMPS, TESTED = 60, 12  # directions that relightable formats are fitted to, and tested with
FULL = 65535.0
FORMATS = EXPORTS
IN_RANGE = ("png", "tiff", "glb", "ply", "materialx", "openpbr")  # formats whose colours are 0…1
OF_MATERIALS = ("materialx", "openpbr", "rgl")  # formats that need no surface
INSTEAD = "its channels stand as red, green and blue, for rgb variants of Mitsuba"
BEYOND = "these are beyond 1, as they are where nobody stated how strong the lamps are"
RTI = {"rti": ("hsh", "ptm")}  # what programs for RTI open: a word for both of their files
# What every object loses; what its reflectances lose, by their parameters, is said by `losses`
LOST = {
    "png": "normals, albedo, roughness and depth in 65535 steps; spectra are lost",
    "tiff": "as png",
    "exr": "nothing of normals, albedo and depth but single precision; spectra are not in it",
    "glb": "one roughness for the whole object; steep steps of depth are holes",
    "ply": "colours of 8 bits per vertex; steep steps of depth are holes",
    "csv": "all but the spectra of bodies, and the covariance of these",
    "materialx": LOSS,
    "openpbr": LOSS,
    "rgl": "parameters, as who reads a table interpolates in it: off by 0.2 % in the median, up to 7 % in 99 of 100",
    "openmaterial": "parameters but as a note, as a table of directions stands for them, finer about the highlight; "
    "copyrights, license and authors are to be filled in",
} | dict.fromkeys(PICTURES, "highlights become broad, cast shadows and spectra are lost; display values (sRGB curve)")


def export(
    measured: Measurement | str | Path,
    formats: Sequence[str],
    out: str | Path,
    *,
    capture: Capture | str | Path | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Write a measured object to the folder `out` in `formats`, of `FORMATS`; returns the record of export.json.

    measured: a `Measurement`, its folder, or a materials.json, for the formats of `OF_MATERIALS`.
    capture: that was measured, where the measurement is of version 0.2.
    `rti` stands for what programs for RTI open: hsh (object.rti) and ptm (object.ptm).
    Relightable formats are fitted to pictures of the object by its own reflectance under `LAMPS` far white lamps,
    without cast shadows; their error against `TESTED` others is in the record: root mean square, of display values 0…1.
    A format that is unknown, or needs what was not measured, does not keep the others from being written: the record
    says why under `refused`. `InputError` where none is left.
    """
    named = list(dict.fromkeys(one for name in formats for one in RTI.get(name, (name,))))
    source = measured if isinstance(measured, Measurement) else _read(Path(measured))
    shots = capture if isinstance(capture, Capture) or capture is None else load_capture(capture)
    maps = page_source(source, shots).maps if source.labels.size else None
    refused = {name: why for name in named if (why := _refusal(name, source, maps))}
    left = [name for name in named if name not in refused]
    if not left:
        raise InputError("; ".join(refused.values()) or f"no format was given: give some of {', '.join(FORMATS)}")
    factor = _colour_factor(source, maps)
    record: dict[str, Any] = {
        "formats": {name: _lost(name, source, factor if name in IN_RANGE else 1.0) for name in left},
        "refused": refused,
        **({} if maps is None else {"axes": "x right, y up, z to the camera", "lengths": _lengths(maps)}),
        "hagoromo": written_by(),
    }
    with whole_folder(out, force) as home:
        for name, written in _write(home, left, source, maps, factor, progress).items():
            record["formats"][name] |= written
        write_json(home / "export.json", record)
    return record


def _read(path: Path) -> Measurement:
    """The measurement in a folder, or that of the materials of a file, without a pixel."""
    if not path.is_file():
        return Measurement.load(path)
    return Measurement(tuple(read_materials(path)), np.zeros((0, 0), int), (), (), np.zeros((0, 0, 3), np.float32))


def _lengths(maps: SurfaceMaps) -> str:
    return "m" if maps.has_scale else "no scale is known: depths and meshes are not in metres"


def _refusal(name: str, source: Measurement, maps: SurfaceMaps | None) -> str:
    """Why a format cannot be written; "" where it can."""
    if name not in FORMATS:
        return f"no format is called {name}: give some of {', '.join((*FORMATS, *RTI))}"
    if maps is None and name not in OF_MATERIALS:
        return f"{name}: a file of materials has no surface and no spectra: give the folder that measure wrote"
    if name == "csv" and not source.body_spectra:
        return "csv: the measurement has no spectra: they need the lamp's spectrum and the camera's response"
    if name == "openmaterial":
        bare = [one.name for one in source.materials if one.name not in source.body_spectra]
        if bare:
            return f"openmaterial: the spectrum of material {bare[0]!r} is not known: it needs lamp and response"
    if maps is not None and name in ("glb", "ply"):
        try:
            triangles(maps)
        except InputError as error:
            return f"{name}: {error}"
    if name in ("rgl", "openmaterial"):
        try:
            for material in source.materials:
                measured_brdf(material, source.body_spectra.get(material.name), source.photographed_with)
        except InputError as error:
            return f"{name}: {error}"
    return ""


def _write(
    home: Path,
    names: Sequence[str],
    source: Measurement,
    maps: SurfaceMaps | None,
    factor: float,
    progress: Progress,
) -> dict[str, Any]:
    """Write the formats, those of IN_RANGE with colours times `factor`; gives what the record says of them beside their
    losses.
    """
    written: dict[str, Any] = {}
    in_range = [one.times(factor) for one in source.materials]
    if "materialx" in names:
        write_materialx(home / "materials.mtlx", in_range)
    if "openpbr" in names:
        off = write_openpbr(home / "openpbr.mtlx", in_range)
        differs = {one.name: list(each) for one, each in zip(source.materials, off, strict=True)}
        written["openpbr"] = {"file": "openpbr.mtlx", "relative_difference": differs}
    if "rgl" in names:
        files = write_measured_brdfs(home, source.materials, source.body_spectra, source.photographed_with)
        written["rgl"] = {"files": files, "covariance": COVARIANCE}
    if "openmaterial" in names:
        files = write_openmaterial(home, source.materials, source.body_spectra, source.photographed_with)
        written["openmaterial"] = {"files": files}
    if "csv" in names:
        _write_spectra(home / "spectra.csv", source)
    if maps is None:
        return written
    for name in names:
        if name in PLANES:
            _write_planes(home, name, maps, factor)
    meshes = {name: home / f"object.{name}" for name in ("glb", "ply") if name in names}
    if meshes:
        write_mesh(meshes, maps, shown(albedo_map(maps), 1.0 / factor))
    relightable = [name for name in names if name in WRITERS]
    return written | (_write_relightable(home, relightable, maps, progress) if relightable else {})


def _colour_factor(source: Measurement, maps: SurfaceMaps | None) -> float:
    """`colour_factor`; of materials without pixels by the brightest channel of all."""
    if maps is not None:
        return colour_factor(maps)
    brightest = max((np.pi * one.alpha * max(one.body_colour) for one in source.materials), default=0.0)
    return 1.0 / max(brightest, 1.0)


def _lost(form: str, source: Measurement, factor: float) -> dict[str, Any]:
    """What a format loses: of every object, and of the reflectance of each material. factor: on its colours."""
    lines = losses(form, source.materials)
    if form == "rgl":
        bare = [one.name for one in source.materials if one.name not in source.body_spectra]
        lines += [f"material {name!r}: its spectrum, which is not known: {INSTEAD}" for name in bare]
    if factor == 1.0:
        return {"lost": f"{LOST[form]}; {EVIDENCE}", "lost_of_materials": lines}
    scale = f"the scale of the colours, which are {factor:.3g} times those measured: {BEYOND}"
    return {"lost": f"{scale}; {LOST[form]}; {EVIDENCE}", "lost_of_materials": lines, "colours_times": factor}


def _write_planes(home: Path, kind: str, maps: SurfaceMaps, factor: float) -> None:
    """normals, albedo, roughness and depth; of 16 bits: −1…1, 0…1 (sRGB curve), 0…1 and near…far as 0…65535. The albedo
    of those is times `factor`.
    """
    albedo, rough = albedo_map(maps), _roughness(maps)
    if kind == "exr":
        layers = dict(zip(("N.X", "N.Y", "N.Z"), np.moveaxis(maps.normals, 2, 0), strict=True))
        layers |= dict(zip("RGB", np.moveaxis(albedo, 2, 0), strict=True)) | {"roughness": rough}
        layers |= {"A": maps.known.astype(np.float32)}
        layers |= {} if maps.depth is None else {"Z": np.where(maps.known, maps.depth, 0.0)}
        write_exr(home / "planes.exr", layers, {"axes": "x right, y up, z to the camera; Z [m] along the optical axis"})
        return
    planes = {
        "normals": np.where(maps.known[..., None], 0.5 + 0.5 * maps.normals, 0.0),
        "albedo": shown(albedo, 1.0 / factor),
        "roughness": rough,
    }
    if maps.depth is not None:
        near, far = maps.depth[maps.known].min(), maps.depth[maps.known].max()
        planes["depth"] = np.where(maps.known, (maps.depth - near) / max(far - near, 1e-12), 0.0)
        write_json(home / "depth.json", {"near_m": float(near), "far_m": float(far), "hagoromo": written_by()})
    for name, plane in planes.items():
        numbers = np.rint(FULL * np.clip(plane, 0.0, 1.0)).astype(np.uint16)
        if kind == "png":
            write_png(home / f"{name}.png", numbers)
        else:
            import tifffile

            tifffile.imwrite(home / f"{name}.tiff", numbers, compression="deflate", software="", datetime=False)


def _roughness(maps: SurfaceMaps) -> Array:
    """(h, w) see `roughness`, of each pixel's γ where it is known."""
    of_materials = np.array([roughness(material) for material in maps.materials])
    rough = np.where(maps.known, of_materials[np.maximum(maps.labels, 0)], 0.0)
    if maps.gamma is None:
        return rough
    fine = np.sqrt(np.maximum(maps.gamma, 0.0) / np.sqrt(np.sqrt(2.0) - 1.0))
    return np.where(maps.known & (maps.gamma > 0.0), np.clip(fine, 0.02, 1.0), rough)


def _write_spectra(path: Path, measurement: Measurement) -> None:
    spectra = measurement.body_spectra
    columns: dict[str, Any] = {"wavelength_nm": next(iter(spectra.values())).wavelengths}
    for name, spectrum in spectra.items():
        low, high = spectrum.band_95
        columns |= {name: spectrum.values, f"{name} low": low, f"{name} high": high}
    write_table(path, columns)


def _write_relightable(home: Path, names: Sequence[str], maps: SurfaceMaps, progress: Progress) -> dict[str, Any]:
    """Write the relightable formats; gives the file of each, with its error under lamps that it was not fitted to."""
    white, directions = white_level(maps), hemisphere(LAMPS)
    pictures = []
    for number, to_lamp in enumerate(directions):
        progress(number / LAMPS, "lamps")
        pictures.append(shown(reflected(maps, to_lamp), white))
    tested = hemisphere(TESTED, 0.25)
    truth = np.array([shown(reflected(maps, to_lamp), white)[maps.known] for to_lamp in tested])
    written = {}
    for name in names:
        file, write = WRITERS[name]
        write(home / file, pictures, directions)
        terms = fitted(pictures, BASES[name](directions))[:, maps.known]
        again = np.clip(np.einsum("lt,tkc->lkc", BASES[name](tested), terms), 0.0, 1.0)
        error = float(np.sqrt(np.mean((again - truth) ** 2)))
        written[name] = {"file": file, "rms_error_before_quantisation": error}
    return written
