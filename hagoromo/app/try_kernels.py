"""Small kernels on the backend that would be used, with their numbers checked.

`doctor` starts it as a process of its own, `python -m hagoromo.app.try_kernels FILE`: a library that does not fit may
abort it. It writes JSON to FILE as it gets on, so that what was found stays when it is aborted.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import json
import math
import sys
from pathlib import Path
from typing import Any

from hagoromo import backend
from hagoromo.errors import InputError

RAYS, CELLS = 1000, 32
TOLERANCE = 1e-5  # of a transmittance of 0 to 1 in single precision
GPU_TEXT = 256  # characters of the name of a GPU

Facts = dict[str, Any]


def try_kernels(answer: Path) -> None:
    """Write to the file `answer` which backends there are, which one is used and whether its kernels are right."""
    facts: Facts = {"backends": {"used": None, "llvm": _llvm(), "cuda": _cuda(), "metal": _metal()}}
    _write(answer, facts)
    try:
        facts["backends"]["used"] = backend.name()
        _write(answer, facts)
        facts |= {"kernel": {"error": _kernel_error(), "ray_meets_sphere_at": _ray_length()}, "threads": _threads()}
        if backend.name() == "cuda":
            facts["backends"]["cuda"]["optix"] = _loaded("nvoptix")
    except InputError as error:
        _write(answer, facts | {"can_render": False, "why_not": str(error)})
        return
    wrong = facts["kernel"]["error"] > TOLERANCE or abs(facts["kernel"]["ray_meets_sphere_at"] - 2.0) > TOLERANCE
    facts["kernel"]["state"] = "wrong" if wrong else "right"
    why = "a small kernel gives wrong numbers: report this page, and set HAGOROMO_BACKEND to another backend"
    _write(answer, facts | {"can_render": not wrong, "why_not": why if wrong else None})


def transmittances(steps: list[float]) -> Any:
    """exp(−x Σ steps) for RAYS values x of 0 to 1, by a loop that gathers the optical depth of each of the steps."""
    import drjit as dr

    jit = backend.arrays()
    table = backend.lookup(jit.Float, [float(step) for step in steps])
    share = dr.arange(jit.Float, RAYS) / (RAYS - 1)

    def is_inside(cell: Any, _depth: Any) -> Any:
        return cell < len(steps)

    def stepped(cell: Any, depth: Any) -> Any:
        return cell + 1, depth + share * dr.gather(jit.Float, table, cell)

    start = (dr.zeros(jit.UInt, RAYS), dr.zeros(jit.Float, RAYS))
    _, depth = dr.while_loop(start, is_inside, stepped, labels=("cell", "depth"))
    # libLLVM that is too old aborts at a maximum and at arctan2
    return dr.fmax(dr.exp(-depth), 0.0) + dr.atan2(share, jit.Float(1.0))


def _kernel_error() -> float:
    """Largest error of `transmittances` against its closed form."""
    import numpy as np

    steps = [0.01 * (cell + 1) for cell in range(CELLS)]
    share = np.arange(RAYS) / (RAYS - 1)
    wanted = np.exp(-math.fsum(steps) * share) + np.arctan2(share, 1.0)
    error = np.abs(np.asarray(transmittances(steps), np.float64) - wanted)
    return float(error.max()) if np.isfinite(error).all() else math.inf


def _ray_length() -> float:
    """Where a ray that starts three units from the centre of a unit sphere meets it: at 2."""
    mi = backend.mitsuba()
    scene = backend.traced_scene({"ball": {"type": "sphere"}})
    return float(scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(0, 0, -3), mi.Vector3f(0, 0, 1))).t[0])


def _threads() -> int:
    import drjit as dr

    return dr.thread_count()


def _llvm() -> Facts:
    import drjit as dr
    import drjit.detail

    if not dr.has_backend(dr.JitBackend.LLVM):
        return {"works": False, "why_not": "libLLVM was not found, see DRJIT_LIBLLVM_PATH"}
    version = ".".join(map(str, drjit.detail.llvm_version()))
    return {"works": True, "version": version, "library": _loaded("LLVM")}


def _loaded(name: str) -> str | None:
    """Path of a library that this process has loaded, with `name` in its file name; None if the system does not say."""
    import psutil

    process: Any = psutil.Process()
    if not hasattr(process, "memory_maps"):
        return None  # macOS
    return next((mapped.path for mapped in process.memory_maps() if name in Path(mapped.path).name), None)


def _metal() -> Facts:
    import drjit as dr

    if sys.platform != "darwin":
        return {"works": False, "why_not": "only macOS has it"}
    works = bool(dr.has_backend(dr.JitBackend.Metal))
    return {"works": works, **({} if works else {"why_not": "Dr.Jit found no Metal device"})}


def _cuda() -> Facts:
    """NVIDIA GPUs, or why there are none: asked of the driver, as Dr.Jit says only whether it works."""
    import drjit as dr
    import drjit.detail

    works = bool(dr.has_backend(dr.JitBackend.CUDA))
    facts: Facts = {"works": works, **_gpus()}
    if works:
        facts["cuda"] = ".".join(map(str, drjit.detail.cuda_version()))
    elif "why_not" not in facts:
        facts["why_not"] = "the driver works but Dr.Jit does not take it: it may be too old"
    return facts


def _gpus() -> Facts:
    if sys.platform == "darwin":
        return {"why_not": "macOS has no NVIDIA driver"}
    try:
        usual = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
        driver = ctypes.CDLL(_loaded(usual.removesuffix(".1")) or usual)  # Dr.Jit looks in more places
    except OSError:
        return {"why_not": "the NVIDIA driver is not installed"}
    if (status := driver.cuInit(0)) != 0:
        return {"why_not": f"the NVIDIA driver found no GPU (cuInit says {status})"}
    version, count, name = ctypes.c_int(), ctypes.c_int(), ctypes.create_string_buffer(GPU_TEXT)
    driver.cuDriverGetVersion(ctypes.byref(version))
    driver.cuDeviceGetCount(ctypes.byref(count))
    devices = []
    for index in range(count.value):
        driver.cuDeviceGetName(name, GPU_TEXT, index)
        devices.append(name.value.decode("utf-8", "replace"))
    return {"driver_supports_cuda": f"{version.value // 1000}.{version.value % 1000 // 10}", "devices": devices}


def _write(answer: Path, facts: Facts) -> None:
    answer.write_text(json.dumps(facts), encoding="utf-8")


if __name__ == "__main__":
    try_kernels(Path(sys.argv[1]))
