"""Contact rows: every manifold near enough to matter in this substep, with its old impulses.

Body index n is the ground (the wall); it never moves.  Rows are in the order of a, then b,
then id, whatever the age of the pair list, and so are the stored impulses of the substep
before: one merge finds them again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tbsa.kernels.geometry import circle_corner, square_square
from tbsa.kernels.jit import U, columns, inline
from tbsa.kernels.neighbours import Pairs

CIRCLE, RECTANGLE = 1, 2

# Points further apart than they can close at their present speeds, by this fraction of the
# width, are left out: an impact or a force would have to close it within one substep.
SPARE = 0.02


class Rows(NamedTuple):
    """One manifold a row; arrays of one length, two slots where a manifold has two points.

    The relative velocity is that of b against a; ``vn < 0`` is approach.
    """

    a: np.ndarray  # int64
    b: np.ndarray  # int64, n for the wall
    points: np.ndarray  # int64, 1 or 2
    nx: np.ndarray  # normal from a to b
    ny: np.ndarray
    at: np.ndarray  # r . n from a and from b: the lever arms of friction
    bt: np.ndarray
    id0: np.ndarray  # int64, feature ids
    id1: np.ndarray
    gap0: np.ndarray  # m
    gap1: np.ndarray
    an0: np.ndarray  # r x n from a and from b: the lever arms of the normal impulses
    bn0: np.ndarray
    an1: np.ndarray
    bn1: np.ndarray
    pn0: np.ndarray  # N s, normal impulses, >= 0
    pn1: np.ndarray
    pt: np.ndarray  # N s, friction impulse of the manifold, |pt| <= mu (pn0 + pn1)
    want0: np.ndarray  # m/s, the solve makes vn >= -want: a gap may just close in a substep
    want1: np.ndarray
    base: np.ndarray  # N s, normal impulse already applied that friction may count on
    k00: np.ndarray  # 1/kg, velocity change of point 0 for a unit impulse at 0
    k01: np.ndarray  # ... at 1; in a row of one point, by a unit friction impulse
    k11: np.ndarray
    ktt: np.ndarray  # 1/kg, the same for friction
    i00: np.ndarray  # kg, inverses of these
    i11: np.ndarray
    itt: np.ndarray
    idet: np.ndarray  # kg^2, of the 2 x 2 problem of a row; not a number where it has none
    vn0: np.ndarray  # m/s, normal velocities, see `approach`
    vn1: np.ndarray
    seen: np.ndarray  # int64, when the row was last solved


class Impulses(NamedTuple):
    """The impulses at the end of the last substep: part of the state and of a checkpoint."""

    size: np.ndarray  # int64[1]
    a: np.ndarray  # int64
    b: np.ndarray  # int64
    id0: np.ndarray  # int64
    id1: np.ndarray  # int64, -1 for a manifold of one point
    pn0: np.ndarray
    pn1: np.ndarray
    pt: np.ndarray


def empty_rows(capacity: int) -> Rows:
    """Space for `capacity` manifolds."""
    whole = {"a", "b", "points", "id0", "id1", "seen"}
    return Rows(*columns(capacity, [int if f in whole else float for f in Rows._fields]))


def empty_impulses(capacity: int) -> Impulses:
    """Space for the impulses of `capacity` manifolds; none stored."""
    whole = {"a", "b", "id0", "id1"}
    return Impulses(np.zeros(1, np.int64), *columns(
        capacity, [int if f in whole else float for f in Impulses._fields[1:]]))


@inline
def travel(h: float, width: float, vx: float, vy: float, w: float) -> float:
    """The way two bodies can close in a substep (m), and more for what speeds them up in it."""
    return h * (math.sqrt(vx * vx + vy * vy) + 0.7072 * width * w) + SPARE * width


@inline
def find_contacts(rows: Rows, pairs: Pairs, n: int, width: float, h: float, wall: int,
                  wall_x: float, wall_y: float, x: np.ndarray, y: np.ndarray, c: np.ndarray,
                  s: np.ndarray, vx: np.ndarray, vy: np.ndarray, w: np.ndarray,
                  mobile: np.ndarray, far: np.ndarray) -> int:
    """Fill `rows`; returns their number, or -1 where they do not fit.  `far` is scratch."""
    # Arrays are taken out of their tuples before a loop: Numba counts references at every
    # access through a tuple, which costs more than the access.
    start, other = pairs.start, pairs.other
    ra, rb, rcount, rnx, rny, rat, rbt = (rows.a, rows.b, rows.points, rows.nx, rows.ny, rows.at,
                                          rows.bt)
    rid0, rgap0, ran0, rbn0 = rows.id0, rows.gap0, rows.an0, rows.bn0
    rid1, rgap1, ran1, rbn1 = rows.id1, rows.gap1, rows.an1, rows.bn1
    m = 0
    half = 0.5 * width
    for a in range(n):  # a bound without a pair's own root, for a first look
        far[a] = travel(h, width, vx[a], vy[a], abs(w[a]))
    for a in range(n):
        far_a = far[a]
        for k in range(start[a], start[a + 1]):
            b = U(other[k])
            dx, dy = x[b] - x[a], y[b] - y[a]
            if dx * dx + dy * dy > (1.41422 * width + far_a + far[b]) ** 2:
                continue
            margin = travel(h, width, vx[b] - vx[a], vy[b] - vy[a], abs(w[a]) + abs(w[b]))
            (count, nx, ny, id0, gap0, an0, bn0, id1, gap1, an1, bn1, at, bt) = square_square(
                dx, dy, c[a], s[a], c[b], s[b], width, margin)
            if count == 0:
                continue
            if m == ra.size:
                return -1
            ra[m], rb[m], rcount[m] = a, b, count
            rnx[m], rny[m], rat[m], rbt[m] = nx, ny, at, bt
            rid0[m], rgap0[m], ran0[m], rbn0[m] = id0, gap0, an0, bn0
            rid1[m], rgap1[m], ran1[m], rbn1[m] = id1, gap1, an1, bn1
            m += 1
        if wall == 0 or mobile[a] == 0.0:
            continue
        margin = far_a
        corner = 0.70711 * width + margin
        if wall == CIRCLE:
            near = wall_x - corner
            if near > 0.0 and x[a] * x[a] + y[a] * y[a] < near * near:
                continue
        elif abs(x[a]) + corner < wall_x and abs(y[a]) + corner < wall_y:
            continue
        for k in range(4):  # corners, counter-clockwise from that between E and N
            ex = half if k == 0 or k == 3 else -half
            ey = half if k < 2 else -half
            rx, ry = c[a] * ex - s[a] * ey, s[a] * ex + c[a] * ey
            px, py = x[a] + rx, y[a] + ry
            for side in range(1 if wall == CIRCLE else 2):
                if wall == CIRCLE:
                    gap, nx, ny = circle_corner(px, py, wall_x)
                elif side == 0:
                    gap, nx, ny = wall_x - abs(px), 1.0 if px > 0.0 else -1.0, 0.0
                else:
                    gap, nx, ny = wall_y - abs(py), 0.0, 1.0 if py > 0.0 else -1.0
                if gap > margin:
                    continue
                if m == ra.size:
                    return -1
                ra[m], rb[m], rcount[m] = a, n, 1
                rnx[m], rny[m] = nx, ny
                rat[m], rbt[m] = rx * nx + ry * ny, 0.0
                rid0[m], rgap0[m] = 2 * k + side, gap
                ran0[m], rbn0[m] = rx * ny - ry * nx, 0.0
                rid1[m], rgap1[m], ran1[m], rbn1[m] = -1, gap, 0.0, 0.0
                m += 1
    return m


@inline
def recall(rows: Rows, m: int, n: int, old: Impulses) -> None:
    """Give every point the impulse that it had in the last substep, or zero."""
    ra, rb, count, rid0, rid1 = rows.a, rows.b, rows.points, rows.id0, rows.id1
    pn0, pn1, pt = rows.pn0, rows.pn1, rows.pt
    oa, ob, oid0, oid1 = old.a, old.b, old.id0, old.id1
    opn0, opn1, opt = old.pn0, old.pn1, old.pt
    j, size = 0, old.size[0]
    for i in range(m):
        pn0[i] = pn1[i] = pt[i] = 0.0
        a, b, id0, id1, wall = ra[i], rb[i], rid0[i], rid1[i], rb[i] == n
        while j < size and (oa[j] < a or (oa[j] == a and (
                ob[j] < b or (wall and ob[j] == b and oid0[j] < id0)))):
            j += 1
        if j == size or oa[j] != a or ob[j] != b or (wall and oid0[j] != id0):
            continue
        if oid0[j] == id0:
            pn0[i] = opn0[j]
        elif oid1[j] == id0:
            pn0[i] = opn1[j]
        if count[i] == 2:
            if oid1[j] == id1:
                pn1[i] = opn1[j]
            elif oid0[j] == id1:
                pn1[i] = opn0[j]
        pt[i] = opt[j]


@inline
def remember(rows: Rows, m: int, store: Impulses) -> None:
    """Store the impulses of the rows that carry any."""
    ra, rb, count, rid0, rid1 = rows.a, rows.b, rows.points, rows.id0, rows.id1
    pn0, pn1, pt = rows.pn0, rows.pn1, rows.pt
    sa, sb, sid0, sid1 = store.a, store.b, store.id0, store.id1
    spn0, spn1, spt = store.pn0, store.pn1, store.pt
    j = 0
    for i in range(m):
        if pn0[i] == 0.0 and pn1[i] == 0.0:
            continue
        two = count[i] == 2
        sa[j], sb[j], sid0[j], spn0[j], spt[j] = ra[i], rb[i], rid0[i], pn0[i], pt[i]
        sid1[j], spn1[j] = (rid1[i], pn1[i]) if two else (-1, 0.0)
        j += 1
    store.size[0] = j
