"""Colours of a page: matrices from body and interface to the display, for every lamp spectrum and every camera.

f = w_d c_b(λ) + w_s e with geometric weights (MODEL §5): with c_b = Σ_j b_j B_j the value of a channel is
ρ_c = w_d Σ_j b_j ∫B_j E R_c dλ + w_s ∫e E R_c dλ, so that small matrices give any lamp and any camera exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_white, response_matrix, srgb_from_camera
from hagoromo.light.colour import SRGB_FROM_XYZ
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.spectra.body_basis import body_basis

# Lamps that a page offers: its label → the name in colour-science
DAYLIGHT = "Daylight (D65)"
NAMED_LAMPS = {
    DAYLIGHT: "D65",
    "Daylight (D50)": "D50",
    "Incandescent (A)": "A",
    "White LED (LED-B3)": "LED-B3",
    "Fluorescent (FL11)": "FL11",
}
OF_CAPTURE, OF_SCENE = "Lamp of the photographs", "Lamp of the scene"
EYE = "Human eye (CIE 1931)"
AS_PHOTOGRAPHED = "As photographed"
Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PageColours:
    """Colours of C body channels and M materials, for lamps s and cameras c of n channels each.

    lamps, cameras: labels. body[c][s]: (n, C), of a unit of α c_b. interface[c][s]: (n, M); empty without interfaces.
    Lamps are equally bright to the eye. balanced[c][s]: (3, n) to linear sRGB, with lamp s as white (1, 1, 1);
    daylight[c]: with D65 as white. exact: whether the response of the camera and the spectrum of the lamps are known.
    Where they are not, channels are shown as linear sRGB and only one lamp and one camera are offered.
    """

    lamps: tuple[str, ...]
    cameras: tuple[str, ...]
    body: tuple[tuple[Matrix, ...], ...]
    interface: tuple[tuple[Matrix, ...], ...]
    balanced: tuple[tuple[Matrix, ...], ...]
    daylight: tuple[Matrix, ...]
    exact: bool

    def record(self) -> dict[str, Any]:
        """For the page's script."""
        plain = lambda nested: (  # noqa: E731
            np.asarray(nested).tolist() if isinstance(nested, np.ndarray) else [plain(one) for one in nested]
        )
        matrices = {key: plain(getattr(self, key)) for key in ("body", "interface", "balanced", "daylight")}
        return {"lamps": list(self.lamps), "cameras": list(self.cameras), "exact": self.exact} | matrices


def page_colours(
    materials: Sequence[MaterialEstimate], response: Response | None, lamp: Spectrum | None
) -> PageColours:
    """The colours of measured materials. response, lamp: of the photographs; None where they are not known."""
    count = len(materials[0].body_colour)
    interfaces = np.array([one.interface_colour for one in materials]).T
    if response is None or lamp is None:
        to_display = np.eye(3) if count == 3 else np.full((3, count), 1.0 / count)
        whole = np.eye(count)
        one = ((whole,),), ((interfaces,),), ((to_display,),), (to_display,)
        return PageColours((AS_PHOTOGRAPHED,), (AS_PHOTOGRAPHED,), *one, exact=False)
    basis = body_basis(response, lamp)
    colours = [_interface(one, basis) for one in materials]
    return _tables(basis, colours, {OF_CAPTURE: lamp}, "Camera of the photographs", response)


def stack_colours(colours: Sequence[Spectrum], response: Response | None, lamps: Sequence[Spectrum]) -> PageColours:
    """The colours of weights, each a body; response: of the scene's camera; lamps: the spectra of the scene's own."""
    observer = Response.load("cie1931")
    stated = [one for one in lamps if np.ptp(one.values) > 0.0 and camera_white(one, observer)[1] > 0.0]
    own = {OF_SCENE if len(stated) == 1 else f"{OF_SCENE} {k + 1}": one for k, one in enumerate(stated)}
    return _tables(colours, (), own, "Camera of the scene", response)


def _tables(
    bodies: Sequence[Spectrum],
    interfaces: Sequence[Spectrum],
    own_lamps: Mapping[str, Spectrum],
    camera_label: str,
    response: Response | None,
) -> PageColours:
    """For every lamp, the own ones first, and every camera: `response`, where it has three channels, and the eye."""
    observer = Response.load("cie1931")
    lit = {**own_lamps} | {label: Spectrum.named(name) for label, name in NAMED_LAMPS.items()}
    lamps = {label: one.scaled(1.0 / camera_white(one, observer)[1]) for label, one in lit.items()}
    cameras: dict[str, Response] = {}
    if response is not None and len(response.channels) == 3:
        cameras[f"{camera_label} ({response.name})" if response.name else camera_label] = response
    cameras[EYE] = observer
    body, interface, balanced, daylight = [], [], [], []
    for camera in cameras.values():
        body.append(tuple(response_matrix(bodies, one, camera) for one in lamps.values()))
        if interfaces:
            interface.append(tuple(response_matrix(interfaces, one, camera) for one in lamps.values()))
        balanced.append(tuple(_display(camera, one) for one in lamps.values()))
        daylight.append(_display(camera, lamps[DAYLIGHT]))
    return PageColours(
        tuple(lamps), tuple(cameras), tuple(body), tuple(interface), tuple(balanced), tuple(daylight), exact=True
    )


def _display(camera: Response, lamp: Spectrum) -> Matrix:
    """(3, n) from the values of a camera to linear sRGB, `lamp` as white."""
    if camera.channels == ("X", "Y", "Z"):
        return SRGB_FROM_XYZ * (WHITE_XYZ / camera_white(lamp, camera))
    return np.asarray(srgb_from_camera(camera, lamp))


def _interface(material: MaterialEstimate, basis: Sequence[Spectrum]) -> Spectrum:
    """Spectrum of the interface: 1 where it is neutral, else Σ e_c B_c, 0 where that is negative."""
    if len(set(material.interface_colour)) <= 1:
        return Spectrum.constant(1.0)
    values = np.sum([e * one.values for e, one in zip(material.interface_colour, basis, strict=True)], axis=0)
    return Spectrum(basis[0].wavelengths, np.maximum(values, 0.0))
