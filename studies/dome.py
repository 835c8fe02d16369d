"""A small simulated dome: JPEG files of an object and a chrome ball, one lamp on in each, as a heritage laboratory has.

    python -m studies.dome --out dome --lamps 48

Output: photographs/ (sRGB with EXIF), dome.lp (direction of every lamp), ball.png (mask of the chrome ball),
correction.png (black on the ball, grey elsewhere), and truth/normals.exr.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import hagoromo as hg
from hagoromo.camera.camera import unplaced_camera
from studies.command import command

Array = NDArray[np.float64]
OBJECT, BALL = ((0.14, 0.0, 0.0), 0.24), ((-0.32, 0.05, 0.0), 0.12)  # centre and radius, in picture widths
FOCAL_MM, SENSOR_MM = 85.0, 36.0
ALBEDO = (0.55, 0.42, 0.28)
LAMP_RADIUS = 0.06  # [rad] of the lamps in their reflectors
RAYS_PER_AXIS = 3  # rays of a pixel along each axis
EXPOSURE_TAG, ISO_TAG, FOCAL_TAG, FILM_TAG, INNER = 0x829A, 0x8827, 0x920A, 0xA405, 0x8769


def dome_lamps(count: int) -> Array:
    """(count, 3) directions, x right, y up, z to the camera, evenly over the dome from 20° to 75° above its floor."""
    up = np.arcsin(np.linspace(np.sin(np.radians(20.0)), np.sin(np.radians(75.0)), count))
    around = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    return np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)


def dome(out: str | Path, lamps: int = 48, width: int = 240, seed: int = 0, force: bool = False) -> Path:
    """Photograph an object and a chrome ball under `lamps` lamps with a camera of `width` pixels."""
    with hg.whole_folder(out, force) as home:
        height = 2 * width // 3
        camera = unplaced_camera(width, height, FOCAL_MM / SENSOR_MM * width)
        eye = camera.unproject(_fine(width, height))
        body, ball = _sphere(camera.position, eye, *OBJECT), _sphere(camera.position, eye, *BALL)
        random, directions = np.random.default_rng(seed), dome_lamps(lamps)
        for folder in ("photographs", "truth"):
            (home / folder).mkdir()
        for number, to_lamp in enumerate(directions):
            light = _means(_light(body, ball, eye, to_lamp)) + random.normal(0.0, 0.002, (height, width, 3))
            _save(home / "photographs" / f"{number:02d}.jpg", light)
        rows = [f"{k:02d}.jpg {x:.6f} {y:.6f} {z:.6f}" for k, (x, y, z) in enumerate(directions)]
        (home / "dome.lp").write_text("\n".join([str(lamps), *rows]) + "\n", encoding="utf-8")
        middle = np.s_[RAYS_PER_AXIS // 2 :: RAYS_PER_AXIS, RAYS_PER_AXIS // 2 :: RAYS_PER_AXIS]
        ball, body = ball[middle], body[middle]
        on_ball, on_body = (np.linalg.norm(normal, axis=2) > 0.5 for normal in (ball, body))
        hg.write_png(home / "ball.png", on_ball.astype(np.uint8) * 255)
        hg.write_png(home / "correction.png", np.where(_grown(on_ball), 0, 128).astype(np.uint8))
        layers = {f"N.{axis}": (body[..., k] * on_body).astype(np.float32) for k, axis in enumerate("XYZ")}
        hg.write_exr(home / "truth" / "normals.exr", layers)
    return Path(out)


def _fine(width: int, height: int) -> Array:
    row, column = (np.mgrid[: height * RAYS_PER_AXIS, : width * RAYS_PER_AXIS] + 0.5) / RAYS_PER_AXIS
    return np.stack([column, row], axis=-1)


def _means(fine: Array) -> Array:
    """(h, w, 3) means over the rays of each pixel."""
    height, width = (size // RAYS_PER_AXIS for size in fine.shape[:2])
    return fine.reshape(height, RAYS_PER_AXIS, width, RAYS_PER_AXIS, 3).mean(axis=(1, 3))


def _sphere(eye: Array, ray: Array, centre: tuple[float, float, float], radius: float) -> Array:
    """(h, w, 3) normal where the rays meet a sphere, 0 elsewhere."""
    offset = np.array(centre) - eye
    along = ray @ offset
    root = along**2 - offset @ offset + radius**2
    normal = (ray * (along - np.sqrt(np.maximum(root, 0.0)))[..., None] - offset) / radius
    return np.where(root[..., None] > 0.0, normal, 0.0)


def _light(body: Array, ball: Array, ray: Array, to_lamp: Array) -> Array:
    """(h, w, 3) light: a matte object with a broad gloss, the lamp in the chrome ball, a dark cloth."""
    on_body, on_ball = (np.linalg.norm(normal, axis=2, keepdims=True) > 0.5 for normal in (body, ball))
    cosine = np.maximum(body @ to_lamp, 0.0)[..., None]
    half = to_lamp - ray
    half /= np.linalg.norm(half, axis=2, keepdims=True)
    angle = np.arccos(np.clip(np.sum(body * half, axis=2), -1.0, 1.0))[..., None]
    matte = cosine * np.array(ALBEDO) + 0.1 * np.exp(-((angle / 0.2) ** 2)) * (cosine > 0.0)
    mirrored = ray - 2.0 * np.sum(ball * ray, axis=2, keepdims=True) * ball
    off = np.arccos(np.clip(mirrored @ to_lamp, -1.0, 1.0))[..., None]
    chrome = 0.05 + 0.05 * np.exp(-((off / 0.2) ** 2)) + 8.0 * (off < LAMP_RADIUS)
    return np.where(on_body, matte, np.where(on_ball, chrome, 0.01 * to_lamp[2]))


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(mask, iterations=4), np.bool_)


def _save(path: Path, light: Array) -> None:
    exif = Image.Exif()
    exif.get_ifd(INNER).update({EXPOSURE_TAG: 0.125, ISO_TAG: 100, FOCAL_TAG: FOCAL_MM, FILM_TAG: round(FOCAL_MM)})
    picture = Image.fromarray(hg.srgb_encode(np.clip(light, 0.0, 1.0)))
    picture.save(path, quality=97, subsampling=0, exif=exif)


def main(out: Path, lamps: int = 48, width: int = 240, seed: int = 0, force: bool = False) -> None:
    """Simulate the dome.

    Args:
        out: folder to write.
        lamps: how many.
        width: of the photographs [px].
        seed: of the noise.
        force: replace an existing folder.
    """
    print(f"wrote {dome(out, lamps, width, seed, force)}")


if __name__ == "__main__":
    command(main)
