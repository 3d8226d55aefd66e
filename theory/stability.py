"""The paper's self-stabilizing argument: net force and stability margin against size.

Two families of tiles push in opposite directions, so that the forces on an assembly cancel while
the pull of the seed grows with its side.  Here: how well they cancel, and what that leaves of the
load that an assembly can bear, by the exact statics of ``theory.statics``.

The *margin* of an assembly is the critical factor of its drive's worst phase: 1 where the drive
is just borne.  It is found tile by tile (the weakest tile or group of tiles decides) and for
groups as bodies (tiles that hang together without the seed move together or not at all), which is
what the paper's net forces are about.

``python -m theory.stability`` prints the tables.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.stats import binom

from theory import command
from theory.floor import engine_torque, max_force
from theory.magnets import Law
from theory.statics import (
    Site,
    Statics,
    Tiles,
    block,
    chessboard,
    l_seed,
    magnet_wrench,
    uniform,
)

Reals = NDArray[np.float64]
Ints = NDArray[np.int64]
LEAST, MOST = 1e-12, 1e12  # N, N m: drives on the command line
Loads = tuple[Reals, ...]  # one load that reverses, or two of a rotating one; float64[n, 3] each


class Numbers(NamedTuple):
    """What holds an assembly beside its glues."""

    law: Law = Law(cutoff=0.03, switch=0.1)
    mating: bool = False  # only magnets that mate, or all pairs in range
    mu: float = 0.25
    floor: tuple[float, float] = (max_force(0.25, 0.016), engine_torque(0.25, 0.016, 0.03))


# Drives.


def unicycle(tiles: Tiles, family: ArrayLike, heading: ArrayLike, force: float,
             torque: float = 0.0) -> Loads:
    """The load of the unicycle drive at u = 1: a_i F along the heading, and a_i T.

    `family` a_i and `heading` (rad) are of shape [n]; the drive reverses, u is between -1 and 1.
    """
    family, heading = np.broadcast_arrays(family, heading)
    load = np.column_stack([family * force * np.cos(heading), family * force * np.sin(heading),
                            family * torque])
    return (np.where(tiles.held[:, None], 0.0, load),)


def shaking(tiles: Tiles, force: float) -> Loads:
    """The loads a and b of orbital shaking, which runs through all cos(phase) a + sin(phase) b."""
    return uniform(tiles, force, 0.0), uniform(tiles, 0.0, force)


# How well two families cancel: mean and standard deviation of the number of tiles of one family
# less that of the other.  Numbers below 0, and probabilities that are none, are a ValueError.


def _numbers(*counts: float) -> None:
    if not all(count >= 0 for count in counts):
        raise ValueError(f"numbers of sites and tiles must be at least 0, not {counts}")


def _probability(p: float) -> None:
    if not 0.0 <= p <= 1.0:
        raise ValueError(f"a probability must be from 0 to 1, not {p}")


def imbalance_of_block(n: int) -> int:
    """Of a perfect n x n chessboard: 0, or 1 where n is odd."""
    return n * n % 2


def imbalance_of_occupation(plus: int, minus: int, p: float) -> tuple[float, float]:
    """Each of `plus` and `minus` sites is occupied with probability p, independently."""
    _numbers(plus, minus)
    _probability(p)
    return p * (plus - minus), math.sqrt(p * (1.0 - p) * (plus + minus))


def imbalance_of_choice(plus: int, minus: int, tiles: int) -> tuple[float, float]:
    """`tiles` of `plus` + `minus` sites are occupied at random (hypergeometric)."""
    _numbers(plus, minus, tiles)
    sites = plus + minus
    if tiles > sites:
        raise ValueError(f"{tiles} tiles do not fit on {sites} sites")
    of = max(sites, 1)
    variance = tiles * plus * minus * (sites - tiles) / (of**2 * max(sites - 1, 1))
    return tiles * (plus - minus) / of, 2.0 * math.sqrt(variance)


def imbalance_of_families(tiles: int, share: float = 0.5) -> tuple[float, float]:
    """Each tile is of the first family with probability `share`; sqrt(tiles) spread at 1/2."""
    _numbers(tiles)
    _probability(share)
    return tiles * (2.0 * share - 1.0), 2.0 * math.sqrt(tiles * share * (1.0 - share))


def imbalance_of_turns(plus: int, minus: int, turned: float) -> tuple[float, float]:
    """Each tile's heading is half a turn wrong with probability `turned`, independently."""
    _numbers(plus, minus)
    _probability(turned)
    return ((1.0 - 2.0 * turned) * (plus - minus),
            2.0 * math.sqrt((plus + minus) * turned * (1.0 - turned)))


