"""Camera geometry (MODEL §4, Tanaka eq. 7–9 and 12): world points → image points, image points → rays.

The camera frame is OpenCV's (+x right, +y down, +z forward). An image point (x, y) [px] counts from the upper left
corner of the image: the centre of pixel (row, column) is at (column + ½, row + ½). World units are metres.

Unplaced camera: one whose distance from the object nobody has measured, with the object at the world's origin.

World axes: x right, y up, z from the object to the camera, those of lamps that were calibrated without a camera. The
unit of length is the longer side of the picture at the object, because nothing states the object's size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo import backend
from hagoromo.camera.lens import COEFFICIENTS, Lens, distort, lens_from_coefficients, undistort
from hagoromo.camera.pose import inverse_pose, pose_of, rigid_pose
from hagoromo.camera.response import Response
from hagoromo.camera.sensor import CANON_EOS_300D, Sensor
from hagoromo.errors import InputError

LARGEST_SIDE = 1 << 24  # px, of an image
PRESETS = ("canon_eos_kiss_digital",)
# Focal length over the longer side of the pinhole that stands for an orthographic view: its rays differ by 0.04° at a
# corner. Single precision, in which pictures and maps of points are, still has 1/16,000 of a side there.
ORTHOGRAPHIC_FOCAL = 1000.0
UP_AND_BACK = np.diag([1.0, -1.0, -1.0, 1.0])  # world axes x right, y up, z to the camera → the camera's

Axes: TypeAlias = tuple[Any, Any, Any, Any]  # Array3f


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera, or a thin lens, with lens distortion, and the sensor behind it.

    width, height: size of the image [px]. focal: (α_x, α_y) [px]. principal: (x_0, y_0) [px]. distortion: OpenCV's (k1,
    k2, p1, p2, k3, k4, k5, k6); given 4 or 5 of them, the others are 0. world_to_camera: (4, 4) rigid pose [m].
    response, sensor: colour response and noise, where known. orthographic: whether this pinhole, far away, stands for
    an orthographic view. aperture: diameter of the lens [m], 0 for a pinhole; focus: distance from the lens, along its
    axis, of the plane that is sharp [m]. A point at the distance z spreads over a disc of the diameter α · aperture ·
    |z − focus| / (z · focus) [px], α the focal length [px]; `project` and `unproject` are those of the pinhole.
    Raises `InputError` when a figure makes no camera.

    >>> camera = hg.Camera(640, 480, focal=(800, 800), principal=(320, 240))
    >>> camera.project([0.1, 0.0, 2.0]).tolist()  # 800 px · 0.1 m / 2 m to the right of the principal point
    [360.0, 240.0]
    """

    width: int
    height: int
    focal: tuple[float, float]
    principal: tuple[float, float]
    distortion: tuple[float, ...] = (0.0,) * len(COEFFICIENTS)
    world_to_camera: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    response: Response | None = None
    sensor: Sensor | None = None
    name: str = ""
    orthographic: bool = False
    aperture: float = 0.0
    focus: float = math.inf

    def __post_init__(self) -> None:
        """Check every figure once and freeze the pose."""
        if int(self.width) != self.width or int(self.height) != self.height or min(self.width, self.height) < 1:
            raise InputError(f"the image is {self.width} × {self.height} px: give two whole numbers above 0")
        if max(self.width, self.height) > LARGEST_SIDE:
            raise InputError(
                f"the image is {str(self.width)[:20]} × {str(self.height)[:20]} px: at most {LARGEST_SIDE} a side"
            )
        keep = object.__setattr__
        keep(self, "width", int(self.width))
        keep(self, "height", int(self.height))
        keep(self, "focal", _figures("focal length", self.focal, 2))
        keep(self, "principal", _figures("principal point", self.principal, 2))
        keep(self, "distortion", _distortion(self.distortion))
        if min(self.focal) <= 0.0:
            raise InputError(f"the focal length is {self.focal} px: both figures must be above 0")
        if not (np.isfinite(self.aperture) and self.aperture >= 0.0):
            raise InputError(f"the aperture is {self.aperture!r:.60} m: give a diameter of 0 or more")
        if not self.focus > 0.0:
            raise InputError(f"the focus is at {self.focus!r:.60} m: give a distance above 0")
        placed = rigid_pose(self.world_to_camera, "world_to_camera")
        placed.setflags(write=False)
        keep(self, "world_to_camera", placed)

    def __repr__(self) -> str:
        """The name, the size, the focal length and the place."""
        where = ", ".join(f"{x:.4g}" for x in self.position)
        focal = f"{self.focal[0]:.6g}, {self.focal[1]:.6g}"
        return f"Camera({self.name!r}, {self.width} × {self.height} px, focal length ({focal}) px, at ({where}) m)"

    @staticmethod
    def preset(name: str, focal_mm: float = 55.0, binning: int = 1) -> Camera:
        """A camera by name, at the origin, looking along +z.

        "canon_eos_kiss_digital" (the paper's; also sold as EOS 300D): 22.7 × 15.1 mm, 3072 × 2048 px, RGGB mosaic.
        focal_mm: focal length of the lens [mm]. binning: see `binned`.
        """
        if name not in PRESETS:
            raise InputError(f"no camera is called {name!r}: choose one of {', '.join(PRESETS)}")
        width, height, width_mm, height_mm = 3072, 2048, 22.7, 15.1  # Canon EOS 300D, manufacturer's data sheet
        return Camera(
            width,
            height,
            focal=(focal_mm * width / width_mm, focal_mm * height / height_mm),
            principal=(width / 2, height / 2),
            response=Response.load("canon_eos_300d"),
            sensor=CANON_EOS_300D,
            name=name,
        ).binned(binning)

    def binned(self, k: int) -> Camera:
        """The camera whose pixels are the means of k × k pixels (of one colour each, where there is a mosaic)."""
        if int(k) != k or k < 1 or self.width % k or self.height % k:
            raise InputError(
                f"binning {k} does not divide the image of {self.width} × {self.height} px: choose a common divisor"
            )
        coarse = self.resampled(self.width // int(k), self.height // int(k), (k, k))
        return replace(coarse, sensor=self.sensor.binned(int(k)) if self.sensor else None)

    def resampled(
        self, width: int, height: int, step: tuple[float, float], corner: tuple[float, float] = (0.0, 0.0)
    ) -> Camera:
        """The same view through `width` × `height` other pixels, without a sensor.

        step: width and height of such a pixel; corner: where the first one begins, x and y [px of this camera].
        """
        return replace(
            self,
            width=width,
            height=height,
            focal=(self.focal[0] / step[0], self.focal[1] / step[1]),
            principal=((self.principal[0] - corner[0]) / step[0], (self.principal[1] - corner[1]) / step[1]),
            sensor=None,
        )

    def limited(self, longest: int) -> Camera:
        """The same view with at most `longest` px along the longer side; then without a sensor."""
        share = longest / max(self.width, self.height)
        if share >= 1.0:
            return self
        width, height = max(round(self.width * share), 1), max(round(self.height * share), 1)
        return self.resampled(width, height, (self.width / width, self.height / height))

    def with_pose(self, world_to_camera: ArrayLike) -> Camera:
        """The same camera at another (4, 4) pose."""
        return replace(self, world_to_camera=np.asarray(world_to_camera, np.float64))

    def look_at(self, eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Camera:
        """The same camera at `eye` [m], looking at `target` [m], with `up` pointing up in the image.

        Raises `InputError` where `eye` and `target` coincide or `up` lies along the line between them.
        """
        eye, target, up = (_vector(n, v) for n, v in (("eye", eye), ("target", target), ("up", up)))
        forward = target - eye
        right = np.cross(forward, up)
        if not np.linalg.norm(forward) > 1e-12 * (1.0 + np.linalg.norm(eye)):
            raise InputError(f"the camera at {eye.tolist()} looks at itself: move its target or its eye")
        if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(forward) * np.linalg.norm(up) > 0.0:
            raise InputError(f"up = {up.tolist()} lies along the line of sight {forward.tolist()}: choose another up")
        rotation = np.stack([right, np.cross(forward, right), forward])
        rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
        return self.with_pose(pose_of(rotation, -rotation @ eye))

    @property
    def camera_to_world(self) -> NDArray[np.float64]:
        """(4, 4) pose of the camera frame in the world [m]."""
        return inverse_pose(self.world_to_camera)

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) centre of projection in the world [m]."""
        return self.camera_to_world[:3, 3]

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 4) M of s [x y 1]ᵀ = M [X Y Z 1]ᵀ, the projection without distortion."""
        (ax, ay), (x0, y0) = self.focal, self.principal
        # Tanaka eq. (9), with the third row that eq. (8) prints as zero
        return np.array([[ax, 0.0, x0, 0.0], [0.0, ay, y0, 0.0], [0.0, 0.0, 1.0, 0.0]]) @ self.world_to_camera

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Image points (..., 2) (x, y) [px] of world points (..., 3) [m]; NaN behind the camera or outside the lens."""
        points = np.asarray(points, np.float64)
        local = points @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        depth = np.where(local[..., 2:] > 0.0, local[..., 2:], np.nan)
        return self._through_lens(distort, local[..., :2] / depth) * self.focal + self.principal

    def unproject(self, image_points: ArrayLike) -> NDArray[np.float64]:
        """Unit world directions (..., 3) of rays through image points (..., 2) (x, y) [px]; NaN outside the lens."""
        xy = (np.asarray(image_points, np.float64) - self.principal) / self.focal
        xy = self._through_lens(undistort, xy)
        # Tanaka eq. (12)
        direction = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1) @ self.world_to_camera[:3, :3]
        return direction / np.linalg.norm(direction, axis=-1, keepdims=True)

    def pixel_directions(self) -> NDArray[np.float64]:
        """Unit world directions (height, width, 3) of the rays through the centres of all pixels."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return self.unproject(np.stack([x, y], axis=-1))

    def rays(
        self, x: Any, y: Any, ahead: float = 0.0, lens: tuple[Any, Any] | None = None, axes: Axes | None = None
    ) -> tuple[Any, Any]:
        """Origin [m] and unit direction (Dr.Jit Array3f, world axes) of the rays through image points (x, y) [px].

        x, y: Dr.Jit Float. The camera's figures enter as data, so a camera that moves compiles no new kernel.
        ahead: depth of the plane that the rays begin on [m]; from a camera far away, places near that plane are exact.
        lens: two numbers each in [0, 1), the place on the lens of a camera with an aperture; None: its middle.
        axes: of a camera that moves, in place of its pose: right, down and forward of each ray, and where those through
        the middle begin.
        """
        jit = backend.arrays()
        (ax, ay), (x0, y0) = (_opaque(self.focal), _opaque(self.principal))
        x, y = (x - x0) / ax, (y - y0) / ay
        if any(self.distortion):
            x, y = undistort(x, y, Lens(*_opaque(lens_from_coefficients(self.distortion))))
        if axes is None:
            right, down, forward = (jit.Array3f(*_opaque(row)) for row in self.world_to_camera[:3, :3])
            begin = jit.Array3f(*_opaque(self.position + ahead * self.world_to_camera[2, :3]))
        else:
            right, down, forward, begin = axes
        aside = x * right + y * down
        (depth,) = _opaque([ahead])
        if self.aperture > 0.0 and lens is not None:
            radius, per_focus = _opaque([0.5 * self.aperture, 1.0 / self.focus])
            sine, cosine = dr.sincos(2.0 * math.pi * lens[1])
            beside = radius * dr.sqrt(lens[0]) * (cosine * right + sine * down)
            begin, aside = begin + beside, aside - beside * per_focus  # both rays meet in the plane that is sharp
        return begin + aside * depth, dr.normalize(aside + forward)  # Tanaka eq. (12)

    def _through_lens(self, way: Any, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """`distort` or `undistort` of (..., 2) normalised points, in double precision."""
        if not any(self.distortion) or xy.size == 0:
            return xy
        double = backend.arrays().Float64
        lens = Lens(*(dr.opaque(double, k) for k in lens_from_coefficients(self.distortion)))
        x, y = way(double(xy[..., 0].ravel()), double(xy[..., 1].ravel()), lens)
        return np.stack([x.numpy(), y.numpy()], axis=-1).reshape(xy.shape)


def _opaque(figures: Sequence[float] | NDArray[np.float64]) -> list[Any]:
    return [dr.opaque(backend.arrays().Float, float(figure)) for figure in figures]


def _figures(what: str, figures: Sequence[float], count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(figure) for figure in figures)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"{what} is {figures!r}: give {count} finite numbers")
    return numbers


def _distortion(figures: Sequence[float]) -> tuple[float, ...]:
    short = len(figures) in (4, 5)
    given = _figures(f"distortion {' '.join(COEFFICIENTS)}", figures, len(figures) if short else len(COEFFICIENTS))
    return given + (0.0,) * (len(COEFFICIENTS) - len(given))


def _vector(what: str, vector: ArrayLike) -> NDArray[np.float64]:
    return np.array(_figures(what, np.asarray(vector).ravel().tolist(), 3))


def unplaced_camera(width: int, height: int, focal_px: float | None) -> Camera:
    """The camera of `width` × `height` px; focal_px: None for an orthographic view, which a far pinhole stands for.

    >>> camera = unplaced_camera(30, 20, None)
    >>> camera.position.tolist(), camera.project([0.5, 0.0, 0.0]).tolist()  # the right edge of the picture
    ([0.0, 0.0, 1000.0], [30.0, 10.0])
    """
    longer = max(width, height)
    focal = ORTHOGRAPHIC_FOCAL * longer if focal_px is None else focal_px
    pose = UP_AND_BACK.copy()
    pose[2, 3] = focal / longer
    name = "orthographic" if focal_px is None else ""
    camera = Camera(width, height, (focal, focal), (width / 2, height / 2), name=name, orthographic=focal_px is None)
    return camera.with_pose(pose)


def is_unplaced(camera: Camera) -> bool:
    """Whether `camera` stands where `unplaced_camera` puts one: its lengths are no metres.

    >>> is_unplaced(unplaced_camera(30, 20, 45.0)), is_unplaced(Camera(30, 20, (45.0, 45.0), (15.0, 10.0)))
    (True, False)
    """
    expected = unplaced_camera(camera.width, camera.height, camera.focal[0])
    return bool(np.allclose(camera.world_to_camera, expected.world_to_camera, rtol=1e-9, atol=1e-12))
