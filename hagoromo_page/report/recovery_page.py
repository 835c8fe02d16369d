"""The page of a recovered object: photographs that were kept aside beside their predictions, normals, and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.plot import nice
from hagoromo.light.colour import delta_e_2000, srgb_encode
from hagoromo.photograph.photograph import Photograph
from hagoromo_page.report.page import page_picture, write_page
from hagoromo_page.report.report_pictures import around, map_picture
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.recovered import Recovered
from hagoromo_recovery.shading.mixed_gloss import mixed_gloss

MOST_SHOWN = 6  # photographs kept aside that the page shows
VIEWS = 4  # photographs whose normals the page shows
PHOTOGRAPH_WIDTH_PX = 320  # px, of a photograph on the page
SCALE_PERCENTILE = 95  # percentile of a map that its scale holds
WHITE_PERCENTILE = 99.5  # of the light of a photograph, what is shown as white
COVERED = 0.5  # opacity of a pixel that shows the object
BEHIND = 0.93  # grey behind normals


def write_recovery_report(path: Path, recovered: Recovered, record: dict[str, Any]) -> None:
    """Write the page to `path`: one self-contained HTML file. record: that of `Recovered.record`."""
    views = recovered.photographs[:: max(len(recovered.photographs) // VIEWS, 1)]
    known = record["errors"] and record["errors"]["position_m"]
    reach = nice(1e6 * known[1]) if known else 0.0
    write_page(
        path,
        "recovery.html.j2",
        name=recovered.name,
        photographs=record["photographs"],
        kept=len(recovered.kept),
        found=_found(recovered, record),
        remarks=[said[0].upper() + said[1:] + "." for said in record["remarks"]],
        gloss=[_gloss(material) for material in record["materials"]],
        places=_places(recovered, views),
        scores=[
            [s["name"], f"{s['psnr']:.2f}", f"{s['inside']:.2f}", f"{s['scaled']:.2f}"] for s in record["kept_aside"]
        ],
        assumptions=[f"{what}: {said}" for what, said in record["assumptions"].items()],
        shown=[_shown(recovered, kept) for kept in recovered.kept[:MOST_SHOWN]],
        normals=[_normals(recovered, p) for p in views],
        errors=[_errors(recovered, p, reach) for p in views] if reach else [],
        lit=recovered.lit,
        fuzzy=recovered.fuzzy is not None,
        stated=recovered.stated,
        shadows=bool(record["hagoromo"]["settings"]["shadows"]),
        complete=recovered.complete,
    )


def _found(recovered: Recovered, record: dict[str, Any]) -> list[str]:
    size = " × ".join(f"{1e3 * edge:.4g}" for edge in record["size_m"])
    said = [f"The lattice measures {size} mm; its nodes are {1e3 * record['voxel_m']:.3g} mm apart."]
    if record["assumptions"].get("scale", "").startswith("none"):
        said.append("These are not real millimetres: nothing gave the photographs a scale.")
    if errors := record["errors"]:
        position, normal, colour = (errors[key] for key in ("position_m", "normal_rad", "body_colour"))
        if position:
            said.append(
                f"Standard errors, median and 95th percentile: position {_both(position, 1e6)} µm, "
                f"normal {_both(normal, 180.0 / np.pi)}°, body colour {_both(colour, 100.0)} %."
            )
        if errors["too_thin"] > 0.0:
            said.append(
                f"Of {100.0 * errors['too_thin']:.1f} % of the surface no errors are stated: its matter is too thin "
                "for the lattice."
            )
        said.append(
            f"{100.0 * errors['never_shown']:.1f} % of the surface is lit in no photograph: it is closed smoothly."
        )
    if (material := record["material"]) and material["beta"] == 0.0:
        said.append(f"No gloss was found: β is below {material['interval_95']['beta'][1]:.2g} 1/sr.")
    if tried := record["matter_tried_db"]:
        words = ", ".join(f"{law} {db:.2f} dB" for law, db in tried.items())
        said.append(f"The matter is {record['matter']}. A first look tried: {words}.")
    if places := record["gloss"]:
        beta, gamma = ([f"{places[key][k]:.2g}" for k in (0, -1)] for key in ("beta", "gamma"))
        said.append(
            f"The gloss differs from place to place: β is {' to '.join(beta)} 1/sr and γ {' to '.join(gamma)} rad "
            "in 90 % of what photographs show."
        )
    if tried := record["gloss_tried_db"]:
        words = ", ".join(f"{kind} {db:.2f} dB" for kind, db in tried.items())
        said.append(f"A first look tried one gloss and one of each place: {words}.")
    if record["orders"] == "all":
        said.append("Light from one part of the object to another is computed.")
    if tried := record["orders_tried_db"]:
        words = ", ".join(f"{kind} {db:.2f} dB" for kind, db in tried.items())
        said.append(f"A first look tried light of the first order and of all orders: {words}.")
    if hollow := record["hollow"]:
        said.append(
            f"A hollow was found that no silhouette shows: one with a wall of {1e3 * hollow['wall_m']:.2g} mm left "
            f"{100.0 * (1.0 - hollow['left_over']):.0f} % less unexplained than a dent."
        )
    if not recovered.lit:
        tried = ", ".join(f"{kind} {db:.2f} dB" for kind, db in record["lights_tried_db"].items())
        said.append(f"The light is {record['lamps']}." + (f" A first look tried: {tried}." if tried else ""))
    for what, found in (("Cameras", recovered.look.cameras), ("Strengths", recovered.look.strengths)):
        if found is not None:
            said.append(f"{what}: {found}, estimated from the photographs that were used.")
    return said


def _both(values: list[float], scale: float) -> str:
    """Values to two digits, such as 240 and 5.1."""
    return " and ".join(f"{float(f'{scale * value:.2g}'):g}" for value in values)


def _gloss(material: dict[str, Any]) -> list[list[str]]:
    """Rows of the table of gloss."""
    words = {"beta": "β, weight of the interface [1/sr]", "gamma": "γ, half width of the facets [rad]", "n": "n, index"}
    rows = []
    for key, text in words.items():
        low, high = material["interval_95"][key]
        known = "yes" if material["identifiable"][key] else "no: what is usual stands in its place"
        rows.append([text, f"{material[key]:.4g}", f"{low:.4g} to {high:.4g}", known])
    return rows


def _shown(recovered: Recovered, kept: ObjectView) -> dict[str, Any]:
    """A photograph that was kept aside, its prediction, and maps of what is between them."""
    photograph, silhouette = kept.photograph, kept.silhouette
    light, _ = recovered.picture(photograph)
    values = photograph.values.astype(np.float64)
    values = np.repeat(values, 3, axis=2) if values.shape[2] == 1 else values
    there = photograph.mask & silhouette & np.isfinite(values).all(axis=2)
    white = max(float(np.percentile(values[there].max(axis=1), WHITE_PERCENTILE)), 1e-30)
    crop = around(silhouette)
    truth, found = np.nan_to_num(values) / white, light / white
    delta = np.where(there, delta_e_2000(np.clip(found, 0.0, 1.0), np.clip(truth, 0.0, 1.0)), 0.0)
    difference = 100.0 * (found - truth).mean(axis=2)
    limit = nice(float(np.percentile(np.abs(difference[there]), SCALE_PERCENTILE)))
    reach = nice(float(np.percentile(delta[there], SCALE_PERCENTILE)))
    return {
        "name": photograph.name,
        "pictures": [
            page_picture(_enlarged(truth[crop]), f"photograph {photograph.name}", "photograph, kept aside", True),
            page_picture(_enlarged(found[crop]), f"prediction of {photograph.name}", "prediction", True),
        ],
        "maps": [
            map_picture(difference, there, crop, "RdBu_r", (-limit, limit), "% of white", "prediction − photograph"),
            map_picture(delta, there, crop, "magma", (0.0, reach), "ΔE00", "colour difference"),
        ],
    }


def _normals(recovered: Recovered, photograph: Photograph) -> Any:
    """The normals, or axes of fibres, that a view shows, in its camera's axes: right red, up green, towards it blue."""
    normals, opacity = recovered.normals(photograph)
    camera = photograph.camera.world_to_camera[:3, :3]
    local = normals @ camera.T * np.array([1.0, -1.0, -1.0])
    covered = opacity > COVERED
    picture = np.where(covered[..., None], 0.5 + 0.5 * local, BEHIND)
    crop = _crop(covered)
    pixels = (255.0 * np.clip(picture[crop], 0.0, 1.0)).astype(np.uint8)
    times = max(round(PHOTOGRAPH_WIDTH_PX / 2 / pixels.shape[1]), 1)
    shown = pixels.repeat(times, axis=0).repeat(times, axis=1)
    what = "normals" if recovered.fuzzy is None else "axes"
    return page_picture(shown, f"{what} seen in {photograph.name}", photograph.name, lossless=True)