def half_turn_holds(n: int, bond: float, load: float) -> float:
    """Probability that the net force of an n x n block of random half turns is borne.

    Without friction a side of n bonds bears n F_g; the net force is F times a sum of n^2 signs,
    of spread n F: both grow alike, and the probability tends to erf(F_g/(F sqrt(2))).

    Raises
    ------
    ValueError
        An n that is not whole or below 1, what is no number, a load below 0, or an infinite bond
        and load.
    """
    if (not n >= 1 or not math.isfinite(n) or n != math.floor(n) or math.isnan(bond)
            or not load >= 0.0 or bond == load == math.inf):
        raise ValueError("n must be whole and at least 1, the bond a number and the load one from "
                         f"0 N, not {n}, {bond} N and {load} N")
    # Of |imbalance| = |n^2 - 2 k|; a force just borne is, however the quotient is rounded.
    share = n * max(bond, 0.0) / load * (1.0 + 1e-12) if load > 0.0 else math.inf
    most = min(share, n * n)
    low, high = math.ceil((n * n - most) / 2.0), math.floor((n * n + most) / 2.0)
    return float(binom.cdf(high, n * n, 0.5) - binom.cdf(low - 1, n * n, 0.5))


def net_force(load: ArrayLike) -> Reals:
    """Sum of the forces of a load (float64[n, 3]) on all tiles: float64[2] (N)."""
    return np.asarray(np.asarray(load, dtype=np.float64)[:, :2].sum(axis=0))


# Margins.


class Margin(NamedTuple):
    """Critical factors of a drive's worst phase."""

    tiles: float  # tile by tile
    phase: float  # rad, of a rotating load; 0 or pi of one that reverses
    body: float  # of the largest group, as one body
    net: float  # N, largest net force on that group


def recorded(site: ArrayLike, kind: ArrayLike, turns: ArrayLike, held: ArrayLike,
             glues: ArrayLike) -> Tiles:
    """Tiles as recorded.

    Parameters
    ----------
    site : int[n, 2]
        Column and row in the seed's lattice.
    kind, turns : int[n]
        Number of the tile's type, and its quarter turns counter-clockwise.
    held : bool[n]
    glues : int[k, 4]
        Glues N, E, S, W of the k types.
    """
    kind, turns, site = np.asarray(kind), np.asarray(turns), np.asarray(site)
    if any(numbers.size and numbers.dtype.kind not in "iu" for numbers in (kind, turns, site)):
        raise ValueError("site, kind and turns must be whole numbers, not "
                         f"{site.dtype}, {kind.dtype} and {turns.dtype}")
    if kind.size and not 0 <= kind.min() <= kind.max() < len(np.asarray(glues)):
        raise ValueError(f"kind must be from 0 to {len(np.asarray(glues)) - 1}")
    kind, turns = kind.astype(np.int64), turns.astype(np.int64)
    edge = (np.arange(4) + turns[:, None]) % 4  # after one turn the E edge faces N
    facing = np.take_along_axis(np.asarray(glues, dtype=np.int64)[kind], edge, axis=1)
    return Tiles(np.asarray(site, dtype=np.int64), facing, np.asarray(held, dtype=bool))


def groups(tiles: Tiles) -> Ints:
    """Number of the group of every tile, int64[n]: free tiles joined by shared edges.

    Held tiles are groups of their own.
    """
    at = {site: i for i, site in enumerate(map(tuple, tiles.site.tolist()))}
    pairs = np.array([(i, j) for (c, r), i in at.items() for other in ((c + 1, r), (c, r + 1))
                      if (j := at.get(other)) is not None
                      and not (tiles.held[i] or tiles.held[j])], dtype=np.int64).reshape(-1, 2)
    graph = sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(at), len(at)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def margin(tiles: Tiles, loads: Loads, numbers: Numbers = Numbers()) -> Margin:  # noqa: B008
    """Margin of an assembly under a drive, see :func:`unicycle` and :func:`shaking`."""
    law, mating, mu, floor = numbers
    factor, phase = _worst(Statics(tiles, law, mating=mating, mu=mu, floor=floor), loads)
    group = groups(tiles)
    count = np.bincount(group[tiles.free], minlength=1)
    largest = group == np.argmax(count)
    part = [np.where(largest[:, None], load, 0.0) for load in loads]
    # Whether the other groups have a state of rest does not matter to it; their magnets do.
    fixed = Tiles(tiles.site, tiles.glues, tiles.held | ~largest)
    body, _ = _worst(Statics(fixed, law, mating=mating, mu=mu, floor=floor, rigid=group),
                     tuple(part))
    return Margin(factor, phase, body, _largest_net(part))


