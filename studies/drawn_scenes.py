"""Scenes drawn at random: matter, materials, lamps, surfaces and camera from one number, for studies.random_scenes.

A number always draws the same scene. Nothing in it is chosen to be easy: boxes are turned and overlap, lamps stand
behind matter or close to it, depths and albedos go from thin and dark to dense and nearly white. Numbers from
FIRST_WILD on draw from wider ranges, see WILD.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import hagoromo as hg

FIRST_WILD = 1000  # number of the first scene that is drawn from WILD
SIZES = 1e-3, 10.0  # of a scene [m]
SECOND_BOX, WITH_SURFACE = 0.3, 0.3
AREA_OF_SPHERE = 0.5  # of spheres of projected extinction, over that of the matter that they stand for
MANY_WORDS = 4  # lights from which they are counted, not named one by one
LESS = 0.9  # of the body of a material that gives back more than it takes, in each try
Array = NDArray[np.float64]
Draw = np.random.Generator


class Ranges(NamedTuple):
    """What scenes are drawn from: ends of ranges, and shares of scenes, boxes, materials or lamps.

    depths: mean free paths across a box at density 1. lacking: 1 − albedo, its largest and least value. sides: voxels
    of a box. lamps: their numbers, of equal chance. wide: of lights, those with a size. gammas: of facets [rad].
    materials, glossy, through, coloured: of materials. inside: of cameras, those in matter. boxes: at most. basis: of
    boxes, those whose voxels have colours of their own.
    """

    depths: tuple[float, float] = (0.5, 200.0)
    lacking: tuple[float, float] = (0.8, 0.005)
    sides: tuple[int, int] = (14, 32)
    lamps: tuple[int, ...] = (1, 1, 2, 4)
    wide: float = 0.05
    gammas: tuple[float, float] = (0.08, 0.6)
    materials: float = 0.3
    glossy: float = 0.4
    through: float = 0.2
    coloured: float = 0.2
    inside: float = 0.0
    boxes: int = 2
    basis: float = 0.0


USUAL = Ranges()
WILD = Ranges(
    depths=(1e-3, 1e4), lacking=(1.0, 5e-4), sides=(2, 32), lamps=(1, 2, 3, 8, 40), wide=0.2, gammas=(0.004, 1.4),
    materials=0.5, glossy=0.6, through=0.3, coloured=0.5, inside=0.15, boxes=4, basis=0.3,
)  # fmt: skip


class DrawnScene(NamedTuple):
    """A scene, and words for what was drawn."""

    scene: hg.Scene
    words: str


class DrawnMatter(NamedTuple):
    """Density (z, y, x), 0…1, and axes (z, y, x, 3) where matter has its own; fibres: whether these are tangents."""

    density: Array
    axis: Array | None = None
    fibres: bool = False


def drawn_scene(number: int, pixels: int) -> DrawnScene:
    """The scene of a number, as a picture of so many pixels a side."""
    draw = np.random.default_rng([number, 0x5CE7E])
    ranges = USUAL if number < FIRST_WILD else WILD
    size = between(draw, SIZES) if draw.random() < 0.5 else 1.0
    boxes, words = [], []
    for k in range(1 + int(draw.random() < SECOND_BOX) if ranges.boxes == 2 else draw.integers(1, ranges.boxes + 1)):
        away = unit(draw) * draw.uniform(0.0, 0.9) * size * k
        box, said = drawn_box(draw, ranges, size * (1.0 - 0.3 * k if ranges.boxes == 2 else 0.5**k), away)
        boxes.append(box)
        words.append(said)
    reach = max(float(np.linalg.norm(box.corners(), axis=1).max()) for box in boxes)
    surfaces, said = drawn_surfaces(draw, ranges, reach) if draw.random() < WITH_SURFACE else ((), "")
    words += [said] if said else []
    lights, said = drawn_lights(draw, ranges, boxes, reach)
    words.append(said)
    camera, said = drawn_camera(draw, ranges, reach, pixels)
    words += [said] if said else []
    return DrawnScene(hg.Scene(camera, boxes=tuple(boxes), surfaces=surfaces, **lights), "; ".join(words))


def drawn_camera(draw: Draw, ranges: Ranges, reach: float, pixels: int) -> tuple[hg.Camera, str]:
    """A camera that looks at (0, 0, 0), from around the matter or from within; and words for the latter."""
    eye = unit(draw) * draw.uniform(2.5, 5.0) * reach
    focal = 0.5 * pixels * float(np.linalg.norm(eye)) / reach
    within = ranges.inside > 0.0 and draw.random() < ranges.inside
    if within:
        eye, focal = eye * draw.uniform(0.01, 0.2), 0.5 * pixels
    up = (0.0, 0.0, 1.0) if abs(eye[2]) < 0.95 * np.linalg.norm(eye) else (0.0, 1.0, 0.0)
    camera = hg.Camera(pixels, pixels, (focal, focal), (pixels / 2, pixels / 2)).look_at(eye, (0, 0, 0), up)
    return camera, "camera within" if within else ""


def between(draw: Draw, ends: tuple[float, float]) -> float:
    """A number between two, whose logarithm is even."""
    return float(np.exp(draw.uniform(*np.log(ends))))


def unit(draw: Draw) -> Array:
    """A direction, even over the sphere."""
    found = draw.standard_normal(3)
    return found / np.linalg.norm(found)


def turned(draw: Draw) -> Array:
    """A rotation (3, 3)."""
    found, _ = np.linalg.qr(draw.standard_normal((3, 3)))
    return found * np.sign(np.linalg.det(found))


def places(side: int) -> tuple[Array, Array, Array]:
    """x, y and z of the voxels of a cube, −1…1 between its faces."""
    middle = (2.0 * np.arange(side) + 1.0) / side - 1.0
    z, y, x = np.meshgrid(middle, middle, middle, indexing="ij")
    return x, y, z


def noise(draw: Draw, side: int, width: float) -> Array:
    """Smooth noise of deviation 1."""
    found = gaussian_filter(draw.standard_normal((side,) * 3), width, mode="wrap")
    return np.asarray(found / max(found.std(), 1e-30))


def block(draw: Draw, side: int) -> DrawnMatter:
    """The whole cube."""
    return DrawnMatter(np.ones((side,) * 3))


def ball(draw: Draw, side: int) -> DrawnMatter:
    """A hard ball."""
    x, y, z = places(side)
    return DrawnMatter((x**2 + y**2 + z**2 < 0.9).astype(float))


def shell(draw: Draw, side: int) -> DrawnMatter:
    """A hollow ball."""
    x, y, z = places(side)
    radius = np.sqrt(x**2 + y**2 + z**2)
    return DrawnMatter(((radius < 0.95) & (radius > 0.7)).astype(float))


def soft_ball(draw: Draw, side: int) -> DrawnMatter:
    """A ball that fades outwards."""
    x, y, z = places(side)
    density = np.exp(-4.0 * (x**2 + y**2 + z**2))
    return DrawnMatter(np.where(density > 0.02, density, 0.0))


def gradient(draw: Draw, side: int) -> DrawnMatter:
    """A cube whose density rises a hundredfold from side to side."""
    along = np.einsum("c,czyx->zyx", unit(draw), np.stack(places(side)))
    return DrawnMatter(0.01 ** (0.5 - 0.5 * along / np.abs(along).max()))


def grains(draw: Draw, side: int) -> DrawnMatter:
    """Single voxels."""
    return DrawnMatter((draw.random((side,) * 3) < 0.3).astype(float))


def clumps(draw: Draw, side: int) -> DrawnMatter:
    """Lumps with hard faces and hollows between them."""
    return DrawnMatter((noise(draw, side, draw.uniform(1.0, 3.0)) > 0.3).astype(float))


def cloud(draw: Draw, side: int) -> DrawnMatter:
    """Density that differs smoothly, and vanishes in places."""
    found = np.maximum(noise(draw, side, draw.uniform(1.0, 4.0)) + 0.3, 0.0)
    return DrawnMatter(found / max(found.max(), 1e-30))


def sheet(draw: Draw, side: int) -> DrawnMatter:
    """A thin layer."""
    _, _, z = places(side)
    return DrawnMatter((np.abs(z) < 3.0 / side).astype(float))


def fibres(draw: Draw, side: int) -> DrawnMatter:
    """Voxels of fibres along one direction."""
    axis = np.broadcast_to(unit(draw), (side, side, side, 3))
    return DrawnMatter((draw.random((side,) * 3) < 0.3).astype(float), axis, fibres=True)


def cloth(draw: Draw, side: int) -> DrawnMatter:
    """Two sets of threads, over and under each other."""
    x, y, z = places(side)
    count = draw.integers(2, 4)
    thick, high = 0.35 / count, 0.3 / count
    density, axis = np.zeros_like(x), np.zeros((*x.shape, 3))
    axis[..., 2] = 1.0
    for k in range(count):
        middle = (2 * k + 1) / count - 1.0
        for first, along, across in ((0, x, y), (1, y, x)):
            phase = np.pi * (0.5 * count * (along + 1.0) + k + first)
            height, slope = high * np.sin(phase), 0.5 * high * np.pi * count * np.cos(phase)
            inside = (across - middle) ** 2 + (z - height) ** 2 < thick**2
            tangent = np.zeros((*x.shape, 3))
            tangent[..., first], tangent[..., 2] = 1.0, slope
            tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
            density[inside], axis[inside] = 1.0, tangent[inside]
    return DrawnMatter(density, axis, fibres=True)


MATTER: tuple[Callable[[Draw, int], DrawnMatter], ...] = (
    block, ball, shell, soft_ball, gradient, grains, clumps, cloud, sheet, fibres, cloth,
)  # fmt: skip


def drawn_axes(draw: Draw, density: Array) -> Array:
    """Axes for matter without its own: one, those of its own slopes, or smooth noise."""
    way, shape = draw.integers(3), density.shape
    if way == 0:
        return np.broadcast_to(unit(draw), (*shape, 3))
    if way == 1:
        slopes = np.gradient(-gaussian_filter(density, 2.0))
        found = np.stack(slopes[::-1], axis=-1) + 1e-6 * unit(draw)
    else:
        found = unit(draw) + 0.6 * np.stack([noise(draw, shape[0], 2.5) for _ in range(3)], axis=-1)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def drawn_colour(draw: Draw, ranges: Ranges) -> hg.Spectrum:
    """White, or a smooth colour whose brightest value is 1."""
    if draw.random() > ranges.coloured:
        return hg.Spectrum.constant(1.0)
    values = draw.uniform(draw.uniform(0.2, 0.6), 1.0, 3)
    return hg.Spectrum([400, 550, 700], (values / values.max()).tolist())


def drawn_material(draw: Draw, ranges: Ranges, element: str) -> hg.Reflectance:
    """A material that gives back no more than it takes."""
    keys: dict[str, Any] = {"beta": 0.0, "gamma": 0.3, "n": 1.5, "element": element}
    albedo = 1.0 - between(draw, (ranges.lacking[1], ranges.lacking[0]))
    if draw.random() < ranges.glossy:
        keys |= {"beta": draw.uniform(0.1, 1.0), "gamma": drawn_gamma(draw, ranges), "n": draw.uniform(1.3, 1.8)}
    if draw.random() < ranges.through:
        keys["transmission"] = draw.uniform(0.1, 0.7)
        if element == "cylinder":
            keys["clearness"] = draw.uniform(0.0, 0.8)
    colour = drawn_colour(draw, ranges)
    while True:
        try:
            return hg.Reflectance(albedo / math.pi, body_colour=colour, **keys)
        except hg.InputError:
            albedo, keys["beta"] = LESS * albedo, LESS * keys["beta"]


def drawn_gamma(draw: Draw, ranges: Ranges) -> float:
    """A half width of facets [rad]: even, of wild scenes in its logarithm."""
    return draw.uniform(*ranges.gammas) if ranges is USUAL else between(draw, ranges.gammas)


def drawn_box(draw: Draw, ranges: Ranges, size: float, middle: Array) -> tuple[hg.VolumeBox, str]:
    """A box about `middle` (3,) [m], turned at random, and words for it."""
    make, side, depth = (
        MATTER[draw.integers(len(MATTER))],
        int(draw.integers(*ranges.sides)),
        between(draw, ranges.depths),
    )
    matter = make(draw, side)
    element = "cylinder" if matter.fibres else ("plane", "cylinder", "sphere")[draw.integers(3)]
    count = int(draw.integers(2, 4)) if draw.random() < ranges.materials else 1
    materials = [drawn_material(draw, ranges, element) for _ in range(count)]
    parts = np.clip((noise(draw, side, 3.0) + 1.0) * 0.5 * count, 0, count - 1).astype(np.uint8)
    axis = drawn_axes(draw, matter.density) if matter.axis is None else matter.axis
    extinction = "isotropic" if element == "sphere" and draw.random() < 0.5 else "projected"
    tau = depth / size / (AREA_OF_SPHERE if extinction == "projected" else 1.0)
    pose = np.eye(4)
    pose[:3, :3] = turned(draw)
    pose[:3, 3] = middle - pose[:3, :3] @ np.full(3, 0.5 * size)
    basis = tuple(drawn_colour(draw, ranges) for _ in range(draw.integers(1, 5))) if has_basis(draw, ranges) else ()
    colours = draw.dirichlet(np.ones(len(basis)), (side,) * 3) if basis else None
    box = hg.VolumeBox.from_arrays(
        matter.density, axis, size / side, tau, materials, parts, colours, pose=pose, extinction=extinction, basis=basis
    )
    albedo = max(one.body_albedo for one in materials)
    few = f", {count} materials" if count > 1 else ""
    through = " that let light through" if any(one.transmission for one in materials) else ""
    glossy = ", glossy" if any(one.beta for one in materials) else ""
    few += ", colours of voxels" if basis else ""
    name = make.__name__.replace("_", " ")
    return box, f"{name} of {element}s{through}{glossy}{few}, depth {depth:.3g}, albedo {albedo:.3g}"


def has_basis(draw: Draw, ranges: Ranges) -> bool:
    """Whether the voxels of a box have colours of their own."""
    return ranges.basis > 0.0 and draw.random() < ranges.basis


def drawn_surfaces(draw: Draw, ranges: Ranges, reach: float) -> tuple[tuple[hg.Surface, ...], str]:
    """A floor, a ball beside the matter, or one that stands in it; and words for it."""
    matter = drawn_material(draw, ranges, "plane")
    way = draw.integers(3)
    if way == 0:
        return (hg.Surface.floor(-0.8 * reach, 2.0 * reach, matter),), "floor"
    if way == 1:
        return (
            hg.Surface.sphere((unit(draw) * 1.1 * reach).tolist(), 0.4 * reach, matter, name="ball"),
        ), "ball beside"
    return (hg.Surface.sphere((unit(draw) * 0.2 * reach).tolist(), 0.3 * reach, matter, name="ball"),), "ball within"


def drawn_lights(draw: Draw, ranges: Ranges, boxes: list[hg.VolumeBox], reach: float) -> tuple[dict[str, Any], str]:
    """One to four lights, as keys of a scene; and words for them."""
    lamps: list[hg.Lamp] = []
    area_lamps: list[hg.AreaLamp] = []
    found: dict[str, Any] = {"lamps": lamps, "area_lamps": area_lamps}
    words = []
    for _ in range(int(draw.choice(ranges.lamps))):
        kinds = (
            ("sphere", "rectangle", "tube", "sky") if draw.random() < ranges.wide else ("far", "near", "close", "spot")
        )
        way = kinds[draw.integers(4)]
        bright, to = draw.uniform(0.3, 1.0), unit(draw)
        spectrum = hg.Spectrum.named("D65" if draw.random() < 0.7 else "A")
        distance = draw.uniform(1.3, 3.0) * reach
        if way == "close":
            distance = just_outside(boxes, to, reach) + draw.uniform(0.03, 0.2) * reach
        place = distance * to
        own: dict[str, Any] = {"spectrum": spectrum, "name": f"{way} {len(words)}"}
        if way == "far":
            lamps.append(hg.Lamp(to_lamp=to, intensity=bright, **own))
        elif way in ("near", "close"):
            lamps.append(hg.Lamp(position=place, intensity=bright * distance**2, **own))
        elif way == "spot":
            power = between(draw, (1.0, 20.0))
            lamps.append(hg.Lamp(position=place, intensity=bright * distance**2, axis=-to, axis_power=power, **own))
        elif way == "sky":
            values = draw.random((8, 16)) ** 2
            values[draw.integers(8), draw.integers(16)] = between(draw, (1.0, 100.0))
            found["environment"] = hg.Environment(values, scale=0.3 * bright, spectrum=spectrum)
        else:
            area_lamps.append(drawn_area_lamp(draw, way, place, bright, reach, own))
        words.append(way)
    if len(words) > MANY_WORDS:
        words = [f"{words.count(way)} {way}" for way in sorted(set(words))]
    return found, "light: " + ", ".join(words)


def drawn_area_lamp(
    draw: Draw, way: str, place: Array, bright: float, reach: float, own: dict[str, Any]
) -> hg.AreaLamp:
    """A lamp with a size that looks at (0, 0, 0)."""
    distance = float(np.linalg.norm(place))
    wide = draw.uniform(0.1, 0.6) * (distance - reach) + 0.02 * reach
    if way == "sphere":
        return hg.AreaLamp(place, radius=0.5 * wide, radiance=bright * distance**2 / (0.25 * math.pi * wide**2), **own)
    side = np.cross(place, unit(draw))
    side *= wide / np.linalg.norm(side)
    if way == "tube":
        radiance = bright * distance**2 / (0.1 * wide**2)
        return hg.AreaLamp(place, radius=0.05 * wide, along=side.tolist(), radiance=radiance, **own)
    other = np.cross(side, place) / distance  # side × other shines back along place
    edges = (side, other) if np.dot(np.cross(side, other), place) < 0 else (other, side)
    return hg.AreaLamp(place, edges=edges, radiance=bright * distance**2 / wide**2, **own)


def just_outside(boxes: list[hg.VolumeBox], to: Array, reach: float) -> float:
    """How far along a direction the last of the boxes ends [m]."""
    ways = np.linspace(0.0, 1.01 * reach, 400)
    inside = [way for way in ways if any(box.contains(way * to) for box in boxes)]
    return float(max(inside, default=0.0))
