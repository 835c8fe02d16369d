"""The march along given rays: what a scene sends back along each of them, and its derivative in forward mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.prepared.voxels_of_boxes import read_boxes, write_boxes
from hagoromo.image.ray_gradient import ByLight, RayGradient, RayLight, as_light, ray_gradient
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.differentiable_medium import DifferentiableMedium
from hagoromo.transport.medium import Medium
from hagoromo.volume.voxels import PlainVoxels


class RayMarch:
    """A scene prepared for rays, and the parameters by which its light can be differentiated; lights themselves are not
    seen along rays.

    voxels: Dr.Jit Float (voxels · 4), density and axis (x, y, z) of every stored voxel in single precision; only
    where `differentiable`. materials: Dr.Jit Float, of each material the numbers that `columns` names: alpha, beta,
    gamma [rad], n, element, then the coefficients of its body and interface colours on the palette; beta and gamma of
    further lobes; then other parameters of a reflectance, each only where that of some material is not its plain value.
    Both can be replaced, or tracked by `dr.enable_grad`. Where the law of a body changes its colour, as a varnish does,
    derivatives by its parameters and by alpha leave the change of the colour out.
    Where `differentiable`, steps are those of a tolerance of 0.0025, or of that of the settings if it is less, and
    shadows are marched, if there are any. The derivatives of light and transmittance by densities are those of the
    shadows, too, and right to 1 %. A voxel of density 0 in a stored brick has one; where no voxel around it has an
    axis, it is that of matter with the axis (1, 1, 1). A derivative by axes leaves out light that begins or ends
    suddenly, at the horizon of plane elements.

        rays = hg.RayMarch(scene, differentiable=True)
        light, change = rays.derivative(origins, directions, voxels=direction_of_change)
    """

    def __init__(self, scene: Scene, settings: Settings | None = None, differentiable: bool = False) -> None:
        self.scene, settings = scene, settings or Settings()
        lit, kind = lit_by_points(scene, settings)[0], DifferentiableMedium if differentiable else Medium
        if differentiable and settings.shadows == "map":  # maps are made once, and would be held fixed
            settings = replace(settings, shadows="march")
        self._prepared = PreparedScene(lit, settings, medium=kind, by_camera=False)
        self.palette = self._prepared.palette

    @property
    def voxels(self) -> Any:
        """Density and axis of every stored voxel, flat."""
        medium = self._prepared.medium
        if medium is None or not isinstance(medium.voxels, PlainVoxels):
            raise InputError("the voxels are packed: prepare the scene with RayMarch(scene, differentiable=True)")
        return medium.voxels.values

    @voxels.setter
    def voxels(self, values: Any) -> None:
        assert self.voxels is not None and self._prepared.medium is not None
        self._prepared.medium.voxels = PlainVoxels(arrays().Float(values))

    @property
    def density(self) -> tuple[NDArray[np.float32], ...]:
        """Densities of each box on its lattice, (nz, ny, nx); 0 in bricks that it does not store. Like `axis` and
        `colour` they can be replaced, see `voxels`; `InputError` for densities above 0 where no brick is stored.
        """
        return tuple(each for each in read_boxes(self._boxes, "density") if each is not None)

    @density.setter
    def density(self, boxes: Sequence[ArrayLike | None]) -> None:
        write_boxes(self._boxes, "density", boxes)

    @property
    def axis(self) -> tuple[NDArray[np.float32], ...]:
        """Axes of each box on its lattice, (nz, ny, nx, 3), in box axes."""
        return tuple(each for each in read_boxes(self._boxes, "axis") if each is not None)

    @axis.setter
    def axis(self, boxes: Sequence[ArrayLike | None]) -> None:
        write_boxes(self._boxes, "axis", boxes)

    @property
    def colour(self) -> tuple[NDArray[np.float32] | None, ...]:
        """Coefficients of the body colours of each box on its basis, (nz, ny, nx, 4); None of a box without."""
        return read_boxes(self._boxes, "colour")

    @colour.setter
    def colour(self, boxes: Sequence[ArrayLike | None]) -> None:
        write_boxes(self._boxes, "colour", boxes)

    @property
    def _boxes(self) -> Medium:
        if self._prepared.medium is None:
            raise InputError("the scene has no volume boxes")
        return self._prepared.medium

    @property
    def columns(self) -> tuple[str, ...]:
        """What each number of a row of `materials` is."""
        return tuple(self._prepared.lighting.materials.columns)

    @property
    def materials(self) -> Any:
        """The rows of the materials, flat."""
        return self._prepared.lighting.materials.rows

    @materials.setter
    def materials(self, values: Any) -> None:
        self._prepared.lighting.materials.rows = arrays().Float(values)

    def along(self, origin: Any, direction: Any) -> tuple[list[Any], Any]:
        """Weights (a Dr.Jit Float per channel) and transmittance of Dr.Jit rays, Array3f in the world, unit.

        Far from (0, 0, 0), give `origin` in double precision.
        """
        weights, coverage = self._prepared.radiance(self._from_origin(origin), arrays().Array3f(direction))
        return weights, 1.0 - coverage

    def _from_origin(self, place: Any) -> Any:
        """Places in the world as those from the origin of the scene, in single precision."""
        origin = self._prepared.origin
        offset = type(place)(*(dr.opaque(type(place.x), float(origin[k])) for k in range(3)))
        return arrays().Array3f(place - offset)

    def __call__(self, origins: ArrayLike, directions: ArrayLike) -> RayLight:
        """The light towards `origins` (rays, 3) [m] along the unit vectors `directions` (rays, 3)."""
        return as_light(*self.along(*_rays(origins, directions)))

    def derivative(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        voxels: ArrayLike | None = None,
        materials: ArrayLike | None = None,
    ) -> tuple[RayLight, RayLight]:
        """The light along rays, and its derivative d/dt at t = 0 for the parameters p + t · change.

        voxels, materials: the change of each parameter, of its size; None for no change. `InputError` for another size.
        """
        changes = {"voxels": voxels, "materials": materials}
        chosen = [(getattr(self, key), change, key) for key, change in changes.items() if change is not None]
        if not chosen:
            raise InputError("nothing changes: give the change of voxels, of materials, or of both")
        for parameter, change, key in chosen:
            values = np.asarray(np.ravel(change), np.float32)
            if values.size != dr.width(parameter):
                raise InputError(f"{key}: the change has {values.size} numbers, {dr.width(parameter)} are needed")
            dr.enable_grad(parameter)
            dr.set_grad(parameter, column(arrays().Float, values))
        try:
            weights, transmittance = self.along(*_rays(origins, directions))
            dr.enqueue(dr.ADMode.Forward, *(parameter for parameter, _, _ in chosen))
            dr.traverse(dr.ADMode.Forward)
            slopes = [dr.grad(channel) for channel in weights], dr.grad(transmittance)
            dr.eval(weights, transmittance, slopes)  # together: one march
            return as_light(weights, transmittance), as_light(*slopes)
        finally:
            for parameter, _, _ in chosen:
                dr.disable_grad(parameter)

    def gradient(
        self, origins: ArrayLike, directions: ArrayLike, by_light: ByLight, by: Sequence[str] = ("density",)
    ) -> RayGradient:
        """The light along rays, and the gradient of a loss by all that it depends on, in reverse mode.

            ∂loss/∂p = Σ by_light.weights · ∂weights/∂p + Σ by_light.transmittance · ∂transmittance/∂p

        by_light: the derivative of the loss by the light of each ray, (rays, channels) by its weights, or a `RayLight`
        by both; or a function that gives one of these from the light. by: what p is, some of density, axis, colour,
        materials, lamps, rays; () for the light alone. It costs a few forward marches, whatever the number of voxels:
        `python benchmarks/gradient.py`. Only for `differentiable`.

        The light is that of two samples a step, each with a place of its own (`MarchAdjoint`). It differs from that of
        a call by the errors of both, see the tolerance above; the gradient is that of the light returned, with its
        steps held. It leaves out what jumps: the light of a plane at its horizon, where f drops to 0, which soft shells
        of planes have much of; the border between two materials; the edge of a surface before a lamp. It leaves out the
        shadow of what sends less than 1e-5 of a lamp's light to the eye. Voxels of bricks that are not stored have the
        gradient 0; a box built from arrays stores the bricks of 8³ voxels that hold any matter. By gamma and nu the
        facets of spheres, which are tabled, have none; where the law of a body changes its colour, as a varnish does,
        that is held.
        `InputError` for another shape, an unknown name, colours that no box has, rays that surfaces may meet, or lamps
        of which some stand at one place.
        """
        origin, direction = _rays(origins, directions)
        found = ray_gradient(self._prepared, self._from_origin(origin), arrays().Array3f(direction), by_light, by)
        if found.materials is not None:
            found = found._replace(materials=found.materials.reshape(-1, len(self.columns)))
        if found.lamps is not None:
            found = found._replace(lamps=_along_units(found.lamps, self.scene))
        if found.rays is not None and not dr.is_array_v(directions):
            found = found._replace(rays=(found.rays[0], _across(found.rays[1], np.asarray(directions, np.float64))))
        return found


def march(
    scene: Scene | RayMarch, origins: ArrayLike, directions: ArrayLike, settings: Settings | None = None
) -> RayLight:
    """What a scene sends back along single rays (MODEL §3, eq. 11), of which `render` makes images.

    origins: (rays, 3) [m], world. directions: (rays, 3), made unit, from the eye into the scene. scene: a `Scene`, or a
    `RayMarch`, which keeps the prepared scene for many calls and has the derivative. `InputError` for rays that are
    not finite or differ in number.

    >>> import numpy as np, hagoromo as hg
    >>> grey = hg.Reflectance(0.1, 0.4, 0.3, 1.5, body_colour=hg.Spectrum.constant(1.0))
    >>> ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.1, grey)
    >>> camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, -1.0, 0.0), (0.0, 0.0, 0.0))
    >>> scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, -1.0, 0.0)),), surfaces=(ball,))
    >>> light = hg.march(scene, [[0.0, -1.0, 0.0], [0.5, -1.0, 0.0]], [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    >>> light.transmittance.tolist()
    [0.0, 1.0]
    """
    rays = scene if isinstance(scene, RayMarch) else RayMarch(scene, settings)
    return rays(origins, directions)


def _along_units(by_lamps: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
    """The gradient by the scene's own lamps, those by directions of far ones at a right angle to them."""
    own = by_lamps[: len(scene.lamps)].copy()
    for row, lamp in zip(own, scene.lamps, strict=True):
        if not lamp.near:
            row[:3] = _across(row[None, :3], lamp.place[None])[0]
    return own


def _across(by_units: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """The gradient by vectors (count, 3) from that by them made unit."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    units = vectors / length
    return (by_units - units * (by_units * units).sum(axis=1, keepdims=True)) / length


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Any, Any]:
    """Rays as the kernels take them; Dr.Jit arrays stay as they are."""
    if dr.is_array_v(origins) and dr.is_array_v(directions):
        return origins, directions
    origin, direction = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    if origin.shape != direction.shape or origin.ndim != 2 or origin.shape[1] != 3:
        raise InputError(f"origins of shape {origin.shape}, directions of {direction.shape}: give (rays, 3) for both")
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    if not (np.isfinite(origin).all() and np.isfinite(length).all() and (length > 0.0).all()):
        raise InputError("origins and directions must be finite, and directions not (0, 0, 0)")
    jit = arrays()

    def vector(values: NDArray) -> Any:
        return jit.Array3f64(*(column(jit.Float64, values[:, k]) for k in range(3)))

    return vector(origin), vector(direction / length)