def _worst(statics: Statics, loads: Loads) -> tuple[float, float]:
    """Factor and phase at the worst phase; of one load that reverses: the worse of its signs."""
    if not any(load.any() for load in loads):
        return math.inf, math.nan
    if len(loads) == 2:
        found = statics.worst_phase(*loads)
        return found.factor, found.phase
    (load,) = loads
    return min((statics.rest(sign * load, contacts=False).factor, phase)
               for sign, phase in ((1.0, 0.0), (-1.0, math.pi)))


def _largest_net(loads: Sequence[Reals]) -> float:
    """Largest size of the net force over all phases: the largest singular value (N)."""
    return float(np.linalg.norm(np.array([net_force(load) for load in loads]), ord=2))


# Families of assemblies: what becomes of the argument.

CASES = ("shaken", "chessboard", "random occupation", "random families", "unequal families",
         "random half turns")


def case(name: str, n: int, force: float, torque: float = 0.0, unequal: float = 0.6,
         occupied: float = 0.8, rng: np.random.Generator | None = None) -> tuple[Tiles, Loads]:
    """An n x n block in an L-shaped seed, and the drive's loads on it.

    All headings are +y, as where the N edge is forward, but for "random half turns".  The family
    is the colour, but for "random families", where it is drawn, and "unequal families", with a
    share `unequal` of one.  Of "random occupation" sites are occupied with probability
    `occupied`; tiles that do not hang together with the seed are left out.
    """
    tiles = block(n)
    rng = np.random.default_rng(0) if rng is None else rng
    if name == "random occupation":
        there = [site for site, held in zip(map(tuple, tiles.site.tolist()), tiles.held,
                                            strict=True) if not held and rng.random() < occupied]
        tiles = chessboard(_hanging(there, l_seed(n)), l_seed(n))
    family = np.where(tiles.colour() == 0, 1.0, -1.0)
    heading = np.full(len(family), 0.5 * math.pi)
    if name == "shaken":
        return tiles, shaking(tiles, force)
    if name == "random families":
        family = rng.choice([1.0, -1.0], len(family))
    elif name == "unequal families":
        family = np.where(rng.random(len(family)) < unequal, 1.0, -1.0)
    elif name == "random half turns":
        heading = heading + np.pi * rng.integers(0, 2, len(family))
    elif name not in ("chessboard", "random occupation"):
        raise ValueError(f"the cases are {', '.join(CASES)}")
    return tiles, unicycle(tiles, family, heading, force, torque)


def _hanging(free: Sequence[Site], held: Sequence[Site]) -> list[Site]:
    """The free sites that a chain of shared edges joins to the held ones; at least one."""
    reached, border = set(held), list(held)
    while border:
        c, r = border.pop()
        for site in ((c, r + 1), (c + 1, r), (c, r - 1), (c - 1, r)):
            if site in free and site not in reached:
                reached.add(site)
                border.append(site)
    return [site for site in free if site in reached] or [(0, 0)]


# Torques.


def bond_torque(bond: float, width: float, floor: tuple[float, float] = (0.0, 0.0),
                mu: float = 0.25) -> float:
    """Torque that peels a tile held by one bond, about a corner of the shared edge (N m).

    F_bond w/2 + T_floor, and more by the floor's force R against the tile's middle, which moves
    as well: (n + t) w/2 of its parts n onto the edge and t along it.  Best is n = t = R/sqrt(2),
    if the corner's friction mu (F_bond + n) bears t; else t is at that limit.
    """
    force, torque = floor
    n = t = force * math.sqrt(0.5)
    if t > mu * (bond + n):
        half, square = mu * mu * bond, 1.0 + mu * mu
        n = (math.sqrt(half * half + square * (force**2 - half * bond)) - half) / square
        t = mu * (bond + n)
    return 0.5 * (bond + n + t) * width + torque


def critical_torque(tiles: Tiles, driven: ArrayLike | None = None,
                    numbers: Numbers = Numbers(), force: float = 0.0) -> float:  # noqa: B008
    """Critical T_mag (N m): the largest torque on the driven tiles, in either direction.

    The two families, here the colours, turn in opposite directions; `driven` is bool[n], by
    default all tiles.  With a `force` (N) it is the torque that is left to a drive that pushes the
    families to -y and +y with it as well; 0 where the force alone is not borne.
    """
    law, mating, mu, floor = numbers
    sign = np.where(tiles.colour() == 0, 1.0, -1.0)
    sign = np.where(tiles.held | ~np.broadcast_to(True if driven is None else driven, sign.shape),
                    0.0, sign)
    statics = Statics(tiles, law, mating=mating, mu=mu, floor=floor)
    push = np.outer(force * sign, (0.0, 1.0, 0.0))
    turn = np.outer(sign, (0.0, 0.0, 1.0))
    # Where a torque is borne, but not the force without it, a drive that grows gets to neither.
    return min(statics.rest(way * turn, dead=way * push, contacts=False).factor
               if statics.bears(way * push) else 0.0 for way in (1.0, -1.0))


