"""Share step: how much of each gloss every place has, by the pixels of all views.

The light of a place is linear in its shares, so that a draw of pixels gives each node the normal equation of a share,
after its body colour has been fitted. Few places show themselves near a highlight: neighbours have shares that are
alike, and one linear system over all nodes carries what is known to where nothing is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import cg

from hagoromo_recovery.descent.gloss_step import Slopes, without_colours

Array = NDArray[np.float64]
SHARE_EVENNESS = 4.0  # of the squared differences of neighbours' shares, in units of a pixel's squared error
SLOW = 0.5  # draws: after so many, half of a step is taken
ITERATIONS, ENOUGH = 200, 1e-4  # of conjugate gradients; share of the first residual that ends them


class ShareSteps:
    """Normal equations of some nodes by all draws so far. nodes: (n,) their numbers. shape: of the lattice."""

    def __init__(self, nodes: NDArray[np.integer], shape: tuple[int, ...]) -> None:
        self.nodes, count = nodes.astype(np.int64), len(nodes)
        self.place = np.full(int(np.prod(shape)), count, np.int64)  # of nodes that do not move: the one after the last
        self.place[self.nodes] = np.arange(count)
        rows = (1, shape[2], shape[2] * shape[1])
        around = np.stack([self.place[self.nodes + sign * row] for row in rows for sign in (-1, 1)])
        _, one = np.nonzero(around < count)
        self.neighbours = csr_array((np.ones(len(one)), (one, around[around < count])), (count, count))
        self.matrix, self.side = np.zeros(count), np.zeros(count)
        self.draws, self.pixels = 0, 0

    def step(self, shares: Array, slopes: Slopes, least: float = 0.0) -> Array:
        """Shares (n,) of the second gloss after a step from some, at which slopes were taken; `least` of each gloss."""
        free, rest = without_colours(slopes)
        by, at = free[:, :, -1], self.place[slopes.node]
        held = at < len(self.nodes)
        square, score = (by * by).sum(axis=1)[held], (by * rest).sum(axis=1)[held]
        self.matrix += np.bincount(at[held], square, len(shares))
        self.side += np.bincount(at[held], score + square * shares[at[held]], len(shares))
        self.draws, self.pixels = self.draws + 1, self.pixels + len(at)
        each = self.pixels / max(len(np.unique(slopes.node)), 1)
        new = np.clip(self._solved(each, shares), least, 1.0 - least)
        return shares + self.draws / (self.draws + SLOW) * (new - shares)

    def _solved(self, each: float, start: Array) -> Array:
        """The minimum of ½ Σ matrix (share − known)² + ½ pull Σ (difference of neighbours)², by conjugate gradients."""
        pull = SHARE_EVENNESS * each
        diagonal = self.matrix + pull * self.neighbours.sum(axis=1) + 1e-9
        system, scaled = diags_array(diagonal) - pull * self.neighbours, diags_array(1.0 / diagonal)
        rest = self.side - system @ start
        return start + cg(system, rest, rtol=ENOUGH, atol=0.0, maxiter=ITERATIONS, M=scaled)[0]
