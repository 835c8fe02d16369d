"""MaterialEstimate: the measured parameters of a material, how well each is known, and their table for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from hagoromo.camera.response import Response, camera_white, response_matrix
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.reflectance.body import RoughBody, diffuse_albedo_ratio
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.parameters import FITTED_BODY_LAW, MEASURED, OF_LOBES, ROWS, STATED, BodyLaw
from hagoromo.reflectance.reflectance import LARGEST_GAMMA, SMALLEST_GAMMA, Reflectance
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import Reading, SpectrumEstimate, reflectance_spectrum

PARAMETERS = STATED  # in the order of the correlation matrix
WORST_SEPARATION = 1e6  # condition number of the matrix from weights of a spectrum to a camera's channels
LONGEST_PRINTED_NAME = 40  # characters of a name that `repr` shows
SYMBOLS = {each.name: each.shown for each in MEASURED if each.range is not None}
SYMBOLS |= {key: f"{SYMBOLS[key]} of the body" for key in FITTED_BODY_LAW}  # shown where they were estimated
PARAMETER_TITLES = ("material", "pixels", "parameter", "estimate", "standard error", "95 % interval", "identifiable")


@dataclass(frozen=True, eq=False, repr=False)
class MaterialEstimate(RoughBody):
    """One measured material of a capture.

    pixels: number of pixels with its label. body_colour, interface_colour: one value per channel, of mean 1; an
    interface of ones is neutral. alpha [1/sr], beta [1/sr], gamma [rad], n: see `torrance_sparrow`. nu: ν of the tails
    of the facets, inf for Gaussian ones. specular_albedo: integral of the interface part over all directions, for light
    along the normal, the mean of the channels. lobes: β [1/sr] and γ [rad] of further Gaussian lobes of the interface.
    epsilon, sigma: of the body, see `body_factor`; 0 where they were not estimated, with Lambert's law.
    standard_error, interval_95: of each of these, None where there is none; colours have one per channel.
    correlation: (4, 4) between PARAMETERS, None where one of the two was not estimated.
    identifiable: whether the photographs determine the parameter; where they do not, its value is a stated choice (see
    `remarks`).
    chi_square: of the residuals, per degree of freedom. lack_of_fit: the test whether the model has the right shape, as
    `LackOfFit.record` gives it. texture: whether the body colour varies over the pixels. gloss: whether β and γ vary,
    with the standard deviations of ln β and ln γ. Each of these three is None where the data are too few for the test.
    convergence: how the fit ended, as `FitStatus.record` gives it; None where that is not known.
    """

    name: str
    pixels: int
    body_colour: tuple[float, ...]
    interface_colour: tuple[float, ...]
    alpha: float
    beta: float
    gamma: float
    n: float
    specular_albedo: float
    standard_error: Mapping[str, Any]
    interval_95: Mapping[str, tuple[Any, ...]]
    correlation: tuple[tuple[float | None, ...], ...]
    identifiable: Mapping[str, bool]
    chi_square: float
    element: Element = "plane"
    remarks: tuple[str, ...] = field(default=())
    lack_of_fit: Mapping[str, Any] | None = None
    texture: Mapping[str, Any] | None = None
    gloss: Mapping[str, Any] | None = None
    convergence: Mapping[str, Any] | None = None
    nu: float = math.inf
    lobes: tuple[tuple[float, float], ...] = ()

    def all_lobes(self, beta: Any = None, gamma: Any = None) -> list[tuple[Any, Any]]:
        """β [1/sr] and γ [rad] of every lobe of the interface, the first one's first.

        beta, gamma: of the first lobe where it differs from place to place, numbers or arrays; the further lobes are as
        much stronger and wider there.
        """
        beta, gamma = self.beta if beta is None else beta, self.gamma if gamma is None else gamma
        further = [(beta * (b / self.beta), gamma * (g / self.gamma)) for b, g in self.lobes]
        return [(beta, gamma), *further]

    def with_gloss(self, beta: float, gamma: float, nu: float | None = None) -> MaterialEstimate:
        """The material where its first lobe has another β, γ and ν: see `all_lobes`."""
        _, *further = self.all_lobes(beta, gamma)
        lobes = tuple((b, min(max(g, SMALLEST_GAMMA), LARGEST_GAMMA)) for b, g in further)
        return replace(self, beta=beta, gamma=gamma, lobes=lobes, nu=self.nu if nu is None else nu)

    @property
    def body_law(self) -> BodyLaw:
        """The law of its body: of what is not measured of it, it has the plain values."""
        return BodyLaw(**{key: getattr(self, key) for key in FITTED_BODY_LAW})

    def __repr__(self) -> str:
        name = self.name if len(self.name) <= LONGEST_PRINTED_NAME else self.name[: LONGEST_PRINTED_NAME - 1] + "…"
        further = [key for key in ("nu", *FITTED_BODY_LAW) if getattr(self, key) != ROWS[key].plain]
        shown = [self._parameter(key) for key in (*PARAMETERS, *further)]
        shown += [f"lobe(beta={beta:.3g}, gamma={gamma:.3g})" for beta, gamma in self.lobes]
        return f"MaterialEstimate({name!r}, {', '.join(shown)})"

    def _repr_html_(self) -> str:
        return materials_html([self])

    def _parameter(self, key: str) -> str:
        """`alpha=0.2013 ± 0.0004`; a parameter that is not identifiable says so."""
        error = self.standard_error.get(key)
        digits = decimals(error)
        spread = "" if error is None else f" ± {error:.{digits}f}"
        return f"{key}={getattr(self, key):.{digits}f}{spread}" + (
            "" if self.identifiable.get(key) else " (not identifiable)"
        )

    def reflectance(
        self, response: Response | None = None, lamp_spectrum: Spectrum | None = None, element: Element | None = None
    ) -> Reflectance:
        """The reflectance whose smooth spectra give the colours of body and interface in this camera under this lamp.

        A spectrum is Σ q_j B_j of `smooth_rgb_basis`, with q solved exactly from Σ_j q_j ∫B_j E R_c = b_c ∫E R_c; that
        of a neutral interface is 1. Without `response` the channels are taken as the coefficients of the basis.
        Cylinders and spheres have a body after Lambert's law with the albedo that the body has under light from all
        around.
        `InputError` for other than three channels, curves of the response that are alike, a colour that no such
        spectrum has, or a reflectance that breaks energy conservation.
        """
        if len(self.body_colour) != 3:
            raise InputError(f"material {self.name!r} has {len(self.body_colour)} channels: a spectrum needs three")
        body = self._spectrum("body", self.body_colour, response, lamp_spectrum)
        interface = Spectrum.constant(1.0)
        if len(set(self.interface_colour)) > 1:
            interface = self._spectrum("interface", self.interface_colour, response, lamp_spectrum)
        return self.with_spectra(body, interface, element or self.element)

    def times(self, factor: float) -> MaterialEstimate:
        """The material that reflects `factor` times as much: all of its weights; itself for a factor of 1."""
        if factor == 1.0:
            return self
        lobes = tuple((beta * factor, width) for beta, width in self.lobes)
        return replace(self, alpha=factor * self.alpha, beta=factor * self.beta, lobes=lobes)

    def with_spectra(
        self, body: Spectrum, interface: Spectrum, element: Element = "plane", factor: float = 1.0
    ) -> Reflectance:
        """The reflectance with these colours, its weights α and β times `factor`: see `reflectance`."""
        law, alpha, lobes = self.body_law, self.alpha, tuple((beta * factor, width) for beta, width in self.lobes)
        if element != "plane" and not law.has_lambert_body:
            alpha, law = alpha * diffuse_albedo_ratio(law), BodyLaw()
        numbers: dict[str, Any] = {
            **{key: getattr(self, key) for key in STATED},
            "alpha": alpha * factor,
            "beta": self.beta * factor,
        }
        shape: dict[str, Any] = {"nu": self.nu, "lobes": lobes} | law.body_departures
        named: dict[str, Any] = {
            "body_colour": body,
            "interface_colour": interface,
            "element": element,
            "name": self.name,
        }
        return Reflectance(**numbers, **named, **shape)

    def _spectrum(
        self, part: str, colour: tuple[float, ...], response: Response | None, lamp_spectrum: Spectrum | None
    ) -> Spectrum:
        """The smooth spectrum of the `colour` of a `part`: see `reflectance`."""
        basis, weights = smooth_rgb_basis(), np.array(colour)
        if response is not None:
            lamp = Spectrum.constant(1.0) if lamp_spectrum is None else lamp_spectrum
            matrix = response_matrix(basis, lamp, response)
            if not np.linalg.cond(matrix) < WORST_SEPARATION:
                raise InputError(
                    f"response {response.name!r} does not separate three colours here: its curves are nearly "
                    "sums of each other: give the response of a camera with three different curves"
                )
            weights = np.linalg.solve(matrix, weights * camera_white(lamp, response))
        if weights.min() < 0.0:
            raise InputError(
                f"material {self.name!r}: no smooth spectrum above 0 has the {part} colour {_short(colour)} "
                f"(its weights would be {_short(weights)}): check the lamp's spectrum and the camera's response"
                + (", or measure with --interface neutral" if part == "interface" else "")
            )
        return Spectrum(basis[0].wavelengths, np.array([band.values for band in basis]).T @ weights)

    def body_spectrum(
        self, response: Response, lamp_spectrum: Spectrum, priors: Sequence[ReflectancePrior] | None = None
    ) -> SpectrumEstimate:
        """Spectrum of the body colour (of mean 1 over the channels) with its covariance: see `reflectance_spectrum`.

        Its channels are assumed to be independent. `InputError` where the colour has no standard error.
        """
        error = self.standard_error.get("body_colour")
        if error is None:
            raise InputError(f"material {self.name!r}: its body colour has no standard error, so its spectrum has none")
        reading = Reading(self.body_colour, error, lamp_spectrum, response)
        return reflectance_spectrum([reading], priors, upper=np.inf)


def _short(values: Sequence[float] | np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"


def decimals(error: float | tuple[float, ...] | None) -> int:
    """Decimals that show a standard error with two significant figures; three where there is no error."""
    if not isinstance(error, float) or not 0.0 < error < math.inf:
        return 3
    return max(0, 1 - math.floor(math.log10(error)))


def parameter_rows(material: MaterialEstimate) -> list[list[str]]:
    """The cells under `PARAMETER_TITLES` for each parameter of `material`; the name stands in the first row only."""
    rows = []
    for key, symbol in SYMBOLS.items():
        error = material.standard_error.get(key)
        if key in FITTED_BODY_LAW and error is None:
            continue
        digits = decimals(error)
        low, high = (_figure(bound, digits) for bound in material.interval_95.get(key, (0.0, math.inf)))
        identifiable = "yes" if material.identifiable.get(key) else Markup('<span class="no">no</span>')
        figures = [_figure(getattr(material, key), digits), "" if error is None else f"{error:.{digits}f}"]
        first = ["", ""] if rows else [material.name, str(material.pixels)]
        rows.append([*first, symbol, *figures, f"{low} … {high}", identifiable])
    return [*rows, *_lobe_rows(material)]


def _lobe_rows(material: MaterialEstimate) -> list[list[str]]:
    """The cells of β and γ of each further lobe, which are there because the photographs show them."""
    rows = []
    errors, bounds = (getattr(material, key).get("lobes", ()) for key in ("standard_error", "interval_95"))
    for k, lobe in enumerate(material.lobes):
        for part, parameter in enumerate(ROWS[key] for key in OF_LOBES):
            error = errors[k][part] if k < len(errors) else None
            digits = decimals(error)
            low, high = bounds[k][part] if k < len(bounds) else (0.0, math.inf)
            shown = [_figure(lobe[part], digits), "" if error is None else f"{error:.{digits}f}"]
            spread = f"{_figure(low, digits)} … {_figure(high, digits)}"
            rows.append(["", "", f"{parameter.symbol} of lobe {k + 2} [{parameter.unit}]", *shown, spread, "yes"])
    return rows


def _figure(value: float, digits: int) -> str:
    return "∞" if value == math.inf else f"{value:.{digits}f}"


def materials_html(materials: Sequence[MaterialEstimate]) -> str:
    """An HTML table of the parameters of `materials`, with their remarks below it."""
    head = "".join(f"<th>{cell}</th>" for cell in PARAMETER_TITLES)
    rows = [row for material in materials for row in parameter_rows(material)]
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    remarks = [f"{escape(m.name)}: {escape(remark)}" for m in materials for remark in m.remarks]
    listed = "<ul>" + "".join(f"<li>{remark}</li>" for remark in remarks) + "</ul>" if remarks else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{listed}"
