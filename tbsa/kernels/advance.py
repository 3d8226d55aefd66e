"""Many substeps without coming back to Python.

One substep of length h, of second order in free flight:

    drift   x += h/2 v                                   to the middle of the substep
    lists   near pairs (kept while nobody has moved too far)
    damp    v *= exp(-h/2 c)
    forces  magnets and drive, at the middle
    impacts what hits in this substep, without forces     (impacts.py)
    kick    v += h F/m
    solve   contacts and floor friction at the velocity level (solver.py)
    damp    v *= exp(-h/2 c)
    drift   x += h/2 v
    project deep overlap out of the positions, if there is any

The state at the end of a substep, with the contact impulses, is all that the next one needs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.contacts import Impulses, Rows, find_contacts, recall, remember
from tbsa.kernels.impacts import Scratch, impacts
from tbsa.kernels.jit import inline, kernel
from tbsa.kernels.magnets import (
    MagnetLaw,
    MagnetPairs,
    add_magnet_forces,
    find_magnet_pairs,
)
from tbsa.kernels.neighbours import Pairs, build_pairs, stale
from tbsa.kernels.solver import (
    Bodies,
    FloorLaw,
    Numbers,
    apply_impulses,
    limit_work,
    prepare,
    project,
    relax,
)

# Error words of `advance`.
OK, MORE_PAIRS, MORE_ROWS, NOT_FINITE = 0, 1, 2, 3


class State(NamedTuple):
    """What moves; arrays of length n + 1, the last entry being the ground."""

    x: np.ndarray  # m
    y: np.ndarray
    angle: np.ndarray  # rad
    vx: np.ndarray  # m/s
    vy: np.ndarray
    omega: np.ndarray  # rad/s
    impulses: Impulses


class Tiles(NamedTuple):
    """What each tile is; fixed in a run."""

    mobile: np.ndarray  # float64[n + 1]: 1, or 0 for held tiles and the ground
    glues: np.ndarray  # int64[4 n], N, E, S, W
    family: np.ndarray  # float64[n]
    forward: np.ndarray  # float64[n], rad from the tile's +x to its forward edge


class Work(NamedTuple):
    """Scratch, rebuilt at will: nothing in it outlives a substep but the pair list."""

    pairs: Pairs
    rows: Rows
    bodies: Bodies
    shift: Bodies
    scratch: Scratch
    c: np.ndarray  # cos and sin of the angles
    s: np.ndarray
    lastx: np.ndarray  # where the tiles were at the middle of the substep before
    lasty: np.ndarray
    last_angle: np.ndarray
    still: np.ndarray  # bool, they are there again: what follows from their places is known
    fx: np.ndarray
    fy: np.ndarray
    torque: np.ndarray
    magnets: MagnetPairs


class Counts(NamedTuple):
    """What the run has done so far; part of a checkpoint."""

    substeps: np.ndarray  # int64[1]
    lists: np.ndarray  # pair lists built
    rows: np.ndarray  # manifolds solved, summed over substeps
    passes: np.ndarray  # solver passes
    unconverged: np.ndarray  # substeps that ended at the limit of passes
    impacts: np.ndarray  # points that hit
    projections: np.ndarray  # substeps with overlap beyond the slop
    overlap: np.ndarray  # substeps by deepest overlap: <= 0.01, 0.1, 0.5, 2, more % of w
    deepest: np.ndarray  # float64[1], m


def empty_counts() -> Counts:
    """All zero."""
    return Counts(*(np.zeros(5 if f == "overlap" else 1,
                             np.float64 if f == "deepest" else np.int64)
                    for f in Counts._fields))


@inline
def note_overlap(rows: Rows, m: int, width: float, counts: Counts) -> None:
    """Count the substep under its deepest overlap."""
    gap0, gap1 = rows.gap0, rows.gap1
    deepest = 0.0
    for i in range(m):
        deepest = max(deepest, -gap0[i], -gap1[i])
    counts.deepest[0] = max(counts.deepest[0], deepest)
    share = deepest / width
    counts.overlap[0 if share <= 1e-4 else 1 if share <= 1e-3 else 2 if share <= 5e-3
                   else 3 if share <= 2e-2 else 4] += 1


@inline
def kick(k: Numbers, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray, v: Bodies) -> None:
    """Give every mobile tile the impulse of the forces, and note where it started."""
    fm, fi = k.h / k.mass, k.h / k.inertia
    vx, vy, w, mobile = v.vx, v.vy, v.w, v.mobile
    v.startx[:] = vx
    v.starty[:] = vy
    v.startw[:] = w
    v.floorx[:] = 0.0
    v.floory[:] = 0.0
    v.floort[:] = 0.0
    for i in range(k.n):
        if mobile[i] != 0.0:
            vx[i] += fm * fx[i]
            vy[i] += fm * fy[i]
            w[i] += fi * torque[i]


@inline
def stopping(start: float, trial: float, bound: float) -> float:
    """Fraction of a substep that a sliding tile moves before friction stops it.

    `start` is the speed (times mass) at its beginning, `trial` what it would be at its end
    without friction, in the same direction; `bound` the friction impulse of a whole substep.
    """
    slowing = bound - (trial - start)
    return min(start / slowing, 1.0) if slowing > 0.0 else 1.0


@inline
def drift_back(k: Numbers, floor: FloorLaw, rows: Rows, m: int, im: float, ii: float, v: Bodies,
               x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> None:
    """Take back what a tile without contact drifted after friction had stopped it.

    The first half of the drift went h/2 v; a tile that stops after the fraction f of the
    substep goes f h/2 v.  Without this a stop is off by up to a h^2 / 2.
    """
    ra, rb, pn0, pn1 = rows.a, rows.b, rows.pn0, rows.pn1
    vx, vy, w, mobile, moved = v.vx, v.vy, v.w, v.mobile, v.moved
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    for i in range(m):
        if pn0[i] != 0.0 or pn1[i] != 0.0:
            moved[ra[i]] = -1
            moved[rb[i]] = -1
    for i in range(k.n):
        if mobile[i] == 0.0 or moved[i] == -1:
            continue
        ux, uy, uw = startx[i], starty[i], startw[i]
        if vx[i] == 0.0 and vy[i] == 0.0 and (ux != 0.0 or uy != 0.0):
            speed = math.sqrt(ux * ux + uy * uy)
            trial = -(floorx[i] * ux + floory[i] * uy) / speed
            rest = 1.0 - stopping(speed / im, trial, floor.force * k.h)
            x[i] -= 0.5 * k.h * rest * ux
            y[i] -= 0.5 * k.h * rest * uy
        if w[i] == 0.0 and uw != 0.0:
            trial = -floort[i] if uw > 0.0 else floort[i]
            rest = 1.0 - stopping(abs(uw) / ii, trial, floor.torque * k.h)
            angle[i] -= 0.5 * k.h * rest * uw


@kernel
def advance(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
            drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
            first: int, substeps: int, reach: float, skin: float) -> tuple[int, int]:
    """Advance by `substeps` substeps, the first of which is number `first` of the run.

    Returns the error word and the substeps done; on MORE_PAIRS the state is that before the
    substep that failed, and the caller goes on with more space.
    """
    n, h = k.n, k.h
    x, y, angle = state.x, state.y, state.angle
    v, rows, c, s = work.bodies, work.rows, work.c, work.s
    vx, vy, w, fx, fy, torque = v.vx, v.vy, v.w, work.fx, work.fy, work.torque
    v.vx[:], v.vy[:], v.w[:] = state.vx, state.vy, state.omega
    v.mobile[:] = tiles.mobile
    im, ii = 1.0 / k.mass, 1.0 / k.inertia
    damp, damp_spin = math.exp(-0.5 * h * k.linear_damping), math.exp(-0.5 * h * k.angular_damping)
    no_floor = FloorLaw(0, 0.0, 0.0)
    lastx, lasty, last_angle, still = work.lastx, work.lasty, work.last_angle, work.still
    lastx[:] = np.nan  # nothing is known yet
    error, done = OK, 0
    m = 0
    for step in range(substeps):
        if reach > 0.0 and stale(work.pairs, n, x, y, vx, vy, h):
            fastest = 0.0
            for i in range(n):
                fastest = max(fastest, vx[i] * vx[i] + vy[i] * vy[i])
            found = build_pairs(work.pairs, n, x, y, tiles.mobile, reach,
                                max(skin, 2.0 * h * math.sqrt(fastest)))
            counts.lists[0] += 1
            if found < 0 or found > work.pairs.other.size:
                error = NOT_FINITE if found < 0 else MORE_PAIRS
                break
            lastx[:] = np.nan  # forces are kept by the place of a pair on the list
        for i in range(n):
            x[i] += 0.5 * h * vx[i]
            y[i] += 0.5 * h * vy[i]
            angle[i] += 0.5 * h * w[i]
            vx[i] *= damp
            vy[i] *= damp
            w[i] *= damp_spin
            still[i] = x[i] == lastx[i] and y[i] == lasty[i] and angle[i] == last_angle[i]
            if not still[i]:
                c[i], s[i] = math.cos(angle[i]), math.sin(angle[i])
                lastx[i], lasty[i], last_angle[i] = x[i], y[i], angle[i]
            fx[i] = fy[i] = torque[i] = 0.0
        if magnets.cutoff > 0.0:
            near = find_magnet_pairs(magnets, work.pairs, n, x, y, c, s, still, work.magnets)
            add_magnet_forces(magnets, work.pairs, n, work.magnets, near, tiles.glues, x, y,
                              still, fx, fy, torque)
        drive((first + step + 0.5) * h, drive_parameters, x[:n], y[:n], angle[:n], vx[:n],
              vy[:n], w[:n], tiles.family, tiles.forward, fx, fy, torque)

        if reach > 0.0 or k.wall != 0:
            m = find_contacts(rows, work.pairs, n, k.width, h, k.wall, k.wall_x, k.wall_y, x, y,
                              c, s, vx, vy, w, tiles.mobile, v.lastx)
            if m < 0:
                error = MORE_ROWS
                break
        if m > 0:
            note_overlap(rows, m, k.width, counts)
            prepare(rows, m, im, ii, v.mobile)
            counts.impacts[0] += impacts(rows, m, k, no_floor, c, s, v, work.scratch)
        else:
            counts.overlap[0] += 1
        kick(k, fx, fy, torque, v)
        if m > 0 or floor.law != 0:
            recall(rows, m, n, state.impulses)
            rows.base[:m] = 0.0
            rows.seen[:m] = -1
            rows.want0[:m] = np.maximum(rows.gap0[:m], 0.0) / h
            rows.want1[:m] = np.maximum(rows.gap1[:m], 0.0) / h
            before = work.shift
            before.vx[:], before.vy[:], before.w[:] = vx, vy, w
            apply_impulses(rows, m, im, ii, v)
            passes = relax(rows, m, k, floor, im, ii, c, s, v, k.tolerance)
            counts.unconverged[0] += 1 if passes < 0 else 0
            counts.passes[0] += passes if passes >= 0 else -1 - passes
            if m > 0:
                limit_work(rows, m, k, floor, im, ii, c, s, v, before, k.tolerance)
            remember(rows, m, state.impulses)
        else:
            state.impulses.size[0] = 0
        counts.rows[0] += m
        if floor.law != 0:
            drift_back(k, floor, rows, m, im, ii, v, x, y, angle)
        for i in range(n):
            vx[i] *= damp
            vy[i] *= damp
            w[i] *= damp_spin
            x[i] += 0.5 * h * vx[i]
            y[i] += 0.5 * h * vy[i]
            angle[i] += 0.5 * h * w[i]
        if m > 0 and project(rows, m, k, im, ii, v, work.shift, x, y, angle):
            counts.projections[0] += 1
        done += 1
    state.vx[:], state.vy[:], state.omega[:] = vx, vy, w
    counts.substeps[0] += done
    for i in range(n):
        if not (np.isfinite(vx[i]) and np.isfinite(vy[i]) and np.isfinite(w[i])):
            error = NOT_FINITE
    return error, done
