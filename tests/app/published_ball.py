"""A measured ball of known truth to publish, and its picture by a program that shares no line with the product."""

from dataclasses import replace

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.material.body_map import BodyMap
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from tests.inverse.simulated_ball import BallMaterial, reflected, simulate

SIZE = 97
TRUTHS = (
    BallMaterial((0.20, 0.15, 0.10), 0.9, 0.12, 1.5, lobes=((4.0, 0.03), (0.2, 0.4))),
    BallMaterial((0.05, 0.09, 0.16), 2.0, 0.05, 1.7, 1.5, (1.2, 1.0, 0.8)),
)
EPSILON, SIGMA = 0.2, 0.3  # of the body of the second material
PARAMETERS = ("alpha", "beta", "gamma", "n", "nu", "specular_albedo")
FLIP = np.diag([1.0, -1.0, -1.0])


def estimate(name, truth):
    return MaterialEstimate(
        name=name, pixels=1000, body_colour=tuple(truth.body_colour), interface_colour=truth.interface_colour,
        alpha=truth.alpha, beta=truth.beta, gamma=truth.gamma, n=truth.n, specular_albedo=0.05,
        standard_error={key: 0.01 for key in PARAMETERS} | {"body_colour": (0.01,) * 3, "interface_colour": None},
        interval_95={key: (0.1, 0.2) for key in PARAMETERS}
        | {"body_colour": ((0.9, 1.1),) * 3, "interface_colour": ((0.0, 2.0),) * 3},
        correlation=((1.0,) * 4,) * 4, identifiable={key: key != "n" for key in PARAMETERS},
        chi_square=1.0, nu=truth.nu, lobes=truth.lobes,
        epsilon=EPSILON * (truth is TRUTHS[1]), sigma=SIGMA * (truth is TRUTHS[1]),
    )  # fmt: skip


