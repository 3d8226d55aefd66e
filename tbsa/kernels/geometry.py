"""Contact geometry: two equal squares, and a square's corner against a wall.

Everything a contact row needs follows from the normal `n` (from body a to body b), the gap
along it (negative: overlap) and the lever arms of one common point, seen from both centres:
``r x n`` for the normal impulse and ``r . n`` for the tangential one (tangent t = (-n_y, n_x)).
Because the point is common to both bodies, an impulse keeps angular momentum to rounding.
"""

from __future__ import annotations

import math
from typing import Any

from tbsa.kernels.jit import inline

# Two corners that pass each other with less overlap than this fraction of the width do not
# touch: an exact corner would catch on every joint between the tiles of a straight wall.
BLUNT = 1e-3


@inline
def square_square(dx: float, dy: float, ca: float, sa: float, cb: float, sb: float,
                  width: float, margin: float) -> Any:
    """Manifold of two equal squares: up to two points nearer than `margin`.

    The reference face is the one of the four with the largest separation (the half extent of
    either square along the other's normal is w/2 (|cos| + |sin|) of the relative angle); the
    facing edge of the other square is clipped to it.  Returns ``(count, n_x, n_y, id0, gap0,
    an0, bn0, id1, gap1, an1, bn1, at, bt)``: count 0, 1 or 2; gaps in m; ``an``, ``bn`` = r x n
    and ``at``, ``bt`` = r . n seen from a and from b (``at``, ``bt`` are common to both points,
    which lie on one line along the face).  The id names a's edge, b's edge and the end of their
    overlap, whichever square is the reference, so that an impulse finds its point again.
    """
    half = 0.5 * width
    nothing = (0, 0.0, 0.0, 0, 0.0, 0.0, 0.0, 0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cos_ab, sin_ab = ca * cb + sa * sb, ca * sb - sa * cb
    reach = half * (1.0 + abs(cos_ab) + abs(sin_ab))
    ax, ay = dx * ca + dy * sa, dy * ca - dx * sa  # centre b in a's frame
    bx, by = -(dx * cb + dy * sb), -(dy * cb - dx * sb)  # centre a in b's frame
    on_a, on_b = max(abs(ax), abs(ay)) - reach, max(abs(bx), abs(by)) - reach
    if max(on_a, on_b) > margin:
        return nothing

    # The reference square's frame, turned by quarter turns so that its face looks along +x.
    a_is_reference = on_a >= on_b
    if a_is_reference:
        x, y, cos, sin, rc, rs = ax, ay, cos_ab, sin_ab, ca, sa
    else:
        x, y, cos, sin, rc, rs = bx, by, cos_ab, -sin_ab, cb, sb
    face = (0 if x >= 0.0 else 2) if abs(x) >= abs(y) else (1 if y >= 0.0 else 3)
    if face == 0:
        nx, ny = rc, rs
    elif face == 1:
        x, y, nx, ny = y, -x, -rs, rc
        cos, sin = sin, -cos
    elif face == 2:
        x, y, nx, ny = -x, -y, -rc, -rs
        cos, sin = -cos, -sin
    else:
        x, y, nx, ny = -y, x, rs, -rc
        cos, sin = -sin, cos
    # The other square, turned by quarter turns so that its edge at -x looks at the face.
    facing = 2
    if abs(cos) >= abs(sin):
        if cos < 0.0:
            cos, sin, facing = -cos, -sin, 0
    elif sin > 0.0:
        cos, sin, facing = sin, -cos, 1
    else:
        cos, sin, facing = -sin, cos, 3
    # That edge runs from (x0, y0) up to (x1, y1); clip it to |y| <= half.
    x0, y0 = x - half * (cos - sin), y - half * (sin + cos)
    x1, y1 = x - half * (cos + sin), y - half * (sin - cos)
    slope = (x1 - x0) / (y1 - y0)
    if y0 < -half:
        x0, y0 = x0 + slope * (-half - y0), -half
    if y1 > half:
        x1, y1 = x1 + slope * (half - y1), half
    if y1 - y0 < BLUNT * width:
        return nothing
    gap0, gap1 = x0 - half, x1 - half

    edge_a, edge_b = (face, facing) if a_is_reference else (facing, face)
    pair = (4 * edge_a + edge_b) * 2
    if not a_is_reference:
        pair += 1  # seen from b, the lower end is a's upper one
    id0, id1 = pair, pair ^ 1
    if gap0 > margin and gap1 > margin:
        return nothing
    count = 2
    if gap0 > margin or gap1 > margin:
        count = 1
        if gap0 > margin:
            y0, gap0, id0 = y1, gap1, id1
        gap1 = gap0
    depth = half + 0.25 * (gap0 + gap1)  # midway between the face and the edge
    if a_is_reference:
        return (count, nx, ny, id0, gap0, -y0, y - y0, id1, gap1, -y1, y - y1, depth, depth - x)
    return (count, -nx, -ny, id0, gap0, y0 - y, y0, id1, gap1, y1 - y, y1, x - depth, -depth)


@inline
def circle_corner(px: float, py: float, radius: float) -> Any:
    """A point inside a circular wall about the origin: ``(gap, n_x, n_y)``, n outwards.

    Exact: the wall is the circle itself, not a polygon.
    """
    distance = math.sqrt(px * px + py * py)
    if distance < 1e-12 * radius:
        return radius, 1.0, 0.0
    return radius - distance, px / distance, py / distance
