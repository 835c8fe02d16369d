"""Sent back: the transpose of what cells send on, and its derivative by the colours of a palette in every band.

See `sent_light`; the samples of matter have their coefficients on the palette behind their colours.
"""

from __future__ import annotations

import drjit as dr

from hagoromo.backend import Float, arrays
from hagoromo.transport.field.matter_samples import MatterSample, MatterSamples
from hagoromo.transport.field.scattering import ScatteringTables, scattered
from hagoromo.transport.field.second_order import NUMBERS, second_order
from hagoromo.transport.field.sent_light import Numbers, nothing
from hagoromo.transport.lighting import Lighting


class ByColour:
    """How coefficients of samples stand behind their colours: the part of each colour of the palette; bands."""

    def __init__(self, of_part: tuple[int, ...], bands: int) -> None:
        self.of_part, self.bands, self.first = of_part, bands, (1 + max(of_part)) * bands

    def added(self, sums: list[Float], sample: MatterSample, by_part: list[list[Float]]) -> list[Float]:
        """`sums`, of every colour and band, with a sample; by_part: derivative by its colours, of parts and bands."""
        sums = list(sums)
        for j, part in enumerate(self.of_part):
            if part < len(by_part):
                for band in range(self.bands):
                    place = j * self.bands + band
                    sums[place] = dr.fma(sample.colours[self.first + j], by_part[part][band], sums[place])
        return sums


@dr.syntax
def incident_back(samples: MatterSamples, scattering: ScatteringTables, by_sent: Numbers, bands: int) -> Numbers:
    """The derivative by the incident light, from that by what cells send: the transpose of `sent_again`."""
    jit, cells = arrays(), dr.width(by_sent[0][0])
    k, end = samples.of_cell(dr.arange(jit.UInt, cells))
    back = nothing(len(by_sent), cells)
    while k < end:
        back = _with_incident_back(back, samples.at(k), scattering, by_sent, bands)
        k += 1
    dr.eval(back)
    return back


def _with_incident_back(
    back: Numbers, sample: MatterSample, scattering: ScatteringTables, by_sent: Numbers, bands: int
) -> Numbers:
    back = [list(numbers) for numbers in back]
    for part in range(scattering.parts):
        columns = _columns(sample, scattering, part)
        for number, (channel, numbers) in enumerate(zip(back, by_sent, strict=True)):
            colour = sample.share * sample.colours[part * bands + number % bands]
            channel[:] = [
                dr.fma(colour, _dot(column, numbers), old) for column, old in zip(columns, channel, strict=True)
            ]
    return back


@dr.syntax
def colours_again(
    samples: MatterSamples, scattering: ScatteringTables, by_sent: Numbers, incident: Numbers, by_colour: ByColour
) -> list[Float]:
    """Of every colour and band the derivative by it, a number a cell, of the light that is sent again."""
    jit, cells = arrays(), dr.width(by_sent[0][0])
    k, end = samples.of_cell(dr.arange(jit.UInt, cells))
    sums = [dr.zeros(jit.Float, cells) for _ in range(len(by_colour.of_part) * by_colour.bands)]
    while k < end:
        sums = _with_colours_again(sums, samples.at(k), scattering, by_sent, incident, by_colour)
        k += 1
    dr.eval(sums)
    return sums


def _with_colours_again(
    sums: list[Float],
    sample: MatterSample,
    scattering: ScatteringTables,
    by_sent: Numbers,
    incident: Numbers,
    by_colour: ByColour,
) -> list[Float]:
    by_part = []
    for part in range(scattering.parts):
        columns = _columns(sample, scattering, part)
        each = [arrays().Float(0)] * by_colour.bands
        for number, (sent, numbers) in enumerate(zip(by_sent, incident, strict=True)):
            moved = sum(n * _dot(column, sent) for n, column in zip(numbers, columns, strict=True))
            each[number % by_colour.bands] = dr.fma(sample.share, moved, each[number % by_colour.bands])
        by_part.append(each)
    return by_colour.added(sums, sample, by_part)


@dr.syntax
def colours_from_lamps(
    samples: MatterSamples, scattering: ScatteringTables, lighting: Lighting, by_sent: Numbers, by_colour: ByColour
) -> list[Float]:
    """As `colours_again`, of the light of the lamps that is scattered once."""
    jit, cells = arrays(), dr.width(by_sent[0][0])
    k, end = samples.of_cell(dr.arange(jit.UInt, cells))
    sums = [dr.zeros(jit.Float, cells) for _ in range(len(by_colour.of_part) * by_colour.bands)]
    while k < end:
        sums = _with_colours_from_lamps(sums, samples, samples.at(k), scattering, lighting, by_sent, by_colour)
        k += 1
    dr.eval(sums)
    return sums


def _with_colours_from_lamps(
    sums: list[Float],
    samples: MatterSamples,
    sample: MatterSample,
    scattering: ScatteringTables,
    lighting: Lighting,
    by_sent: Numbers,
    by_colour: ByColour,
) -> list[Float]:
    bands = by_colour.bands
    by_part = [[arrays().Float(0)] * bands for _ in range(scattering.parts)]
    for number, irradiance in enumerate(sample.light):
        to_lamp, _, _ = lighting.arriving(number, sample.point)
        light = sample.share * irradiance * samples.area(sample.material, sample.axis, to_lamp)
        for part in range(scattering.parts):
            leaves = scattering.from_lamp(sample.material, part, sample.axis, to_lamp).numbers()
            for band in range(bands):
                for group, share in lighting.lamps[number].groups:
                    moved = _dot(leaves, by_sent[group * bands + band])
                    by_part[part][band] = dr.fma(light * share, moved, by_part[part][band])
    return by_colour.added(sums, sample, by_part)


def _columns(sample: MatterSample, scattering: ScatteringTables, part: int) -> list[list[Float]]:
    """Of each of the nine numbers of incident light, the nine that a sample of white colour sends on of its unit."""
    kind, blocks = arrays().Float, scattering.blocks(sample.material, part)
    units = [[kind(float(k == n)) for k in range(NUMBERS)] for n in range(NUMBERS)]
    return [scattered(blocks, sample.axis, second_order(unit)).numbers() for unit in units]


def _dot(a: list[Float], b: list[Float]) -> Float:
    return sum(one * other for one, other in zip(a, b, strict=True))
