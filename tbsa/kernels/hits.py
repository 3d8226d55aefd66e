"""What impacts know: what acts on the tiles in a substep, what takes part, and how it goes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.floor import FloorLaw
from tbsa.kernels.jit import inline, lane
from tbsa.kernels.queue import Queue, empty_queue
from tbsa.kernels.rows import AN0, AN1, BN0, BN1, NX, NY, WIDE

# Points nearer than this fraction of the width take part in an impact of their tiles, at most.
TOUCHING = 1e-3
# Hits of one tile at times that differ by less than this part of the substep are one.
SAME = 1e-3
# Tiles that come no further than this fraction of the width until they hit are left where they are.
NOWHERE = 1e-5
# In ``points``: an impact of this substep has left a row together, if none that came after it; and
# has parted what was pressed.
LISTED, SPLIT = 4, 8
# In ``leans``: it gains what forces and contacts gave it in the last substep.
ALONG = 2


class Scratch(NamedTuple):
    """Scratch of the impacts, by rows (WIDE block + lane) and by bodies."""

    queue: Queue  # the rows that hit, by when in the substep (s)
    known: np.ndarray  # int64, 0, or whether a row takes part, and how
    rows: np.ndarray  # int64, the rows that take part
    time: np.ndarray  # s, when in the substep the impact reaches a row
    in_it: np.ndarray  # int64[n], whether a tile takes part
    tiles: np.ndarray  # int64, the tiles that do
    pace: np.ndarray  # m/s, the fastest approach of what has reached it
    struck: np.ndarray  # int64, how often one has hit
    island: np.ndarray  # int64, union-find over them
    ux: np.ndarray  # velocities before a phase
    uy: np.ndarray
    uw: np.ndarray
    most: np.ndarray  # J, energy that an island may have
    energy: np.ndarray
    mixed: np.ndarray
    since: np.ndarray  # s, from when in the substep a tile has gone as it goes now
    when: np.ndarray  # s, how far in the substep a tile of an impact has flown on
    part: np.ndarray  # the share of its gain that it has there
    gainx: np.ndarray  # m/s, what forces and floor give a tile in the substep
    gainy: np.ndarray
    gainw: np.ndarray  # rad/s
    owedx: np.ndarray  # m/s, what it is to get besides when all that hits has hit
    owedy: np.ndarray
    owedw: np.ndarray  # rad/s
    alongx: np.ndarray  # m/s, what forces and contacts give one that goes ALONG, without the floor
    alongy: np.ndarray
    alongw: np.ndarray  # rad/s
    drawn: np.ndarray  # int64, whether it has been asked for that
    leans: np.ndarray  # int64, and whether it lies on a tile that moves: 0, 1 or ALONG
    pulled: np.ndarray  # int64, the tiles that have
    left: np.ndarray  # int64, the rows that an impact of this substep has left together
    points: np.ndarray  # int64, and which of their points: 1, 2 or 3, and LISTED, SPLIT
    thrown: np.ndarray  # int64, the rows that an impact of this substep throws on, though pressed
    lost0: np.ndarray  # N s, what their points bore until then; 0 of all others
    lost1: np.ndarray
    lostt: np.ndarray  # N s, and their friction
    was0: np.ndarray  # the feature ids of these points
    was1: np.ndarray
    size: np.ndarray  # int64[6], rows and tiles that take part, tiles that are asked, rows `left`
    # and `thrown`; 1 if an impact of this substep has ended at the limit of its passes


def empty_scratch(n: int, blocks: int) -> Scratch:
    """Scratch of `n` tiles and of `blocks` blocks of rows."""
    whole = {"in_it", "tiles", "struck", "island", "drawn", "leans", "pulled"}
    parts = [empty_queue(WIDE * blocks), *columns(WIDE * blocks, [int, int, float])]
    of_tiles = Scratch._fields[4:Scratch._fields.index("left")]
    parts += columns(n + 1, [int if f in whole else float for f in of_tiles])
    parts += columns(WIDE * blocks, [int, int, int, float, float, float, float, float])
    return Scratch._make([*parts, np.zeros(6, np.int64)])


class Loads(NamedTuple):
    """What acts on the tiles during a substep."""

    h: float  # s, its length
    gain: float  # m, how much further two tiles may come through it than as they go
    told: bool  # whether the last substep's impulses tell what contacts give under these loads
    fx: np.ndarray  # N
    fy: np.ndarray
    torque: np.ndarray  # N m
    floor: FloorLaw
    end: float  # s, from its middle; inf where nobody looks at the tiles then
    slow: float  # what damping leaves of velocities until then
    slow_spin: float
    early: np.ndarray  # int64[n + 1], how many tiles hit only after that, and which; and ...
    seen: np.ndarray  # float64[6 n], their x, y, angle, vx, vy and omega at the end (SI units)


@inline
def leave(z: Scratch, row: int, points: int) -> None:
    """Put a row on the list of what impacts of this substep have left together, by these points, or
    parted."""
    if z.points[row] == 0:
        z.left[z.size[3]] = row
        z.size[3] += 1
    z.points[row] |= points | LISTED


@lane
def approach(r: np.ndarray, at: int, v: Bodies, a: int, b: int) -> Any:
    """Normal velocities of the points of a row of bodies a and b (m/s), < 0 where they come."""
    along = r[at + NX] * (v.vx[b] - v.vx[a]) + r[at + NY] * (v.vy[b] - v.vy[a])
    return (along + r[at + BN0] * v.w[b] - r[at + AN0] * v.w[a],
            along + r[at + BN1] * v.w[b] - r[at + AN1] * v.w[a])


@inline
def corner_speed(k: Numbers, v: Bodies, i: int) -> float:
    """What no corner of a tile is faster than (m/s)."""
    return float(math.sqrt(v.vx[i] * v.vx[i] + v.vy[i] * v.vy[i])
                 + 0.7072 * k.width * abs(v.w[i]))


@inline
def pair_speed(k: Numbers, v: Bodies, a: int, b: int) -> float:
    """What no corner of two bodies is faster than, as seen from the other one (m/s)."""
    ux, uy = v.vx[b] - v.vx[a], v.vy[b] - v.vy[a]
    return float(math.sqrt(ux * ux + uy * uy)
                 + 0.7072 * k.width * (abs(v.w[a]) + abs(v.w[b])))
