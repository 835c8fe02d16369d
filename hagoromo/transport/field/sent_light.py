"""Sent light: what the matter of cells sends on, per metre, of the light of the lamps and of smooth incident light.

As nine numbers a cell and channel (see `second_order`); channels are the bands of every group of lamps.
"""

from __future__ import annotations

import drjit as dr

from hagoromo.backend import Float, arrays
from hagoromo.transport.field.matter_samples import MatterSample, MatterSamples
from hagoromo.transport.field.scattering import ScatteringTables, scattered
from hagoromo.transport.field.second_order import NUMBERS, second_order
from hagoromo.transport.lighting import Lighting

Numbers = list[list[Float]]  # per channel, the nine of every cell


@dr.syntax
def sent_from_lamps(
    samples: MatterSamples, scattering: ScatteringTables, lighting: Lighting, bands: int, cells: int
) -> Numbers:
    """Light of the lamps that is scattered once."""
    jit = arrays()
    k, end = samples.of_cell(dr.arange(jit.UInt, cells))
    groups = len(lighting.materials.palette.lamps)
    sent = nothing(groups * bands, cells)
    while k < end:
        sent = with_lamps(sent, samples, samples.at(k), scattering, lighting, bands)
        k += 1
    dr.eval(sent)
    return sent


def with_lamps(
    sent: Numbers,
    samples: MatterSamples,
    sample: MatterSample,
    scattering: ScatteringTables,
    lighting: Lighting,
    bands: int,
) -> Numbers:
    """`sent` and what one sample adds."""
    sent = [list(numbers) for numbers in sent]
    for number, irradiance in enumerate(sample.light):
        to_lamp, _, _ = lighting.arriving(number, sample.point)
        light = sample.share * irradiance * samples.area(sample.material, sample.axis, to_lamp)
        for part in range(scattering.parts):
            leaves = scattering.from_lamp(sample.material, part, sample.axis, to_lamp).numbers()
            for band in range(bands):
                for group, share in lighting.lamps[number].groups:
                    channel = sent[group * bands + band]
                    factor = light * sample.colours[part * bands + band] * share
                    channel[:] = [dr.fma(factor, new, old) for new, old in zip(leaves, channel, strict=True)]
    return sent


@dr.syntax
def sent_again(
    samples: MatterSamples, scattering: ScatteringTables, incident: Numbers, bands: int, cells: int
) -> Numbers:
    """Of incident light, nine numbers a cell and channel."""
    jit = arrays()
    k, end = samples.of_cell(dr.arange(jit.UInt, cells))
    sent = nothing(len(incident), cells)
    while k < end:
        sent = with_incident(sent, samples.at(k), scattering, incident, bands)
        k += 1
    dr.eval(sent)
    return sent


def with_incident(
    sent: Numbers, sample: MatterSample, scattering: ScatteringTables, incident: Numbers, bands: int
) -> Numbers:
    """`sent` and what one sample adds."""
    sent = [list(numbers) for numbers in sent]
    parts = [scattering.blocks(sample.material, part) for part in range(scattering.parts)]
    for number, (channel, numbers) in enumerate(zip(sent, incident, strict=True)):
        colours = [sample.share * sample.colours[part * bands + number % bands] for part in range(scattering.parts)]
        blocks = [sum(c * part[k] for c, part in zip(colours, parts, strict=True)) for k in range(len(parts[0]))]
        leaves = scattered(blocks, sample.axis, second_order(numbers)).numbers()
        channel[:] = [old + new for old, new in zip(channel, leaves, strict=True)]
    return sent


def added(*parts: Numbers) -> Numbers:
    """The sum of several."""
    return [[sum(each) for each in zip(*numbers, strict=True)] for numbers in zip(*parts, strict=True)]


def nothing(channels: int, cells: int) -> Numbers:
    """No light."""
    return [[dr.zeros(arrays().Float, cells) for _ in range(NUMBERS)] for _ in range(channels)]
