"""Object page: the maps, colours, lamps and photographs of an object as what the viewer's script reads."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import camera_white
from hagoromo.errors import InputError
from hagoromo.files.finite import finite_json
from hagoromo.light.lamp import stated_spectrum
from hagoromo.measurement.photographed import Photographed
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import EVIDENCE, FITTED_BODY_LAW, losses
from hagoromo.reflectance.torrance_sparrow import normal_fresnel
from hagoromo_page.publication.closely import BENT_STOPS, OPEN_STOPS, CloseLook
from hagoromo_page.publication.colours import PageColours, page_colours
from hagoromo_page.publication.document import Viewer, overhead
from hagoromo_page.publication.notes import Note
from hagoromo_page.publication.page_lamps import PageLamp, jpeg_text, middle_of, page_lamp, photograph_picture
from hagoromo_page.publication.planes import PackedPlanes, pack_planes
from hagoromo_page.publication.quantised import ERROR_ENDS, Quantised, quantised, scale_of
from hagoromo_page.publication.surface_maps import FLIP, SurfaceMaps

LONGEST_SIDE = 4096  # px, of a texture that every browser takes
PIXELS_PER_BYTE = 0.6  # of one file: more never fit
PHOTOGRAPH_SIDE = 900  # px, of the longer side of a photograph on the page
PHOTOGRAPHS_SHARE = 0.25  # of the bytes of a page
TILE_SIDE, RAY_CELLS = 512, 32
DISPLAY_KEY = 0.8  # display value of the brightest body under the first lamp of the page
FIRST_LAMP = (-0.33, 0.36)  # on the page's disc, as in viewer.js
# What the shader reads of a material; the colours of its parts and α are in `colours` and in the map of bodies
ENTRIES: dict[str, Callable[[MaterialEstimate], Any]] = {
    **{key: attrgetter(key) for key in ("beta", "gamma", "n", *FITTED_BODY_LAW)},
    "tail": lambda one: 1.0 / one.nu,
    "lobes": lambda one: [list(lobe) for lobe in one.all_lobes(1.0, 1.0)[1:]],  # in β and γ of the first one
    "grey": lambda one: not has_measured_gloss(one),  # in views of the gloss
}
ALBEDO = "Diffuse albedo: the body's colour without shading or gloss."
ERRORS = "hv-errors"  # element with the errors of distances
LEAST_BYTES = 5000  # of a picture
GENTLE = 0.97  # how much more than needed a picture is reduced


@dataclass(frozen=True, eq=False)
class PageSource:
    """maps of the object; taken: the camera and lamps they were measured with; photographs: to compare with;
    assumptions: of the measurement, in words. look: what is looked at closely. facts: of the object, by name, such as
    its inventory number.
    """

    maps: SurfaceMaps
    taken: Photographed
    photographs: tuple[Photograph, ...] = ()
    assumptions: tuple[str, ...] = ()
    look: CloseLook | None = None
    facts: tuple[tuple[str, str], ...] = ()
    notes: tuple[Note, ...] = ()


@dataclass(frozen=True, eq=False)
class ObjectPage:
    """viewer: what the document holds. size: (width, height) of the picture [px]. reduced: photograph px per px."""

    viewer: Viewer
    size: tuple[int, int]
    reduced: float


def single_page(source: PageSource, limit: int) -> ObjectPage:
    """The page as one file of at most `limit` bytes; its picture is reduced where it must be."""
    maps = whole = source.maps
    height, width = maps.labels.shape
    factor = max(1.0, max(width, height) / LONGEST_SIDE, math.sqrt(maps.known.sum() / (PIXELS_PER_BYTE * limit)))
    pictures_limit = PHOTOGRAPHS_SHARE * limit
    for _ in range(8):
        maps = whole if factor == 1.0 else whole.reduced(factor)
        made = quantised(maps)
        data, pictures = _data(source, maps, made, width / maps.labels.shape[1], pictures_limit)
        packed = pack_planes(made.planes, maps.known)
        tiles = [{"key": "0-0-0", "header": packed.header}]
        viewer = Viewer(data | {"tiles": tiles}, {"0-0-0": packed.text}, pictures, _errors(source))
        rest = overhead(viewer)
        if rest + len(packed.text) <= limit:
            return ObjectPage(viewer, (maps.labels.shape[1], maps.labels.shape[0]), data["pixel"])
        if rest + LEAST_BYTES > limit:
            raise InputError(f"a page of {limit} bytes is too small: give {2 * (rest + LEAST_BYTES)} or more")
        factor *= math.sqrt(len(packed.text) / (limit - rest)) / GENTLE
    raise InputError(f"the picture does not fit into {limit} bytes: give more, or a folder instead of an .html file")


def tiled_page(source: PageSource, home: Path) -> ObjectPage:
    """The page with tiles at full resolution and coarser ones, written to `home`/tiles."""
    maps = source.maps
    height, width = maps.labels.shape
    scales = scale_of(maps)
    made = Quantised({}, scales)
    data, pictures = _data(source, maps, made, 1.0, math.inf)
    (home / "tiles").mkdir()
    levels, factor = [], 1
    while True:
        small = maps if factor == 1 else maps.reduced(factor)
        rows, columns = (-(-side // TILE_SIDE) for side in small.labels.shape)
        planes = quantised(small, scales).planes
        for row in range(rows):
            for column in range(columns):
                part = tuple(slice(k * TILE_SIDE, (k + 1) * TILE_SIDE) for k in (row, column))
                packed = pack_planes({name: one[part] for name, one in planes.items()}, small.known[part])
                _write_tile(home / "tiles", f"{len(levels)}-{column}-{row}", packed)
        across, down = small.labels.shape[1], small.labels.shape[0]
        levels.append({"factor": width / across, "width": across, "height": down, "tiles": rows * columns})
        if rows * columns == 1:
            break
        factor *= 2
    data |= {"levels": levels, "side": TILE_SIDE, "folder": True, "tiles": []}
    return ObjectPage(Viewer(data, {}, pictures, _errors(source)), (width, height), 1.0)


def _errors(source: PageSource) -> dict[str, str]:
    packed = None if source.look is None else source.look.packed
    return {} if packed is None else {ERRORS: packed.text}


def _write_tile(folder: Path, key: str, packed: PackedPlanes) -> None:
    text = f'hagoromoTile("{key}", {finite_json(packed.header, key)}, "{packed.text}");\n'
    (folder / f"{key}.js").write_text(text, encoding="utf-8", newline="\n")


def _data(
    source: PageSource, maps: SurfaceMaps, made: Quantised, pixel: float, pictures_limit: float
) -> tuple[dict[str, Any], dict[str, str]]:
    """What the script reads, and photographs as JPEG by identifier. pixel: photograph px per px of the picture."""
    taken = source.taken
    lamp = stated_spectrum(taken.lamps)
    colours = page_colours(maps.materials, taken.camera.response, lamp)
    channels = maps.body.shape[2]
    lamps = [page_lamp(one, maps, channels, colours.exact) for one in taken.lamps]
    exposure = _exposure(maps, colours)
    listed, pictures = _photographs(maps, source.photographs, lamps, colours, exposure, pictures_limit)
    height, width = maps.labels.shape
    camera = maps.camera
    middle = FLIP @ (camera.world_to_camera[:3, :3] @ middle_of(maps) + camera.world_to_camera[:3, 3])
    albedo_factor = _albedo_factor(maps, colours)
    views, legend = page_views(maps, made.scales, albedo_factor)
    views += [] if source.look is None else close_views(source.look, made.scales)
    return {
        "title": maps.name,
        "note": _note(maps, pixel),
        "facts": source.facts,
        "notes": source.notes,
        "corner": [maps.x, maps.y],
        "assumptions": [*source.assumptions, *_own_assumptions(maps, colours)],
        "alone": True,
        "folder": False,
        "width": width,
        "height": height,
        "pixel": pixel,
        "side": max(width, height),
        "levels": [{"factor": 1, "width": width, "height": height, "tiles": 1}],
        "hasScale": maps.has_scale and maps.depth is not None,
        "focal": list(camera.focal),
        "principal": list(camera.principal),
        "rays": _rays(maps),
        "middle": middle.tolist(),
        "scales": made.scales,
        "materials": [{key: entry(one) for key, entry in ENTRIES.items()} for one in maps.materials],
        "lobes": max(len(one.lobes) for one in maps.materials),
        "colours": colours.record(),
        "lamps": [one.record() for one in lamps],
        "photographs": listed,
        "exposure": exposure,
        "albedoFactor": albedo_factor,
        "views": views,
        "legend": legend,
        "closely": None if source.look is None else source.look.record(maps.x, maps.y),
    }, pictures


def _own_assumptions(maps: SurfaceMaps, colours: PageColours) -> list[str]:
    """What the page takes for given beside the measurement."""
    if maps.depth is None:
        shape = "No shape was measured, only normals: nothing casts a shadow, and lengths are in pixels."
    else:
        shape = "Shadows are cast by the measured surface. Light from one part of it onto another is left out."
    said = [shape]
    if maps.depth is not None and not maps.has_scale:
        said.append("The photographs have no scale: lengths are in pixels.")
    if not colours.exact:
        said.append(
            "Colours are those of the camera's channels, shown as red, green and blue: its response or the spectrum of "
            "the lamps is not known. With both, other lamps and the eye could be chosen."
        )
    said += [f"Left out: {loss}." for loss in (*losses("page", maps.materials), EVIDENCE)]
    vague = [one.name for one in maps.materials if one.beta > 0.0 and not has_measured_gloss(one)]
    if vague:
        said.append(f"The highlight is not determined by the photographs, and shown as they allow: {', '.join(vague)}.")
    return said


def has_measured_gloss(material: MaterialEstimate) -> bool:
    """Whether the photographs determine a highlight of the material."""
    return material.beta > 0.0 and material.identifiable.get("gamma", True)


def _rays(maps: SurfaceMaps) -> dict[str, Any]:
    """x/z and y/z of the camera's rays on a grid over the picture; two by two are exact without distortion."""
    height, width = maps.labels.shape
    cells = RAY_CELLS if any(maps.camera.distortion) else 1
    x, y = np.meshgrid(np.linspace(0, width, cells + 1), np.linspace(0, height, cells + 1))
    rays = maps.camera.unproject(np.stack([x, y], axis=-1)) @ maps.camera.world_to_camera[:3, :3].T
    values = (rays[..., :2] / rays[..., 2:]).ravel()
    return {"columns": cells + 1, "rows": cells + 1, "values": [float(f"{value:.9g}") for value in values]}


