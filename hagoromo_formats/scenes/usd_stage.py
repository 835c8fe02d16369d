"""USD: how every file of it is opened, in a process of its own, and which of its objects are shown.

A file that names other files to be composed is refused, as they could lie anywhere; so is one whose references to
itself make more objects than fit, and more memory than is free is not given to the process. What is in an archive
(.usdz) is brought into a folder first.
"""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, sized_file
from hagoromo.files.memory import SHARE_OF_MEMORY, free_memory, require
from hagoromo.files.reading import library, reading
from hagoromo.files.whole import scratch_folder

ARCHIVE = ".usdz"
PLAIN = (".usd", ".usda", ".usdc")
USD = (*PLAIN, ARCHIVE)
MOST_FILES = 10_000  # in an archive
GROWTH = 40.0  # memory of what is in a file, in sizes of the file
LARGEST_FILE = 1 << 32  # bytes
MOST_SAMPLES = 1_000_000  # of transforms over time
MOST_OBJECTS = 100_000  # with those that references put in place
DEEPEST = 200  # objects within objects
UP = {"Y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "Z": np.eye(3)}  # axes of the file → x, y, z with z up
ARCS = ("referenceList", "payloadList", "inheritPathList", "specializesList")


def usd_file(path: str | Path) -> Path:
    """`path`; `InputError` where it is no file, or one that is not read as USD, or is too large, and without usd-core.

    Asked before the other process starts.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in PLAIN:
        raise InputError(f"{path} is no USD file: give one of {', '.join(USD)}")
    file = sized_file(path, LARGEST_FILE, "a USD file")
    require(GROWTH * file.stat().st_size, str(path))
    library("pxr.Usd")
    return file


@contextmanager
def unpacked(path: str | Path) -> Iterator[Path]:
    """`path`, or of an archive the file that it begins with, in a folder that is removed when the block ends.

    `InputError` for a damaged archive, one that is packed, and names that lead out of the folder.
    """
    if Path(path).suffix.lower() != ARCHIVE:
        yield Path(path)
        return
    source = sized_file(path, LARGEST_FILE, "a USD file")
    with scratch_folder() as folder:
        with reading(path, "a USD archive"), zipfile.ZipFile(source) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if not 0 < len(entries) <= MOST_FILES:
                raise InputError(f"{path} holds {len(entries)} files: an archive has 1 to {MOST_FILES}")
            packed = [entry.filename for entry in entries if entry.compress_type != zipfile.ZIP_STORED]
            if packed or sum(entry.file_size for entry in entries) > source.stat().st_size:
                raise InputError(f"{path} is packed, which archives of USD are not: make it with usdzip")
            if not entries[0].filename.lower().endswith(PLAIN):
                raise InputError(f"{path} begins with {entries[0].filename!r}, no USD file: make it with usdzip")
            places = [inside(folder, entry.filename) for entry in entries]
            if not all(place.resolve().is_relative_to(folder.resolve()) for place in places):  # also of allowed ones
                raise InputError(f"{path} has files with names that lead out of it: make it with usdzip")
            for entry, place in zip(entries, places, strict=True):
                place.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(entry) as stored, place.open("wb") as out:
                    shutil.copyfileobj(stored, out)
        yield places[0]


def open_stage(path: Path) -> Any:
    """The stage of a USD file; only in a process of its own, whose memory is bounded from here on."""
    _bound_memory()
    usd, layers = library("pxr.Usd"), library("pxr.Sdf")
    try:
        layer = layers.Layer.OpenAsAnonymous(str(path))
    except Exception as error:  # it begins with where in USD's own code it was raised
        raise ValueError(str(error).partition(".h : '")[2] or str(error)) from error
    named = sorted({*layer.GetCompositionAssetDependencies(), *layer.GetExternalAssetDependencies()} - {""})
    if named:
        raise InputError(f"{path} names other files, such as {named[0]}: write it into one file (flattened)")
    count = sum(_composed(layer, root, {}, 0, str(path)) for root in layer.rootPrims)
    if count > MOST_OBJECTS:
        raise InputError(f"{path} has {count:.3g} objects, {MOST_OBJECTS} at most are read: join them")
    return usd.Stage.Open(layer)


def shown(stage: Any) -> Iterator[Any]:
    """The objects that renderers show, those of instances as well; nothing that is hidden or a guide.

    What stands below a PointInstancer is only given in its places: the instancer itself is given, without it.
    """
    usd, geometry = library("pxr.Usd"), library("pxr.UsdGeom")
    walk = iter(usd.PrimRange.Stage(stage, usd.TraverseInstanceProxies(usd.PrimDefaultPredicate)))
    for prim in walk:
        image = geometry.Imageable(prim)
        if image and image.ComputeVisibility(usd.TimeCode.EarliestTime()) == "invisible":
            walk.PruneChildren()
            continue
        if image and image.ComputePurpose() in ("guide", "proxy"):
            continue
        if prim.GetTypeName() == "PointInstancer":
            walk.PruneChildren()
        yield prim


class Places:
    """Where objects stand: (4, 4) to columns of points in metres, z up, at the earliest time of the file."""

    def __init__(self, stage: Any) -> None:
        usd, geometry = library("pxr.Usd"), library("pxr.UsdGeom")
        self.metres = float(geometry.GetStageMetersPerUnit(stage))
        if not (np.isfinite(self.metres) and self.metres > 0.0):
            raise ValueError(f"its metersPerUnit is {self.metres}")
        self.world = np.eye(4)
        self.world[:3, :3] = self.metres * UP[str(geometry.GetStageUpAxis(stage))]
        self._caches: dict[float | None, Any] = {None: geometry.XformCache(usd.TimeCode.EarliestTime())}
        self._samples = 0

    def of(self, prim: Any, time: float | None = None) -> NDArray[np.float64]:
        """The place of an object, at a time code."""
        if time not in self._caches:
            self._caches[time] = library("pxr.UsdGeom").XformCache(library("pxr.Usd").TimeCode(time))
        return self.world @ np.array(self._caches[time].GetLocalToWorldTransform(prim), np.float64).T

    def moving(self, prim: Any) -> dict[str, Any] | None:
        """Its places (n, 16) at the time codes at which its transform, or one of what holds it, is sampled; None where
        it stands still.
        """
        geometry, times, one = library("pxr.UsdGeom"), set[float](), prim
        while one and not one.IsPseudoRoot():
            place = geometry.Xformable(one)
            times |= set(place.GetTimeSamples()) if place else set()
            one = one.GetParent()
        self._samples += len(times)
        if self._samples > MOST_SAMPLES:
            raise ValueError(f"it has more than {MOST_SAMPLES} time samples of transforms")
        places = np.array([self.of(prim, time) for time in sorted(times)])
        if len(times) < 2 or not np.ptp(places, axis=0).any():
            return None
        if not np.isfinite(places).all():
            raise ValueError(f"{prim.GetPath()} has a transform that is not finite")
        return {"times": sorted(times), "places": places.reshape(-1, 16).tolist()}


def value(prim: Any, name: str, default: Any) -> Any:
    """What an attribute states at the earliest time, also under the names that lamps have had; else `default`."""
    earliest = library("pxr.Usd").TimeCode.EarliestTime()
    for each in (name, f"inputs:{name}"):
        attribute = prim.GetAttribute(each)
        if attribute and attribute.HasAuthoredValue():
            stated = attribute.Get(earliest)
            return default if stated is None else stated
    return default


def _composed(layer: Any, prim: Any, known: dict[str, int], depth: int, where: str) -> int:
    """At most so many objects come of a prim: itself, those below it, and of what it refers to in the same file."""
    if depth > DEEPEST:
        raise InputError(f"{where} has objects more than {DEEPEST} deep within one another: it is refused")
    path = str(prim.path)
    if path in known:
        return known[path]
    known[path] = 0  # what refers to itself adds nothing; USD refuses it
    if prim.HasInfo("clips"):
        raise InputError(f"{where} names other files, in clips: write it into one file (flattened)")
    below = [*prim.nameChildren, *(v.primSpec for s in prim.variantSets.values() for v in s.variants.values())]
    for arc in ARCS:
        for item in getattr(prim, arc).GetAppliedItems():
            target = getattr(item, "primPath", item)
            found = layer.GetPrimAtPath(target if not target.isEmpty else f"/{layer.defaultPrim}")
            below += [found] if found else []
    known[path] = 1 + sum(_composed(layer, each, known, depth + 1, where) for each in below)
    return known[path]


def _bound_memory() -> None:
    """Give this process no more memory than is free: the lengths of arrays stand in the file, packed."""
    import psutil

    try:
        import resource
    except ImportError:  # of POSIX alone
        return
    if not Path("/proc/self").exists():
        return

    most = psutil.Process().memory_info().vms + int(SHARE_OF_MEMORY * free_memory())
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
