"""All orders of light at equal error: modes path and full against Mitsuba's volpath and volpathmis, in the same matter.

The matter is one grid of density with the phase function of matte spheres: thin smoke (grey, a mean free path deep) and
a dense white cloth (a plain weave of round yarns, several mean free paths each, albedo 0.94). Mitsuba has no cylinders,
so that the cloth is of spheres here. Walks a pixel are doubled until a picture's root mean square error, over the mean
where there is matter, is at most what was asked for; that picture is the row: its time, all of it. Nothing is
extrapolated. The truth is the mean of a long run of volpath and one of path, whose own noise is subtracted. Mode full
has no noise; its rows are its only picture, and one of another camera, for which nothing is solved again. CPU time of
all threads; kernels were compiled before. Leaves: out/bench/orders.json.

    python benchmarks/orders.py [--rounds 3] [--pixels 128] [--error 0.05]
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from turns import options, record

import hagoromo as hg
from hagoromo.backend import mitsuba
from hagoromo.image.full_picture import full_picture
from hagoromo.image.render import SceneCache, pixel_points

FOCAL, EYE, LAMP, INTENSITY = 2.2, (0.3, 0.5, 3.0), (2.0, 2.5, 2.0), 27.0
TRUTH = 8  # times the walks of the picture at the error that was asked for
MOST_WALKS = 1 << 14
FULL_RAYS = 4  # a pixel
Array = NDArray[np.float64]


class Matter(NamedTuple):
    """Density (z, y, x) in the cube −1…1 m, extinction of density 1 [1/m], albedo."""

    title: str
    density: NDArray[np.float32]
    tau: float
    albedo: float


def smoke(side: int = 64) -> Matter:
    """A soft ball of smooth noise."""
    from scipy.ndimage import gaussian_filter

    z, y, x = np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 3, indexing="ij")
    noise = gaussian_filter(np.random.default_rng(1).normal(size=x.shape), side / 24)
    ball = np.clip((0.9 - np.sqrt(x**2 + y**2 + z**2)) * 2.0, 0.0, 1.0)
    return Matter("thin smoke", (ball * np.exp(1.5 * noise / noise.std()) / 3.0).astype(np.float32), 1.0, 0.6)


def cloth(side: int = 96, yarns: int = 6) -> Matter:
    """A plain weave: yarns along x and y that go over and under each other."""
    z, y, x = np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 3, indexing="ij")
    pitch = 2.0 / yarns
    radius, wave = 0.42 * pitch, 0.22 * pitch
    density = np.zeros(x.shape, bool)
    for number in range(yarns):
        at, sign = (number + 0.5) * pitch - 1.0, (-1) ** number
        for along, across in ((x, y), (y, x)):
            turn = sign if along is x else -sign
            height = turn * wave * np.sin(math.pi * (along + 1.0) / pitch + math.pi / 2)
            density |= (across - at) ** 2 + (z - height) ** 2 < radius**2
    return Matter("dense white cloth", density.astype(np.float32), 40.0, 0.94)


def scene_of(matter: Matter, pixels: int, eye: tuple[float, float, float] = EYE) -> hg.Scene:
    """Ours: grey spheres under a point lamp."""
    grey = hg.Reflectance(matter.albedo / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    side, pose = matter.density.shape[0], np.eye(4)
    pose[:3, 3] = -1.0
    axes = np.zeros((*matter.density.shape, 3))
    box = hg.VolumeBox.from_arrays(matter.density, axes, 2.0 / side, matter.tau, [grey], pose=pose)
    focal, middle = FOCAL * pixels, pixels / 2
    camera = hg.Camera(pixels, pixels, (focal, focal), (middle, middle)).look_at(eye, (0, 0, 0), (0, 1, 0))
    return hg.Scene(camera, (hg.Lamp(position=LAMP, intensity=INTENSITY),), (box,))


def scene_of_mitsuba(matter: Matter, pixels: int, integrator: str) -> Any:
    """The same in Mitsuba's words."""
    mi = mitsuba()
    angle = np.arccos(-np.linspace(-1.0, 1.0, 361))
    phase = ",".join(f"{v:.9g}" for v in np.sin(angle) + (math.pi - angle) * np.cos(angle))
    place = mi.ScalarTransform4f().translate([-1.0] * 3).scale(2.0)
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid(matter.density[..., None]), "to_world": place, "raw": True}
    medium = {
        "type": "heterogeneous", "albedo": {"type": "constvolume", "value": matter.albedo}, "scale": matter.tau,
        "sigma_t": grid, "phase": {"type": "tabphase", "values": phase},
    }  # fmt: skip
    film = {"type": "hdrfilm", "width": pixels, "height": pixels, "component_format": "float32",
            "pixel_format": "rgb", "rfilter": {"type": "box"}}  # fmt: skip
    look = mi.ScalarTransform4f().look_at(list(EYE), [0, 0, 0], [0, 1, 0])
    fov = 2.0 * math.degrees(math.atan(0.5 / FOCAL))
    return mi.load_dict({
        "type": "scene", "integrator": {"type": integrator, "max_depth": -1, "rr_depth": 5},
        "sensor": {"type": "perspective", "fov": fov, "to_world": look, "near_clip": 0.01, "far_clip": 100.0,
                   "film": film, "sampler": {"type": "independent"}},
        "lamp": {"type": "point", "position": list(LAMP), "intensity": {"type": "rgb", "value": INTENSITY}},
        "box": {"type": "cube", "bsdf": {"type": "null"}, "interior": medium},
    })  # fmt: skip


