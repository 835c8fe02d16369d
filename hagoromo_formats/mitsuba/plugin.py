"""Plugin: the BSDF `hagoromo` of Mitsuba 3: the dichromatic Torrance–Sparrow reflectance with its importance sampling.

    <bsdf type="hagoromo">
        <string name="file" value="materials.json"/> <string name="material" value="silk"/>
    </bsdf>

or by its parameters alpha, beta, gamma, n (and nu, lobes, those of the body's law) as numbers, of which beta and gamma
may be raw textures; body_colour and interface_colour as spectra or textures. Mitsuba's `wi` is the direction to the
eye, `wo` that to the lamp, and its value is the radiance for a unit irradiance that faces the lamp, cosine included:
the weights of `torrance_sparrow`. Surfaces reflect alike on both sides.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.errors import InputError
from hagoromo.reflectance.body import is_number
from hagoromo.reflectance.facets import GAUSSIAN
from hagoromo.reflectance.material.material_table import reflectance_from_table
from hagoromo.reflectance.parameters import STATED, BodyLaw
from hagoromo.reflectance.reflectance import LARGEST_GAMMA, SMALLEST_GAMMA, Reflectance
from hagoromo.reflectance.sampling import LobeShare, density_of_lobes, to_lamp_by_lobes
from hagoromo.reflectance.torrance_sparrow import Weights, torrance_sparrow
from hagoromo_formats.mitsuba.bsdf_numbers import NAME, PLACED, TAKEN, numbers_of
from hagoromo_formats.mitsuba.colours import colour_of, variant

COLOURS = ("body_colour", "interface_colour")


def register() -> None:
    """Let Mitsuba know the BSDF `hagoromo` in the variant that it has, or in the package's own where it has none.

    To be called once after every `mitsuba.set_variant`. Load scenes with `parallel=False`: threads that load parts of
    one scene can wait for each other for ever where a plugin is written in Python (drjit issue 524). `InputError` for
    scalar and polarised variants.
    """
    mi, _ = variant()
    _registered(mi.variant())


def bsdf(reflectance: Reflectance) -> dict[str, Any]:
    """The reflectance for `mitsuba.load_dict`, in the variant that Mitsuba has, whose plugin is registered by this.

    f cosθ_i = α cosθ_i c_b + β D F G / cosθ_r e, see `torrance_sparrow`. `InputError` for what is no surface: elements
    other than planes, and light that passes.

    >>> silk = hg.Reflectance(alpha=0.2, beta=0.5, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(0.5))
    >>> hg.mitsuba.bsdf(silk)["alpha"]
    0.2
    """
    register()
    colours = {key: colour_of(getattr(reflectance, key)) for key in ("body_colour", "interface_colour")}
    return {"type": NAME, **numbers_of(reflectance), **colours}


@cache
def _registered(name: str) -> None:
    import mitsuba as mi

    mi.register_bsdf(NAME, lambda props: _kind(name)(props))


@cache
def _kind(name: str) -> Any:
    """The class of the plugin, whose parent and types are those of the variant `name`."""
    import mitsuba as mi

    flags = mi.BSDFFlags
    sides = flags.FrontSide | flags.BackSide

    class Dichromatic(mi.BSDF):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            given = {key: props.get_unbounded_texture(key) for key in COLOURS if key in props}
            self.placed = {key: props.get_unbounded_texture(key) for key in PLACED if _is_texture(props, key)}
            made = _reflectance(props, {key: _largest(texture) for key, texture in (given | self.placed).items()})
            self.colours = [
                given.get(key) or mi.load_dict(colour_of(getattr(made, key)), parallel=False) for key in COLOURS
            ]
            self.numbers = {key: mi.Float(getattr(made, key)) for key in STATED}
            law = {key: mi.Float(value) for key, value in made.body_departures.items()}
            self.nu = GAUSSIAN if made.nu == GAUSSIAN else mi.Float(made.nu)
            self.lobes = [tuple(mi.Float(x) for x in lobe) for lobe in made.lobes]
            self.shares = [mi.Float(share) for share in made.lobe_shares()]
            dr.make_opaque(self.numbers, law, self.lobes, self.shares)
            self.made, self.law = made, BodyLaw(**law)
            self.m_components = [flags.DiffuseReflection | sides, flags.GlossyReflection | sides]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def traverse(self, cb: Any) -> None:
            for key in self.numbers:
                cb.put(key, self.placed.get(key, self.numbers[key]), mi.ParamFlags.Differentiable)
            for key, texture in zip(COLOURS, self.colours, strict=True):
                cb.put(key, texture, mi.ParamFlags.Differentiable)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
            view, sign = _seen(si.wi)
            lobes = self._lobes(ctx, self._gamma(si, active))
            to_lamp = mi.Vector3f(to_lamp_by_lobes(view, lobes, sample1, sample2.x, sample2.y))
            share = sum((one for one, _, _ in lobes), mi.Float(0.0))
            drawn = mi.BSDFSample3f()
            drawn.wo = mi.Vector3f(to_lamp.x, to_lamp.y, to_lamp.z * sign)
            value, drawn.pdf = self.eval_pdf(ctx, si, drawn.wo, active)
            drawn.eta = 1.0
            drawn.sampled_component = dr.select(sample1 < share, mi.UInt32(1), mi.UInt32(0))
            glossy, diffuse = (mi.UInt32(int(f)) for f in (flags.GlossyReflection, flags.DiffuseReflection))
            drawn.sampled_type = dr.select(sample1 < share, glossy, diffuse)
            good = active & (drawn.pdf > 0.0) & (to_lamp.z > 0.0)
            return drawn, dr.select(good, value / drawn.pdf, 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            view, sign = _seen(si.wi)
            to_lamp = mi.Vector3f(wo.x, wo.y, wo.z * sign)
            good = active & (view.z > 0.0) & (to_lamp.z > 0.0)
            gamma, beta = self._gamma(si, active), self._beta(si, active)
            weights = self._weights(to_lamp, view, beta, gamma)
            value = mi.UnpolarizedSpectrum(0.0)
            for number, kind in enumerate((flags.DiffuseReflection, flags.GlossyReflection)):
                if ctx.is_enabled(kind, number):
                    value += self._colour(number, si, active) * weights[number]
            return dr.select(good, value, 0.0), dr.select(
                good, density_of_lobes(to_lamp, view, self._lobes(ctx, gamma)), 0.0
            )

        def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
            return self._colour(0, si, active) * self.numbers["alpha"] * dr.pi

        def _colour(self, number: int, si: Any, active: Any) -> Any:
            """Of body (0) or interface (1), the body's as it shows."""
            colour = self.colours[number].eval(si, active)
            return colour if number else self.made.shown_colour(colour, self.numbers["alpha"])

        def _shares(self, ctx: Any) -> list[Any]:
            """Of the samples, for every lobe of the interface; the rest is for the body."""
            has_body = ctx.is_enabled(flags.DiffuseReflection, 0)
            if not ctx.is_enabled(flags.GlossyReflection, 1):
                return [mi.Float(0.0) for _ in self.shares]
            whole = mi.Float(1.0) if has_body else dr.fmax(sum(self.shares, mi.Float(0.0)), 1e-6)
            return [share / whole for share in self.shares]

        def _beta(self, si: Any, active: Any) -> Any:
            placed = self.placed.get("beta")
            return self.numbers["beta"] if placed is None else dr.maximum(placed.eval_1(si, active), 0.0)

        def _gamma(self, si: Any, active: Any) -> Any:
            placed = self.placed.get("gamma")
            if placed is None:
                return self.numbers["gamma"]
            return dr.clip(placed.eval_1(si, active), SMALLEST_GAMMA, LARGEST_GAMMA)

        def _lobes(self, ctx: Any, first: Any) -> list[LobeShare]:
            """Share of the samples, γ and ν of each lobe; first: γ of the first one."""
            shapes = [(first, self.nu), *((gamma, GAUSSIAN) for _, gamma in self.lobes)]
            return [(share, gamma, nu) for share, (gamma, nu) in zip(self._shares(ctx), shapes, strict=True)]

        def _weights(self, to_lamp: Any, view: Any, beta: Any, gamma: Any) -> Weights:
            alpha, n = self.numbers["alpha"], self.numbers["n"]
            normal = mi.Vector3f(0, 0, 1)
            body, interface = torrance_sparrow(normal, to_lamp, view, alpha, beta, gamma, n, self.nu)
            for more, width in self.lobes:
                interface = interface + torrance_sparrow(normal, to_lamp, view, alpha, more, width, n).interface
            factor = self.law.body_factor(to_lamp.z, view.z, dr.dot(to_lamp, view))
            return Weights(body if is_number(factor, 1.0) else body * factor, interface)

        def to_string(self) -> str:
            return "Hagoromo[" + ", ".join(f"{key} = {value}" for key, value in self.numbers.items()) + "]"

    def _seen(wi: Any) -> tuple[Any, Any]:
        """The direction to the eye on the side that it sees, and the sign of that side."""
        sign = dr.select(wi.z < 0.0, mi.Float(-1.0), mi.Float(1.0))
        return mi.Vector3f(wi.x, wi.y, wi.z * sign), sign

    return Dichromatic


