"""AreaLamp: a sphere or a rectangle that shines alike from every place and into every direction, as a lamp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, checked_spectrum

SQUARE = 1e-6  # cosine of the angle between the sides of a rectangle, at most
LEAST_SIDE = 1e-9  # of a rectangle, over the other one


@dataclass(frozen=True, eq=False)
class AreaLamp:
    """A sphere about `position` of `radius`, or a rectangle about `position` with two sides `edges`: one of the two.

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
    radius: float | None
    edges: NDArray[np.float64] | None
    radiance: float
    spectrum: Spectrum
    name: str
    visible: bool

    def __init__(
        self,
        position: ArrayLike,
        radius: float | None = None,
        edges: ArrayLike | None = None,
        radiance: float = 1.0,
        spectrum: Spectrum | None = None,
        name: str = "",
        visible: bool = False,
    ) -> None:
        who = f"area lamp {name!r}"
        if (radius is None) == (edges is None):
            raise InputError(f"{who}: give either radius (a sphere) or edges (a rectangle)")
        if radius is not None and not (np.isfinite(radius) and radius > 0.0):
            raise InputError(f"{who}: radius is {radius!r:.60}: give a length above 0 m")
        if not (np.isfinite(radiance) and radiance > 0.0):
            raise InputError(f"{who}: radiance is {radiance!r:.60}: give a finite number above 0")
        keep = object.__setattr__
        keep(self, "position", _numbers(position, (3,), f"{who}: position"))
        keep(self, "radius", None if radius is None else float(radius))
        keep(self, "edges", None if edges is None else _rectangle(edges, who))
        keep(self, "radiance", float(radiance))
        keep(
            self,
            "spectrum",
            Spectrum.constant(1.0) if spectrum is None else checked_spectrum(spectrum, f"area lamp {name!r}: spectrum"),
        )
        keep(self, "name", name)
        keep(self, "visible", bool(visible))

    def __repr__(self) -> str:
        """The name, the shape, where it stands and how strong it is."""
        place = ", ".join(f"{x:.4g}" for x in self.position)
        shape = "rectangle" if self.radius is None else "sphere"
        return f"AreaLamp({self.name!r}, {shape} at ({place}) m, radiance {self.radiance:g})"

    @property
    def normal(self) -> NDArray[np.float64]:
        """(3,) unit: the direction into which a rectangle shines. `InputError` for a sphere."""
        if self.edges is None:
            raise InputError(f"area lamp {self.name!r} is a sphere: it has no one normal")
        normal = np.cross(*self.edges)
        return normal / np.linalg.norm(normal)

    @property
    def area(self) -> float:
        """Area that shines [m²]."""
        if self.radius is not None:
            return 4.0 * math.pi * self.radius**2
        return float(np.linalg.norm(np.cross(*self.edges)))  # type: ignore[misc]

    def corners(self) -> NDArray[np.float64]:
        """(n, 3) places whose bounds hold the lamp [m], world."""
        if self.edges is None:
            return self.position + np.outer((-1.0, 1.0), np.full(3, self.radius))
        return self.position + 0.5 * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) @ self.edges

    def record(self) -> dict[str, object]:
        """The lamp as plain values, as a scene file states it."""
        edges = None if self.edges is None else self.edges.tolist()
        shape = {"edges": edges} if self.radius is None else {"radius": self.radius}
        return {
            "position": self.position.tolist(), **shape, "radiance": self.radiance, "spectrum": self.spectrum.record(),
            "name": self.name, "visible": self.visible,
        }  # fmt: skip


def _rectangle(edges: ArrayLike, who: str) -> NDArray[np.float64]:
    sides = _numbers(edges, (2, 3), f"{who}: edges")
    lengths = np.linalg.norm(sides, axis=1)
    if not (lengths.min() > LEAST_SIDE * lengths.max() and np.isfinite(lengths).all()):
        raise InputError(
            f"{who}: edges are {lengths[0]:.3g} m and {lengths[1]:.3g} m long: give two sides with a length"
        )
    if not abs(sides[0] @ sides[1]) <= SQUARE * lengths.prod():
        raise InputError(f"{who}: edges {sides.tolist()} are not at right angles: give the sides of a rectangle")
    return sides


def _numbers(values: ArrayLike, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} must be numbers: given {values!r:.60}") from error
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{what} must be {' × '.join(map(str, shape))} finite numbers: given {array.tolist()!r:.60}")
    array.flags.writeable = False
    return array
