"""Surface: a mesh or exact shape of inhomogeneous dielectric, which Mitsuba intersects.

Enters: meshes (arrays, or any file that trimesh reads) and Mitsuba's exact shapes. Surfaces are lit from both sides.
"""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.pose import FARTHEST
from hagoromo.errors import InputError, described
from hagoromo.image.scene.gloss_texture import alike, ends, widest_glosses
from hagoromo.image.scene.shape_mesh import shape_mesh
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.light.colour import srgb_decode
from hagoromo.light.emitting_surface import SurfaceEmission
from hagoromo.light.spectrum import Spectrum, checked_spectrum
from hagoromo.reflectance.parameters import PLAIN_BODY
from hagoromo.reflectance.reflectance import LARGEST_GAMMA, SMALLEST_GAMMA, Reflectance
from hagoromo.transport.path.optics import KINDS

SHAPES = ("sphere", "rectangle", "disk", "cylinder", "cube")  # Mitsuba's, unit size, before the pose
ROUND_SHAPES = ("sphere", "disk", "cylinder")
TEXTURES = ("body_texture", "beta_texture", "gamma_texture")
RELIEFS = ("normal_texture", "bump_texture")
FINE_ROUND, FINE_SPHERE = 512, 5  # edges around a disk or cylinder that is traced as a mesh, halvings of a ball's
LEAST_STRETCH = 1e-5  # relative difference of lengths, and cosine between axes: more of it is no rounding
LARGEST_ROUNDING = 1e-4  # of the vertices in a file, in sizes of the mesh, beyond which there is a warning
LARGEST_UV = 1e4  # single precision leaves a thousandth of an image there
DETAILS = 256.0  # of a surface, along its size


