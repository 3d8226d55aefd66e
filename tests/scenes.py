"""Small scenes for tests: placed tiles, and only the parts of the physics that are asked for."""

from __future__ import annotations

import math

import numpy as np

from tbsa.kernels import rows as fields
from tbsa.model.scene import (
    SETS,
    Free,
    Material,
    PlacedTile,
    Record,
    Scene,
    Solver,
    TileType,
)
from tbsa.model.simulation import Simulation
from tbsa.model.squares import depth

WIDTH, MASS, GRAVITY = 0.03, 0.016, 9.81
INERTIA = MASS * WIDTH**2 / 6.0
MU = 0.25
SLIDING = MU * MASS * GRAVITY  # N, what the floor holds of a tile
PLAIN = (TileType("tile", (0, 0, 0, 0), "grey"),)
CHESSBOARD = SETS["chessboard"]


def tile(x=0.0, y=0.0, angle=0.0, vx=0.0, vy=0.0, spin=0.0, *, held=False, kind="tile"):
    """A placed tile (m, rad, m/s, rad/s)."""
    return PlacedTile(kind, (x, y), angle, (vx, vy), spin, held)


def material(**changes):
    """A body without damping and with exact restitution at every speed, but for `changes`."""
    exact = {"linear_damping": 0.0, "angular_damping": 0.0, "restitution_threshold": 0.0}
    return Material(**{name: float(value) for name, value in (exact | changes).items()})


class Unchecked(Scene):
    """A scene that breaks a rule on purpose."""

    def validate(self):
        """Nothing is refused."""


def scene(tiles, *, body=None, types=PLAIN, reactor=None, magnet=None, drive=None, floor=None,
          step=1 / 480, substeps=1, tolerance=1e-12, passes=5000, file="", checked=True,
          **switches):
    """A scene of `tiles`, validated unless told not to; nothing else is in it unless given.

    The default tolerance is far below the simulator's own: tests look at the physics of the
    solved contacts, not at where the solver stops.  `switches`: more of the solver.
    """
    result = (Scene if checked else Unchecked)(
        types=types, material=body or material(), reactor=reactor, free=Free((), tuple(tiles)),
        magnet=magnet, drive=drive, floor=floor, file=file,
        solver=Solver(step, substeps, tolerance, passes, **switches),
        record=Record(3600 * step, 3600 * step),
    )
    result.validate()
    return result


def simulate(tiles, **parts):
    """A simulation of :func:`scene`."""
    return Simulation(scene(tiles, **parts))


def state(simulation):
    """All positions and velocities, shape (6, n), copied."""
    s = simulation
    return np.array([s.x, s.y, s.angle, s.vx, s.vy, s.omega])


def momentum(simulation):
    """Momentum (x, y) and angular momentum about the origin, each with its scale."""
    s, k = simulation, simulation.numbers
    m, inertia = k.mass, k.inertia
    speed, distance = np.hypot(s.vx, s.vy), np.hypot(s.x, s.y)
    spin = m * (s.x * s.vy - s.y * s.vx) + inertia * s.omega
    return (np.array([m * s.vx.sum(), m * s.vy.sum(), spin.sum()]),
            np.array([m * speed.sum(), m * speed.sum(),
                      (m * distance * speed + inertia * np.abs(s.omega)).sum()]))


def turned(x, y, angle):
    """A point turned about the origin."""
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


def corners(simulation):
    """Corners of every tile, shape (n, 4, 2)."""
    s, half = simulation, 0.5 * simulation.numbers.width
    c, n = np.cos(s.angle), np.sin(s.angle)
    return np.stack([np.stack([s.x + half * (c * u - n * v), s.y + half * (n * u + c * v)], axis=-1)
                     for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1))], axis=1)


def contact_rows(simulation):
    """What the kernels see of the contacts of tiles at rest: {column: array}."""
    assert not state(simulation)[3:].any()
    simulation.advance(1)
    return moving_rows(simulation)


def moving_rows(simulation):
    """What they saw, in the last substep, of the rows in contact."""
    rows = simulation._work.rows
    slot = rows.slot[: rows.size[0]]
    columns = {name: rows.field[slot + int(fields.LANES) * i]
               for i, name in enumerate(fields.FIELDS)}
    touching = columns["count"] > 0
    columns |= {"a": rows.a[: slot.size], "b": rows.b[: slot.size]}
    return {name: column[touching] for name, column in columns.items()}


def cloud(n, seed, speed=0.3):
    """Tiles at random in a disc, without overlap, thrown at its centre."""
    rng = np.random.default_rng(seed)
    radius = WIDTH * (1.2 * math.sqrt(n) + 0.8)
    placed = np.empty((0, 3))
    while len(placed) < n:
        r, phi, angle = radius * math.sqrt(rng.random()), *(2.0 * math.pi * rng.random(2))
        x, y = r * math.cos(phi), r * math.sin(phi)
        if (depth(WIDTH, x - placed[:, 0], y - placed[:, 1], placed[:, 2],
                  np.float64(angle)) < 0.0).all():
            placed = np.vstack([placed, (x, y, angle)])
    return [tile(x, y, angle, *(-speed / radius * np.array([x, y]) + 0.1 * rng.normal(size=2)),
                 5.0 * rng.normal()) for x, y, angle in placed.tolist()]
