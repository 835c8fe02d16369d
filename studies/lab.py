"""A small simulated laboratory: photographs of a board, a chart and a chrome ball by one camera, with one lamp.

    python -m studies.lab --out lab

Output: board/ and ball/ (8-bit pictures of the camera), chart.png and object/ (raw mosaic numbers as 16-bit PNG),
ball_mask.png, lamp.csv (spectrum of the lamp), and truth/, the ground truth. Photographs with the same number in ball/
and object/ have the same position of the lamp.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.command import command

Array = NDArray[np.float64]
LENS = (-0.3, 0.5, 0.0, 0.0, 0.0)  # k1 k2 p1 p2 k3: 1 % in the corners of so narrow a view
SPECTRUM = "A"  # of the lamp: a halogen bulb
FAR, AWAY = 4.0, 0.6  # m: from the object to the lamp, and to the camera
LAMP_PLACES = ((20, 0), (25, 60), (22, 120), (26, 180), (21, 240), (24, 300), (48, 30), (46, 150), (50, 270))  # °
BOARD, SQUARE = (9, 6), 0.02  # inner corners; m
BALL_RADIUS = 0.035  # m
RAYS_PER_AXIS = 3  # rays a pixel along each axis


def lab_camera(width: int) -> hg.Camera:
    """A camera at the world's origin that looks along +z, x right, y down; `width` and two thirds of it in pixels."""
    height, focal = 2 * width // 3, 3.2 * width
    return hg.Camera(
        width, height, (focal, 1.001 * focal), (0.507 * width, 0.492 * height), LENS,
        response=hg.Response.load("Nikon 5100 (NPL)"), sensor=lab_sensor(), name="lab",
    )  # fmt: skip


def lab_sensor() -> hg.Sensor:
    """The sensor of the Canon EOS 300D."""
    sensor = hg.Camera.preset("canon_eos_kiss_digital").sensor
    assert sensor is not None
    return sensor


def lamps() -> list[hg.Lamp]:
    """The lamp in its places: angles from the line of sight and around it."""
    spectrum = hg.Spectrum.named(SPECTRUM)
    placed = []
    for number, (off, around) in enumerate(np.radians(LAMP_PLACES)):
        towards = np.array([np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), -np.cos(off)])
        place = np.array([0.0, 0.0, AWAY]) + FAR * towards
        placed.append(hg.Lamp(position=place, intensity=np.pi * FAR**2, spectrum=spectrum, name=f"{number}"))
    return placed


def lab(out: str | Path, width: int = 480, seed: int = 0, force: bool = False) -> Path:
    """Photograph everything with a camera of `width` pixels, and write it to the folder `out`."""
    with hg.whole_folder(out, force) as home:
        camera, lit = lab_camera(width), lamps()
        assert camera.response is not None
        bright = float(hg.camera_white(lit[0].spectrum, camera.response).max())
        sensor = lab_sensor().metered(bright, 0.9)  # white where the chart stands nearly fills the range
        for folder in ("board", "ball", "object", "truth"):
            (home / folder).mkdir()
        random = np.random.default_rng(seed)
        for number in range(10):
            grey = _board(camera, random)[..., None] * 0.8 + 0.002 * random.normal(size=(camera.height, width, 1))
            hg.write_png(home / "board" / f"{number}.png", hg.srgb_encode(np.repeat(grey, 3, axis=2)))
        hg.write_png(home / "chart.png", hg.expose_raw(_chart(camera, lit[0].spectrum), sensor, seed))
        scene = hg.Scene(camera, tuple(lit), surfaces=_object(camera.response, lit[0].spectrum))
        rays = _on_ball(camera)
        for number, lamp in enumerate(lit):
            image = hg.render(scene.with_lamps(lamp), hg.Settings(samples=RAYS_PER_AXIS)).expose(camera.response)
            hg.write_png(home / "object" / f"{number}.png", hg.expose_raw(image, sensor, seed + 100 + number))
            ball = _ball(rays, lamp) + 0.002 * random.normal(size=(camera.height, width))
            hg.write_png(home / "ball" / f"{number}.png", hg.srgb_encode(np.repeat(ball[..., None], 3, axis=2)))
        hg.write_png(home / "ball_mask.png", np.rint(255.0 * _means(rays[0])).astype(np.uint8))
        wavelengths = np.arange(380.0, 731.0, 5.0)
        hg.write_table(home / "lamp.csv", {"wavelength_nm": wavelengths, SPECTRUM: lit[0].spectrum.at(wavelengths)})
        _write_truth(home / "truth", scene, sensor)
    return Path(out)


