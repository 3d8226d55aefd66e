"""What held bodies give each other through a tile that fills the space between them.

Impulses that press such a tile from both sides alike do no work and change nothing, so that any
of them are part of a solution, and a solve that begins with them keeps them: as a squeeze by loads
that have gone, or by passes that came to one side before the other.  Friction would count on them.
Of all impulses with the same force and torque on the tile the least ones (in the sum of squares)
are those of a space that is wider by however little; what wedges a tile has a torque, and stays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.jit import U, inline, lane
from tbsa.kernels.rows import (
    AN0,
    AN1,
    BETWEEN,
    BN0,
    BN1,
    LANES,
    MU,
    NX,
    NY,
    PN0,
    PN1,
    POINTS,
    PT,
    Rows,
    bodies_of,
    lane_of,
)
from tbsa.kernels.sweeps import speed_of

# Rows of a tile are looked at whose normals are along one line, to this cosine.
ALONG = 0.999
# A squeeze that is less than this part of what presses a tile is left; the larger one of a tile at
# rest, which each solve would move a little where friction counts on it.
LITTLE, HALF = 1e-6, 0.5
# Of every point: the way that it presses, 1 or -1; its lever arm (m); 1 if it has an impulse; and
# that (N s).
WAY, ARM, ON, IMPULSE = (U(field) for field in range(0, 4 * POINTS, POINTS))


@lane
def pressed(rows: Rows, q: int, tile: int, mobile: np.ndarray) -> Any:
    """What a held body presses the tile with in row q (N s; 0 if the other body is not held), and
    where to; whether the tile is the second of the row."""
    r, body = rows.field, rows.body
    i, t = lane_of(q), bodies_of(q)
    held, second = mobile[body[t]] * mobile[body[t + LANES]] == 0.0, body[t + LANES] == tile
    sign = 1.0 if second else -1.0
    return (r[i + PN0] + r[i + PN1] if held else 0.0), sign * r[i + NX], sign * r[i + NY], second


@inline
def list_points(rows: Rows, tile: int, mobile: np.ndarray) -> int:
    """List the points in which held bodies press a tile along the line of the hardest; returns how
    many, or 0 where none presses the other way."""
    r, of, lanes, points = rows.field, rows.of, rows.lanes, rows.points
    first, last = rows.start[tile], rows.start[tile + 1]
    most, nx, ny, some = 0.0, 0.0, 0.0, 0
    for o in range(first, last):
        p, x, y, _ = pressed(rows, of[o], tile, mobile)
        some += 1 if p > 0.0 else 0
        if p > most:
            most, nx, ny = p, x, y
    if some < 2:
        return 0
    size, both = U(0), False
    for o in range(first, last):
        p, x, y, second = pressed(rows, of[o], tile, mobile)
        along, i = x * nx + y * ny, lane_of(of[o])
        if p == 0.0 or abs(along) < ALONG or size + U(2) > U(POINTS):
            continue
        both |= along < 0.0
        lanes[size // U(2)] = i
        arm0, arm1 = (r[i + BN0] if second else -r[i + AN0],
                      r[i + BN1] if second else -r[i + AN1])
        for arm, impulse in ((arm0, r[i + PN0]), (arm1, r[i + PN1])):
            points[WAY + size], points[ARM + size] = (1.0 if along > 0.0 else -1.0), arm
            points[ON + size], points[IMPULSE + size] = (1.0 if impulse > 0.0 else 0.0), impulse
            size += U(1)
    return int(size) if both else 0


@inline
def least_squares(points: np.ndarray, size: int) -> float:
    """Put the least impulses with the same force and torque in place of those listed; returns what
    part of all that is less.

    Without a bound each is a multiple of its way and one of its arm; what would pull is left out,
    the hardest first.
    """
    force, torque, before = 0.0, 0.0, 0.0
    for m in range(U(size)):
        p = points[IMPULSE + m]
        force, torque, before = (force + points[WAY + m] * p, torque + points[ARM + m] * p,
                                 before + p)
    for _ in range(size):
        s, st, tt = 0.0, 0.0, 0.0
        for m in range(U(size)):
            on, way, arm = points[ON + m], points[WAY + m], points[ARM + m]
            s, st, tt = s + on, st + on * way * arm, tt + on * arm * arm
        det = s * tt - st * st
        if s == 0.0:
            return 0.0
        alike = det <= 1e-9 * s * tt  # all at one arm
        push = force / s if alike else (tt * force - st * torque) / det
        turn = 0.0 if alike else (s * torque - st * force) / det
        if alike and abs(st * push - torque) > LITTLE * math.sqrt(tt) * before:
            return 0.0  # these alone have another torque
        worst, which, after = 0.0, -1, 0.0
        for m in range(U(size)):
            p = points[ON + m] * (points[WAY + m] * push + points[ARM + m] * turn)
            points[IMPULSE + m] = p
            after += p
            if p < worst:
                worst, which = p, int(m)
        if which < 0:
            return float(1.0 - after / before)
        points[ON + U(which)] = 0.0
    return 0.0


@inline
def ease(rows: Rows, k: Numbers, v: Bodies) -> None:
    """Take from the impulses that a solve begins with what held bodies give each other through a
    tile, and from its friction what counted on that."""
    r, points = rows.field, rows.points
    for j in range(rows.size[BETWEEN]):
        i = rows.between[j]
        size = list_points(rows, i, v.mobile)
        if size == 0:
            continue
        moves = speed_of(v.startx[i], v.starty[i], v.startw[i], k.width) > k.tolerance
        if least_squares(points, size) <= (LITTLE if moves else HALF):
            continue
        for m in range(U(0), U(size), U(2)):
            at = U(rows.lanes[m // U(2)])
            r[at + PN0], r[at + PN1] = points[IMPULSE + m], points[IMPULSE + m + U(1)]
            bound = r[at + MU] * (r[at + PN0] + r[at + PN1])
            r[at + PT] = min(max(r[at + PT], -bound), bound)
