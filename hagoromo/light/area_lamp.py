"""AreaLamp: a lamp with a size, which shines alike from every place and into every direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.light_points import (
    COUNTS,
    FINE,
    LightPoints,
    PointSources,
    error_of_points,
    light_at,
    probes_between,
)
from hagoromo.light.other_programs import MitsubaPlugin, UsdLight, at
from hagoromo.light.shapes import shape_of
from hagoromo.light.shapes.lamp_shape import AreaLight, LampShape
from hagoromo.light.shapes.rectangle import Rectangle
from hagoromo.light.shapes.sphere import Sphere
from hagoromo.light.spectrum import Spectrum, checked_spectrum


@dataclass(frozen=True, eq=False)
class AreaLamp:
    """A lamp of some shape about `position`: a sphere of `radius`, a rectangle with two sides `edges`, or what further
    keys say, see `hagoromo.light.shapes`.

    position: (3,) [m], world. radius: [m]; the sphere shines outwards. edges: (2, 3) the sides of the rectangle as
    vectors at right angles [m], world; it shines to the side of edges[0] × edges[1]. radiance: [W/(m² sr) times the
    unit of `spectrum`], the same all over it and into all directions (Lambert's law). spectrum: relative spectrum of
    its light. visible: whether the camera sees the lamp itself. It is light only: it casts no shadow, and
    hides nothing. `InputError` when the numbers make no lamp.

    >>> lamp = hg.AreaLamp(position=(0, 0, 1), edges=((0, 0.2, 0), (0.3, 0, 0)), radiance=10)
    >>> lamp.normal.tolist(), round(lamp.area, 3)
    ([0.0, 0.0, -1.0], 0.06)
    """

    position: NDArray[np.float64]
    shape: LampShape
    radiance: float
    spectrum: Spectrum
    name: str
    visible: bool
    what = "area lamp"
    surface = None

    def __init__(
        self,
        position: ArrayLike,
        radius: float | None = None,
        edges: ArrayLike | None = None,
        radiance: float = 1.0,
        spectrum: Spectrum | None = None,
        name: str = "",
        visible: bool = False,
        **keys: Any,
    ) -> None:
        who = f"area lamp {name!r}"
        if not (np.isfinite(radiance) and radiance > 0.0):
            raise InputError(f"{who}: radiance is {radiance!r:.60}: give a finite number above 0")
        given = {key: _plain(value) for key, value in {"radius": radius, "edges": edges, **keys}.items()}
        keep = object.__setattr__
        keep(self, "position", _place(position, who))
        keep(self, "shape", shape_of({key: value for key, value in given.items() if value is not None}, who))
        keep(self, "radiance", float(radiance))
        white = Spectrum.constant(1.0)
        keep(self, "spectrum", white if spectrum is None else checked_spectrum(spectrum, f"{who}: spectrum"))
        keep(self, "name", name)
        keep(self, "visible", bool(visible))

    def __repr__(self) -> str:
        """The name, the shape, where it stands and how strong it is."""
        place = ", ".join(f"{x:.4g}" for x in self.position)
        return f"AreaLamp({self.name!r}, {self.shape.word} at ({place}) m, radiance {self.radiance:g})"

    @property
    def radius(self) -> float | None:
        """Of a sphere [m]; else None."""
        return self.shape.radius if isinstance(self.shape, Sphere) else None

    @property
    def edges(self) -> NDArray[np.float64] | None:
        """(2, 3) sides of a rectangle [m]; else None."""
        return self.shape.sides if isinstance(self.shape, Rectangle) else None

    @property
    def normal(self) -> NDArray[np.float64]:
        """(3,) unit: the direction into which a rectangle shines. `InputError` for other shapes."""
        if not isinstance(self.shape, Rectangle):
            raise InputError(f"area lamp {self.name!r} is a {self.shape.word}: it has no one normal")
        return self.shape.normal

    @property
    def area(self) -> float:
        """Area that shines [m²]."""
        return self.shape.area

    def turned_record(self, turn: NDArray[np.float64], middle: NDArray[np.float64]) -> dict[str, Any]:
        """The keys that change when it is turned by a rotation (3, 3) about `middle` (3,) [m], as plain values."""
        return {"position": (turn @ (self.position - middle) + middle).tolist(), **self.shape.turned_record(turn)}

    @property
    def parts(self) -> tuple[AreaLamp]:
        """See `WideLight`: itself."""
        return (self,)

    @property
    def stands_at(self) -> NDArray[np.float64]:
        """(1, 3) its middle [m], world."""
        return self.position[None]

    def corners(self) -> NDArray[np.float64]:
        """(n, 3) places whose bounds hold the lamp [m], world."""
        return self.position + self.shape.corners()

    def moved(self, by: ArrayLike) -> AreaLamp:
        """The lamp with `by` (3,) added to its position [m]."""
        other = {key: getattr(self, key) for key in ("radiance", "spectrum", "name", "visible")}
        return AreaLamp(self.position + np.asarray(by), **self._keys(), **other)

    def points(self, low: NDArray[np.float64], high: NDArray[np.float64], tolerance: float) -> LightPoints:
        """Point lamps in its place, see `WideLight`: as many as keep the error within the tolerance."""
        probes = probes_between(low, high)
        whole = self.sources(FINE)
        truth = [light_at(probe, whole) for probe in probes]
        for count in COUNTS:
            few = self.sources(count)
            error = error_of_points(few, truth, probes)
            if error <= tolerance:
                break
        return LightPoints(self.point_lamps(few), len(few.places), error)

    def sources(self, count: int) -> PointSources:
        """`count` point sources, all alike, spread over it."""
        places, axes = self.shape.points(count)
        area = self.shape.far_area if axes is None else self.area
        return PointSources(self.position + places, axes, np.full(count, self.radiance * area / count))

    def point_lamps(self, sources: PointSources) -> list[Lamp]:
        """Point sources as lamps of its spectrum and name."""
        axes = [None] * len(sources.places) if sources.axes is None else sources.axes
        return [
            Lamp(place, intensity=float(strength), spectrum=self.spectrum, name=self.name, axis=axis)
            for place, axis, strength in zip(sources.places, axes, sources.strengths, strict=True)
        ]

    def on_device(self) -> AreaLight:
        """Its light in kernels; its position counts from the origin of the scene."""
        return self.shape.on_device(self.position, self.radiance, self.visible)

    def seen_on_device(self) -> AreaLight:
        """See `WideLight`."""
        return self.on_device()

    def mitsuba(self) -> tuple[MitsubaPlugin, list[str]]:
        """A black shape with an area emitter."""
        dark = MitsubaPlugin("bsdf", "diffuse", {"reflectance": Spectrum.constant(0.0)})
        light = MitsubaPlugin("emitter", "area", {"radiance": self.spectrum * self.radiance})
        kind, values = self.shape.mitsuba(self.position)
        lost = ["area lamps hide what is behind them: Mitsuba's are bodies"]
        return MitsubaPlugin("shape", kind, values, (dark, light)), lost

    def gltf(self) -> tuple[None, list[str]]:
        """None: lights of glTF have no size."""
        return None, [f"area lamp {self.name!r}" if self.name else "area lamps without a name"]

    def usd(self) -> tuple[UsdLight, list[str]]:
        """The light of its shape."""
        kind, axes, inputs = self.shape.usd()
        return UsdLight(kind, at(self.position, axes), self.spectrum, self.radiance, inputs), []

    def record(self) -> dict[str, object]:
        """The lamp as plain values, as a scene file states it."""
        return {
            "position": self.position.tolist(), **self._keys(), "radiance": self.radiance,
            "spectrum": self.spectrum.record(), "name": self.name, "visible": self.visible,
        }  # fmt: skip

    def _keys(self) -> dict[str, Any]:
        """Those of its shape, as plain values."""
        return {key: _plain(getattr(self.shape, key)) for key in self.shape.__struct_fields__}


def _plain(value: Any) -> Any:
    """Arrays and tuples as lists, NumPy's numbers as Python's."""
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _place(values: ArrayLike, who: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{who}: position must be numbers: given {values!r:.60}") from error
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{who}: position must be 3 finite numbers: given {array.tolist()!r:.60}")
    array.flags.writeable = False
    return array