def contenders(matter: Matter, pixels: int) -> dict[str, Callable[[int, int], Array]]:
    """Pictures by walks a pixel and seed."""
    mi, ours = mitsuba(), scene_of(matter, pixels)
    theirs = {name: scene_of_mitsuba(matter, pixels, name) for name in ("volpath", "volpathmis")}

    def path(walks: int, seed: int) -> Array:
        return radiance(hg.render(ours, hg.Settings(samples=walks, seed=seed), mode="path"))

    def by_mitsuba(name: str) -> Callable[[int, int], Array]:
        return lambda walks, seed: np.array(mi.render(theirs[name], spp=walks, seed=seed), float)[..., 1]

    return {"path": path} | {f"Mitsuba {name}": by_mitsuba(name) for name in theirs}


def radiance(image: hg.Image) -> Array:
    """At 550 nm."""
    return image.weights.astype(float) @ np.array([colour.at(550.0) for colour in image.palette.colours])


def measured(matter: Matter, pixels: int, error: float, rounds: int) -> list[dict[str, Any]]:
    """The rows of a matter."""
    pictures = contenders(matter, pixels)
    for picture in pictures.values():
        picture(1, 0)  # compiles
    first = {name: until(picture, error) for name, picture in pictures.items()}
    walks = {name: count for name, (count, _) in first.items()}
    long = {name: pictures[name](TRUTH * walks[name], 1000) for name in ("path", "Mitsuba volpath")}
    one, other = long.values()
    truth = 0.5 * (one + other)
    seen = truth > 0.02 * truth.max()
    own_noise = float(np.mean((one - other)[seen] ** 2)) / 4.0

    def off(picture: Array) -> float:
        return math.sqrt(max(float(np.mean((picture - truth)[seen] ** 2)) - own_noise, 0.0)) / float(truth[seen].mean())

    times: dict[str, list[float]] = {name: [] for name in pictures}
    errors: dict[str, list[float]] = {name: [] for name in pictures}
    for turn in range(rounds):
        for name, picture in pictures.items():
            taken, values = cpu(lambda: picture(walks[name], 1 + turn))  # noqa: B023
            times[name].append(taken)
            errors[name].append(off(values))
    rows = [
        {
            "matter": matter.title, "by": name, "walks": walks[name], "error": float(np.median(errors[name])),
            "cpu_s": float(np.median(times[name])),
            "mean": float(long.get(name, truth)[seen].mean() / truth[seen].mean()),
        }
        for name in pictures
    ]  # fmt: skip
    return rows + full_rows(matter, pixels, off, truth[seen], seen)


def full_rows(matter: Matter, pixels: int, off: Callable[[Array], float], truth: Array, seen: Any) -> list[dict]:
    """Mode full: solved and marched, and marched from elsewhere."""
    scene, settings = scene_of(matter, pixels), hg.Settings(FULL_RAYS)
    points, cache = pixel_points(FULL_RAYS, 0), SceneCache()
    full_picture(scene, settings, points, SceneCache())  # compiles
    taken, image = cpu(lambda: full_picture(scene, settings, points, cache))
    turned = scene.with_camera(scene_of(matter, pixels, (-1.5, 0.5, 2.6)).camera)
    again, _ = cpu(lambda: full_picture(turned, settings, points, cache))
    march, _ = cpu(lambda: hg.render(scene, settings))
    values, share = radiance(image), image.metadata["field"]["bytes"] / scene.boxes[0].bricks.bytes
    common = {"matter": matter.title, "walks": FULL_RAYS}
    return [
        common | {"by": "full", "error": off(values), "cpu_s": taken, "mean": float(values[seen].mean() / truth.mean()),
                  "memory": share},
        common | {"by": "full, another camera", "cpu_s": again, "march_s": march},
    ]  # fmt: skip


def until(picture: Callable[[int, int], Array], error: float) -> tuple[int, float]:
    """Fewest walks a pixel, a power of two, whose error is below `error`: from the difference of two pictures."""
    walks = 4
    while True:
        one, other = picture(walks, 101), picture(walks, 202)
        mean = 0.5 * (one + other)
        seen = mean > 0.02 * np.percentile(mean, 99.0)
        noise = math.sqrt(0.5 * float(np.mean((one - other)[seen] ** 2))) / float(mean[seen].mean())
        if noise <= error or walks >= MOST_WALKS:
            return walks, noise
        walks *= 2


def cpu(frame: Callable[[], Any]) -> tuple[float, Any]:
    """CPU time of all threads [s], and the result."""
    begin = time.process_time()
    result = frame()
    dr.sync_thread()
    return time.process_time() - begin, result


def main() -> None:
    """Measure both matters."""
    parser = options(__doc__, 3)
    parser.add_argument("--pixels", type=int, default=128)
    parser.add_argument("--error", type=float, default=0.05)
    given = parser.parse_args()
    rows = []
    for matter in (smoke(), cloth()):
        rows += measured(matter, given.pixels, given.error, given.rounds)
        for row in rows[-5:]:
            print(row, flush=True)
    figures = {"pixels": given.pixels, "error": given.error, "rounds": given.rounds, "seeds": "1, 2, …", "rows": rows}
    record("orders", figures)


if __name__ == "__main__":
    main()
