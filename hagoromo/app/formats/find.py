"""Find: which of the formats a file or folder has, by its name, or by its first bytes where the name does not tell."""

from __future__ import annotations

from pathlib import Path

from hagoromo.app.formats.table import FORMATS, MITSUBA, suffixes
from hagoromo.camera.formats.camera_file import NERFSTUDIO, cameras_within, transforms_in
from hagoromo.camera.formats.colmap import find_colmap
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, inside
from hagoromo.files.format import Format
from hagoromo.files.stores import address
from hagoromo.files.volumes.arrays import file_and_dataset
from hagoromo.files.volumes.formats import volume_format
from hagoromo.files.volumes.tiff_stack import slices
from hagoromo.mitsuba.xml_tree import is_scene

SIGNATURES = {
    b"v/1\x01": "OpenEXR", b"\x89PNG": "PNG", b"\xff\xd8\xff": "JPEG", b"II*\0": "TIFF", b"MM\0*": "TIFF",
    b"NRRD": "NRRD", b"VOL\3": "Mitsuba grid volume", b"\x93NUMPY": "NumPy array", b"\x89HDF": "HDF5", b"ply": "PLY",
    b"glTF": "glTF", b"%YAML": "OpenCV YAML or JSON",
    b" BDV\0\0\0\0": "OpenVDB", b"NanoVDB": "NanoVDB",
}  # fmt: skip
BY_NAME = {each.name: each for each in FORMATS}
BY_SUFFIX = {suffix: each for each in reversed(FORMATS) for suffix in each.suffixes if suffix and not each.folder}
PLAIN = {
    **BY_SUFFIX,
    ".xml": BY_NAME["IES TM-27-14"],
    ".json": BY_NAME["materials, camera, lamps"],
    ".tif": BY_NAME["TIFF"],
    ".tiff": BY_NAME["TIFF"],
}
START = 4096  # bytes of a file that are looked at


def format_of(path: str | Path) -> Format:
    """The format of the file or folder at `path`; `InputError`, which lists all that are read, where it has none."""
    path = Path(path)
    if address(path):
        return BY_NAME["volume box"]
    if path.is_dir():
        return _of_folder(path)
    volume = volume_format(path)
    if volume and file_and_dataset(path)[1]:
        return volume
    suffix = existing_file(path).suffix.lower()
    if path.name.lower().endswith(".nii.gz"):
        return BY_NAME["NIfTI"]
    if suffix in ("", ".json", ".txt", ".bin"):
        cameras = cameras_within(path)
        if cameras:
            return BY_NAME[cameras]
    if suffix == ".xml" and b"<lensdatabase" in _start(path):
        return BY_NAME["lensfun"]
    if suffix == ".xml" and is_scene(_start(path)):
        return BY_NAME[MITSUBA]
    if suffix in PLAIN and suffix not in (".txt", ".bin"):
        return PLAIN[suffix]
    if suffix == "":
        start = _start(path)
        for signature, name in SIGNATURES.items():
            if start.startswith(signature):
                return BY_NAME[name]
    raise InputError(f"{path} is of unknown type: give a folder or one of {suffixes()}")


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(START)


def _of_folder(path: Path) -> Format:
    if inside(path, "transforms.json").exists():
        return BY_NAME["capture"]
    if (path / "zarr.json").exists():
        return BY_NAME["volume box"]
    if transforms_in(path) is not None:
        return BY_NAME[NERFSTUDIO]
    if find_colmap(path) is not None:
        return BY_NAME["COLMAP"]
    if len(slices(path)) > 1:
        return BY_NAME["TIFF stack"]
    raise InputError(
        f"{path} is neither a capture (transforms.json, transforms_train.json) nor a volume box (zarr.json), "
        f"and holds no COLMAP model and no stack of TIFF files: give one of these"
    )
