"""The paper's limit on the size of a shaken assembly, step by step and in every reading.

An n x n block sits in the corner of an L-shaped seed, at the left and below, with n bonds on each
of its two sides.  Numbers of equations are the paper's, section "Assembly detachment"; x and y
are the block's axes, the seed holds it towards (-1, -1).  `load` is the force on a tile, m a
in the paper (N); `bond` is the force F_g of one glue (N); `floor` is the largest friction of the
floor on a tile, mu_f m g (N); `mu` is the friction between tiles.

``python -m theory.scaling`` prints all bounds.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from theory import command, statics
from theory.floor import max_force
from theory.magnets import Glues, Law, force

Reals = NDArray[np.float64]
LEAST, MOST = 1e-12, 1e12  # N, loads on the command line


def net_force(forces: ArrayLike) -> Reals:
    """Eq. (1): F_nt, the sum of the forces (float64[k, 2], N) on the tiles."""
    return np.asarray(np.sum(np.asarray(forces, dtype=np.float64), axis=0))


def net_tile_force(n: float, mass: float, acceleration: ArrayLike) -> Reals:
    """Eq. (3): F_nt = n^2 m a, float64[2] (N); every tile has the same acceleration (m/s^2)."""
    return n * n * mass * np.asarray(acceleration, dtype=np.float64)


def net_glue_force_printed(n: float, bond: float) -> Reals:
    """Eq. (4) as printed: 2 n F_g (sqrt(2)/2) [1, 1], of norm 2 n F_g, away from the seed (N)."""
    return 2.0 * n * bond * math.sqrt(0.5) * np.ones(2)


def net_glue_force(n: float, bond: float) -> Reals:
    """What eq. (4) should be: n bonds pull along -x and n along -y, -n F_g [1, 1] (N)."""
    return -n * bond * np.ones(2)


def leaves_quadrant(tile_force: ArrayLike, glue_force: ArrayLike) -> bool:
    """Eq. (2): whether F_nt + F_ng does not lie in the third quadrant (without any friction)."""
    return bool((np.asarray(tile_force) + np.asarray(glue_force)).max() > 0.0)


def exceeds_norm(tile_force: ArrayLike, glue_force: ArrayLike) -> bool:
    """Eq. (5): whether the norm of F_ng is less than that of F_nt."""
    return bool(np.linalg.norm(glue_force) < np.linalg.norm(tile_force))


# The largest load per tile, for an angle between load and x axis.


def critical_load(angle: float, n: float, bond: float, mu: float = 0.0,
                  floor: float = 0.0) -> float:
    """The largest load for which a block has a state of rest (N).

    The load less the glue's pull, F u - g (1, 1) with g = F_g/n, must be met by the floor (a disc
    of radius `floor`) and by pressure and friction of the two walls (the cone between the
    directions atan(mu) beyond each wall).  Their sum is bounded by lines with normals at atan(mu)
    and pi/2 - atan(mu), and by the disc's arc between:

        F = (g (cos psi + sin psi) + floor)/cos(psi - angle), the least over those psi;

    on the axis (1 + mu) g + floor sqrt(1 + mu^2), on the diagonal sqrt(2) g + floor.
    Needs mu < 1; infinite where the load presses the block into the corner.

    Raises
    ------
    ValueError
        A size that is not positive, a bond or friction below 0, mu from 1 on, or an angle that is
        not finite.
    """
    _check_angle(angle)
    if not n > 0.0 or not bond >= 0.0 or not floor >= 0.0:
        raise ValueError(f"the size must be positive, bond and floor at least 0, not {n}, "
                         f"{bond} N and {floor} N")
    if not 0.0 <= mu < 1.0:
        raise ValueError(f"mu must be from 0 to below 1, not {mu}")
    g, low = bond / n, math.atan(mu)
    c, s = math.cos(angle), math.sin(angle)
    root = (g * (c + s)) ** 2 - 2.0 * g * g + floor * floor
    if root >= 0.0:
        size = g * (c + s) + math.sqrt(root)
        psi = math.atan2(size * s - g, size * c - g)
        if low <= psi <= 0.5 * math.pi - low and size > 0.0 and floor > 0.0:
            return size
    ends = [(psi, math.cos(psi - angle)) for psi in (low, 0.5 * math.pi - low)]
    return min(((g * (math.cos(psi) + math.sin(psi)) + floor) / cos if cos > 1e-15 else math.inf)
               for psi, cos in ends)


def _check_angle(angle: float) -> None:
    if not math.isfinite(angle):
        raise ValueError(f"the angle must be finite, not {angle} rad")


def slip_onset(angle: float, n: float, bond: float, mu: float = 0.0, floor: float = 0.0) -> float:
    """The least load at which a block can begin to slip (N): the smaller of the admissible modes.

    - Along a wall: F (cos + mu sin) = (1 + mu) g + floor, g = F_g/n, while the block still presses
      on that wall, F sin <= g; or the same with the axes exchanged.
    - Lift-off from both: |F u - g (1, 1)| = floor with both components >= 0.

    Below the critical load by what the floor could bear if it pressed the block onto the wall
    along which this slides: the floor's friction is against the motion once there is motion, but
    at rest it may have any direction.  Between the two loads both rest and slip are consistent,
    and which of them happens depends on how the load came about.

    Raises
    ------
    ValueError
        A size that is not positive, a bond or friction below 0, or an angle that is not finite.
    """
    _check_angle(angle)
    if not n > 0.0 or not bond >= 0.0 or not floor >= 0.0 or not mu >= 0.0:
        raise ValueError(f"the size must be positive, bond, mu and floor at least 0, not {n}, "
                         f"{bond} N, {mu} and {floor} N")
    g = bond / n
    c, s = math.cos(angle), math.sin(angle)
    found = [math.inf]
    for along, across in ((c, s), (s, c)):
        gain = along + mu * across
        if gain > 1e-15:
            size = ((1.0 + mu) * g + floor) / gain
            if size * across <= g * (1.0 + 1e-12):
                found.append(size)
    root = (g * (c + s)) ** 2 - 2.0 * g * g + floor * floor
    for sign in (-1.0, 1.0):
        size = g * (c + s) + sign * math.sqrt(max(root, 0.0))
        least = min(size * c, size * s) - g
        if root > -1e-12 * g * g and size > 0.0 and least >= -1e-12 * g:
            found.append(size)
    return min(found)


def worst_angle(mu: float) -> float:
    """Angle of a rotating load at which the block's state of rest ends first: atan(mu) (rad).

    The normal of the nearest line of :func:`critical_load`; by symmetry also its complement.
    """
    return math.atan(mu)


# The bound on n_s, eq. (6), in all readings.


class Reading(NamedTuple):
    """A reading of eq. (6): the block detaches when n_s exceeds ``bound``."""

    name: str
    formula: str
    assumes: str
    bound: Callable[[float, float, float, float], float]  # of bond, load, mu, floor


def _per(pull: float, load: float) -> float:
    """The size at which the load is that of the pull; without a load there is none."""
    return pull / load if not load <= 0.0 else math.inf  # what is no number stays none


READINGS: tuple[Reading, ...] = (
    Reading("printed", "sqrt(2 F_g/F)", "eq. (6) as it stands; follows from no step before it",
            lambda g, f, mu, r: math.sqrt(_per(2.0 * g, f))),
    Reading("printed norms", "2 F_g/F", "eqs. (3), (4), (5): all 2 n bonds pull in one direction",
            lambda g, f, mu, r: _per(2.0 * g, f)),
    Reading("vector sum", "sqrt(2) F_g/F", "eq. (5), but bonds pull along -x and -y; no friction",
            lambda g, f, mu, r: _per(math.sqrt(2.0) * g, f)),
    Reading("diagonal", "sqrt(2) F_g/F", "eq. (2) for a load that stays on the diagonal",
            lambda g, f, mu, r: _per(math.sqrt(2.0) * g, f)),
    Reading("quadrant", "F_g/F", "eq. (2) for a rotating load, worst on an axis; no friction",
            lambda g, f, mu, r: _per(g, f)),
    Reading("tile friction, axis", "(1 + mu) F_g/F", "load on an axis, sliding along a wall",
            lambda g, f, mu, r: _per((1.0 + mu) * g, f)),
    Reading("tile friction, rotating", "(1 + mu) F_g/(F sqrt(1 + mu^2))",
            "rotating load, worst atan(mu) off an axis",
            lambda g, f, mu, r: _per((1.0 + mu) * g, f) / math.hypot(1.0, mu)),
    Reading("floor friction, axis, slip", "(1 + mu) F_g/(F - R)",
            "load on an axis; R = mu_f m g against the motion",
            lambda g, f, mu, r: _per((1.0 + mu) * g, f - r)),
    Reading("floor friction, axis, rest", "(1 + mu) F_g/(F - R sqrt(1 + mu^2))",
            "load on an axis; the floor may press the block onto the wall",
            lambda g, f, mu, r: _per((1.0 + mu) * g, f - r * math.hypot(1.0, mu))),
    Reading("floor friction, rotating, rest", "(1 + mu) F_g/((F - R) sqrt(1 + mu^2))",
            "rotating load, worst atan(mu) off an axis",
            lambda g, f, mu, r: _per((1.0 + mu) * g, f - r) / math.hypot(1.0, mu)),
    Reading("floor friction, diagonal", "sqrt(2) F_g/(F - R)",
            "load that stays on the diagonal; lift-off",
            lambda g, f, mu, r: _per(math.sqrt(2.0) * g, f - r)),
)


def seed_bond(n: float, law: Law, glues: tuple[Glues, Glues] = statics.CHESSBOARD) -> float:
    """F_g with all pairs in range: pull of the L-shaped seed on an n x n block per bond (N).

    Away from its ends a side adds the same force with every two tiles, for a cut-off of up to one
    tile width, so that the blocks with n = 1 to 4 tell it for any whole `n`; between two of them
    the force of all bonds together is linear, and below 1 it is the bond of a single tile.  It
    holds the block as a whole.  Without friction a single row, which has no more than the last
    two tiles add, slides out first; ``theory.statics`` finds that.

    Raises
    ------
    ValueError
        A cut-off beyond one tile width, or a size that is not positive.
    """
    if not 0.0 < n < math.inf:
        raise ValueError(f"the size must be positive and finite, not {n}")
    return _bond_of(n, _pulls(law, glues))


def _pulls(law: Law, glues: tuple[Glues, Glues]) -> list[float]:
    """Forces (N) of the seed on the blocks with n = 1 to 4, which tell those on any other."""
    if not law.cutoff <= law.width * (1.0 + 1e-9):
        raise ValueError(f"the cut-off must be at most one tile width, {law.width:g} m, not "
                         f"{law.cutoff:g} m")
    return [_pull(k, law, glues) for k in (1, 2, 3, 4)]


def _bond_of(n: float, pulls: Sequence[float]) -> float:
    """:func:`seed_bond`, from these forces."""

    def whole(k: float) -> float:
        odd = int((k - 1) % 2)
        return pulls[odd] + (pulls[odd + 2] - pulls[odd]) * ((k - 1) // 2)

    n = max(n, 1.0)  # further down rounding over n would be all of it
    below = float(math.floor(n))
    return (whole(below) + (n - below) * (whole(below + 1.0) - whole(below))) / n


def _pull(n: int, law: Law, glues: tuple[Glues, Glues]) -> float:
    """Force of the seed on a block along -x, by every pair of magnets (N)."""
    tiles = statics.block(n, glues)
    wrench = statics.magnet_wrench(tiles, law, mating=False)
    return -float(wrench[tiles.free, 0].sum())


def bound_all_pairs(reading: Reading, load: float, mu: float, floor: float, law: Law,
                    glues: tuple[Glues, Glues] = statics.CHESSBOARD) -> float:
    """The least n_s at which a reading's bound is met by the bonds of a block of that size.

    0 where the seed pushes them away.  Bonds of which every second one is another may hold a
    larger block than one that they do not hold.

    Raises
    ------
    ValueError
        As of :func:`seed_bond`; or what is no number.
    """
    if math.isnan(load + mu + floor):
        raise ValueError(f"load, mu and floor must be numbers, not {load} N, {mu} and {floor} N")
    pulls = _pulls(law, glues)

    def beyond(log_n: float) -> float:
        n = math.exp(log_n)
        return n - reading.bound(max(_bond_of(n, pulls), 0.0), load, mu, floor)

    if math.isinf(reading.bound(1.0, load, mu, floor)):
        return math.inf
    # Further out it no longer shows that every second bond is another.
    places = [-60.0, *np.log(np.arange(1.0, 101.0)), 60.0]
    after = next(i for i, place in enumerate(places) if beyond(place) >= 0.0)
    if after == 0:
        return 0.0
    return math.exp(float(brentq(beyond, places[after - 1], places[after])))


def _short(value: float) -> str:
    return f"{value:.2f}" if 0.01 <= value < 1e4 or math.isinf(value) else f"{value:.1e}"


def report(load: float, mu: float = 0.25, floor: float | None = None,
           law: Law | None = None) -> str:
    """All readings as a table; `law` is that of the columns with all pairs.

    Raises
    ------
    ValueError
        As of :func:`seed_bond`.
    """
    law = Law(cutoff=0.03, switch=0.1) if law is None else law
    floor = max_force(0.25, 0.016) if floor is None else floor
    bond = force(2.0 * law.inset, Law(law.alpha, law.beta))
    lines = [
        f"An n x n block detaches from its seed when n exceeds the bound.  Load {load:g} N per "
        f"tile,", f"mu = {mu:g}, floor friction R = {floor:.4f} N.  F_g: mating magnets alone "
        f"{bond:.4f} N; with all pairs",
        f"in range of {100 * law.cutoff:g} cm, by the size of the block:", "",
        f"{'n':>28}" + "".join(f"{n:9d}" for n in (1, 2, 4, 10, 20)),
    ]
    sets = {"chessboard": statics.CHESSBOARD, "chessboard-oriented": statics.ORIENTED}
    for name, glues in sets.items():
        lines.append(f"{'F_g, ' + name + ' (N)':>28}" + "".join(
            f"{seed_bond(n, law, glues):9.4f}" for n in (1, 2, 4, 10, 20)))
    lines += ["", f"{'reading':31}{'bound on n':39}{'mating':>7}{'chessb.':>9}{'oriented':>9}"]
    for reading in READINGS:
        values = [reading.bound(bond, load, mu, floor),
                  *(bound_all_pairs(reading, load, mu, floor, law, glues)
                    for glues in sets.values())]
        lines += [f"{reading.name:31}{reading.formula:39}{_short(values[0]):>7}"
                  + "".join(f"{_short(value):>9}" for value in values[1:]),
                  f"    {reading.assumes}"]
    return "\n".join(lines)


def main() -> None:
    """Print the report for a load given on the command line."""
    parser = argparse.ArgumentParser(prog="python -m theory.scaling", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--load", type=float, default=0.07, metavar="N",
                        help="force on a tile (default: 0.07 N)")
    parser.add_argument("--friction", type=float, default=0.25, help="between tiles (0.25)")
    options = parser.parse_args()
    if not LEAST <= options.load <= MOST or not 0.0 <= options.friction < 1.0:
        parser.error(f"the load must be from {LEAST:g} to {MOST:g} N, the friction from 0 to "
                     "below 1")
    print(report(options.load, options.friction))


if __name__ == "__main__":
    command(main)