class Same:
    """A part of a key, equal to that of the same object alone; it holds it, so that no other takes its place in memory.

    >>> one = [1.0]
    >>> Same(one) == Same(one), Same(one) == Same([1.0])
    (True, False)
    """

    def __init__(self, thing: Any) -> None:
        self.thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and self.thing is other.thing

    def __hash__(self) -> int:
        return id(self.thing)


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface with one reflectance: `shape` of SHAPES, or a mesh of vertices (n, 3) [m] and faces (m, 3).

    pose: shape to world, (4, 4) affine (scale included). smooth: interpolate the normals of a mesh's vertices.
    optics: "mirror" or "glass" in place of body and facets, in mode path: of the reflectance, `n` (glass) and the
    interface colour (of mirrored light, and of what passes) count. Glass is closed and smooth, in air or wholly in
    other glass, which it does not touch; lamps without size do not shine through it. "": a surface by its reflectance.
    absorption: coefficient a of glass [1/m], over wavelength; of light that goes d through it exp(−a d) is left
    (Beer–Lambert). None: clear glass.
    body_texture: the body colour from place to place, in place of that of the reflectance. beta_texture: a factor on
    beta, 0…1, one value a place. gamma_texture: the half width γ of the facets [rad], one value a place, in place of
    that of the reflectance, which becomes the mean where β is the same everywhere; further lobes keep theirs.
    normal_texture: an image of normals in the tangent space of the UVs, (normal + 1) / 2, its green along v (as OpenGL
    has it). bump_texture: an image of heights over the surface [m]. Both turn the normal by which light is reflected,
    one on top of the other; outline, hits and shadows are those of the surface itself.
    uv: (n, 2) of the vertices of a mesh, which images need; shapes have Mitsuba's.
    emission: light that its front gives off.

    >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
    >>> hg.Surface.sphere(centre=(0, 0, 0.1), radius=0.1, reflectance=matte).corners().max(axis=0).tolist()  # [m]
    [0.1, 0.1, 0.2]
    """

    reflectance: Reflectance
    shape: str = "mesh"
    vertices: np.ndarray | None = None
    faces: np.ndarray | None = None
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    smooth: bool = True
    name: str = ""
    optics: str = ""
    absorption: Spectrum | None = None
    body_texture: SurfaceTexture | None = None
    beta_texture: SurfaceTexture | None = None
    gamma_texture: SurfaceTexture | None = None
    normal_texture: SurfaceTexture | None = None
    bump_texture: SurfaceTexture | None = None
    uv: np.ndarray | None = None
    emission: SurfaceEmission | None = None

    def __post_init__(self) -> None:
        who = f"surface {self.name!r}" if self.name else "surface"
        if self.optics not in KINDS:
            raise InputError(f"{who}: optics is {self.optics!r}: give mirror or glass, or leave it out")
        if self.absorption is not None:
            if self.optics != "glass":
                raise InputError(f"{who}: absorption is of glass, and optics is {self.optics!r}: leave absorption out")
            checked_spectrum(self.absorption, f"{who}: absorption")
            if not (self.absorption.values >= 0.0).all():
                raise InputError(f"{who}: absorption is below 0 at some wavelength: give 0 or more [1/m]")
        if self.optics:
            smooth = replace(self.reflectance, alpha=0.0, beta=0.0, lobes=(), **PLAIN_BODY)
            object.__setattr__(self, "reflectance", smooth)
        pose = np.asarray(self.pose, float)
        if not (np.abs(pose) <= FARTHEST).all():
            raise InputError(f"{who}: pose holds what is no number up to {FARTHEST:g}")
        if pose.shape != (4, 4) or abs(np.linalg.det(pose[:3, :3])) < 1e-30:
            raise InputError(f"{who}: pose is not an invertible 4 × 4 matrix of finite numbers")
        if self.reflectance.element != "plane":
            raise InputError(
                f"{who}: its reflectance has element {self.reflectance.element!r}: a surface needs 'plane'"
            )
        if self.shape not in SHAPES:
            self._check_mesh(who)
        self._check_textures(who)
        if self.emission is not None and self.optics:
            raise InputError(f"{who} is {self.optics} and has an emission: leave one of them out")

    def _check_mesh(self, who: str) -> None:
        if self.shape != "mesh" or self.vertices is None or self.faces is None:
            raise InputError(f"{who}: shape is {self.shape!r}: give a mesh or one of {', '.join(SHAPES)}")
        vertices, faces = np.asarray(self.vertices), np.asarray(self.faces)
        if (
            vertices.ndim != 2
            or vertices.shape[1] != 3
            or not len(vertices)
            or not (np.abs(vertices) <= FARTHEST).all()
        ):
            raise InputError(f"{who}: vertices are {vertices.shape}: give (n, 3) finite numbers up to {FARTHEST:g} m")
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"{who}: faces are {faces.shape}: give (m, 3) indices of its {len(vertices)} vertices")
        if self.uv is None:
            return
        uv = np.asarray(self.uv)
        if uv.shape != (len(vertices), 2) or not (np.abs(uv) <= LARGEST_UV).all():
            raise InputError(f"{who}: uv are {uv.shape}: give 2 numbers up to {LARGEST_UV:g} for each of its vertices")

    def _check_textures(self, who: str) -> None:
        if self.uv is not None and self.shape != "mesh":
            raise InputError(f"{who}: uv are of a mesh, and a {self.shape} has its own: leave uv out")
        for key, texture in zip((*TEXTURES, *RELIEFS), (*self.textures, *self.reliefs), strict=True):
            if texture is None:
                continue
            if key in RELIEFS:
                _check_relief(key, texture, who)
            if self.traced_as_mesh:
                what = f"stretched {self.shape}" if self.emission is None else f"{self.shape} with an emission"
                raise InputError(f"{who} is a {what} and has a {key}: give a mesh with UVs")
            if self.optics:
                raise InputError(f"{who} is {self.optics} and has a {key}: leave one of them out")
            if texture.of == "image" and self.shape == "mesh" and self.uv is None:
                raise InputError(f"{who}: {key} is an image, and its mesh has no UVs: give uv, or a mesh that has them")
            if texture.of == "vertices" and (self.vertices is None or len(texture.values) != len(self.vertices)):
                count = "no" if self.vertices is None else str(len(self.vertices))
                raise InputError(
                    f"{who}: {key} is of {len(texture.values)} vertices, and the surface has {count}: give one each"
                )
        if self.beta_texture is not None:
            if self.beta_texture.values.shape[-1] != 1 or self.beta_texture.values.max() > 1.0:
                raise InputError(f"{who}: beta_texture is a factor on beta: give one value 0…1 a place")
        with described(f"{who}: where its body_texture is brightest"):
            made = self.brightest
        if self.gamma_texture is not None:
            self._check_gamma(self.gamma_texture.values, who)
            for gloss in widest_glosses(self.gamma_texture, self.beta_texture, self.faces):
                also = "" if self.beta_texture is None else f" and its beta_texture up to {gloss.factor:.3g}"
                if alike(*self.textures[1:]) and self.gamma_texture.of == "image" and self.gamma_texture.smooth:
                    also += " at neighbours, as images repeat (smooth = false takes each pixel alone)"
                with described(f"{who}: where its gamma_texture is up to {gloss.gamma:.4g} rad{also}"):
                    gloss.of(made)
            if self.beta_texture is None:
                mean = float(np.clip(self.gamma_texture.values.mean(dtype=np.float64), *ends(self.gamma_texture)))
                object.__setattr__(self, "reflectance", replace(self.brightest, gamma=mean))

    def _check_gamma(self, values: np.ndarray, who: str) -> None:
        """`InputError` for what is no γ [rad]."""
        if values.shape[-1] != 1:
            raise InputError(f"{who}: gamma_texture has {values.shape[-1]} values a place: give one, γ [rad]")
        wrong = ~((values >= np.float32(SMALLEST_GAMMA)) & (values <= np.float32(LARGEST_GAMMA)))
        if wrong.any():
            first = np.argwhere(wrong)[0]
            where = f"row {first[0]}, column {first[1]}" if len(first) == 3 else f"vertex {first[0]}"
            raise InputError(
                f"{who}: gamma_texture has {int(wrong.sum())} values outside {SMALLEST_GAMMA:g}…{LARGEST_GAMMA:.4g} "
                f"rad, first {values[tuple(first)]:.4g} in {where}: mend it, or give another range"
            )

    @property
    def brightest(self) -> Reflectance:
        """Its reflectance with the brightest body colour of its body_texture."""
        if self.body_texture is None:
            return self.reflectance
        return replace(self.reflectance, body_colour=Spectrum.constant(self.body_texture.brightest()))

    @property
    def textures(self) -> tuple[SurfaceTexture | None, ...]:
        """Of the body, of beta and of gamma, as TEXTURES."""
        return self.body_texture, self.beta_texture, self.gamma_texture

    @property
    def reliefs(self) -> tuple[SurfaceTexture | None, ...]:
        """Of normals and of heights, as RELIEFS."""
        return self.normal_texture, self.bump_texture

    @property
    def tiles(self) -> tuple[int, int]:
        """How many images of UDIM its textures were laid together from, across and up, on which its UVs are 0…1."""
        return next((one.tiles for one in (*self.textures, *self.reliefs) if one is not None), (1, 1))

    def __repr__(self) -> str:
        """The name, the shape and the reflectance's name."""
        faces = "" if self.faces is None else f" of {len(self.faces)} faces"
        return f"Surface({self.name!r}, {self.shape}{faces}, reflectance {self.reflectance.name!r})"

    @classmethod
    def sphere(cls, centre: Sequence[float], radius: float, reflectance: Reflectance, name: str = "") -> Surface:
        """An exact sphere: `centre` (x, y, z) and `radius` in metres; `name` stands in records and messages."""
        pose = np.diag([radius, radius, radius, 1.0])
        pose[:3, 3] = centre
        return cls(reflectance, "sphere", pose=pose, name=name)

    @classmethod
    def floor(cls, height: float, half_width: float, reflectance: Reflectance, name: str = "floor") -> Surface:
        """A square that faces up (+z) at z = `height`, its sides 2 · `half_width` long, in metres."""
        pose = np.diag([half_width, half_width, 1.0, 1.0])
        pose[2, 3] = height
        return cls(reflectance, "rectangle", pose=pose, name=name)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        reflectance: Reflectance,
        vertex_colours: bool = False,
        vertex_gamma: tuple[float, float] | None = None,
        **record: Any,
    ) -> Surface:
        """The mesh in the file at `path` (PLY, OBJ, …, in metres) with its UVs; several parts become one mesh.

        vertex_colours: whether the colours of its vertices are the `body_texture`; those of a glTF are linear, others
        sRGB. vertex_gamma: γ [rad] where R of these colours is 0 and where it is 1, linear, whose line is the
        `gamma_texture`. record: further fields of the Surface, such as pose, smooth or name. `InputError` for a file
        without faces, or without colours of vertices where they are asked for.
        """
        from hagoromo.files.mesh import read_coloured_mesh, read_mesh, uv_of, vertex_colours_of

        mesh = (read_coloured_mesh if vertex_colours or vertex_gamma is not None else read_mesh)(path)
        vertices = np.asarray(mesh.vertices)
        rounding = float(np.spacing(np.float32(np.abs(vertices).max())))
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        if rounding > LARGEST_ROUNDING * size and np.array_equal(vertices, vertices.astype(np.float32)):
            warnings.warn(
                f"{path} holds a mesh of {size:.3g} m in single precision, {rounding:.1g} m apart so far out: "
                "write it about (0, 0, 0) and place it by position",
                stacklevel=2,
            )
        if vertex_colours:
            stored, encoded = vertex_colours_of(mesh, path)
            colours = srgb_decode(255.0 * stored) if encoded else stored
            record["body_texture"] = SurfaceTexture(colours, of="vertices", name=f"{path}: colours of vertices")
        if vertex_gamma is not None:
            red = vertex_colours_of(mesh, path)[0][:, 0]
            stored = SurfaceTexture(red, of="vertices", name=f"{path}: R of vertices")
            record["gamma_texture"] = stored.between(*vertex_gamma)
        return cls(reflectance, "mesh", vertices, np.asarray(mesh.faces), uv=uv_of(mesh), **record)

    @property
    def figure(self) -> Hashable:
        """Key of its geometry: equal for two surfaces of the same arrays, shape and pose."""
        if self.traced_as_mesh:
            return self.traced().figure
        relief = (*map(Same, self.reliefs), Same(self.uv)) if any(self.reliefs) else ()
        pose = np.asarray(self.pose, float).tobytes()
        return self.shape, Same(self.vertices), Same(self.faces), self.smooth, pose, *relief

    @property
    def finest(self) -> float:
        """Length that is taken for its finest detail: 1 / DETAILS of its size [m]."""
        return float(np.linalg.norm(np.ptp(self.corners(), axis=0))) / DETAILS

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (n, 3), before the pose, and faces (m, 3), of which the front of a shape is the front; of round
        shapes a fine mesh.
        """
        if self.vertices is not None and self.faces is not None:
            return np.asarray(self.vertices), np.asarray(self.faces)
        return _fine_mesh(self.shape, bool(np.linalg.det(self.pose[:3, :3]) < 0.0))

    @property
    def traced_as_mesh(self) -> bool:
        """Whether a fine mesh stands for a round shape when rays are traced: where it gives off light, as places on it
        are drawn from triangles, and where its pose makes it what Mitsuba has no exact shape for: a sphere an
        ellipsoid, a cylinder an oblique or elliptic one.
        """
        if self.shape not in ROUND_SHAPES:
            return False
        if self.emission is not None:
            return True
        axes = np.asarray(self.pose, float)[:3, :3]
        lengths = np.linalg.norm(axes, axis=0)
        skew = np.abs((axes / lengths).T @ (axes / lengths) - np.eye(3)).max()
        alike = lengths[: {"sphere": 3, "cylinder": 2, "disk": 0}[self.shape]]  # axes that must be of one length
        return bool(len(alike) and max(skew, np.ptp(alike) / alike.max()) > LEAST_STRETCH)

    def traced(self) -> Surface:
        """The surface that rays are traced against: dark, and a mesh where `traced_as_mesh`."""
        if not self.traced_as_mesh:
            return replace(self, emission=None)
        vertices, faces = self.triangles()
        return replace(self, emission=None, shape="mesh", vertices=vertices, faces=faces)

    def corners(self) -> np.ndarray:
        """Corners of its bounding box in the world [m]: (8, 3)."""
        low, high = -np.ones(3), np.ones(3)
        if self.vertices is not None:
            low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        return (low + unit * (high - low)) @ self.pose[:3, :3].T + self.pose[:3, 3]


@cache
def _fine_mesh(shape: str, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a shape, as they stand before a pose that mirrors, or not; the same arrays each time."""
    vertices, faces, _ = shape_mesh(shape, FINE_ROUND, FINE_SPHERE)
    return vertices, faces[:, ::-1] if mirrored else faces


def _check_relief(key: str, texture: SurfaceTexture, who: str) -> None:
    """`InputError` for an image that holds no normals, or no heights."""
    wanted, what = (3, "three values a place, R, G, B") if key == "normal_texture" else (1, "one value a place")
    if texture.of != "image" or texture.values.shape[-1] != wanted:
        raise InputError(f"{who}: {key} must be an image of {what}: given {texture!r}")
    if key == "normal_texture" and not np.median(texture.values[..., 2]) > 0.5:
        raise InputError(
            f"{who}: {key} has blue below 0.5 in most places: normals in the tangent space of the UVs point away from "
            f"the surface, bake them so"
        )
