"""Contact geometry: two equal squares, a square's corner against a round wall, and a square against
a flat one, whose side is the face of another square.

Everything a contact row needs follows from the normal `n` (from body a to body b), the gap
along it (negative: overlap) and the lever arms of one common point, seen from both centres:
``r x n`` for the normal impulse and ``r . n`` for the tangential one (tangent t = (-n_y, n_x)).
Because the point is common to both bodies, an impulse keeps angular momentum to rounding.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Numbers
from tbsa.kernels.jit import lane

CIRCLE, RECTANGLE = 1, 2

# Two corners that pass each other with less overlap than this fraction of the width do not
# touch: an exact corner would catch on every joint between the tiles of a straight wall.  More than
# what overlap is left alone (`projection.SLOP`): what is pressed on such a wall lies that deep.
BLUNT = 1.5e-3
# A corner at the end of a face is over it up to this (widths): where two meet, over one at least.
ROUNDED = 1e-12


@lane
def square_square(dx: float, dy: float, ca: float, sa: float, cb: float, sb: float,
                  width: float, margin: float, wall: bool = False) -> Any:
    """Manifold of two equal squares: up to two points nearer than `margin`.

    The reference face is the one of the four with the largest separation (the half extent of
    either square along the other's normal is w/2 (|cos| + |sin|) of the relative angle); the
    facing edge of the other square is clipped to it.  Returns ``(count, n_x, n_y, id0, gap0,
    an0, bn0, id1, gap1, an1, bn1, at, bt, miss, of_a)``: count 0, 1 or 2; gaps in m; ``an``,
    ``bn`` = r x n and ``at``, ``bt`` = r . n seen from a and from b (``at``, ``bt`` are common to
    both points, which lie on one line along the face); ``miss`` is how far along the face the
    squares pass each other (m) where that is all that keeps them apart, else not positive: minus
    how far they have to go along it until they do, where they are no further apart than `margin`;
    ``of_a`` whether the face is one of a's.  The id names a's edge, b's edge and the end of their
    overlap, whichever square is the reference, so that an impulse finds its point again.
    Counts and ids are whole numbers kept as floats.  Of a `wall` the face is b's, without an end.
    """
    half = 0.5 * width
    end = 1e3 * width if wall else half
    cos_ab, sin_ab = ca * cb + sa * sb, ca * sb - sa * cb
    reach = half * (1.0 + abs(cos_ab) + abs(sin_ab))
    ax, ay = dx * ca + dy * sa, dy * ca - dx * sa  # centre b in a's frame
    bx, by = -(dx * cb + dy * sb), -(dy * cb - dx * sb)  # centre a in b's frame
    on_a, on_b = max(abs(ax), abs(ay)) - reach, max(abs(bx), abs(by)) - reach

    # The reference square's frame, turned by quarter turns so that its face looks along +x:
    # a turn to y where the face is N or S, and half a turn where it is W or S.
    of_a = (on_a >= on_b) & (not wall)
    x, y, sin = (ax if of_a else bx), (ay if of_a else by), (sin_ab if of_a else -sin_ab)
    rc, rs = (ca if of_a else cb), (sa if of_a else sb)
    along_x = abs(x) >= abs(y)
    turn = 1.0 if (x if along_x else y) >= 0.0 else -1.0
    face = (0.0 if along_x else 1.0) + (0.0 if turn > 0.0 else 2.0)  # E, N, W, S
    nx, ny = turn * (rc if along_x else -rs), turn * (rs if along_x else rc)
    x, y = turn * (x if along_x else y), turn * (y if along_x else -x)
    cos, sin = turn * (cos_ab if along_x else sin), turn * (sin if along_x else -cos_ab)
    # The other square, turned by quarter turns so that its edge at -x looks at the face.
    even = abs(cos) >= abs(sin)
    cos, sin = (cos if even else sin), (sin if even else -cos)
    other = -1.0 if cos < 0.0 else 1.0
    cos, sin = other * cos, other * sin
    facing = (2.0 if even else 1.0) + (0.0 if other > 0.0 else (-2.0 if even else 2.0))
    # That edge runs from (x0, y0) up to (x1, y1); clip it to |y| <= half, the end of the face.
    x0, y0 = x - half * (cos - sin), y - half * (sin + cos)
    x1, y1 = x - half * (cos + sin), y - half * (sin - cos)
    slope = (x1 - x0) / (y1 - y0)
    x0, y0 = (x0 + slope * (-end - y0) if y0 < -end else x0), max(y0, -end)
    x1, y1 = (x1 + slope * (end - y1) if y1 > end else x1), min(y1, end)
    gap0, gap1 = x0 - half, x1 - half

    # Seen from b, the lower end is a's upper one.
    pair = 8.0 * (face if of_a else facing) + 2.0 * (facing if of_a else face)
    id0, id1 = pair + (0.0 if of_a else 1.0), pair + (1.0 if of_a else 0.0)
    # What is as short as corners are blunt is one point; the edge may end there, or go on beyond.
    length, short = y1 - y0, y1 - y0 < BLUNT * width
    far0 = (gap0 > margin) | (short & (gap1 < gap0))
    far1 = (gap1 > margin) | (short & (gap0 < gap1))
    count = 1.0 if far0 | far1 else 2.0
    miss = max(BLUNT * width - (reach - abs(y)), -length)
    apart = (max(on_a, on_b) > margin) | (miss > ROUNDED * width) | (far0 & far1)
    count = 0.0 if apart else count
    miss = miss if max(on_a, on_b) <= margin else 0.0
    y0, gap0, id0 = (y1 if far0 else y0), (gap1 if far0 else gap0), (id1 if far0 else id0)
    gap1 = gap0 if far1 else gap1
    depth = half + 0.5 * min(gap0, gap1)  # midway between the face and the point that bears
    an0, bn0 = (-y0 if of_a else y0 - y), (y - y0 if of_a else y0)
    an1, bn1 = (-y1 if of_a else y1 - y), (y - y1 if of_a else y1)
    at, bt = (depth if of_a else x - depth), (depth - x if of_a else -depth)
    nx, ny = (nx if of_a else -nx), (ny if of_a else -ny)
    return count, nx, ny, id0, gap0, an0, bn0, id1, gap1, an1, bn1, at, bt, miss, of_a


@lane
def arc(angle: float) -> Any:
    """What an arc differs by from its tangent, ``1 - cos`` and ``angle - sin``, of the angle of a
    substep: to 3e-5 up to 1 rad, which it is cut off at."""
    a = min(max(angle, -1.0), 1.0)
    z = a * a
    return (z * (0.5 - z * (1.0 / 24.0 - z / 720.0)),
            a * z * (1.0 / 6.0 - z * (1.0 / 120.0 - z / 5040.0)))


@lane
def bends(width: float, gap0: float, gap1: float, away: float, aside: float, p0: float, p1: float,
          along: float, across: float, turn: float, other: float) -> Any:
    """What the gaps of two points gain (m) while both squares fly on, and how far the nearer one
    slides along the face, beyond what they do at their present rates.

    A gap is ``n . (d + R r) - w/2``, and a slide that of ``t . (d + R r)``, where n and t are out
    of the face and along it, the other square's centre is at d from that of the face's square, and
    its point at r from there.  In their frame d is (`away`, `aside`) and r is
    (w/2 + gap - away, `p`).  Meanwhile the other centre goes (`along`, `across`), n turns by
    `turn`, and r, as seen from n, by `other` (rad).
    """
    up, over = arc(turn)
    back, lag = arc(other)
    centre = (turn - over) * across - over * aside - up * (away + along)
    r = 0.5 * width - away
    slide = over * (away + along) - turn * along - up * (aside + across)
    return (centre + lag * p0 - back * (r + gap0), centre + lag * p1 - back * (r + gap1),
            slide - lag * (r + min(gap0, gap1)) - back * (p0 if gap0 <= gap1 else p1))


@lane
def circle_corner(px: float, py: float, radius: float) -> Any:
    """A point inside a circular wall about the origin: ``(gap, n_x, n_y)``, n outwards.

    Exact: the wall is the circle itself, not a polygon.
    """
    distance = math.sqrt(px * px + py * py)
    centre = distance < 1e-12 * radius  # no direction there: any
    scale = 1.0 / (1.0 if centre else distance)
    return radius - distance, (1.0 if centre else px * scale), (0.0 if centre else py * scale)


@lane
def cos_sin(angle: float) -> Any:
    """Cosine and sine, to 1.5e-16 for angles up to a million turns; vectorises, as the library's
    functions do not.

    The angle less a multiple of a quarter turn (in three parts, Cody and Waite), then the
    polynomials of Sun's fdlibm on [-pi/4, pi/4].
    """
    turns = np.floor(angle * 0.6366197723675814 + 0.5)  # a float; math.floor makes an integer
    r = angle - turns * 1.57079632673412561417
    r = (r - turns * 6.07710050630396597660e-11) - turns * 2.02226624879595063154e-21
    z = r * r
    sin = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * (
            -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))))
    cos = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * (
        -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * (
            -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09
                                               - z * 1.13596475577881948265e-11)))))
    quarter = turns - 4.0 * np.floor(0.25 * turns)
    odd = (quarter == 1.0) | (quarter == 3.0)
    c, s = (sin if odd else cos), (cos if odd else sin)
    c = -c if (quarter == 1.0) | (quarter == 2.0) else c
    s = -s if quarter >= 2.0 else s
    return c, s


@lane
def turned_on(c: float, s: float, turn: float) -> Any:
    """Cosine and sine after a turn (rad) from where they are c and s: to 1e-7, with a third of the
    work, where that is as small as mostly in a substep."""
    up, over = arc(turn)
    cos, sin = 1.0 - up, turn - over
    if abs(turn) > 0.5:
        cos, sin = cos_sin(turn)
    return c * cos - s * sin, s * cos + c * sin


@lane
def pair_gap(dx: float, dy: float, ca: float, sa: float, cb: float, sb: float,
             half: float) -> Any:
    """Largest gap of two squares across a face of one of them (m), and how far at least they are
    apart along that face (negative: beside each other); the centres are this far apart."""
    cos, sin = ca * cb + sa * sb, ca * sb - sa * cb
    reach = half * (1.0 + abs(cos) + abs(sin))
    ax, ay = abs(dx * ca + dy * sa), abs(dy * ca - dx * sa)
    bx, by = abs(dx * cb + dy * sb), abs(dy * cb - dx * sb)
    on_a, on_b = max(ax, ay), max(bx, by)
    aside = min(ax, ay) if on_a >= on_b else min(bx, by)
    return max(on_a, on_b) - reach, aside - reach


@lane
def off_wall(k: Numbers, x: float, y: float, reach: float) -> bool:
    """Whether nothing within this reach of a place meets the wall."""
    near = k.wall_x - reach
    inside = (near > 0.0) & (x * x + y * y < near * near)
    between = (abs(x) + reach < k.wall_x) & (abs(y) + reach < k.wall_y)
    return inside if k.wall == CIRCLE else between


@lane
def corner_arm(q: int, half: float, c: float, s: float) -> Any:
    """From a tile's centre to its corner q, counter-clockwise from that between E and N."""
    ex = half if (q == 0) | (q == 3) else -half
    ey = half if q < 2 else -half
    return c * ex - s * ey, s * ex + c * ey


@lane
def wall_square(k: Numbers, code: int, x: float, y: float) -> Any:
    """From a place to the centre of a square behind a side of a rectangle, right across (m).

    The side is a face of that square, E, N, W or S by its code: that of the west wall looks east.
    """
    half = 0.5 * k.width
    along, across = k.wall_x + half, k.wall_y + half
    dx = -along - x if code == 0 else along - x
    dy = -across - y if code == 1 else across - y
    return (dx if code % 2 == 0 else 0.0), (dy if code % 2 == 1 else 0.0)


@lane
def gap_to_wall(k: Numbers, code: int, x: float, y: float, c: float, s: float) -> float:
    """Gap of a tile to the wall (m): of one of its four corners to a round one; of its nearest to
    one of the four sides of a rectangle, see `wall_square`."""
    half = 0.5 * k.width
    rx, ry = corner_arm(code, half, c, s)
    gap, _, _ = circle_corner(x + rx, y + ry, k.wall_x)
    dx, dy = wall_square(k, code, x, y)
    flat = abs(dx) + abs(dy) - half * (1.0 + abs(c) + abs(s))
    return float(gap if k.wall == CIRCLE else flat)
