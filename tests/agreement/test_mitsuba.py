"""Mitsuba's path tracer, an independent solver of the same equations, sees the same absolute radiance as the render.

Single scattering: `volpath` of depth 2 in a cloud whose phase function is a matte sphere's, and `path` of depth 2 on
Lambert surfaces. Pictures are judged block by block (`blocks_agree`) against Mitsuba's own variance, estimated from
independent renders; significance 0.1 %, fixed seeds. The judge must also refuse our picture made 3 % brighter.
"""

import math
from functools import cache

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import mitsuba
from hagoromo.image.scene.settings import Settings
from tests.judges import blocks_agree
from tests.oracle.lattice import OracleVoxels
from tests.oracle.radiance import camera_rays, radiance

PIXELS, BLOCK = 32, 8  # pixels a side of the picture, and of a block
FOCAL = 2.5  # focal length over the width: every block shows matter, else few lucky paths decide and Z is not normal
EYE, LAMP, INTENSITY = (0.0, 0.0, 3.0), (2.0, 2.5, 2.0), 27.0  # [m], [m], [W/sr]
LOW_LAMP = (5.0, 0.7, 1.75)  # 8.5° above the face z = 1 of the cube [m]
ALPHA, TAU = 0.3, 3.0  # [1/sr], [1/m]
VOXELS, FULL_VOXELS = 24, 6  # a side of the cloud; of the full cube: one mean free path each
RENDERS, PATHS = 16, 16  # independent renders by Mitsuba, paths a pixel of each
LOW_PATHS = 64  # light that grazes reaches few of them
OURS_BIAS = 0.005  # of a block: steps of the march, and few of the infinitely many rays of a pixel
SOFT = Settings(samples=4, shadows="march", tolerance=0.01)  # for a cloud, whose radiance varies little in a pixel
SHARP = Settings(samples=64)  # for outlines of surfaces
MATTE = hg.Spectrum.constant(1.0)


def cloud() -> np.ndarray:
    """Density (z, y, x) of a soft, lopsided ball of noise in the cube −1…1 m, which ends before the cube does."""
    centres = (np.arange(VOXELS) + 0.5) / VOXELS * 2.0 - 1.0
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    ball = np.clip((0.85 - np.sqrt(x**2 + y**2 + z**2)) * 2.0, 0.0, 1.0)
    return (ball * (1.0 + 0.5 * x) * np.random.default_rng(1).uniform(0.5, 1.5, ball.shape)).astype(np.float32)


