"""A cloth that falls over a ball: our simulation beside Newton's on Warp (CPU), in CPU time, strain and crossings.

    python benchmarks/drape.py        Newton only where it is installed: pip install --only-binary :all: -r
                                      benchmarks/newton.txt

Both have the same grid, weight, bending length (Peirce), friction, ball and floor, and the same time to fall. Newton's
`SolverVBD` (vertex block descent) has self-contact on.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.shape import sphere
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.settle import GRAVITY, STRAIN, ClothMechanics, Fall, settled
from hagoromo_matter.drape.sheet import Sheet

SIZE, SPACING, RADIUS, TOP = (60.0, 52.0), 1.7, 12.0, 25.0  # mm
BENDING, FRICTION, CLEAR, SECONDS = 2.0, 0.4, 0.6, 1.0  # mm, –, mm, s
WEIGHT = 1.5e-4  # g/mm²
STEPS_PER_SECOND, ITERATIONS = 600, (10, 40)  # of Newton's solver


def main() -> None:
    """Print the table."""
    print("solver                     CPU s   mean strain   largest   crossings   in the ball [mm]")
    for levels in (1, 2):
        ours(levels)  # compiles
        start = time.process_time()
        _line(f"ours, {levels} grid{'s' * (levels - 1)}", start, ours(levels))
    try:
        import warp

        warp.config.quiet = True
        import newton  # noqa: F401
    except ImportError:
        print("Newton is not installed: pip install --only-binary :all: -r benchmarks/newton.txt")
        return
    newtons(1, 0.01)  # compiles
    for iterations in ITERATIONS:
        start = time.process_time()
        _line(f"Newton VBD, {iterations} passes", start, newtons(iterations, SECONDS))


def _line(name: str, start: float, sheet: Sheet) -> None:
    took = time.process_time() - start
    strain = np.abs(strains(sheet))
    sunk = RADIUS - np.linalg.norm(sheet.points - (0.0, 0.0, RADIUS), axis=2).min()
    print(
        f"{name:25} {took:6.1f} {100 * strain.mean():11.2f} % {100 * strain.max():7.1f} % {crossings(sheet):9d} "
        f"{max(sunk, 0.0):12.2f}"
    )


def ours(levels: int) -> Sheet:
    """Our drape; with two levels it falls on a grid twice as coarse before, as that of recipes does."""
    reach = RADIUS + 5.0
    ball = Collider(
        [lambda p: sphere(p, (0.0, 0.0, RADIUS), RADIUS)],
        (-reach, -reach, -5.0),
        (reach, reach, 2 * reach),
        RADIUS / 16,
    )

    def start(s: Any, t: Any) -> NDArray[np.floating]:
        return np.stack(np.broadcast_arrays(SIZE[0] * (s - 0.5), SIZE[1] * (t - 0.5), TOP), axis=-1)

    return settled([Cut(*SIZE, start)], ball, ClothMechanics(BENDING, FRICTION, CLEAR), Fall(SPACING, SECONDS, levels))[
        0
    ]


def newtons(iterations: int, seconds: float) -> Sheet:
    """The drape of Newton, in g, mm and s. Membrane stiffness: STRAIN under the weight of the cloth's length."""
    import newton
    import warp as wp

    columns, rows = (round(length / SPACING) for length in SIZE)
    cell = SIZE[0] / columns, SIZE[1] / rows
    stiff, bend = WEIGHT * GRAVITY * max(SIZE) / STRAIN, WEIGHT * GRAVITY * BENDING**3
    with wp.ScopedDevice("cpu"):
        builder = newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=(0.0, 0.0, -GRAVITY))
        surface = newton.ModelBuilder.ShapeConfig(mu=FRICTION, ke=1e5, kd=1e-2)
        builder.add_ground_plane(cfg=surface)
        builder.add_shape_sphere(
            -1, xform=wp.transform((0.0, 0.0, RADIUS), wp.quat_identity()), radius=RADIUS, cfg=surface
        )
        builder.add_cloth_grid(
            pos=wp.vec3(-0.5 * SIZE[0], -0.5 * SIZE[1], TOP), rot=wp.quat_identity(), vel=wp.vec3(0.0, 0.0, 0.0),
            dim_x=columns, dim_y=rows, cell_x=cell[0], cell_y=cell[1], mass=WEIGHT * cell[0] * cell[1],
            tri_ke=stiff, tri_ka=stiff, tri_kd=1e-4, edge_ke=bend / SPACING, edge_kd=1e-3, particle_radius=CLEAR,
        )  # fmt: skip
        builder.color()
        model = builder.finalize()
        model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e4, 1e-2, FRICTION
        draw = np.random.default_rng(0).normal(size=(model.particle_count, 3)) * 0.02 * SPACING
        solver = newton.solvers.SolverVBD(
            model, iterations=iterations, particle_enable_self_contact=True,
            particle_self_contact_margin=CLEAR, particle_self_contact_gap=0.5 * CLEAR,
        )  # fmt: skip
        now, after, control = model.state(), model.state(), model.control()
        now.particle_q.assign((now.particle_q.numpy() + draw).astype(np.float32))
        for _ in range(round(seconds * STEPS_PER_SECOND)):
            now.clear_forces()
            contacts = model.collide(now)
            solver.step(now, after, control, contacts, 1.0 / STEPS_PER_SECOND)
            now, after = after, now
        points = now.particle_q.numpy().astype(float).reshape(rows + 1, columns + 1, 3)
    u, v = np.meshgrid(np.linspace(0, SIZE[0], columns + 1), np.linspace(0, SIZE[1], rows + 1))
    return Sheet(points, u, v)


def strains(sheet: Sheet) -> NDArray[np.float64]:
    """Along the yarns, of all neighbours."""
    parts = []
    for axis, rest in ((1, sheet.u), (0, sheet.v)):
        length = np.linalg.norm(np.diff(sheet.points, axis=axis), axis=2)
        parts.append((length / np.abs(np.diff(rest, axis=axis)) - 1.0).ravel())
    return np.concatenate(parts)


def crossings(sheet: Sheet) -> int:
    """How many edges of the grid's triangles pass through triangles that they share no corner with."""
    points, faces = sheet.points.reshape(-1, 3), sheet.faces()
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal, count = np.cross(b - a, c - a), 0
    for start, end in edges:
        p, way = points[start], points[end] - points[start]
        slope = normal @ way
        apart = ~((faces == start) | (faces == end)).any(axis=1) & (np.abs(slope) > 1e-12)
        share = np.where(apart, ((a - p) * normal).sum(axis=1) / np.where(apart, slope, 1.0), -1.0)
        hit = p + share[:, None] * way
        sides = [(np.cross(two - one, hit - one) * normal).sum(axis=1) for one, two in ((a, b), (b, c), (c, a))]
        count += int(((share > 0) & (share < 1) & (np.min(sides, axis=0) > 0) & apart).sum())
    return count


if __name__ == "__main__":
    main()
