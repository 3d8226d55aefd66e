"""Critical load of n x n blocks in the simulator against the exact statics.

    python -m tests.benchmarks.critical_load [--sizes 1 2 4] [--angles 0 22.5 45] [--pairs]

A block of free tiles rests in the corner of a held L-shaped seed, and a constant load is put on
every tile.  The block *moves* if a tile is further than 1e-4 widths from its place within 0.25 s,
and is *gone* if one is further than a tenth of a width within a second.  Loads are bisected
between 0.7 and 1.4 times the critical load.  Printed: where slip can begin and where rest must
end, by theory; the largest load borne and the least that moved the block; the deviation, which is
0 inside the bracket of theory; and the least load that detached it.  That is larger: magnets that
mate are pulled back as they slide past each other, faster than those that open let go, so that a
block finds another state of rest beside its first.
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np

from tbsa.model.layout import Layout
from tbsa.model.scene import SETS, Drive, Floor, Free, Magnet, Material, PlacedTile, Scene, Solver
from tbsa.model.simulation import Simulation, floor_limits
from theory.magnets import force
from theory.scaling import seed_bond, slip_onset
from theory.statics import Statics, Tiles, block, uniform

from .invariants import law_of

WIDTH = 0.03
MATING = Magnet(cutoff=0.02)  # the magnets of neighbouring edges are 2.13 cm apart
FRICTIONS = {"none": (0.0, None), "tile": (0.25, None), "tile and floor": (0.25, Floor())}


def scene(tiles: Tiles, drive: Drive, magnet: Magnet, mu: float, floor: Floor | None,
          passes: int = 400, tolerance: float = 1e-6) -> Scene:
    """The tiles of an unturned chessboard as a scene, in the same order.

    Where a block of 10 x 10 bears its load, 400 passes let it creep by 1e-4 widths before it
    rests, 20,000 by 1e-8.
    """
    names = [kind.name for kind in SETS["chessboard"]]
    placed = tuple(
        PlacedTile(names[colour], (WIDTH * column, WIDTH * row), held=held)
        for (column, row), colour, held in zip(tiles.site.tolist(), tiles.colour().tolist(),
                                               tiles.held.tolist(), strict=True))
    result = Scene(types=SETS["chessboard"], material=Material(friction=mu), magnet=magnet,
                   free=Free((), placed), drive=drive, floor=floor,
                   solver=Solver(1 / 120, 4, tolerance, passes))
    result.validate()
    return result


MOVES, GONE = (1e-4, 0.25), (0.1, 1.0)  # how far (widths), within which time (s)


def holds(simulation: Simulation, layout: Layout, far: float, seconds: float) -> bool:
    """Whether nothing moves by more than `far` widths in a time (s)."""
    for _ in range(10):
        simulation.run(0.1 * seconds)
        moved = np.hypot(simulation.x - layout.x, simulation.y - layout.y)
        if moved.max() > far * WIDTH:
            return False
    return True


def bears(tiles: Tiles, load: tuple[float, float, float], magnet: Magnet, mu: float,
          floor: Floor | None, limit: tuple[float, float] = MOVES) -> bool:
    """Whether the simulated tiles hold under a constant load (N, N, N m)."""
    fx, fy, torque = load
    exact = (20_000, 1e-9) if limit == MOVES else (400, 1e-6)
    simulation = Simulation(scene(tiles, Drive("constant", (fx, fy), torque), magnet, mu, floor,
                                  *exact))
    return holds(simulation, simulation.layout, *limit)


def simulated(tiles: Tiles, angle: float, magnet: Magnet, mu: float, floor: Floor | None,
              near: float, limit: tuple[float, float] = MOVES,
              steps: int = 8) -> tuple[float, float]:
    """Largest load that held and least that did not (N), from 0.7 and 1.4 times `near`."""
    low, high = 0.7 * near, 1.4 * near
    for _ in range(steps):
        load = 0.5 * (low + high)
        if bears(tiles, (load * math.cos(angle), load * math.sin(angle), 0.0), magnet, mu, floor,
                 limit):
            low = load
        else:
            high = load
    return low, high


def main() -> int:
    """Print the table; returns 1 where a load is out of its bracket by more than 1 %."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.critical_load",
                                     description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=list(range(1, 11)), metavar="n")
    parser.add_argument("--angles", type=float, nargs="+", default=[0.0, 22.5, 45.0],
                        metavar="deg")
    parser.add_argument("--pairs", action="store_true", help="all pairs within 3 cm")
    options = parser.parse_args()
    magnet = Magnet() if options.pairs else MATING
    law = law_of(magnet)
    print(f"{'n':>3}{'angle':>7}  {'friction':15}{'slip':>9}{'rest':>9}{'borne':>9}{'moves':>9}"
          f"{'deviation':>11}{'gone':>9}", flush=True)
    code = 0
    for n in options.sizes:
        tiles = block(n)
        for degrees in options.angles:
            angle = math.radians(degrees)
            for name, (mu, floor) in FRICTIONS.items():
                limits = (floor_limits(scene(tiles, Drive("constant", (0.0, 0.0)), magnet, mu,
                                             floor)))
                exact = Statics(tiles, law, mating=False, mu=mu, floor=limits)
                rest = exact.rest(uniform(tiles, math.cos(angle), math.sin(angle)),
                                  contacts=False).factor
                bond = seed_bond(n, law) if options.pairs else force(2.0 * law.inset, law)
                slip = min(rest, slip_onset(angle, n, bond, mu, limits[0]))
                low, high = simulated(tiles, angle, magnet, mu, floor, rest)
                off = high / slip - 1.0 if high < slip else max(low / rest - 1.0, 0.0)
                code |= abs(off) > 0.01
                _, gone = simulated(tiles, angle, magnet, mu, floor, rest, GONE)
                print(f"{n:3d}{degrees:7.1f}  {name:15}{slip:9.4f}{rest:9.4f}{low:9.4f}"
                      f"{high:9.4f}{100.0 * off:+10.2f}%{gone:9.4f}", flush=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
