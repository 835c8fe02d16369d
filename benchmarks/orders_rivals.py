"""The rivals of the benchmark of all orders of light: Mitsuba in this process, Cycles in one of its own."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from orders_scenes import WAVELENGTH, OrdersContest

import hagoromo as hg
from hagoromo.backend import mitsuba

CYCLES = Path(".venv/cycles/bin/python")  # bpy needs another NumPy than ours
MITSUBA_AT_ONCE = 1 << 24  # walks of one launch
Array = NDArray[np.float64]


def scene_of_mitsuba(contest: OrdersContest, pixels: int, integrator: str) -> Any:
    """A contest in Mitsuba's words."""
    mi, lattice = mitsuba(), contest.lattice
    angle = np.arccos(-np.linspace(-1.0, 1.0, 361))
    phase = ",".join(f"{v:.9g}" for v in np.sin(angle) + (math.pi - angle) * np.cos(angle))
    place = mi.ScalarTransform4f().translate(lattice.low.tolist()).scale(lattice.edges.tolist())

    def volume(values: NDArray[np.float32]) -> dict[str, Any]:
        grid = mi.VolumeGrid(np.ascontiguousarray(values[..., None]))
        return {"type": "gridvolume", "grid": grid, "to_world": place, "raw": True}

    scale = float(lattice.extinction.max())
    alike = float(np.ptp(lattice.albedo)) == 0.0
    albedo = {"type": "constvolume", "value": float(lattice.albedo.max())} if alike else volume(lattice.albedo)
    medium = {
        "type": "heterogeneous", "albedo": albedo, "scale": scale, "sigma_t": volume(lattice.extinction / scale),
        "phase": {"type": "tabphase", "values": phase},
    }  # fmt: skip
    film = {"type": "hdrfilm", "width": pixels, "height": pixels, "component_format": "float32",
            "pixel_format": "rgb", "rfilter": {"type": "box"}}  # fmt: skip
    look = mi.ScalarTransform4f().look_at(list(contest.eye), list(contest.target), list(contest.up))
    fov = 2.0 * math.degrees(math.atan(0.5 / contest.focal))
    lamps = {
        f"lamp{k}": {"type": "point", "position": np.asarray(lamp.position).tolist(),
                     "intensity": {"type": "rgb", "value": at_550(lamp)}}
        for k, lamp in enumerate(contest.lamps)
    }  # fmt: skip
    return mi.load_dict({
        "type": "scene", "integrator": {"type": integrator, "max_depth": -1, "rr_depth": 5},
        "sensor": {"type": "perspective", "fov": fov, "to_world": look, "near_clip": 0.01, "far_clip": 100.0,
                   "film": film, "sampler": {"type": "independent"}},
        "box": {"type": "cube", "to_world": place @ half_cube(mi), "bsdf": {"type": "null"}, "interior": medium},
    } | lamps)  # fmt: skip


def half_cube(mi: Any) -> Any:
    """From Mitsuba's cube −1…1 to 0…1."""
    return mi.ScalarTransform4f().translate([0.5] * 3).scale(0.5)


def at_550(lamp: hg.Lamp) -> float:
    """Intensity of a lamp at the wavelength that is compared."""
    return float(np.mean(lamp.intensity) * lamp.spectrum.at(WAVELENGTH))


class Mitsuba:
    """Pictures of a contest by one of Mitsuba's integrators."""

    def __init__(self, contest: OrdersContest, pixels: int, integrator: str) -> None:
        self.scene, self.pixels = scene_of_mitsuba(contest, pixels, integrator), pixels

    def __call__(self, walks: int, seed: int) -> Array:
        """The mean of `walks` walks a pixel, in launches that fit memory."""
        mi, left, total = mitsuba(), walks, np.zeros((self.pixels, self.pixels))
        most = max(MITSUBA_AT_ONCE // self.pixels**2, 1)
        while left > 0:
            count = min(left, most)
            picture = mi.render(self.scene, spp=count, seed=(seed << 16) + left)
            total += count * np.array(picture, float)[..., 1]
            left -= count
        return total / walks


class Cycles:
    """Pictures of a contest by Blender's Cycles: absorption and scattering of its own phase function.

    Its CPU time is that of the render call in its process; `cpu_s` has that of the last picture.
    """

    def __init__(self, contest: OrdersContest, pixels: int, folder: Path, threads: int) -> None:
        """`folder`: where its files lie. `FileNotFoundError` where Cycles is not installed."""
        if not CYCLES.exists():
            raise FileNotFoundError(f"{CYCLES} is not there: make cycles")
        folder.mkdir(parents=True, exist_ok=True)
        lattice = contest.lattice
        np.savez(folder / "lattice.npz", extinction=lattice.extinction, albedo=lattice.albedo)
        job = {
            "low": lattice.low.tolist(), "edges": lattice.edges.tolist(), "pixels": pixels, "focal": contest.focal,
            "eye": list(map(float, contest.eye)), "target": list(map(float, contest.target)), "up": list(contest.up),
            "lamps": [[*np.asarray(lamp.position).tolist(), at_550(lamp)] for lamp in contest.lamps],
            "threads": threads, "folder": str(folder.resolve()),
        }  # fmt: skip
        (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
        script = Path(__file__).with_name("orders_cycles.py")
        self.child = subprocess.Popen(
            [str(CYCLES), str(script), str(folder / "job.json")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
        )  # fmt: skip
        self.version, self.cpu_s = self._answer()["version"], 0.0

    def __call__(self, walks: int, seed: int) -> Array:
        """A picture by `walks` samples a pixel."""
        assert self.child.stdin is not None
        self.child.stdin.write(json.dumps({"walks": walks, "seed": seed}) + "\n")
        self.child.stdin.flush()
        answer = self._answer()
        self.cpu_s = float(answer["cpu_s"])
        return np.load(answer["file"]).astype(float)

    def _answer(self) -> dict[str, Any]:
        assert self.child.stdout is not None
        for line in self.child.stdout:
            if line.startswith("{"):
                return json.loads(line)
        raise RuntimeError(f"Cycles ended with status {self.child.wait()}")

    def close(self) -> None:
        """End its process."""
        assert self.child.stdin is not None
        self.child.stdin.close()
        self.child.wait(timeout=60)