def ball(
    photographs=3, spectrum=None, response=None, far=False, name="ball", tails=True
) -> tuple[Capture, Measurement]:
    """The capture, and its measurement with body colours and gloss that vary from pixel to pixel.

    tails: whether those of the second material vary, too; the first one has none.
    """
    labels = np.zeros((SIZE, SIZE), int)
    labels[:, SIZE // 2 :] = 1
    angles = ((35, 20), (-50, -15), (-10, 40), (60, -30), (5, 5), (-30, 60))[:photographs]
    capture = simulate(TRUTHS, 1, SIZE, labels, angles)
    shots = [_changed(shot, spectrum, response, far) for shot in capture.photographs]
    capture = replace(capture, name=name, photographs=tuple(shots))
    assert capture.normals is not None
    known = np.linalg.norm(capture.normals, axis=2) > 0.5
    labels = np.where(known, labels, -1)
    random = np.random.default_rng(3)
    texture = 1.0 + 0.3 * np.sin(np.arange(SIZE) / 5.0)[:, None, None] * random.uniform(0.8, 1.0, (SIZE, SIZE, 1))
    colours = np.array([truth.alpha_body for truth in TRUTHS])
    body = np.where(known[..., None], colours[labels] * texture, np.nan)
    each = np.broadcast_to(1.0 + 0.2 * np.cos(np.arange(SIZE) / 9.0), (SIZE, SIZE))
    beta, gamma = (
        np.where(known, np.array([getattr(truth, key) for truth in TRUTHS])[labels] * each, np.nan)
        for key in ("beta", "gamma")
    )
    nu = np.where(labels == 1, TRUTHS[1].nu * each.T if tails else TRUTHS[1].nu, np.where(known, np.inf, np.nan))
    gloss = GlossMap(beta, gamma, 0.1 * beta, 0.05 * gamma, body, 0.02 * body, nu, 0.1 * nu)
    materials = tuple(estimate(f"material {k}", truth) for k, truth in enumerate(TRUTHS))
    measured = Measurement(
        materials, labels, (), (), capture.normals, capture.points,
        BodyMap(body, 0.02 * body, materials, labels, None, gloss),
        normal_variance=np.where(known, 1e-4, np.inf).astype(np.float32),
        distance_variance=np.full((SIZE, SIZE), 1e-8, np.float32),
        capture=capture,
    )  # fmt: skip
    return capture, measured


def _changed(shot, spectrum, response, far):
    lamp = shot.lamps[0]
    place = {"to_lamp": lamp.position} if far else {"position": lamp.position}
    lit = Lamp(**place, intensity=lamp.intensity, spectrum=spectrum or Spectrum.constant(1.0), name=shot.name)
    return replace(shot, lamps=(lit,), camera=replace(shot.camera, response=response))


def radiance(capture, measured, direction=None, position=None, irradiance=np.pi):
    """Body weight times α c_b (h, w, 3) and interface weight (h, w) [1/sr] × irradiance, float64, and the mask.

    direction: to a far lamp, page's axes; position: of a near one [m], page's axes.
    irradiance: of a plane that faces it; at 1 m of a near one.
    """
    camera = capture.photographs[0].camera
    turn = camera.world_to_camera[:3, :3].T @ FLIP
    points, normals = capture.points.astype(float), measured.normals.astype(float)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    to_eye = unit(camera.position - points)
    if position is None:
        to_lamp, falloff = np.broadcast_to(turn @ direction, points.shape), 1.0
    else:
        offset = turn @ position + camera.position - points
        to_lamp = unit(offset)
        falloff = 1.0 / (offset**2).sum(axis=2)
    known = measured.labels >= 0
    factor = np.where(measured.labels == 1, body_factor(normals, to_lamp, to_eye), 1.0)[..., None]
    body, gloss = np.nan_to_num(measured.body.value), measured.gloss
    both = np.zeros((*known.shape, 3)), np.zeros((*known.shape, 3))
    for label, truth in enumerate(TRUTHS):
        at = measured.labels == label
        vectors = normals[at], to_lamp[at], to_eye[at]
        both[0][at] = reflected(*vectors, replace(truth, alpha_body=body[at], beta=0.0, lobes=()))
        beta, gamma = gloss.beta[at], gloss.gamma[at]
        lobes = tuple((b * beta / truth.beta, g * gamma / truth.gamma) for b, g in truth.lobes)
        dark = replace(truth, alpha_body=(0.0, 0.0, 0.0), beta=beta, gamma=gamma, nu=gloss.nu[at], lobes=lobes)
        both[1][at] = reflected(*vectors, dark)
    scale = np.broadcast_to(np.asarray(irradiance * falloff), known.shape)[..., None]
    return both[0] * factor * scale, both[1] * scale, known


RIDGE = slice(30, 34), 9.0  # columns of a straight ridge on a plane, and its height [px]


def ridge() -> Measurement:
    """A matte plane that faces a far camera, with a ridge on it."""
    height, width, focal = 61, 113, 20.0 * 113
    depth = np.full((height, width), 1.0)
    depth[:, RIDGE[0]] -= RIDGE[1] / focal
    camera = Camera(width, height, (focal, focal), (width / 2, height / 2))
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    points = np.stack([x / focal, y / focal, np.ones_like(x)], axis=2) * depth[..., None]
    normals = np.broadcast_to(np.array([0.0, 0.0, -1.0]), points.shape)
    labels, truth = np.zeros((height, width), int), BallMaterial((0.2, 0.2, 0.2), 0.0, 0.2, 1.5)
    shot = Photograph(
        np.full(points.shape, 0.2), np.full(points.shape, 1e-4), labels == 0, camera,
        (Lamp(to_lamp=(0, 0, -1)),), "front",
    )  # fmt: skip
    return Measurement(
        (estimate("plane", truth),),
        labels,
        (),
        (),
        normals.astype(np.float32),
        points,
        capture=Capture((shot,), "ridge"),
    )


def body_factor(normals, to_lamp, to_eye):
    """Minnaert's exponent and Oren–Nayar's roughness of the second material."""
    cos_i, cos_r = (normals * to_lamp).sum(axis=2), (normals * to_eye).sum(axis=2)
    s = (to_lamp * to_eye).sum(axis=2) - cos_i * cos_r
    t = np.where(s > 0.0, np.maximum(np.maximum(cos_i, cos_r), 0.02), 1.0)
    return (np.maximum(cos_i, 0.02) * np.maximum(cos_r, 0.02)) ** EPSILON * np.maximum(1.0 + SIGMA * s / t, 0.0)


def unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def encoded(linear):
    """sRGB, 0 … 255, not rounded: IEC 61966-2-1."""
    u = np.clip(linear, 0.0, 1.0)
    return 255.0 * np.where(u <= 0.0031308, 12.92 * u, 1.055 * np.maximum(u, 0.0031308) ** (1 / 2.4) - 0.055)
