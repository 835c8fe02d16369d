"""materials.json: the estimates of a capture's materials, a list with one table per material."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from msgspec import Meta, defstruct

from hagoromo.errors import InputError
from hagoromo.files.record import Count, Record, WrittenBy, about, decode, read_json, save_json, written_by
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.facets import GAUSSIAN, TailExponent
from hagoromo.reflectance.material.material_estimate import PARAMETERS, MaterialEstimate
from hagoromo.reflectance.parameters import FITTED_BODY_LAW, OF_LOBES, STATED, meaning, of_parameter

UNKNOWN = "; null: it was not estimated"
Bounds = tuple[float | None, float | None]  # null: no bound
Row = Annotated[tuple[float | None, ...], Meta(min_length=len(PARAMETERS), max_length=len(PARAMETERS))]


if TYPE_CHECKING:
    StandardErrors = Record
    Intervals = Record
    Identifiable = Record
else:

    def _table(name: str, words: str, *fields: Any) -> type[Record]:
        """The class of a table of parameters; fields: name, type and default, or groups of these."""
        each = [one for field in fields for one in (field if isinstance(field, list) else [field])]
        named = {"__doc__": words, "takes_null": True}
        return defstruct(name, each, bases=(Record,), namespace=named, frozen=True, kw_only=True)

    OF_LOBES_EACH = about(f"of {' and '.join(OF_LOBES)} of each further lobe")
    OF_INTERFACE = about("of the interface colour, one per channel; null: it was not estimated")

    StandardErrors = _table(
        "StandardErrors",
        "Standard errors, each in the unit of its parameter; null where there is none.",
        [(key, Annotated[float | None, of_parameter(key)], None) for key in STATED],
        ("nu", Annotated[float | None, of_parameter("nu", "; null for Gaussian facets")], None),
        [(key, Annotated[float | None, of_parameter(key, UNKNOWN)], None) for key in FITTED_BODY_LAW],
        ("specular_albedo", Annotated[float | None, about("of the specular albedo")], None),
        ("body_colour", Annotated[tuple[float | None, ...] | None, about("of the body colour, one per channel")], None),
        ("interface_colour", Annotated[tuple[float | None, ...] | None, OF_INTERFACE], None),
        ("lobes", Annotated[tuple[tuple[float, float], ...], OF_LOBES_EACH], ()),
    )
    Intervals = _table(
        "Intervals",
        "95 % confidence intervals [low, high], each in the unit of its parameter; null: no bound on that side.",
        [(key, Annotated[Bounds, of_parameter(key)]) for key in STATED],
        ("specular_albedo", Annotated[Bounds, about("of the specular albedo")]),
        ("body_colour", Annotated[tuple[Bounds, ...], about("of the body colour, one per channel")]),
        ("nu", Annotated[Bounds, of_parameter("nu", "; null above: up to Gaussian facets")], (0.0, None)),
        [(key, Annotated[Bounds | None, of_parameter(key, UNKNOWN)], None) for key in FITTED_BODY_LAW],
        ("interface_colour", Annotated[tuple[Bounds, ...] | None, OF_INTERFACE], None),
        ("lobes", Annotated[tuple[tuple[Bounds, Bounds], ...], OF_LOBES_EACH], ()),
    )
    Identifiable = _table(
        "Identifiable",
        "Whether the photographs determine a parameter; where not, its value is a stated choice (see `remarks`).",
        [(key, bool) for key in STATED],
        [(key, bool, False) for key in ("nu", *FITTED_BODY_LAW, "interface_colour")],
    )


class MaterialRecord(Record, frozen=True, kw_only=True):
    """One measured material of materials.json: see `MaterialEstimate`."""

    version_key = "hagoromo.format_version"
    takes_null = True

    name: Annotated[str, meaning("name")]
    pixels: Annotated[Count, meaning("pixels")]
    body_colour: Annotated[tuple[float, ...], meaning("body_colour", ", one per channel, mean 1")]
    interface_colour: Annotated[tuple[float, ...], meaning("interface_colour", ", one per channel")]
    alpha: Annotated[float, meaning("alpha")]
    beta: Annotated[float, meaning("beta")]
    gamma: Annotated[float, meaning("gamma")]
    nu: Annotated[TailExponent | None, meaning("nu", "; null: Gaussian facets")] = None
    n: Annotated[float, meaning("n")]
    epsilon: Annotated[float, meaning("epsilon")] = 0.0
    sigma: Annotated[float, meaning("sigma")] = 0.0
    lobes: Annotated[tuple[tuple[float, float], ...], meaning("lobes", f", each [{', '.join(OF_LOBES)}]")] = ()
    specular_albedo: Annotated[float, about("directional albedo of the interface part, viewed along the normal")]
    element: Annotated[Element, meaning("element")] = "plane"
    standard_error: Annotated[StandardErrors, about("standard error of each parameter")]
    interval_95: Annotated[Intervals, about("95 % confidence interval of each parameter")]
    correlation: Annotated[
        tuple[Row, ...],
        about(f"correlation of the estimates of {', '.join(STATED)}; null where one was not estimated"),
    ]
    identifiable: Annotated[Identifiable, about("whether the photographs determine a parameter")]
    chi_square: Annotated[float, about("χ² of the residuals per degree of freedom")]
    remarks: Annotated[tuple[str, ...], about("remarks for people")] = ()
    lack_of_fit: Annotated[dict[str, Any] | None, about("test whether the model has the right shape")] = None
    texture: Annotated[dict[str, Any] | None, about("whether the body colour varies over the pixels")] = None
    gloss: Annotated[dict[str, Any] | None, about("whether β and γ vary over the pixels")] = None
    convergence: Annotated[dict[str, Any] | None, about("how the fit ended: status, steps, gradient, last step")] = None
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


OF_PARAMETERS = {"standard_error": StandardErrors, "interval_95": Intervals, "identifiable": Identifiable}
FIELDS = tuple(name for name in MaterialRecord.__struct_fields__ if name != "hagoromo")


def write_materials(
    materials: Sequence[MaterialEstimate],
    path: str | Path,
    force: bool = False,
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
) -> Path:
    """Write materials.json, whole or not at all: the fields of `MaterialEstimate`, null for None and for no bound.

    settings, seed: those that the materials were estimated with.
    """
    records = [
        {name: getattr(material, name) for name in FIELDS}
        | {name: _whole(kind, getattr(material, name)) for name, kind in OF_PARAMETERS.items()}
        | {"hagoromo": written_by(settings, seed)}
        for material in materials
    ]
    return save_json(path, _plain(records), force)


def _whole(kind: type[Record], of: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a table of parameters, those that are missing with their default."""
    defaults = {field.name: field.default for field in msgspec.structs.fields(kind) if not field.required}
    return {name: of.get(name, defaults.get(name)) for name in kind.__struct_fields__}