# Report.


def _number(value: float, width: int, decimals: int) -> str:
    """A column of a table that stays apart from the one before, however large the number."""
    text = f"{value:.{decimals}f}"
    return f"{text if len(text) < width else f'{value:.3g}':>{width}}"


def sizes_table(sizes: Sequence[int], force: float, torque: float, samples: int,
                numbers: Numbers) -> str:
    """Net force and margins of the cases against size; medians of `samples` of the random ones."""
    lines = [f"{'case':20}{'n':>4}{'net (N)':>10}{'n F (N)':>10}{'body':>9}{'tiles':>9}"
             f"{'tiles, T_mag':>14}"]
    for name in CASES:
        for n in sizes:
            rows: list[tuple[float, ...]] = []
            for k in range(samples if name not in CASES[:2] else 1):
                tiles, loads = case(name, n, force, rng=np.random.default_rng(k))
                found = margin(tiles, loads, numbers)
                turning = found.tiles
                if name != "shaken":
                    tiles, loads = case(name, n, force, torque, rng=np.random.default_rng(k))
                    turning = margin(tiles, loads, numbers).tiles
                rows.append((found.net, n * force, found.body, found.tiles, turning))
            columns = zip(np.median(rows, axis=0), (10, 10, 9, 9, 14), (4, 4, 3, 3, 3), strict=True)
            lines.append(f"{name:20}{n:4d}" + "".join(_number(*each) for each in columns))
    return "\n".join(lines)


def torque_table(sizes: Sequence[int], force: float, numbers: Numbers) -> str:
    """Critical T_mag of single tiles by position, and of whole blocks by size."""
    row = [(i, -1) for i in range(-5, 6)]
    corner = [*row, *((-1, i) for i in range(5))]
    scenes = {
        "one bond, lone pair": (chessboard([(0, 0)], [(0, -1)]), None),
        "one bond, on a straight row": (chessboard([(0, 0)], row), None),
        "two bonds, in a corner": (chessboard([(0, 0)], corner), None),
    }
    for n in sizes:
        tiles = block(n)
        scenes[f"{n} x {n} block, all tiles"] = tiles, None
        if n > 1:
            for name, site in (("outer corner", (n - 1, n - 1)), ("middle", (n // 2, n // 2))):
                scenes[f"{n} x {n} block, {name}"] = tiles, (tiles.site == site).all(axis=1)
    lines = [f"{'torque on':36}{'T (N m)':>11}{'with F':>11}"]
    for name, (tiles, driven) in scenes.items():
        found = [critical_torque(tiles, driven, numbers, push) for push in (0.0, force)]
        lines.append(f"{name:36}" + "".join(f"{value:11.3e}" for value in found))
    return "\n".join(lines)


def main() -> None:
    """Print the tables for a drive given on the command line."""
    parser = argparse.ArgumentParser(prog="python -m theory.stability", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--force", type=float, default=0.07, metavar="N", help="F_mag (0.07)")
    parser.add_argument("--torque", type=float, default=1.65e-3, metavar="NM",
                        help="T_mag (1.65e-3)")
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 2, 4, 6, 8], metavar="n")
    parser.add_argument("--samples", type=int, default=5, help="of each random case (5)")
    options = parser.parse_args()
    for name in ("force", "torque"):
        if not LEAST <= getattr(options, name) <= MOST:
            parser.error(f"--{name} must be from {LEAST:g} to {MOST:g}, not "
                         f"{getattr(options, name):g}")
    if min(options.sizes) < 1 or options.samples < 1:
        parser.error("sizes and samples must be from 1")
    for mating in (True, False):
        numbers = Numbers(mating=mating)
        print("Magnets:", "mating pairs alone" if mating else "all pairs in range")
        print(sizes_table(options.sizes, options.force, options.torque, options.samples, numbers))
        print()
        print(torque_table(options.sizes, options.force, numbers), end="\n\n")
    bond = float(-magnet_wrench(chessboard([(0, 0)], [(-1, 0)]), Law(), mating=True)[0, 0])
    print("Probability that a block of random half turns is borne, frictionless, F_g = "
          f"{bond:.4f} N:")
    for n in options.sizes:
        print(f"    n = {n}: {half_turn_holds(n, bond, options.force):.4f}")
    print(f"    limit: {math.erf(bond / options.force / math.sqrt(2.0)):.4f}")


if __name__ == "__main__":
    command(main)
