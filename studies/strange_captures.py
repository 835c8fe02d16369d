"""Captures as strangers bring them: other shapes, masks that are wrong, backgrounds, units, lamps and files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import hagoromo as hg
from hagoromo.files.png import write_png
from hagoromo.matter import shape as sd
from hagoromo_recovery.outline.hull import signed_distance
from studies.recover_scenes import DISTANCE, Shots, Simulated, TrueObject, around, photograph_of

Array = NDArray[np.float64]
Background = Callable[[int, np.random.Generator], Array]  # light (pixels, pixels, 3) of what is behind the object


class Mug(TrueObject):
    """A cup with a wall of 4 mm and a handle: its inside shows in no silhouette."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        outside = upright(p, 0.026, 0.032, 0.0)
        inside = upright(p, 0.022, 0.032, 0.004)
        x, z = p.x - 0.028, p.z
        ring = dr.sqrt(x * x + z * z) - 0.016
        handle = dr.sqrt(ring * ring + p.y * p.y) - 0.004
        return dr.fmax(dr.fmin(outside, handle), -inside)


class WhiteObject(TrueObject):
    """A matt white object."""

    def __init__(self) -> None:
        super().__init__(beta=0.0, flat=True)

    def colours(self, p: Any) -> list[Any]:
        """The body colour."""
        return [0.8 + 0.0 * p.x] * 3


class Bowl(WhiteObject):
    """A white bowl, whose inside lights itself."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]: a shell of 4 mm, cut off above its middle."""
        shell = dr.abs(dr.norm(p) - 0.03) - 0.002
        return dr.fmax(shell, p.z - 0.008)


class WhiteMug(WhiteObject):
    """A white mug: its inside lights itself, and shows in no silhouette."""

    distance = Mug.distance


class TouchingBalls(WhiteObject):
    """Two white balls that touch each other."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return dr.fmin(sd.sphere(p, (-0.022, 0.0, 0.0), 0.022), sd.sphere(p, (0.022, 0.0, 0.0), 0.022))


class HollowCorner(WhiteObject):
    """A white block from which one eighth is cut out: three faces that meet in a corner light each other."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        block = sd.rounded_box(p, (0.0, 0.0, 0.0), (0.0303, 0.0303, 0.0303), 0.002)
        return dr.fmax(block, -sd.rounded_box(p, (0.0303, 0.0303, 0.0303), (0.0303, 0.0303, 0.0303), 0.002))


class MattBall(TrueObject):
    """A matt ball with patterns: nothing lights itself."""

    def __init__(self) -> None:
        super().__init__(beta=0.0)

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return sd.sphere(p, (0.0, 0.0, 0.0), 0.035)


class ThinPlate(TrueObject):
    """A plate 3 mm thick."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return sd.rounded_box(p, (0.0, 0.0, 0.0), (0.042, 0.03, 0.0015), 0.0005)


class Cube(TrueObject):
    """A cube with sharp edges."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return sd.rounded_box(p, (0.0, 0.0, 0.0), (0.026, 0.026, 0.026), 0.0005)


def upright(p: Any, radius: float, half: float, lift: float) -> Any:
    """Signed distance [m] to a cylinder about the z axis."""
    across, along = dr.sqrt(p.x * p.x + p.y * p.y) - radius, dr.abs(p.z - lift) - half
    x, z = dr.fmax(across, 0.0), dr.fmax(along, 0.0)
    return dr.fmin(dr.fmax(across, along), 0.0) + dr.sqrt(x * x + z * z)


def dark(pixels: int, random: np.random.Generator) -> Array:
    """Nothing."""
    return np.zeros((pixels, pixels, 3))


def even(pixels: int, random: np.random.Generator) -> Array:
    """A grey wall."""
    return np.full((pixels, pixels, 3), 0.25)


def textured(pixels: int, random: np.random.Generator) -> Array:
    """A wall with spots of all sizes, about as bright as the object."""
    noise = np.zeros((pixels, pixels, 3))
    for size in (1.0, 3.0, 9.0):
        noise += size * ndimage.gaussian_filter(random.normal(0.0, 1.0, noise.shape), (size, size, 0))
    return 0.25 * np.exp(0.5 * noise / noise.std())


def behind(taken: Simulated, background: Background, seed: int = 0) -> Simulated:
    """The same photographs before a background."""
    random, photographs = np.random.default_rng(seed), []
    for k, (p, light, share) in enumerate(zip(taken.capture.photographs, taken.exact, taken.shares, strict=True)):
        whole = light + (1.0 - share)[..., None] * background(p.camera.width, random)
        photographs.append(photograph_of(whole, share, p.camera, p.lamps[0], random, k))
    return replace(taken, capture=replace(taken.capture, photographs=tuple(photographs)))