def _errors(recovered: Recovered, photograph: Photograph, reach: float) -> str:
    """The standard errors of the position that a view shows; grey where no photograph that was used shows the place,
    and where matter is too thin for the lattice.
    """
    assert recovered.errors is not None and recovered.evidence is not None  # `reach` is known
    node, opacity = recovered.places(photograph)
    covered = opacity > COVERED
    crop = _crop(covered)
    error = 1e6 * recovered.errors.position.ravel()[node].astype(np.float64)
    there = covered & np.isfinite(error) & (recovered.evidence.photographs.ravel()[node] > 0)
    return map_picture(error, there, crop, "viridis", (0.0, reach), "µm", photograph.name)


def _places(recovered: Recovered, views: Sequence[Photograph]) -> list[str]:
    """Maps of β and of γ that some views show; none where the object has one gloss."""
    if recovered.shares is None:
        return []
    found, near = mixed_gloss(recovered.gloss, recovered.shares), np.abs(recovered.distance) < 1.0
    shown = [
        (values.ravel(), (0.0, nice(float(np.percentile(values[near], SCALE_PERCENTILE)))), unit, word)
        for values, unit, word in ((found.beta, "1/sr", "β"), (found.gamma, "rad", "γ"))
    ]
    maps = []
    for photograph in views:
        node, opacity = recovered.places(photograph)
        covered = opacity > COVERED
        crop = _crop(covered)
        for values, limits, unit, word in shown:
            title = f"{word}, {photograph.name}"
            maps.append(map_picture(values[node], covered, crop, "viridis", limits, unit, title))
    return maps


def _crop(covered: NDArray[np.bool_]) -> tuple[slice, slice]:
    """What is around the pixels that show the object; the whole picture where none does."""
    return around(covered) if covered.any() else (slice(0, covered.shape[0]), slice(0, covered.shape[1]))


def _enlarged(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """sRGB picture, enlarged by a whole number to about PHOTOGRAPH_WIDTH_PX pixels of width."""
    times = max(round(PHOTOGRAPH_WIDTH_PX / linear.shape[1]), 1)
    return srgb_encode(linear).repeat(times, axis=0).repeat(times, axis=1)
