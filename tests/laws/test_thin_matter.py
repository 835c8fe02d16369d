"""Thin matter sends back what its elements do: the mean radiance of a box against the quadrature of its voxels."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import build
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

MATERIAL = {"alpha": 0.2, "beta": 0.3, "gamma": 0.35, "n": 1.5, "body_colour": 0.8}
PATCHES = {
    "skin": {"kind": "skin", "size_mm": 1.7, "voxel_mm": 0.03},
    "cloth": {"kind": "cloth", "lay": "patch", "width_mm": 1.7, "height_mm": 1.9, "voxel_mm": 0.03},
    "knit": {"kind": "knit", "lay": "patch", "width_mm": 2.3, "height_mm": 2.9, "voxel_mm": 0.06},
    "feather": {"kind": "feather", "patch_mm": [1.1, 1.3], "voxel_mm": 0.02},
}
PIXELS, AWAY = 97, 300.0  # px a side; distance in fields of view: directions to the eye differ by 0.1°
SEEN = 3000  # voxels of the quadrature, drawn by their density: a standard error of about 0.5 %
TO_LAMP = (-0.5, -0.7, 0.51)


def facets(normal: np.ndarray, to_lamp: np.ndarray, to_eye: np.ndarray, material: Reflectance) -> np.ndarray:
    """f of MODEL §2, eq. (2)–(6), for normals (..., 3)."""
    half = (to_lamp + to_eye) / np.linalg.norm(to_lamp + to_eye)
    incidence, view, tilt, c = normal @ to_lamp, normal @ to_eye, normal @ half, float(to_eye @ half)
    g = np.sqrt(material.n**2 + c * c - 1)
    fresnel = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
    density = np.exp(-np.log(2) * (np.arccos(np.clip(tilt, -1, 1)) / material.gamma) ** 2)
    safe = np.maximum(view, 1e-9)
    masking = np.minimum(1, np.minimum(2 * tilt * view / c, 2 * tilt * incidence / c))
    body = material.alpha * incidence * float(material.body_colour.at(np.array([550.0]))[0])
    return np.where((incidence > 0) & (view > 0), body + material.beta * density * fresnel * masking / safe, 0.0)


def sent_back(axes: np.ndarray, to_lamp: np.ndarray, to_eye: np.ndarray, material: Reflectance) -> np.ndarray:
    """Mean of f over the normals that the eye sees of elements with `axes` (n, 3): (n,)."""
    if material.element == "plane":
        return facets(axes, to_lamp, to_eye, material)
    if material.element == "cylinder":
        one = np.cross(axes, np.where(np.abs(axes[:, :1]) < 0.6, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
        one /= np.linalg.norm(one, axis=1, keepdims=True)
        turn = 2 * np.pi * (np.arange(256) + 0.5) / 256
        normals = one[:, None] * np.cos(turn)[:, None] + np.cross(axes, one)[:, None] * np.sin(turn)[:, None]
    else:  # Fibonacci's points on the sphere
        index = np.arange(20_000) + 0.5
        height, turn = 1 - 2 * index / 20_000, np.pi * (1 + 5**0.5) * index
        flat = np.sqrt(1 - height**2)
        normals = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)[None]
    weight = np.maximum(normals @ to_eye, 0)
    found = (facets(normals, to_lamp, to_eye, material) * weight).sum(axis=1) / weight.sum(axis=1)
    return np.broadcast_to(found, len(axes))


def quadrature(box: VolumeBox, to_lamp: np.ndarray, to_eye: np.ndarray) -> float:
    """∫ σ f dV over the voxels of a box [m²/sr], from SEEN of them."""
    density, axis = box.bricks.dense()
    weight = density.astype(float).ravel()
    drawn = np.random.default_rng(7).choice(weight.size, SEEN, p=weight / weight.sum())
    axes, numbers = axis.reshape(-1, 3)[drawn].astype(float), np.zeros(SEEN, int)
    if box.bricks.material is not None:
        numbers = material_numbers(box).ravel()[drawn]
    found = np.zeros(SEEN)
    for number, material in enumerate(box.materials):
        chosen = numbers == number
        if chosen.any():
            lengths = np.linalg.norm(axes[chosen], axis=1, keepdims=True)
            found[chosen] = sent_back(axes[chosen] / lengths, to_lamp, to_eye, material)
    return float(box.tau * box.voxel_size**3 * weight.sum() * found.mean())


def material_numbers(box: VolumeBox) -> np.ndarray:
    """Material numbers of all voxels (nz, ny, nx)."""
    whole = np.zeros(tuple(-(-n // 8) * 8 + 8 for n in box.bricks.shape), np.uint8)
    held = box.bricks.read(0, len(box.bricks.places))["material"]
    for (z, y, x), brick in zip(box.bricks.places * 8, held, strict=True):
        whole[z : z + 8, y : y + 8, x : x + 8] = brick[:8, :8, :8]
    nz, ny, nx = box.bricks.shape
    return whole[:nz, :ny, :nx]


@pytest.mark.by_night("knit", "cloth")
@pytest.mark.parametrize("name", PATCHES)
def test_thin_matter_sends_back_what_its_elements_do(name):
    """Extinction a ten-thousandth of the recipe's: nothing shades, light adds up. 3 %: 2 % of the march, draws."""
    box = build(PATCHES[name] | {"material": MATERIAL})
    box = replace(box, tau=1e-4 * box.tau)
    corners = box.corners()
    middle, field = corners.mean(axis=0), 1.05 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    to_eye = np.array([0.25, -1.0, 0.15]) / np.linalg.norm([0.25, -1.0, 0.15])
    to_lamp = np.array(TO_LAMP) / np.linalg.norm(TO_LAMP)
    focal, centre = PIXELS * AWAY, 0.5 * PIXELS
    camera = Camera(PIXELS, PIXELS, (focal, focal), (centre, centre))
    camera = camera.look_at(middle + AWAY * field * to_eye, middle)
    scene = Scene(camera, (Lamp(to_lamp=to_lamp),), (box,))
    radiance = render(scene, Settings(4, "none", tolerance=0.02)).xyz()[..., 1]
    assert float(radiance.sum(dtype=float)) * (field / PIXELS) ** 2 == pytest.approx(
        quadrature(box, to_lamp, to_eye), rel=0.03
    )