def first_direction() -> NDArray[np.float64]:
    """Unit direction to the first lamp of a page, page's axes."""
    radius = math.hypot(*FIRST_LAMP)
    across = math.sin(radius * math.pi / 2) / radius
    return np.array([FIRST_LAMP[0] * across, FIRST_LAMP[1] * across, math.cos(radius * math.pi / 2)])


def _exposure(maps: SurfaceMaps, colours: PageColours) -> float:
    """Exposure that shows the brightest half percent of the bodies under the first lamp at DISPLAY_KEY."""
    known = maps.known
    matrix = colours.balanced[0][0] @ colours.body[0][0]
    facing = np.maximum(maps.normals[known] @ first_direction(), 0.0)
    brightest = (math.pi * facing[:, None] * (maps.body[known] @ matrix.T)).max(axis=1)
    level = float(np.percentile(brightest, 99.5))
    return DISPLAY_KEY / level if level > 0.0 else 1.0


def _albedo_factor(maps: SurfaceMaps, colours: PageColours) -> float:
    """What body colours are shown times: 1, or less where a hundredth of them is beyond 1 (see `colour_factor`)."""
    matrix = colours.balanced[0][0] @ colours.body[0][0]
    white = float(np.percentile((math.pi * maps.body[maps.known] @ matrix.T).max(axis=1), 99.0))
    return 1.0 / max(white, 1.0)


