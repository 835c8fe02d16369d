"""Scenes of rough matter, which changes from voxel to voxel: errors and CPU times of their frames.

KERNEL's noisy ball, and small pieces of the shipped recipes, under three lamps that move: every frame makes medium and
maps anew. An error is root mean square over the mean, where there is matter, against a fine march of the same version
through strips of the picture. This file asks so little of the package that version 0.2.0 runs it, too:

    python benchmarks/rough_scenes.py --keep MATTER                      # voxels, for a version without such recipes
    PYTHONPATH=CHECKOUT python benchmarks/rough_scenes.py --matter MATTER [--scene skin]

With --seconds there is no yardstick: for checkouts that take turns on one machine.
"""

from __future__ import annotations

import argparse
import time
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

ROOT = Path(__file__).parents[1]
OWN_RECIPES = Path(hg.__file__).parents[1] / "examples/recipes"
BOXES = ROOT / "out/bench/boxes"  # built once
FINEST = 0.0025  # tolerance of the reference: a sixteenth of the usual one
STRIPS, ROWS = 16, 4  # of the picture that are compared, and rows of each
COMPARED = 0.6  # of the height of the picture, around its middle, over which they are spread
TEXELS = ("linen", "satin", "stockinette")  # which a version builds by its own recipes
RECIPES: dict[str, dict[str, Any]] = {  # what differs from the shipped recipe, so that building takes seconds
    "skin": {"size_mm": 8.0},
    "linen": {"width_mm": 10.0, "height_mm": 10.0},
    "satin": {"width_mm": 6.0, "height_mm": 6.0},
    "stockinette": {"width_mm": 14.0, "height_mm": 14.0},
    "primary": {"resolution": 0.5},
    "hair": {"resolution": 0.4},
    "wing": {"resolution": 0.25},
}
ELEMENTS: dict[str, Any] = {"skin": "sphere", "primary": "cylinder", "hair": "cylinder", "wing": "cylinder"}
NOISY = "noisy ball"
NAMES = (NOISY, *RECIPES)
VIEW = np.array([0.35, -1.0, 0.3])  # from the middle of the matter to the eye
LAMPS = np.array([[-1.2, -1.6, 1.0], [1.5, -1.2, 0.6], [0.3, -1.0, 1.8]])  # [radii], from the middle
Array = NDArray[Any]


class RoughScene(NamedTuple):
    """A box with its eye, its lamps and its picture; focal: length in widths of the picture."""

    box: hg.VolumeBox
    middle: Array
    eye: Array
    up: Array
    lamps: Array
    intensity: float
    focal: float
    pixels: int

    def scene(self, turn: float = 0.0, rows: range | None = None) -> hg.Scene:
        """With the lamps turned about z [rad]; rows: of the picture that are seen, all if None."""
        rows = rows or range(self.pixels)
        focal, half = self.focal * self.pixels, 0.5 * self.pixels
        camera = hg.Camera(self.pixels, len(rows), (focal, focal), (half, half - rows.start))
        cosine, sine = np.cos(turn), np.sin(turn)
        places = (self.lamps - self.middle) @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + self.middle
        lamps = tuple(hg.Lamp(position=p, intensity=self.intensity, spectrum=hg.Spectrum.constant(1.0)) for p in places)
        return hg.Scene(camera.look_at(self.eye, self.middle, self.up), lamps, (self.box,))

    def strips(self) -> list[range]:
        """The rows that are compared."""
        middles = 0.5 + COMPARED * ((np.arange(STRIPS) + 0.5) / STRIPS - 0.5)
        starts = (middles * self.pixels).astype(int) // ROWS * ROWS
        return [range(start, start + ROWS) for start in starts]

    def reference(self) -> tuple[Array, Array]:
        """Weights of the compared rows by the fine march, and where they show matter."""
        fine = hg.Settings(shadows="march", tolerance=FINEST)
        images = [hg.render(self.scene(0.0, rows), fine) for rows in self.strips()]
        return tuple(np.concatenate([getattr(one, key) for one in images]) for key in ("weights", "alpha"))  # type: ignore[return-value]

    def error(self, settings: hg.Settings, reference: tuple[Array, Array]) -> float:
        """Root mean square difference from the reference over its mean, where there is matter."""
        (true, alpha), rows = reference, np.concatenate(self.strips())
        seen = hg.render(self.scene(), settings).weights[rows].sum(axis=-1)
        true, matter = true.sum(axis=-1), alpha > 0.0
        return float(np.sqrt(np.mean((seen - true)[matter].astype(float) ** 2)) / true[matter].mean())


def rough(name: str, box: hg.VolumeBox) -> RoughScene:
    """A scene of this name."""
    if name == NOISY:
        from peers_scene import EYE, FOCAL, INTENSITY
        from peers_scene import LAMPS as PLACES

        return RoughScene(
            box, np.zeros(3), np.array(EYE), np.array([0.0, 1, 0]), np.array(PLACES), INTENSITY, FOCAL, 512
        )
    unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners = unit * box.size @ box.pose[:3, :3].T + box.pose[:3, 3]
    middle = corners.mean(axis=0)
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    eye = middle + 6.0 * radius * VIEW / np.linalg.norm(VIEW)
    lamps, intensity = middle + 3.0 * radius * LAMPS / np.linalg.norm(LAMPS, axis=1)[:, None], 9.0 * radius**2
    return RoughScene(box, middle, eye, np.array([0.0, 0, 1]), lamps, intensity, 3.4, 256)


