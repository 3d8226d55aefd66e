"""Least speed at which a thrown tile knocks others off, against the load that they bear.

    python -m tests.benchmarks.impacts [RUN ...]

Tiles stand on a straight row of held ones, under a load away from it of a part of the critical
load (all pairs of magnets, friction of tiles and floor).  A tile without magnets is thrown along
the row at the topmost layer, 0.1 widths higher, from 0.05 widths away.  They are knocked off if
one of them is half a width from its place within 2 s.  Beside the speed: the energy of the thrown
tile over that which would take the tiles off to infinity.  Of the runs named: speeds of their
tiles that are not attached.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

import tbsa
from tbsa.model.scene import Drive, Floor, Magnet, PlacedTile, TileType
from tbsa.model.simulation import Simulation, floor_limits
from tbsa.model.tiles import ground_truth
from theory.magnets import pair_energy
from theory.statics import Statics, Tiles, chessboard, uniform

from .critical_load import WIDTH, scene
from .invariants import law_of

ROW = [(i, -1) for i in range(-8, 9)]
SHAPES = {
    "one tile": [(0, 0)],
    "a row of three": [(0, 0), (1, 0), (2, 0)],
    "a block of 2 x 2": [(i, j) for i in range(2) for j in range(2)],
    "a block of 3 x 3": [(i, j) for i in range(3) for j in range(3)],
}
PARTS = (0.0, 0.25, 0.5, 0.75, 0.9, 0.99)


def knocked_off(tiles: Tiles, load: float, speed: float) -> bool:
    """Whether a tile thrown at `speed` (m/s) along the row takes tiles off under `load` (N)."""
    base = scene(tiles, Drive("constant", (0.0, load)), Magnet(), 0.25, Floor())
    height = WIDTH * (tiles.site[tiles.free, 1].max() + 0.1)
    thrown = PlacedTile("plain", (-1.05 * WIDTH, height), velocity=(speed, 0.0))
    result = replace(
        base, types=(*base.types, TileType("plain", (0, 0, 0, 0), "grey")),
        free=replace(base.free, tiles=(*base.free.tiles, thrown)))
    result.validate()
    simulation = Simulation(result)
    free, layout = tiles.free, simulation.layout
    for _ in range(20):
        simulation.run(0.1)
        moved = np.hypot(simulation.x - layout.x, simulation.y - layout.y)[free]
        if moved.max() > 0.5 * WIDTH:
            return True
    return False


def least_speed(tiles: Tiles, load: float, steps: int = 8) -> float:
    """Least speed (m/s) that knocks tiles off, up to 3 m/s."""
    low, high = 0.0, 3.0
    for _ in range(steps):
        speed = 0.5 * (low + high)
        if knocked_off(tiles, load, speed):
            high = speed
        else:
            low = speed
    return high


def binding_energy(tiles: Tiles) -> float:
    """Energy of the magnets between free and held tiles (J)."""
    law = law_of(Magnet())
    pose = [(WIDTH * c, WIDTH * r, 0.0) for c, r in tiles.site.tolist()]
    return -sum(pair_energy(pose[a], tiles.glues[a], pose[b], tiles.glues[b], law)
                for a in tiles.free for b in np.flatnonzero(tiles.held)
                if math.dist(pose[a], pose[b]) < 3.0 * WIDTH)


def speeds(folder: str) -> str:
    """Quantiles of the speeds of tiles in a run that are not attached and near one that is.

    Of a drive that reverses, records at the times of u = 0 show tiles that have come to rest.
    """
    run = tbsa.read_run(folder)
    truth = ground_truth(run.scene)
    found = []
    for k in range(len(run.time) // 2, len(run.time)):
        now = tbsa.assembly(run.scene, run.layout, run.x[k], run.y[k], run.angle[k], truth)
        member = now.attached | now.seed
        place = np.column_stack([run.x[k], run.y[k]])
        near = cKDTree(place[member]).query(place[~member])[0] < 3.0 * run.scene.material.width
        found.append(np.hypot(run.vx[k], run.vy[k])[~member][near])
    quantiles = np.quantile(np.concatenate(found), [0.5, 0.9, 0.99, 1.0])
    return (f"{folder}: speed of free tiles within 3 widths of an attached one, median "
            "{:.3f}, 90 % {:.3f}, 99 % {:.3f}, largest {:.3f} m/s".format(*quantiles))


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table, and the speeds in runs."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.impacts",
                                     description="Speeds that knock tiles off loaded assemblies.")
    parser.add_argument("run", nargs="*", help="also print the speeds of tiles in these runs")
    folders = parser.parse_args(argv).run
    law, mass = law_of(Magnet()), 0.016
    print(f"{'tiles':18}{'load/critical':>14}{'load (N)':>10}{'speed (m/s)':>13}{'energy':>9}",
          flush=True)
    for name, free in SHAPES.items():
        tiles = chessboard(free, ROW)
        limits = floor_limits(scene(tiles, Drive("constant", (0.0, 0.0)), Magnet(), 0.25,
                                    Floor()))
        exact = Statics(tiles, law, mating=False, mu=0.25, floor=limits)
        critical = exact.rest(uniform(tiles, 0.0, 1.0), contacts=False).factor
        for part in PARTS:
            speed = least_speed(tiles, part * critical)
            energy = 0.5 * mass * speed**2 / binding_energy(tiles)
            print(f"{name:18}{part:14.2f}{part * critical:10.4f}{speed:13.3f}{energy:9.2f}",
                  flush=True)
    for folder in folders:
        print(speeds(folder))


if __name__ == "__main__":
    main()