def _photographs(
    maps: SurfaceMaps,
    photographs: Sequence[Photograph],
    lamps: Sequence[PageLamp],
    colours: PageColours,
    exposure: float,
    limit: float,
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Names and lamps of the photographs, and their JPEGs, of at most `limit` bytes together."""
    places = {one.name: k for k, one in enumerate(lamps)}
    usable = [one for one in photographs if one.name in places and lamps[places[one.name]].level > 0.0]
    height, width = maps.labels.shape
    side = min(PHOTOGRAPH_SIDE, max(width, height))
    while usable:
        size = max(round(width * side / max(width, height)), 1), max(round(height * side / max(width, height)), 1)
        texts = []
        for one in usable:
            to_display = colours.balanced[0][0]
            if not colours.exact and one.camera.response is not None:
                to_display = to_display / camera_white(one.lamps[0].spectrum, one.camera.response)
            gain = exposure * math.pi / lamps[places[one.name]].level
            texts.append(jpeg_text(photograph_picture(one, maps, to_display, gain, size)))
        if sum(map(len, texts)) <= limit:
            names = [f"hv-photograph-{k}" for k in range(len(texts))]
            listed = [
                {"name": one.name, "lamp": places[one.name], "id": name}
                for one, name in zip(usable, names, strict=True)
            ]
            return listed, dict(zip(names, texts, strict=True))
        side = round(0.8 * side)
        if side < 200:
            usable, side = usable[: len(usable) // 2], PHOTOGRAPH_SIDE
    return [], {}


def _note(maps: SurfaceMaps, pixel: float) -> str:
    height, width = maps.labels.shape
    size = f"{width} × {height} px"
    if pixel > 1.001:
        size += f", reduced: {pixel:.2f} px of the photographs each"
    if maps.has_scale and maps.depth is not None:
        each = 1000.0 * float(np.median(maps.depth[maps.known])) / float(np.mean(maps.camera.focal))
        size += f"; {each:.3g} mm a pixel"
    return size


def page_views(
    maps: SurfaceMaps, scales: dict[str, Any], albedo_factor: float = 1.0
) -> tuple[list[dict[str, Any]], dict[str, list[float]]]:
    """The views of the page, and the ranges of the colour scales of γ [rad] and of the peak β F₀ [1/sr].

    albedo_factor: what body colours are shown times.
    """
    times = "" if albedo_factor == 1.0 else (
        f" Times {albedo_factor:.2g}, as they are beyond 1: how strong the lamps are was not stated."
    )  # fmt: skip
    views: list[dict[str, Any]] = [
        {"label": "Lit", "number": 0},
        {"label": "Normals", "number": 1, "note": "Red: faces right. Green: faces up. Blue: faces the camera."},
        {"label": "Body colour", "number": 2, "note": ALBEDO + times},
    ]
    glossy = [one for one in maps.materials if one.beta > 0.0]
    legend = {
        "gamma": _widened(scales.get("gamma") or _span([one.gamma for one in glossy])),
        "peak": _peaks(maps, scales),
    }
    without = [one.name for one in maps.materials if not has_measured_gloss(one)]
    has_gloss = len(without) < len(maps.materials)
    grey = f"Grey: no highlight is determined by the photographs ({', '.join(without)})." if without else ""
    of_gloss = {"gloss": True} | _of_each([], grey)
    if has_gloss:
        which = " of the first lobe" if any(one.lobes for one in maps.materials) else ""
        measured = [one for one in maps.materials if has_measured_gloss(one)]
        each = [f"{one.name} {math.degrees(one.gamma):.3g}°" for one in measured]
        note = _of_each(each if maps.gamma is None else [], grey)
        low, high = (f"{math.degrees(one):.2g}°" for one in legend["gamma"])
        views.append(_scaled("Gloss: width", 3, low, f"half width of the highlight γ{which}", high) | of_gloss | note)
        each = [f"{one.name} {one.beta * normal_fresnel(one.n):.2g}" for one in measured]
        note = _of_each(each if maps.beta is None else [], grey)
        low, high = (f"{one:.2g}" for one in legend["peak"])
        views.append(
            _scaled("Gloss: strength", 4, low, f"peak of the highlight β F₀{which} [1/sr]", high) | of_gloss | note
        )
    if "normal_error" in scales:
        ends = [f"{math.degrees(one):.2g}°" for one in scales["normal_error"]]
        views.append(_of_error("Error: normal", 5, ends, "standard error of the normal", "normal_error"))
    key, what = ("gloss_error", "gloss") if has_gloss and "gloss_error" in scales else ("body_error", "colour")
    if key in scales:
        ends = [f"{100 * one:.2g} %" for one in scales[key]]
        quantity = "of γ" if what == "gloss" else "of the body colour"
        view = _of_error(f"Error: {what}", 6, ends, f"relative standard error {quantity}", key)
        views.append(view | of_gloss if what == "gloss" else view)
    return views, legend


def close_views(look: CloseLook, scales: dict[str, Any]) -> list[dict[str, Any]]:
    """The views of curvature, occlusion and stretched colours."""
    bent, dark = scales["curvature"][1], scales["occlusion"][0]
    unit = f"mean curvature [1/{look.unit}]: grooves below 0, ridges above"
    views = [
        _scaled("Curvature", 7, f"−{bent:g}", unit, f"{bent:g}") | {"stops": BENT_STOPS},
        _scaled("Occlusion", 8, f"{100 * dark:.0f} %", "share of the sky that is open", "100 %")
        | {"stops": OPEN_STOPS},
    ]
    if look.stretch is not None:
        note = "Decorrelation stretch: faint differences are as strong as the others. Hues are no longer true."
        views.append({"label": "Stretched colours", "number": 9, "note": note})
    return views


def _of_error(label: str, number: int, ends: Sequence[str], unit: str, key: str) -> dict[str, Any]:
    """A view of standard errors, whose scale leaves out a few pixels at each end."""
    low, high = ends
    share = f"{ERROR_ENDS[0]:g} % of the pixels lie beyond each end"
    return _scaled(label, number, f"≤ {low}", f"{unit}; {share}", f"≥ {high}") | {"error": key}


def _of_each(values: Sequence[str], grey: str) -> dict[str, str]:
    """The note of a view of the gloss. values: of materials that have one value each; grey: what is grey, and why."""
    one = f"One value for each material: {', '.join(values)}." if values else ""
    said = " ".join(filter(None, (one, grey)))
    return {"note": said} if said else {}


def _peaks(maps: SurfaceMaps, scales: dict[str, Any]) -> list[float]:
    """Range of β F₀ [1/sr] over the object."""
    facing = [normal_fresnel(one.n) for one in maps.materials]
    if "beta" in scales:
        return _widened([scales["beta"][0] * min(facing), scales["beta"][1] * max(facing)])
    return _widened(_span([m.beta * f for m, f in zip(maps.materials, facing, strict=True) if m.beta > 0.0]))


def _span(values: Sequence[float]) -> list[float]:
    """Least and largest value; any range above 0 where there is none."""
    return [min(values, default=0.1), max(values, default=0.1)]


def _scaled(label: str, number: int, low: str, unit: str, high: str) -> dict[str, Any]:
    return {"label": label, "number": number, "range": True, "low": low, "unit": unit, "high": high}


def _widened(limits: Sequence[float]) -> list[float]:
    """A range that is never empty."""
    low, high = float(limits[0]), float(limits[1])
    return [low, high] if high > 1.05 * low else [low / 1.5, high * 1.5]