def camera(pixels: int = PIXELS) -> hg.Camera:
    middle = pixels / 2.0
    pinhole = hg.Camera(pixels, pixels, (FOCAL * pixels, FOCAL * pixels), (middle, middle))
    return pinhole.look_at(EYE, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def lamp_of(cutoff_deg: float | None) -> hg.Lamp:
    """A point lamp, or Mitsuba's spot towards the middle as a profile: its edge lies within the picture."""
    if cutoff_deg is None:
        return hg.Lamp(position=LAMP, intensity=INTENSITY)
    spot = hg.LampProfile([0], [0, 0.25 * cutoff_deg, cutoff_deg], [[1, 1, 0]])
    return hg.Lamp(position=LAMP, intensity=INTENSITY, axis=-np.array(LAMP), profile=spot)


def pictures_of_mitsuba(
    integrator: str,
    objects: dict,
    cutoff_deg: float | None = None,
    place: tuple = LAMP,
    paths: int = PATHS,
    depth: int = 2,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean radiance (height, width) [W m⁻² sr⁻¹] of independent renders, and the variance of that mean.

    cutoff_deg: of Mitsuba's spot towards the middle, whose light falls to nothing there, linearly with the angle.
    place: of the lamp [m]. paths: a pixel of each render. depth: one more than the events of light; −1 for all.
    """
    mi = mitsuba()
    look = mi.ScalarTransform4f().look_at(EYE, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    film = {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "component_format": "float32",
            "pixel_format": "rgb", "rfilter": {"type": "box"}}  # fmt: skip
    fov = 2.0 * math.degrees(math.atan(0.5 / FOCAL))
    sensor = {"type": "perspective", "fov": fov, "to_world": look, "near_clip": 0.01, "far_clip": 100.0}
    lamp = {"type": "point", "position": list(place), "intensity": {"type": "rgb", "value": INTENSITY}}
    if cutoff_deg is not None:
        aimed = mi.ScalarTransform4f().look_at(list(place), [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        lamp = {"type": "spot", "intensity": lamp["intensity"], "to_world": aimed,
                "cutoff_angle": cutoff_deg, "beam_width": 0.25 * cutoff_deg}  # fmt: skip
    scene = mi.load_dict({
        "type": "scene", "integrator": {"type": integrator, "max_depth": depth, "rr_depth": 1000},
        "sensor": {**sensor, "film": film, "sampler": {"type": "independent"}}, "lamp": lamp, **objects,
    })  # fmt: skip
    renders = np.array([np.array(mi.render(scene, spp=paths, seed=seed))[..., 1] for seed in range(RENDERS)])
    return renders.mean(axis=0), renders.var(axis=0, ddof=1) / RENDERS


def phase_of_matte_spheres() -> dict:
    """f [1/sr] of a matte sphere at χ = ∠(L, V), for Mitsuba, which counts the angle from straight on."""
    phase = np.arccos(-np.linspace(-1.0, 1.0, 361))
    values = np.sin(phase) + (math.pi - phase) * np.cos(phase)
    return {"type": "tabphase", "values": ",".join(f"{value:.9g}" for value in values)}


def assert_same_radiance(radiance: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> None:
    """And brighter by 3 %, of which OURS_BIAS is granted, it is another picture."""
    assert blocks_agree(mean, radiance, variance, BLOCK, relative_bias=OURS_BIAS)
    assert not blocks_agree(mean, 1.03 * radiance, variance, BLOCK, relative_bias=OURS_BIAS)


@pytest.mark.by_night("30.0-None", "3.0-14.0")
@pytest.mark.parametrize(("tau", "cutoff_deg"), [(TAU, None), (10.0 * TAU, None), (TAU, 14.0)])
def test_the_march_sees_the_radiance_of_volpath(tau, cutoff_deg):
    """A cloud of optical depth 3, and of 30, with its own shadow: the albedo of matter of spheres is π α.

    Also under Mitsuba's spot, see `lamp_of`.
    """
    ours = hg.render(hg.Scene(camera(), (lamp_of(cutoff_deg),), (box_of_cloud(tau),)), SOFT)
    assert_same_radiance(ours.weights[..., 0], *cloud_of_mitsuba(tau, cutoff_deg))


def box_of_cloud(tau: float) -> hg.VolumeBox:
    """The cloud as a volume box of matte spheres."""
    density, pose = cloud(), np.eye(4)
    pose[:3, 3] = -1.0
    matter = hg.Reflectance(ALPHA, 0.0, 0.2, 1.5, MATTE, element="sphere")
    return hg.VolumeBox.from_arrays(density, np.zeros((*density.shape, 3)), 2.0 / VOXELS, tau, [matter], pose=pose)


def cloud_of_mitsuba(tau: float, cutoff_deg: float | None, depth: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """The cloud by `volpath`, see `pictures_of_mitsuba`."""
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium_of_mitsuba(tau)}
    return pictures_of_mitsuba("volpath", {"box": cube}, cutoff_deg, depth=depth)


def medium_of_mitsuba(tau: float) -> dict:
    """The matter of the cloud."""
    mi = mitsuba()
    place = mi.ScalarTransform4f().translate([-1.0, -1.0, -1.0]).scale(2.0)
    grid = {"type": "gridvolume", "grid": mi.VolumeGrid(cloud()[..., None]), "to_world": place, "raw": True}
    return {
        "type": "heterogeneous", "albedo": {"type": "constvolume", "value": math.pi * ALPHA}, "scale": tau,
        "sigma_t": grid, "phase": phase_of_matte_spheres(),
    }  # fmt: skip


def test_light_that_grazes_a_hard_face_is_that_of_volpath():
    """A full cube, one mean free path a voxel, its lamp 8.5° above the face that the camera sees."""
    theirs, lamp, box = full_cube_of_mitsuba(), hg.Lamp(position=LOW_LAMP, intensity=INTENSITY), full_cube().box()
    ours = hg.render(hg.Scene(camera(), (lamp,), (box,)), SOFT)
    assert_same_radiance(ours.weights[..., 0], *theirs)


def test_the_oracle_sees_the_radiance_of_volpath():
    """The float64 oracle, which judges the march in `tests/laws/test_first_order.py`, under light that grazes."""
    lamp = hg.Lamp(position=LOW_LAMP, intensity=INTENSITY)
    ours, _ = radiance([full_cube()], [lamp], camera_rays(camera(PIXELS // 4)), 550.0)  # the face is smooth
    ours = np.kron(ours.reshape(PIXELS // 4, PIXELS // 4), np.ones((4, 4)))
    assert_same_radiance(ours, *full_cube_of_mitsuba())


def full_cube() -> OracleVoxels:
    """Homogeneous matter of matte spheres in the cube −1…1 m."""
    pose, shape = np.eye(4), (FULL_VOXELS,) * 3
    pose[:3, 3] = -1.0
    matter = hg.Reflectance(ALPHA, 0.0, 0.2, 1.5, MATTE, element="sphere")
    return OracleVoxels(np.ones(shape), np.zeros((*shape, 3)), 2.0 / FULL_VOXELS, 0.5 * FULL_VOXELS, (matter,), pose)


@cache
def full_cube_of_mitsuba() -> tuple[np.ndarray, np.ndarray]:
    medium = {
        "type": "homogeneous", "albedo": {"type": "constvolume", "value": math.pi * ALPHA},
        "sigma_t": {"type": "constvolume", "value": 1.0}, "scale": 0.5 * FULL_VOXELS, "phase": phase_of_matte_spheres(),
    }  # fmt: skip
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium}
    return pictures_of_mitsuba("volpath", {"box": cube}, place=LOW_LAMP, paths=LOW_PATHS)


@pytest.mark.parametrize("cutoff_deg", [None, 12.0])
def test_surfaces_see_the_radiance_of_path(cutoff_deg):
    """A Lambert ball before a wall that it shades: f = α cos θ of ours is a reflectance of π α.

    Also under Mitsuba's spot, see `lamp_of`.
    """
    mi, matter = mitsuba(), hg.Reflectance(ALPHA, 0.0, 0.2, 1.5, MATTE)
    wall = np.diag([2.0, 2.0, 1.0, 1.0])
    wall[2, 3] = -0.9
    surfaces = (hg.Surface.sphere((0.1, -0.2, 0.0), 0.6, matter), hg.Surface(matter, "rectangle", pose=wall))
    ours = hg.render(hg.Scene(camera(), (lamp_of(cutoff_deg),), (), surfaces), SHARP)
    paint = {"type": "diffuse", "reflectance": {"type": "rgb", "value": math.pi * ALPHA}}
    ball = {"type": "sphere", "center": [0.1, -0.2, 0.0], "radius": 0.6, "bsdf": paint}
    plane = {"type": "rectangle", "to_world": mi.ScalarTransform4f(wall.tolist()), "bsdf": paint}
    assert_same_radiance(ours.weights[..., 0], *pictures_of_mitsuba("path", {"ball": ball, "plane": plane}, cutoff_deg))