def _board(camera: hg.Camera, random: np.random.Generator) -> Array:
    """(h, w) light of the board in a random place before the camera, the picture filled."""
    middle = np.array([(BOARD[0] - 1) / 2, (BOARD[1] - 1) / 2, 0.0]) * SQUARE
    tilt, around, roll = random.uniform(0.3, 0.8), random.uniform(0.0, 2.0 * np.pi), random.normal(0.0, 0.2)
    away = random.uniform(1.25, 1.5) * (BOARD[0] + 1) * SQUARE * camera.focal[0] / camera.width
    eye = middle + away * np.array([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), -np.cos(tilt)])
    aim = middle + 0.3 * SQUARE * random.normal(size=3)
    square = _on_plane(camera.look_at(eye, aim, (np.sin(roll), -np.cos(roll), 0.0))) / SQUARE + 1.0
    column, row = np.floor(square[..., 0]), np.floor(square[..., 1])
    inside = (column >= 0) & (row >= 0) & (column <= BOARD[0]) & (row <= BOARD[1])
    return _means(np.where(inside & ((column + row) % 2 == 0), 0.03, 0.8))


def _chart(camera: hg.Camera, lamp: hg.Spectrum) -> Array:
    """(h, w, 3) ρ of a chart of 24 patches where the object stands, facing camera and lamp."""
    assert camera.response is not None
    patches = np.array([hg.camera_response(patch, lamp, camera.response) for patch in hg.chart_spectra()])
    cell, gap = 0.9 * AWAY * camera.width / camera.focal[0] / 6.2, 0.1
    size = np.array([6.0, 4.0]) * cell
    towards = camera.look_at((0.5 * size[0], 0.5 * size[1], -AWAY), (0.5 * size[0], 0.5 * size[1], 0.0), (0.05, -1, 0))
    patch = _on_plane(towards) / cell
    column, row = np.floor(patch[..., 0]).astype(int), np.floor(patch[..., 1]).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < 6) & (row < 4)
    within = inside & (np.abs(patch - np.floor(patch) - 0.5) < 0.5 - 0.5 * gap).all(axis=-1)
    frame = (patch > -gap).all(axis=-1) & (patch[..., 0] < 6 + gap) & (patch[..., 1] < 4 + gap)
    reads = hg.camera_white(lamp, camera.response)
    table = np.where(frame[..., None], 0.03, 0.35) * reads
    fine = np.where(within[..., None], patches[np.where(within, 6 * row + column, 0)], table)
    return np.stack([_means(fine[..., channel]) for channel in range(3)], axis=2)


def _on_plane(camera: hg.Camera) -> Array:
    """(RAYS_PER_AXIS h, RAYS_PER_AXIS w, 2) where the camera's rays meet z = 0 [m]."""
    direction = camera.unproject(_fine(camera))
    return camera.position[:2] - direction[..., :2] * (camera.position[2] / direction[..., 2])[..., None]


def _object(response: hg.Response, lamp: hg.Spectrum) -> tuple[hg.Surface, ...]:
    """A gourd of two materials, its axis across the line of sight."""
    knots = (380.0, 450.0, 500.0, 550.0, 600.0, 650.0, 730.0)
    ochre = hg.Spectrum(knots, (0.10, 0.14, 0.25, 0.45, 0.62, 0.68, 0.70))
    green = hg.Spectrum(knots, (0.08, 0.14, 0.32, 0.42, 0.28, 0.20, 0.35))
    low = hg.Reflectance(1.0 / np.pi, 0.25, 0.22, 1.5, ochre, name="ochre")
    top = hg.Reflectance(1.0 / np.pi, 0.6, 0.15, 1.5, green, name="green")
    return (
        hg.Surface.sphere((0.0, 0.012, AWAY), 0.034, low, "below"),
        hg.Surface.sphere((0.004, -0.03, AWAY), 0.022, top, "above"),
    )