def read_materials(path: str | Path) -> tuple[MaterialEstimate, ...]:
    """The estimates in the materials.json at `path`, as `hagoromo measure` writes it, in its order.

    `InputError` for a file that `write_materials` would not write; it names the material and the key.
    """
    record = read_json(path)
    if not isinstance(record, list):
        raise InputError(f"{path} must hold a list of materials: given {type(record).__name__}")
    return tuple(_material(entry, f"{path} material {i + 1}") for i, entry in enumerate(record))


def _material(entry: Any, where: str) -> MaterialEstimate:
    record = decode(entry, MaterialRecord, where)
    if len(record.interface_colour) != len(record.body_colour):
        raise InputError(f"{where}: body_colour and interface_colour must have one number per channel each")
    fields = {name: getattr(record, name) for name in FIELDS}
    for name in OF_PARAMETERS:
        fields[name] = msgspec.structs.asdict(fields[name])
    for key in FITTED_BODY_LAW:
        if fields["standard_error"][key] is None:  # it was not estimated
            del fields["standard_error"][key], fields["identifiable"][key]
    fields["nu"] = GAUSSIAN if record.nu is None else record.nu
    intervals = fields["interval_95"]
    colours = {name: intervals.pop(name) for name in ("body_colour", "interface_colour")}
    lobes = tuple(tuple(_interval(one) for one in lobe) for lobe in intervals.pop("lobes"))
    found: dict[str, Any] = {name: _interval(value) for name, value in intervals.items() if value is not None} | {
        name: tuple(_interval(one) for one in value) for name, value in colours.items() if value is not None
    }
    fields["interval_95"] = found | ({"lobes": lobes} if lobes else {})
    if not fields["standard_error"]["lobes"]:
        del fields["standard_error"]["lobes"]
    return MaterialEstimate(**fields)


def _interval(bounds: Bounds) -> tuple[float, float]:
    """(low, high), infinite where there is no bound."""
    low, high = bounds
    return -math.inf if low is None else low, math.inf if high is None else high


def _plain(value: Any) -> Any:
    """Mappings and sequences as JSON types; numbers that are not finite become null."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