def masks_moved(taken: Simulated, pixels: float) -> Simulated:
    """The same with masks whose outline stands so many pixels further out, or in."""

    def moved(p: hg.Photograph) -> hg.Photograph:
        assert p.silhouette is not None
        mask = signed_distance(p.silhouette) < pixels
        clipped = p.silhouette & ~p.mask
        return replace(p, silhouette=mask, mask=mask & ~clipped)

    photographs = tuple(moved(p) for p in taken.capture.photographs)
    return replace(taken, capture=replace(taken.capture, photographs=photographs))


def resized(taken: Simulated, factor: float, strengths: bool = True) -> Simulated:
    """The same object and rig, larger by a factor. strengths: whether those of the lamps grow with its square, so that
    photographs are the same.
    """

    def grown(p: hg.Photograph) -> hg.Photograph:
        pose = p.camera.world_to_camera.copy()
        pose[:3, 3] *= factor
        by = factor**2 if strengths else 1.0
        lamps = tuple(
            replace(lamp, position=factor * lamp.place, intensity=by * float(np.mean(lamp.intensity)))
            for lamp in p.lamps
        )
        return replace(p, camera=p.camera.with_pose(pose), lamps=lamps)

    photographs = tuple(grown(p) for p in taken.capture.photographs)
    capture = replace(taken.capture, photographs=photographs)
    return replace(taken, capture=capture, points=[factor * each for each in taken.points])


def together(taken: Simulated, count: int) -> Simulated:
    """The same with `count` lamps in each photograph: those that follow each other, of one view."""
    exact = [np.sum(taken.exact[k : k + count], axis=0) for k in range(0, len(taken.exact), count)]
    photographs = []
    for k, light in enumerate(exact):
        first = count * k
        lamps = tuple(p.lamps[0] for p in taken.capture.photographs[first : first + count])
        p, random = taken.capture.photographs[first], np.random.default_rng(k)
        photographs.append(
            replace(photograph_of(light, taken.shares[first], p.camera, lamps[0], random, k), lamps=lamps)
        )
    capture = replace(taken.capture, photographs=tuple(photographs))
    return Simulated(capture, exact, taken.normals[::count], taken.points[::count], shares=taken.shares[::count])


def flash_beside(count: int, pixels: int, aside: float = 0.05) -> Shots:
    """Views with a flash so far [m] to the right of the camera."""
    views = around(count, turn=0.7)
    right = np.cross([0.0, 0.0, 1.0], views)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return Shots(views, [(DISTANCE * v + aside * r)[None] for v, r in zip(views, right, strict=True)], pixels)


def lamps_changed(taken: Simulated, change: Callable[[hg.Photograph], tuple[hg.Lamp, ...]]) -> Simulated:
    """The same photographs with other statements of lamps."""
    photographs = tuple(replace(p, lamps=change(p)) for p in taken.capture.photographs)
    return replace(taken, capture=replace(taken.capture, photographs=photographs))


def at_the_camera(p: hg.Photograph) -> tuple[hg.Lamp, ...]:
    """A lamp that is stated at the camera."""
    lamp = p.lamps[0]
    return (replace(lamp, position=np.array(p.camera.position)),)


def unlit(taken: Simulated, which: Callable[[int], bool]) -> Simulated:
    """The same where some photographs show noise alone, of a lamp that did not flash."""
    random, photographs = np.random.default_rng(5), []
    for k, p in enumerate(taken.capture.photographs):
        noise = np.abs(random.normal(0.0, np.sqrt(np.median(p.variance)), p.values.shape)).astype(np.float32)
        photographs.append(replace(p, values=noise) if which(k) else p)
    return replace(taken, capture=replace(taken.capture, photographs=tuple(photographs)))


def in_files(taken: Simulated, folder: Path, bits: int) -> Simulated:
    """The same through files: PNG of 8 bits, display-encoded, or of 16 bits, linear; with masks and transforms.json."""
    photographs = taken.capture.photographs
    white = max(float(p.values.max()) for p in photographs)
    lamps = lamps_changed(
        taken,
        lambda p: tuple(replace(lamp, intensity=float(np.mean(lamp.intensity)) / white) for lamp in p.lamps),
    )
    lamps.capture.save(folder, force=True)
    record = json.loads((folder / "transforms.json").read_text(encoding="utf-8"))
    for k, (frame, p) in enumerate(zip(record["frames"], photographs, strict=True)):
        shown = np.clip(p.values / white, 0.0, 1.0)
        name, srgb = f"images/{k:04d}.png", bits == 8
        (folder / frame["file_path"]).unlink()
        write_png(folder / name, hg.srgb_encode(shown) if srgb else np.rint(shown * 65535.0).astype(np.uint16))
        frame.pop("sensor", None)
        frame.update({"file_path": name} | ({"transfer": "srgb"} if srgb else {}))
    (folder / "transforms.json").write_text(json.dumps(record), encoding="utf-8")
    aside = [each / white for each in taken.exact]
    return replace(lamps, capture=hg.load_capture(folder), exact=aside)