def _on_ball(camera: hg.Camera) -> tuple[NDArray[np.bool_], Array, Array]:
    """Of every fine ray: whether it meets the chrome ball, the normal there, the direction to the eye."""
    ray, centre = camera.unproject(_fine(camera)), np.array([0.0, 0.0, AWAY])
    along = ray @ centre
    root = along**2 - centre @ centre + BALL_RADIUS**2
    normal = (ray * (along - np.sqrt(np.maximum(root, 0.0)))[..., None] - centre) / BALL_RADIUS
    return root > 0.0, normal, -ray


def _ball(rays: tuple[NDArray[np.bool_], Array, Array], lamp: hg.Lamp) -> Array:
    """(h, w) light of the ball: the lamp's bulb, 24 cm wide in its reflector, in a dim room."""
    on, normal, to_eye = rays
    mirrored = 2.0 * np.sum(normal * to_eye, axis=-1, keepdims=True) * normal - to_eye
    assert lamp.position is not None
    to_lamp = lamp.position - np.array([0.0, 0.0, AWAY])
    angle = np.arccos(np.clip(mirrored @ (to_lamp / np.linalg.norm(to_lamp)), -1.0, 1.0))
    room = 0.02 + 0.1 * np.exp(-((angle / 0.2) ** 2))
    return _means(np.where(on, room + 8.0 * (angle < 0.03), 0.06))


def _fine(camera: hg.Camera) -> Array:
    row, column = np.mgrid[: camera.height * RAYS_PER_AXIS, : camera.width * RAYS_PER_AXIS]
    return np.stack([(column + 0.5) / RAYS_PER_AXIS, (row + 0.5) / RAYS_PER_AXIS], axis=-1)


def _means(fine: NDArray) -> Array:
    """(h, w) means over the rays of each pixel."""
    height, width = (size // RAYS_PER_AXIS for size in fine.shape)
    return fine.reshape(height, RAYS_PER_AXIS, width, RAYS_PER_AXIS).mean(axis=(1, 3), dtype=np.float64)


def _write_truth(folder: Path, scene: hg.Scene, sensor: hg.Sensor) -> None:
    """camera.json, lamps.json, and normals.exr as a pinhole of the same matrix sees them."""
    camera = scene.camera
    keys = ("fl_x", "fl_y", "cx", "cy")
    values = dict(zip(keys, (*camera.focal, *camera.principal), strict=True))
    hg.write_json(folder / "camera.json", {"w": camera.width, "h": camera.height, **values, "distortion": list(LENS)})
    middle = np.array([0.0, 0.0, AWAY])
    towards = [lamp.direction_and_irradiance(middle)[0] for lamp in scene.lamps]
    hg.write_json(folder / "lamps.json", [{"name": f"{k}", "to_lamp": t.tolist()} for k, t in enumerate(towards)])
    shape = hg.visible_shape(scene.with_camera(replace(camera, distortion=(0.0,) * 8)))
    hg.write_exr(
        folder / "normals.exr", dict(zip(("N.X", "N.Y", "N.Z"), np.moveaxis(shape.normals, 2, 0), strict=True))
    )
    assert camera.response is not None
    curves = dict(zip(camera.response.channels, camera.response.values.T, strict=True))
    hg.write_table(folder / "response.csv", {"wavelength_nm": camera.response.wavelengths, **curves})
    hg.write_json(folder / "sensor.json", {"gain": sensor.gain, "read_noise": sensor.read_noise})


def main(out: Path, width: int = 480, seed: int = 0, force: bool = False) -> None:
    """Simulate the laboratory.

    Args:
        out: folder to write.
        width: of the photographs [px].
        seed: of the noise and of the places of the board.
        force: replace an existing folder.
    """
    print(f"wrote {lab(out, width, seed, force)}")


if __name__ == "__main__":
    command(main)
