"""Colours of a page: matrices from body and interface to the display, for every lamp spectrum and every camera.

f = w_d c_b(λ) + w_s e with geometric weights (MODEL §5): with c_b = Σ_j b_j B_j the value of a channel is
ρ_c = w_d Σ_j b_j ∫B_j E R_c dλ + w_s ∫e E R_c dλ, so that small matrices give any lamp and any camera exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, camera_white, response_matrix
from hagoromo.camera.srgb_from_camera import WHITE_XYZ, srgb_from_camera
from hagoromo.light.colour import SRGB_FROM_XYZ
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.spectra.body_basis import body_basis

# Lamps that a page offers: its label → the name in colour-science
NAMED_LAMPS = {
    "Daylight (D65)": "D65",
    "Daylight (D50)": "D50",
    "Incandescent (A)": "A",
    "White LED (LED-B3)": "LED-B3",
    "Fluorescent (FL11)": "FL11",
}
OF_CAPTURE = "Lamp of the photographs"
EYE = "Human eye (CIE 1931)"
AS_PHOTOGRAPHED = "As photographed"
Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PageColours:
    """Colours of C body channels and M materials, for lamps s and cameras c of n channels each.

    lamps, cameras: labels. body[c][s]: (n, C), of a unit of α c_b. interface[c][s]: (n, M). Lamps are equally bright to
    the eye. balanced[c][s]: (3, n) to linear sRGB, with lamp s as white (1, 1, 1); daylight[c]: with D65 as white.
    exact: whether the response of the camera and the spectrum of the lamps are known. Where they are not, channels
    are shown as linear sRGB and only one lamp and one camera are offered.
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
    observer, basis = Response.load("cie1931"), body_basis(response, lamp)
    lit = {OF_CAPTURE: lamp} | {label: Spectrum.named(name) for label, name in NAMED_LAMPS.items()}
    lamps = {label: one.scaled(1.0 / camera_white(one, observer)[1]) for label, one in lit.items()}
    day = lamps["Daylight (D65)"]
    colours = [_interface(one, basis) for one in materials]
    cameras = {
        f"Camera of the photographs ({response.name})" if response.name else "Camera of the photographs": response
    }
    if len(response.channels) != 3:
        cameras = {}
    cameras[EYE] = observer
    body, interface, balanced, daylight = [], [], [], []
    for camera in cameras.values():
        body.append(tuple(response_matrix(basis, one, camera) for one in lamps.values()))
        interface.append(tuple(response_matrix(colours, one, camera) for one in lamps.values()))
        balanced.append(tuple(_display(camera, one) for one in lamps.values()))
        daylight.append(_display(camera, day))
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