def _is_texture(props: Any, key: str) -> bool:
    return key in props and not isinstance(props.get(key), (int, float))


def _reflectance(props: Any, largest: dict[str, float]) -> Reflectance:
    """The reflectance that the properties of the plugin state. largest: values of those that are textures."""
    where = f"bsdf {NAME!r} {props.id()!r}" if props.id() else f"bsdf {NAME!r}"
    if "file" in props:
        texts = {key: str(props.get(key)) for key in ("file", "material", "response", "lamp") if key in props}
        made = reflectance_from_table(texts | {"file": _resolved(texts["file"])}, None, where)
    else:
        stated = {key: float(props.get(key)) for key in TAKEN if key in props and key not in largest}
        record = {**stated, "lobes": _lobes(str(props.get("lobes", "")), where), "body_colour": 1.0, **largest}
        made = reflectance_from_table(record, None, where)
    numbers_of(made)  # refuses what is no surface
    return made


def _resolved(name: str) -> str:
    import mitsuba as mi

    library: Any = mi
    return str(library.file_resolver().resolve(name))


def _lobes(text: str, where: str) -> list[list[float]]:
    """Pairs of β and γ, as '0.5 0.02, 0.1 0.3'."""
    try:
        return [[float(x) for x in pair.split()] for pair in text.split(",") if pair.strip()]
    except ValueError as error:
        raise InputError(f"{where}: lobes is {text!r}: give pairs of beta and gamma as '0.5 0.02, 0.1 0.3'") from error


def _largest(texture: Any) -> float:
    """The largest value of a texture; of attributes of a mesh their scale, 1 of those that do not say it."""
    import mitsuba as mi

    try:
        return float(np.max(np.array(texture.max())))
    except RuntimeError:  # bitmaps and attributes of meshes have no largest value of their own
        pass
    keys: Any = mi.traverse(texture)
    if "data" in keys:
        return float(np.max(np.array(keys["data"])))
    return float(keys["scale"]) if "scale" in keys else 1.0
