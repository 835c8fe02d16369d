"""The march along given rays: what a scene sends back along each of them, and its derivative in forward mode."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.image.lit_by_points import lit_by_points
from hagoromo.image.prepared_scene import PreparedScene
from hagoromo.image.scene import Scene
from hagoromo.image.settings import Settings
from hagoromo.transport.differentiable_medium import DifferentiableMedium
from hagoromo.transport.medium import Medium
from hagoromo.volume.voxels import PlainVoxels


class RayLight(NamedTuple):
    """Of each ray: weights (rays, channels), radiance per unit of lamp spectrum and colour as in `Image`, and the
    transmittance (rays,), the share of the light from behind the boxes that passes them.
    """

    weights: NDArray[np.float32]
    transmittance: NDArray[np.float32]


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
        self._prepared = PreparedScene(lit, settings, medium=kind)
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
        jit, place = arrays(), self._prepared.origin
        offset = type(origin)(*(dr.opaque(type(origin.x), float(place[k])) for k in range(3)))
        weights, coverage = self._prepared.radiance(jit.Array3f(origin - offset), jit.Array3f(direction))
        return weights, 1.0 - coverage

    def __call__(self, origins: ArrayLike, directions: ArrayLike) -> RayLight:
        """The light towards `origins` (rays, 3) [m] along the unit vectors `directions` (rays, 3)."""
        return _light(*self.along(*_rays(origins, directions)))

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
            return _light(weights, transmittance), _light(*slopes)
        finally:
            for parameter, _, _ in chosen:
                dr.disable_grad(parameter)


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


def _light(weights: list[Any], transmittance: Any) -> RayLight:
    count = max(dr.width(channel) for channel in (*weights, transmittance))
    columns = [np.broadcast_to(np.array(channel, np.float32), (count,)) for channel in weights]
    return RayLight(np.stack(columns, axis=1), np.broadcast_to(np.array(transmittance, np.float32), (count,)).copy())
