"""Forces of magnets and drive in the middle of a half step, and the lists of pairs for them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.arrays import copy, set_all, whole
from tbsa.kernels.bodies import Numbers
from tbsa.kernels.crew import AHEAD, LEAST_TILES, collect, give
from tbsa.kernels.floor import FloorLaw
from tbsa.kernels.jit import ZERO, U, inline, rolled
from tbsa.kernels.magnets import (
    MagnetLaw,
    add_magnet_forces,
    list_magnets,
    magnets_stale,
    place_magnets,
)
from tbsa.kernels.mean_forces import add_mean_forces
from tbsa.kernels.motion import turn
from tbsa.kernels.neighbours import list_again, list_pairs, stale
from tbsa.kernels.state import MORE_MAGNETS, MORE_PAIRS, NOT_FINITE, OK, Counts, Tiles, Work

# How long lists last: steps that a tile can go on at its speed and some way more (widths) before
# its pairs are found anew; a fast one fewer, no further than this (widths), but a step for magnets.
# A longer list is older and has more on it that is out of reach.
# Of up to so many tiles all pairs are few.
PAIR_STEPS, PAIR_ROOM, PAIR_MOST, PAIR_FEW = 8.0, 0.35, 0.5, 8
MAGNET_STEPS, MAGNET_ROOM, MAGNET_MOST = 5.0, 0.02, 0.1
# Up to one tile in so many has its pairs listed again, beside those of all others.
FEW_LATE = 16


@inline
def fits(found: int, ahead: int, capacity: int) -> bool:
    """Whether a list has space; at the beginning of a step also for some more in its middle."""
    return found + ahead * (found // 4 + 64) <= capacity


@inline
def find_pairs(k: Numbers, reach: float, tiles: Tiles, x: np.ndarray, y: np.ndarray,
               need: np.ndarray, ahead: int, work: Work, counts: Counts) -> int:
    """Bring the pair list up to date, if a tile that goes as `need` (m) may come too far.

    A list has a margin for every tile, after its speed, so that a single fast one does not make
    it long or short-lived for all; where few come too far, theirs alone are listed again.  In the
    middle of a step (`ahead` 0), when it is too late for more space, one that does not fit with
    margins has none.  Returns an error word.
    """
    margin, pairs, vx, vy = work.margin, work.pairs, work.bodies.vx, work.bodies.vy
    too_far = stale(pairs, k.n, x, y, need)
    if ahead * k.keep_lists == ahead and too_far == 0:
        return OK
    most = PAIR_MOST * k.width * max(1.0, PAIR_FEW / k.n)
    for i in range(U(k.n)):
        pace = math.sqrt(vx[i] * vx[i] + vy[i] * vy[i])
        way = min(PAIR_STEPS * k.substeps * k.h * pace, most)
        margin[i] = max(PAIR_ROOM * k.width + way, 1.5 * need[i])
    found = -1
    if k.keep_lists != 0 and too_far + pairs.late[k.n] <= k.n // FEW_LATE:
        found = list_again(pairs, k.n, x, y, tiles.mobile, reach, margin)
    if found >= 0 and fits(found, 1, pairs.room):
        return OK
    counts.lists[0] += 1
    for bare in range(2 - ahead):
        if bare != 0:
            copy(need, margin, k.n)
        found = list_pairs(pairs, k.n, x, y, tiles.mobile, reach, margin, work.crew)
        if found < 0:
            return NOT_FINITE
        if fits(found, 1 - bare, pairs.room):
            return OK
    return MORE_PAIRS


@inline
def find_magnets(k: Numbers, half: float, reach: float, tiles: Tiles, law: MagnetLaw,
                 x: np.ndarray, y: np.ndarray, angle: np.ndarray, turns_far: bool, ahead: int,
                 work: Work, counts: Counts) -> int:
    """Bring the list of magnet pairs up to date for the places at a time `half` from now, or where
    `turns_far` says that a tile does, up to twice that time.

    So no pair within the cut-off is ever missing, whatever the age of the list.  Returns an
    error word.
    """
    need, turning, pace, speed, near = (work.need, work.turning, work.pace, work.speed,
                                        work.magnets)
    vx, vy, w = work.bodies.vx, work.bodies.vy, work.bodies.w
    until = 2.0 * half if turns_far else half
    for i in range(U(k.n)):
        pace[i] = math.sqrt(vx[i] * vx[i] + vy[i] * vy[i])
        speed[i] = pace[i] + 0.7072 * k.width * abs(w[i])
        need[i], turning[i] = until * pace[i], until * speed[i]
    if (ahead * k.keep_lists == ahead
            and not magnets_stale(near, k.n, law.offset, x, y, angle, need, turning)):
        return OK
    counts.magnet_lists[0] += 1
    more, most, time = MAGNET_ROOM * k.width, MAGNET_MOST * k.width, k.substeps * k.h
    for bare in range(2 - ahead):
        for i in range(U(k.n)):
            centre, corners = time * pace[i], time * speed[i]
            centre = more + max(centre, min(MAGNET_STEPS * centre, most))
            corners = more + max(corners, min(MAGNET_STEPS * corners, most))
            need[i] = until * pace[i] + (centre if bare == 0 else 0.0)
            turning[i] = until * speed[i] + (corners if bare == 0 else 0.0)
        error = find_pairs(k, reach, tiles, x, y, need, ahead, work, counts)
        if error != OK:
            return int(error)
        if work.pairs.start[k.n] > 0:
            turn(ZERO, k.n, angle, work.turned, work.c, work.s)
        found = list_magnets(law, work.pairs, k.n, tiles.glues, x, y, angle, work.c, work.s, need,
                             turning, near, work.crew)
        if fits(found, 1 - bare, near.room):
            return OK
    return MORE_MAGNETS


@rolled
def look_ahead(half: float, law: MagnetLaw, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
               work: Work, begin: int, end: int) -> None:
    """Where these tiles and their magnets will be in a time `half`."""
    v, fx, fy, torque = work.bodies, work.fx, work.fy, work.torque
    midx, midy, mid_angle = work.midx, work.midy, work.mid_angle
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(begin), U(end)):
        midx[i], midy[i] = x[i] + half * vx[i], y[i] + half * vy[i]
        mid_angle[i] = angle[i] + half * w[i]
        fx[i] = fy[i] = torque[i] = 0.0
    if law.cutoff > 0.0 and work.magnets.size[0] > 0:
        turn(begin, end, mid_angle, work.mid_turned, work.mid_c, work.mid_s)
        place_magnets(work.magnets, law.offset, midx, midy, work.mid_c, work.mid_s, begin, end)


@inline
def strongest(k: Numbers, floor: FloorLaw, work: Work, loaded: bool) -> float:
    """What forces, if there are any, and floor speed no point of a tile up by more than (m/s^2)."""
    mobile, fx, fy, torque = work.bodies.mobile, work.fx, work.fy, work.torque
    corner, most = 0.7072 * k.width, 0.0
    for i in range(U(k.front), U(k.n) if loaded else U(k.front)):
        pull = (k.im * math.sqrt(fx[i] * fx[i] + fy[i] * fy[i])
                + k.ii * corner * abs(torque[i]))
        most = max(most, pull if mobile[i] != 0.0 else 0.0)
    return most + k.im * floor.force + k.ii * corner * floor.torque


@inline
def find_forces(t: float, k: Numbers, half: float, tiles: Tiles, law: MagnetLaw, drive: Any,
                parameters: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
                turns_far: bool, loaded: bool, work: Work) -> bool:
    """Forces and torques of magnets and drive a time `half` after the tiles are at x, y; where
    `turns_far` says that a tile does, the mean of the magnets' over twice that time.

    Returns whether any may be other than zero, as `loaded` says of those that are there.
    """
    magnetic = law.cutoff > 0.0 and work.magnets.size[0] > 0
    if not (loaded or magnetic or k.driven != 0):
        return False
    n = k.n
    v, fx, fy, torque, crew = work.bodies, work.fx, work.fy, work.torque, work.crew
    midx, midy, mid_angle = work.midx, work.midy, work.mid_angle
    vx, vy, w = v.vx, v.vy, v.w
    crew.numbers[0] = half
    begin, end = give(crew, AHEAD, ZERO, n, LEAST_TILES)
    look_ahead(half, law, x, y, angle, work, begin, end)
    collect(crew)
    if magnetic:
        add_magnet_forces(law, n, work.magnets, fx, fy, torque, crew)
        if turns_far:
            add_mean_forces(law, work.magnets, 2.0 * half, x, y, angle, v, fx, fy, torque)
        copy(fx, work.pullx, n)
        copy(fy, work.pully, n)
        set_all(work.lagx, n, 0.0)
        set_all(work.lagy, n, 0.0)
    if k.driven != 0:
        drive(t, parameters, whole(midx, n), whole(midy, n), whole(mid_angle, n), whole(vx, n),
              whole(vy, n), whole(w, n), whole(tiles.family, n), whole(tiles.forward, n),
              whole(fx, n), whole(fy, n), whole(torque, n))
    return bool(magnetic or k.driven != 0)