def noisy_ball() -> hg.VolumeBox:
    """KERNEL's ball, see march.py."""
    from peers_scene import TAU, VOXEL, noisy_voxels

    voxels, pose = noisy_voxels(), np.eye(4)
    pose[:3, 3] = -1.0
    matter = hg.Reflectance(0.25, 0.3, 0.2, 1.5, hg.Spectrum.constant(1.0))
    return hg.VolumeBox.from_arrays(voxels[..., 0], voxels[..., 1:], VOXEL, TAU["ball"], [matter], pose=pose)


def built(name: str, folder: Path = BOXES) -> hg.VolumeBox:
    """The box of a scene, kept in `folder` once it is built."""
    if name == NOISY:
        return noisy_ball()
    kept = folder / f"{name}.zarr"
    if not kept.exists():
        folder.mkdir(parents=True, exist_ok=True)
        recipe = tomllib.loads((OWN_RECIPES / f"{name}.toml").read_text(encoding="utf-8")) | RECIPES[name]
        box = hg.build(recipe)
        if not hasattr(box, "save"):  # 0.2.0
            return box
        box.save(kept)
    return hg.VolumeBox.load(kept)


def keep_voxels(folder: Path) -> None:
    """Write the voxels of the boxes without texels, which any version reads."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in NAMES:
        if name == NOISY or name in TEXELS:
            continue
        box = built(name)
        density, axis = box.bricks.dense()
        held = {"density": density, "axis": axis, "voxel_size": box.voxel_size, "tau": box.tau, "pose": box.pose}
        if box.bricks.material is not None:
            held["material"] = dense_material(box.bricks)
        np.savez_compressed(folder / f"{name}.npz", **held)


def dense_material(bricks: Any) -> Array:
    """Material numbers (z, y, x) of bricks."""
    full = np.zeros([8 * m + 1 for m in bricks.lattice], np.uint8)
    for (z, y, x), part in zip(bricks.corners(), bricks.read(0, bricks.kept)["material"], strict=True):
        full[z : z + 9, y : y + 9, x : x + 9] = part
    return full[tuple(slice(n) for n in bricks.shape)]


def from_voxels(name: str, folder: Path) -> hg.VolumeBox:
    """The box of kept voxels; its reflectances are alike but for their colour, of which errors are no question."""
    if name == NOISY or name in TEXELS:
        return built(name, folder)
    with np.load(folder / f"{name}.npz") as held:
        material = held.get("material")
        plain = hg.Reflectance(0.26, 0.35, 0.3, 1.5, hg.Spectrum.constant(0.6), element=ELEMENTS[name])
        materials = [plain] * (1 if material is None else int(material.max()) + 1)
        return hg.VolumeBox.from_arrays(
            held["density"].astype(np.float32), held["axis"].astype(np.float32), float(held["voxel_size"]),
            float(held["tau"]), materials, material, pose=held["pose"],
        )  # fmt: skip


def measured(
    scene: RoughScene, settings: Sequence[hg.Settings], yardstick: Callable[[], Any] | None, rounds: int
) -> list[dict]:
    """Of every setting: CPU time of a frame [s], the same over that of the yardstick between them, and error.

    yardstick: None for none; times over it are NaN then.
    """
    reference = scene.reference()
    errors = [scene.error(each, reference) for each in settings]
    times, yards = [[] for _ in settings], [float("nan")] if yardstick is None else []
    for number in range(rounds):
        lit = scene.scene(0.05 * (number + 1))
        for each, taken in zip(settings, times, strict=True):
            if yardstick is not None:
                yards.append(cpu_seconds(yardstick))
            taken.append(cpu_seconds(lambda each=each, lit=lit: hg.render(lit, each)))
    yard = float(np.median(yards))
    return [
        {
            "shadows": each.shadows, "tolerance": each.tolerance, "error": error,
            "cpu_s": float(np.median(taken)), "time": float(np.median(taken)) / yard,
        }
        for each, taken, error in zip(settings, times, errors, strict=True)
    ]  # fmt: skip


def cpu_seconds(frame: Callable[[], Any]) -> float:
    """CPU time of all threads of the process in one frame [s]."""
    start = time.process_time()
    frame()
    return time.process_time() - start


def numba_yardstick() -> Callable[[], Any]:
    """Numba's march of the peers' ball in 64² pixels, half a voxel a step: it has no code of ours."""
    import tempfile

    from peers_numba import frames
    from peers_scene import STUDIES, PeerScene, make_matter

    study = next(s for s in STUDIES if s.name == "ball, 1 lamp, 64 px")
    with tempfile.TemporaryDirectory() as name:
        make_matter(Path(name))
        scene = PeerScene(study, Path(name))
        frame = frames(scene)["step 0.5 voxel"]
        frame()
    return frame


def main() -> None:
    """Print what this version of the package gives, or keep voxels for another one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--matter", type=Path)
    parser.add_argument("--scene", action="append", choices=NAMES)
    parser.add_argument("--tolerances", type=float, nargs="+", default=[0.16, 0.08, 0.04, 0.02])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", action="store_true")
    given = parser.parse_args()
    if given.keep:
        keep_voxels(given.keep)
        return
    yardstick = None if given.seconds else numba_yardstick()
    settings = [hg.Settings(tolerance=t) for t in given.tolerances]
    for name in given.scene or NAMES:
        box = from_voxels(name, given.matter) if given.matter else built(name)
        for row in measured(rough(name, box), settings, yardstick, given.rounds):
            print(f'    ("{name}", "{row["shadows"]}", {row["tolerance"]:g}, {row["time"]:.3f}, {row["error"]:.5f}),'
                  f"  # {row['cpu_s']:.3f} CPU s", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