@pytest.mark.parametrize("shadows", ["map", "march"])
def test_however_thin_matter_is_none_of_it_is_lost(shadows):
    """Light of a cloud is as its extinction, where hardly any is taken on the way: by 2 % at 1e-3 a voxel, then exact.

    Cells of less than 1e-6 were taken for empty: the picture was black. Small densities with a large tau count alike.
    """

    def light(depth: float, density: float) -> float:
        dense = np.zeros((17, 17, 17), np.float32)
        dense[3:-3, 3:-3, 3:9], dense[3:-3, 3:-3, 9:-3] = density, 0.5 * density
        axis, voxel = np.broadcast_to([0.0, 0.0, 1.0], (17, 17, 17, 3)), 0.1 / 17
        ball = Reflectance(0.2, 0.1, 0.3, 1.5, Spectrum.constant(1.0), element="sphere")
        box = VolumeBox.from_arrays(dense, axis, voxel, depth / (density * voxel), [ball])
        camera = Camera(9, 7, (60, 60), (4.5, 3.5)).look_at(eye=(0.05, -0.8, 0.05), target=(0.05, 0.05, 0.05))
        scene = Scene(camera, (Lamp(to_lamp=(0.3, -1.0, 0.5)),), (box,))
        return float(render(scene, Settings(shadows=shadows)).weights[..., 0].sum()) / depth

    usual = light(1e-3, 1.0)
    for depth, density in ((1e-6, 1.0), (1e-7, 1.0), (1e-7, 1e-3), (1e-20, 1.0)):
        assert light(depth, density) == pytest.approx(light(1e-5, 1.0), rel=1e-3), depth
        assert light(depth, density) == pytest.approx(usual, rel=0.03)
