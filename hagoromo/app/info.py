"""Contents of a file or folder of any type that the package reads."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hagoromo.app import pixel_facts
from hagoromo.app.pixel_facts import Facts, decoded
from hagoromo.calibration.camera.calibrate_camera import NAMES
from hagoromo.camera.formats.camera_file import format_of_cameras, read_views, transforms_in
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.format import format_of, function_at, short
from hagoromo.files.mesh import read_mesh
from hagoromo.files.record import read_json, read_toml
from hagoromo.files.table import read_table
from hagoromo.light.lamp_profile import LampProfile
from hagoromo.light.spectrum import read_spectrum_file
from hagoromo.photograph.capture import count_absent
from hagoromo.photograph.lamp_files import load_lamps
from hagoromo.reflectance.parameters import MEASURED

MATERIAL_FIELDS = (*(each.name for each in MEASURED), "identifiable")


def info(path: str | Path, decode: bool = False) -> Facts:
    """Facts about `path`, name → text or plain numbers, its type first. Of pictures and volumes only headers are read.

    decode: also decode the pixels or voxels: their range, of camera RAW the mosaic and its levels. `InputError` if it
    does not exist, is of unknown type, or cannot be read as the type that its name states.
    """
    path = Path(path)
    found = format_of(path)
    facts = (function_at(found.facts) if found.facts else OF_KIND[found.holds])(path)
    return facts | decoded(found.name, found.holds, path) if decode else facts


def is_capture(path: Path) -> bool:
    """Whether a folder is a capture."""
    return path.is_dir() and inside(path, "transforms.json").exists()


def is_box(path: Path) -> bool:
    """Whether a folder is a volume box."""
    return path.is_dir() and (path / "zarr.json").exists()


def lamps_facts(path: Path) -> Facts:
    """How many lamps a dome has."""
    return {"kind": "lamps", "lamps": len(load_lamps(path))}


def _reflectance(path: Path) -> Facts:
    table = format_of(path).read(path)
    span = [float(table.values.min()), float(table.values.max())]
    return {"kind": "reflectance", "directions": len(table.values), "channels": list(table.channels), "range": span}


def _spectrum(path: Path) -> Facts:
    spectrum = read_spectrum_file(path)
    waves, values = spectrum.wavelengths, spectrum.values
    span, ends = [float(values.min()), float(values.max())], [float(waves[0]), float(waves[-1])]
    return {"kind": "spectrum", "wavelengths": len(waves), "range_nm": ends, "range": span}


def _surface(path: Path) -> Facts:
    mesh = read_mesh(path)
    low, high = mesh.bounds.tolist()
    return {"kind": "mesh", "vertices": len(mesh.vertices), "triangles": len(mesh.faces), "low": low, "high": high,
            "closed": bool(mesh.is_watertight)}  # fmt: skip


def transforms_facts(path: Path) -> Facts:
    """What a capture, or a list of views, holds."""
    path = transforms_in(path) or path if path.is_dir() else path
    record = read_json(path)
    frames = record.get("frames") if isinstance(record, dict) else None
    if not isinstance(frames, list):
        raise InputError(f"{path} has no list of frames: give the transforms.json of a capture")
    return {
        "kind": "capture",
        "frames": len(frames),
        "images_absent": count_absent(path, frames),
        "size": [record.get("w"), record.get("h")],
        "lamps": len(lamps) if isinstance(lamps := record.get("lamps", []), list) else 0,
        "sensor": "sensor" in record,
        "truth": "truth" in record,
        **_sources(record),
    }


def box_facts(path: Path) -> Facts:
    """What a volume box is; its bricks are not read."""
    from hagoromo.volume.store.box_store import look_at_box

    box = look_at_box(path)
    return {
        "kind": "volume box",
        "name": box.header.name,
        "voxels": list(box.shape[::-1]),
        "voxel_size": box.header.voxel_size,
        "size": [n * box.header.voxel_size for n in box.shape[::-1]],
        "pose": box.header.pose.tolist(),
        "tau": box.header.tau,
        "extinction": box.header.extinction,
        "shadow_bias": box.header.shadow_bias,
        "materials": [material.name for material in box.header.materials],
        "bricks": f"{box.kept} hold matter, {box.bytes / 2**20:.1f} MiB",
        **{key: short(value) for key, value in box.header.provenance.items()},
    }


def ies_facts(path: Path) -> Facts:
    """What a profile of a lamp is."""
    profile = LampProfile.from_ies(path)
    angles = {key: [float(a[0]), float(a[-1]), len(a)] for key, a in
              (("lateral", profile.lateral), ("vertical", profile.vertical))}  # fmt: skip
    peak = profile.peak_candela or 0.0
    lumens = peak * profile.solid_angle()
    return {"kind": "IES profile", **angles, "peak_candela": peak, "lumens": lumens, **profile.keywords}


def _toml(path: Path) -> Facts:
    record = read_toml(path)
    if "step" in record:
        names = [step.get("name") for step in record["step"] if isinstance(step, dict)]
        return {"kind": "batch", "each": record.get("each"), "steps": names}
    if "camera" not in record:
        return {"kind": "matter", **{key: short(value) for key, value in record.items()}}
    from hagoromo.image.scene.scene_file import load_scene

    scene, settings = load_scene(path)
    return {
        "kind": "scene",
        "camera": scene.camera.name,
        "size": [scene.camera.width, scene.camera.height],
        "lamps": [lamp.name for lamp in scene.lamps],
        "boxes": [box.name for box in scene.boxes],
        "surfaces": [surface.name for surface in scene.surfaces],
        "render": asdict(settings),
    }


def json_facts(path: Path) -> Facts:
    """What one of our JSON files, or a list of cameras, holds."""
    record = read_json(path)
    if isinstance(record, list):
        return {"kind": "materials", **_materials(path), **_sources(record[0] if record else None)}
    if isinstance(record, dict) and "frames" in record:
        return transforms_facts(path)
    if isinstance(record, dict) and "fl_x" in record:
        shown = {key: short(value) for key, value in record.items() if key != "hagoromo"}
        return {"kind": "camera", **shown, **_sources(record)}
    if format_of_cameras(path) is not None:
        return _cameras(path)
    if isinstance(record, dict) and isinstance(record.get("lamps"), list):
        return {"kind": "lamps", **{str(k): short(lamp) for k, lamp in enumerate(record["lamps"])}, **_sources(record)}
    raise InputError(f"{path} is JSON of unknown type: give materials, camera, lamps or a capture")


def _sources(record: Any) -> Facts:
    """What a file states that it was made from: name → SHA-256."""
    written = record.get("hagoromo") if isinstance(record, dict) else None
    stated = written.get("sources") if isinstance(written, dict) else None
    if not isinstance(stated, list):
        return {}
    named = [one for one in stated if isinstance(one, dict)]
    return {"made_from": {str(one.get("name")): str(one.get("sha256")) for one in named}}


def _cameras(path: Path) -> Facts:
    views = read_views(path)
    lenses = {(c.width, c.height, *c.focal, *c.principal, *c.distortion) for c in views.values()}
    keys = ("w", "h", *NAMES)
    shown = {str(k): dict(zip(keys, lens, strict=True)) for k, lens in enumerate(sorted(lenses))}
    return {"kind": "cameras", "views": len(views), "images": short(list(views)), **shown}


def _materials(path: Path) -> Facts:
    from hagoromo.reflectance.material.materials_file import read_materials

    def fact(value: Any) -> Any:
        return None if isinstance(value, float) and math.isinf(value) else value  # JSON has no infinity

    known = read_materials(path)
    return {m.name: {"pixels": m.pixels, **{k: fact(getattr(m, k)) for k in MATERIAL_FIELDS}} for m in known}


def _csv(path: Path) -> Facts:
    table = read_table(path)
    rows = len(next(iter(table.values())))
    return {"kind": "table", "rows": rows, **{k: [float(v.min()), float(v.max())] for k, v in table.items()}}


OF_KIND: dict[str, Callable[[Path], Facts]] = {
    "volume": pixel_facts.volume, "surface": _surface, "scene": _surface, "spectrum": _spectrum, "cameras": _cameras,
    "picture": pixel_facts.picture, "reflectance": _reflectance, "matter": _toml, "table": _csv,
}  # fmt: skip
