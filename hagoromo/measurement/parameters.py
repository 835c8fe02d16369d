"""Parameters of the fit of one material: where each of them stands in a row θ, and the interface colour among them.

    θ = (α c_b per channel, C − 1 numbers of the interface colour, 1/ν, β F₀, ln γ, ln(n − 1)),   P = 2 C + 3

F₀ = F(0, n), since β itself is strongly correlated with n. The interface colour is e = exp(K x), with the orthonormal
contrasts K (C, C − 1) of Helmert: its geometric mean is 1, and x = 0 is a neutral interface. β F₀ is that of the
geometric mean; results have e of mean 1.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.reflectance.facets import GAUSSIAN
from hagoromo.reflectance.parameters import ROWS
from hagoromo.reflectance.torrance_sparrow import normal_fresnel

Array = NDArray[np.float64]

TAIL, STRENGTH, LOG_GAMMA, LOG_N1 = -4, -3, -2, -1  # places in θ
PLACES = {"nu": TAIL, "gamma": LOG_GAMMA, "n": LOG_N1}  # of the coordinates in which the table has them fitted
GAMMA_RANGE, N_RANGE = ROWS["gamma"].fit.range, ROWS["n"].fit.range  # admissible
DARKEST_COLOUR = 1e-3  # smallest interface colour of a channel, against the mean, that is packed


def check_index(n: float | None) -> None:
    """`InputError` for a refractive index that no fit takes."""
    if n is not None and not N_RANGE[0] <= n <= N_RANGE[1]:
        raise InputError(f"n is {n}: give a refractive index from {N_RANGE[0]:g} to {N_RANGE[1]:g}")


def channels_of(theta: Array) -> int:
    """Number of channels C of rows θ (…, P)."""
    return (theta.shape[-1] - 3) // 2


def colour_slice(channels: int) -> slice:
    """Where the numbers of the interface colour stand in θ."""
    return slice(channels, 2 * channels - 1)


@lru_cache(maxsize=8)
def contrasts(channels: int) -> Array:
    """K (C, C − 1): orthonormal columns of sum 0 (Helmert)."""
    columns = np.zeros((channels, channels - 1))
    for j in range(1, channels):
        columns[:j, j - 1], columns[j, j - 1] = 1.0, -float(j)
        columns[:, j - 1] /= math.sqrt(j * (j + 1.0))
    return columns


def interface_colour(theta: Array) -> Array:
    """e (…, C) of geometric mean 1 at rows θ (…, P)."""
    c = channels_of(theta)
    return np.exp(theta[..., colour_slice(c)] @ contrasts(c).T)


def pack_theta(
    alpha_body: Array, beta: float, gamma: float, n: float, nu: float = GAUSSIAN, colour: Array | None = None
) -> Array:
    """Parameters θ (P,) of a material; alpha_body: α c_b per channel; colour: interface colour, None: neutral."""
    c = len(alpha_body)
    relative = np.ones(c) if colour is None else np.asarray(colour, np.float64)
    log_colour = np.log(np.maximum(relative, DARKEST_COLOUR * relative.mean()))
    strength = beta * normal_fresnel(n) * math.exp(log_colour.mean())
    tail, width, index = ROWS["nu"].fit.of(nu), ROWS["gamma"].fit.of(gamma), ROWS["n"].fit.of(n)
    return np.array([*alpha_body, *(log_colour @ contrasts(c)), tail, strength, width, index])


def unpack_theta(theta: Array) -> tuple[Array, float, float, float, float, Array]:
    """α c_b per channel, β, γ [rad], n, ν and the interface colour of mean 1 of θ (P,): undoes `pack_theta`."""
    c, colour, n = channels_of(theta), interface_colour(theta), ROWS["n"].fit.back(theta[LOG_N1])
    mean = float(colour.mean())
    beta = float(theta[STRENGTH]) * mean * ((n + 1.0) / (n - 1.0)) ** 2
    return theta[:c], beta, ROWS["gamma"].fit.back(theta[LOG_GAMMA]), n, ROWS["nu"].fit.back(theta[TAIL]), colour / mean
