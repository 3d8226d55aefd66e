r"""Dry friction between one tile and the floor, as an impulse over one substep.

The impulse p = (px, py, pt) lies in a convex limit set.  A tile whose stopping impulse lies
inside it stops.  Any other slides, with the impulse of maximum dissipation for its *mean* twist
(start + end)/2, the end including the impulse: second order in the substep while it slides.
With M = diag(m, m, I) and s = start + trial, trial being the end without the impulse,

    p = argmin  1/2 (p + M s)^T M^-1 (p + M s)   over the limit set,

so that the mean twist (s + M^-1 p)/2 is minus a normal of the set at p, and friction does no
work on it.  A tile without contacts that turns round in the substep has no such mean: the substep
is cut where it is slowest, and both parts have theirs (`impulse_of_turn`).  Limit sets, for bounds
R = F_max h and Q = T_max h:

- ``SEPARATE``: |(px, py)| <= R and |pt| <= Q, each of which stops or slides by itself; the spin,
  in one dimension, exactly (`interval`);
- ``COUPLED``: the ellipsoid (px^2 + py^2)/R^2 + pt^2/Q^2 <= 1 (Howe and Cutkosky, "Practical
  force-motion models for sliding manipulation", Int. J. Robotics Research 15, 1996);
- ``EXACT``: the set of a square under uniform pressure (Goyal, Ruina and Papadopoulos, "Planar
  sliding with dry friction", Wear 143, 1991), in closed form.  Its width is Q/(R TORQUE).

Bounds are finite and not negative.  Those of ``SEPARATE`` may be zero; the others' are those of a
square, R > 0 and Q = TORQUE R width.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.jit import apart, inline, lane

NONE, SEPARATE, COUPLED, EXACT = 0, 1, 2, 3

# T_max/(F_max w) of a square under uniform pressure: the mean distance from its centre.
TORQUE = (math.sqrt(2.0) + math.asinh(1.0)) / 6.0

# Below this part of what friction takes in a substep a speed has no direction; see `friction_of`.
SLOW = 0.1

# The exact set lies between these multiples of the ellipsoid with the same axes (0.9337, 1).
INNER, OUTER = 0.93, 1.001
# Beyond this distance of the centre of rotation, in widths, two terms of the expansion in its
# inverse are as good as the closed form, which loses digits there: 1e-8 of F_max w in torque.
FAR = 256.0
# The exact law's Newton steps end at this residual (in F_max and F_max w, or relative to the
# impulse where that is larger), after ten of them at 100 times as much, or at this number of them;
# 3 to 5 are usual.
RESIDUAL = 1e-11
STEPS = 40


class FloorLaw(NamedTuple):
    """Numbers of the floor; `law` 0 where the scene has no floor friction."""

    law: int  # 1 separate, 2 coupled, 3 exact; see the module's text
    force: float  # N, F_max
    torque: float  # N m, T_max


@lane
def floor_impulse(law: int, v0x: float, v0y: float, w0: float, vx: float, vy: float, w: float,
                  m: float, inertia: float, R: float, Q: float, cos: float, sin: float) -> Any:
    """Impulse ``(px, py, pt)`` of the floor on one tile (N s, N s, N m s; world axes), and whether
    it stops and stops turning.

    `v0x`, `v0y`, `w0` is the twist at the start of the substep, `vx`, `vy`, `w` at its end
    without the impulse; `law` is no variable where loops are to become vector code.  A tile that
    stops gets exactly ``-m * vx, -m * vy``, one that stops turning ``-inertia * w``.
    """
    if law == SEPARATE:
        px, py, stops = disc(v0x, v0y, vx, vy, m, R)
        pt, halts = interval(w0, w, inertia, Q)
    elif law == COUPLED:
        px, py, pt, stops = ellipsoid(v0x, v0y, w0, vx, vy, w, m, inertia, R, Q)
        halts = stops
    else:
        px, py, pt = _exact(v0x + vx, v0y + vy, w0 + w, vx, vy, w, m, inertia, R, Q, cos, sin)
        stops, halts = (px == -m * vx) & (py == -m * vy), pt == -inertia * w
    return px, py, pt, stops, halts


@lane
def turns(law: int, v0x: float, v0y: float, w0: float, vx: float, vy: float, w: float, m: float,
          inertia: float, R: float, Q: float, stops: bool) -> bool:
    """Whether a tile may turn round in a substep, arguments as in :func:`floor_impulse`: it ends
    the other way, or stops though what acts on it is more than friction bears."""
    bx, by, bw = vx - v0x, vy - v0y, w - w0
    if law == SEPARATE:
        return (v0x * vx + v0y * vy < 0.0) | (
            stops & (v0x * v0x + v0y * v0y > 0.0) & (m * m * (bx * bx + by * by) > R * R))
    r2, q2 = m * m / (R * R), inertia * inertia / (Q * Q)
    return (m * (v0x * vx + v0y * vy) + inertia * w0 * w < 0.0) | (
        stops & (v0x * v0x + v0y * v0y + w0 * w0 > 0.0)
        & (r2 * (bx * bx + by * by) + q2 * bw * bw > (INNER * INNER if law == EXACT else 1.0)))


@inline
def impulse_of_turn(law: int, v0x: float, v0y: float, w0: float, vx: float, vy: float, w: float,
                    m: float, inertia: float, R: float, Q: float, cos: float, sin: float) -> Any:
    """As :func:`floor_impulse`, of a tile that may turn round: in two parts, up to where it is
    slowest, if it goes on as it begins, and from there.  Exact on a line, for constant forces."""
    bx, by, bw = vx - v0x, vy - v0y, w - w0
    px, py, pt = friction_of(law, v0x, v0y, w0, m, inertia, R, Q, cos, sin)
    ax, ay, aw = bx + px / m, by + py / m, bw + pt / inertia
    r2 = 0.0 if law == SEPARATE else inertia / m
    towards = v0x * ax + v0y * ay + r2 * w0 * aw
    one = min(max(-towards / max(ax * ax + ay * ay + r2 * aw * aw, 1e-300), 0.0), 1.0)
    two = 1.0 - one
    ux, uy, uw = v0x, v0y, w0
    if one > 0.0:
        px, py, pt, _, _ = floor_impulse(law, v0x, v0y, w0, v0x + one * bx, v0y + one * by,
                                         w0 + one * bw, m, inertia, one * R, one * Q, cos, sin)
        ux, uy, uw = v0x + one * bx + px / m, v0y + one * by + py / m, w0 + one * bw + pt / inertia
    stops = halts = False
    if two > 0.0:
        tx, ty, tw = ux + two * bx, uy + two * by, uw + two * bw
        px, py, pt, stops, halts = floor_impulse(law, ux, uy, uw, tx, ty, tw, m, inertia, two * R,
                                                 two * Q, cos, sin)
        ux, uy, uw = tx + px / m, ty + py / m, tw + pt / inertia
    ux, uy = (0.0 if stops else ux), (0.0 if stops else uy)
    px, py, pt = m * (ux - vx), m * (uy - vy), inertia * ((0.0 if halts else uw) - w)
    if law == SEPARATE:  # turning and going are two things
        pt, halts = interval(w0, w, inertia, Q)
    return px, py, pt, stops, halts


@lane
def disc(v0x: float, v0y: float, vx: float, vy: float, m: float, R: float) -> Any:
    """The law for a disc of radius `R`, without branches; and whether the tile stops."""
    speed2 = vx * vx + vy * vy
    stops = m * m * speed2 <= R * R
    sx, sy = v0x + vx, v0y + vy
    s2 = sx * sx + sy * sy
    scale = m if m * m * s2 <= R * R else R / math.sqrt(s2)  # m: the mean velocity is zero
    return (-m * vx if stops else -scale * sx), (-m * vy if stops else -scale * sy), stops


@lane
def interval(v0: float, v: float, m: float, R: float) -> Any:
    """The law in one dimension, exactly, for other forces that are constant in the substep.

    The tile slides to a stop, stays there if the other forces are within the bound, and otherwise
    sets off the other way.  Returns the impulse, and whether the tile is at rest at the end.
    """
    way = 1.0 if (v0 > 0.0) | ((v0 == 0.0) & (v > 0.0)) else -1.0
    start, other = m * abs(v0), way * m * (v - v0)  # impulses, along the way of the start
    left = start + other - R
    halts = (left <= 0.0) & (other >= -R)
    time = start / max(R - other, 1e-300)  # share of the substep until it stops
    impulse = -way * R if left > 0.0 else way * R * (1.0 - 2.0 * time)  # there, and back
    return (-m * v if halts else impulse), halts


@lane
def ellipsoid(v0x: float, v0y: float, w0: float, vx: float, vy: float, w: float, m: float,
              inertia: float, R: float, Q: float) -> Any:
    """The law `COUPLED` for a square, without branches; and whether the tile stops."""
    A, B = R * R / m, Q * Q / inertia
    stops = (vx * vx + vy * vy) * (m / A) + w * w * (inertia / B) <= 1.0
    px, py, pt = projected(v0x + vx, v0y + vy, w0 + w, m, inertia, R, Q)
    return (-m * vx if stops else px, -m * vy if stops else py, -inertia * w if stops else pt,
            stops)


@lane
def projected(sx: float, sy: float, sw: float, m: float, inertia: float, R: float,
              Q: float) -> Any:
    """Minus the projection of M s onto the ellipsoid, in the metric of M^-1, without branches.

    With a multiplier k, p = -(R^2 s_x/(A + k), R^2 s_y/(A + k), Q^2 s_w/(B + k)), A = R^2/m,
    B = Q^2/I, and k solves f(k) = (R |s|/(A + k))^2 + (Q s_w/(B + k))^2 = 1.  1/sqrt(f) is
    concave and nearly straight, so Newton steps on it rise to the root from a lower bound.  For
    Q = TORQUE R width > 0, a square's, B is 0.88 A, and four of them lead as far as numbers go.
    """
    A, B = R * R / m, Q * Q / inertia
    s2 = sx * sx + sy * sy
    rests = s2 * (m / A) + sw * sw * (inertia / B) <= 1.0
    a, b = R * math.sqrt(s2), Q * abs(sw)
    k = max(max(a - A, b - B), math.sqrt(a * a + b * b) - max(A, B))
    for _ in range(4):
        over_a, over_b = 1.0 / (A + k), 1.0 / (B + k)
        u, t = a * over_a, b * over_b
        f = u * u + t * t
        k += f * (math.sqrt(f) - 1.0) / (u * u * over_a + t * t * over_b)
    linear = m if rests else R * R / (A + k)
    angular = inertia if rests else Q * Q / (B + k)
    return -linear * sx, -linear * sy, -angular * sw


@inline
def friction_of(law: int, vx: float, vy: float, w: float, m: float, inertia: float, R: float,
                Q: float, cos: float, sin: float) -> Any:
    """Impulse ``(px, py, pt)`` of the floor on a tile that slides on with this twist (N s, N s,
    N m s; world axes): minus the gradient of its dissipation.

    It is in proportion to what is slower than a part (SLOW) of what it can take away: the direction
    of a tile that is all but at rest is made of rounding.
    """
    v2 = vx * vx + vy * vy
    if law == SEPARATE:
        linear = R / max(math.sqrt(v2), max(SLOW * R / m, 1e-300))
        angular = Q / max(abs(w), max(SLOW * Q / inertia, 1e-300))
        return -linear * vx, -linear * vy, -angular * w
    arm = Q / R
    size = math.sqrt(v2 + arm * arm * w * w)
    if law == COUPLED:
        linear = R / max(size, SLOW * R / m)
        return -linear * vx, -linear * vy, -linear * arm * arm * w
    if size == 0.0:
        return 0.0, 0.0, 0.0
    width = arm / TORQUE
    _, hx, hy, hw, _, _, _, _, _, _ = square_friction(
        cos * vx + sin * vy, cos * vy - sin * vx, width * w)
    bound = R * min(size / (SLOW * R / m), 1.0)
    return -bound * (cos * hx - sin * hy), -bound * (sin * hx + cos * hy), -bound * width * hw


@inline
def square_friction(vx: float, vy: float, w: float) -> Any:
    """Dissipation H of the twist of a unit square, its gradient and its second derivatives.

    H is the mean of |V| over the square, V = (vx - w y, vy + w x); the friction impulse is
    minus its gradient.  In units of F_max and the width, axes of the square; not at rest.
    Returns ``(H, Hx, Hy, Hw, Hxx, Hxy, Hyy, Hxw, Hyw, Hww)``.

    With u = r - c from the centre of rotation c = (-vy, vx)/w, H = |w| times the integral of |u|,
    and every integral needed is one over an edge: of |u| (E) or of 1/|u| (L).
    """
    v = math.sqrt(vx * vx + vy * vy)
    if v > FAR * abs(w):
        tx, ty, e = vx / v, vy / v, w / v
        d = e * e / 24.0
        along = (2.0 * d) / v
        across = (1.0 - d) / v
        return (v * (1.0 + d), tx * (1.0 - d), ty * (1.0 - d), e / 12.0,
                along * tx * tx + across * ty * ty, (along - across) * tx * ty,
                along * ty * ty + across * tx * tx,
                -tx * e / (12.0 * v), -ty * e / (12.0 * v), 1.0 / (12.0 * v))
    cx, cy = -vy / w, vx / w
    x0, x1, y0, y1 = -0.5 - cx, 0.5 - cx, -0.5 - cy, 0.5 - cy
    r00, r10 = math.sqrt(x0 * x0 + y0 * y0), math.sqrt(x1 * x1 + y0 * y0)
    r01, r11 = math.sqrt(x0 * x0 + y1 * y1), math.sqrt(x1 * x1 + y1 * y1)
    L_w, E_w = _edge(x0, y0, y1, r00, r01)
    L_e, E_e = _edge(x1, y0, y1, r10, r11)
    L_s, E_s = _edge(y0, x0, x1, r00, r10)
    L_n, E_n = _edge(y1, x0, x1, r01, r11)
    X, Y = E_e - E_w, E_n - E_s  # integral of u/|u|
    arm = (0.5 * (E_e + E_w + E_n + E_s) + 2.0 * (cx * X + cy * Y)) / 3.0  # of r . u/|u|
    # Integral of u u/|u|^3.
    nxx, nyy, nxy = y1 * L_n - y0 * L_s, x1 * L_e - x0 * L_w, r10 + r01 - r11 - r00
    a = abs(w)
    hx, hy, hw = -Y, X, arm
    if w < 0.0:
        hx, hy, hw = Y, -X, -arm
    bx, by = cx * nxy - cy * nxx, cx * nyy - cy * nxy
    return (vx * hx + vy * hy + w * hw, hx, hy, hw, nxx / a, nxy / a, nyy / a,
            bx / a, by / a, (cx * by - cy * bx) / a)


@inline
def _edge(d: float, s0: float, s1: float, r0: float, r1: float) -> Any:
    """Integrals of 1/|u| and |u| along an edge at distance d, from s0 to s1."""
    if abs(d) < 1e-100:
        L = 0.0  # infinite where the edge passes the centre, but always multiplied by d
    elif s0 >= 0.0:
        L = math.log((s1 + r1) / (s0 + r0))
    elif s1 <= 0.0:
        L = math.log((r0 - s0) / (r1 - s1))
    else:
        L = math.log((s1 + r1) * (r0 - s0) / (d * d))
    return L, 0.5 * (s1 * r1 - s0 * r0 + d * d * L)


@inline
def _normal(bx: float, by: float, bw: float, m: float, inertia: float, nx: float, ny: float,
            nw: float, only_whether: bool) -> Any:
    """Where an impulse b lies against the exact set: ``(k, Hx, Hy, Hw, steps)``.

    Newton's method for b = k M n + grad H(n), from the direction (nx, ny, nw): for k > 0, b lies
    outside, k n is the twist that its friction opposes and grad H(n) its nearest point of the
    set; otherwise b lies inside.  This maximises (n . b - H(n))/|n| with |n|^2 = n . M n.
    With `only_whether`, k > 0 is returned as soon as some n separates b from the set.  Units as
    in :func:`square_friction`; `steps` is STEPS + 1 where the residual has not gone.
    """
    size = math.sqrt(nx * nx + ny * ny + nw * nw)
    nx, ny, nw = nx / size, ny / size, nw / size
    enough = RESIDUAL * max(1.0, max(abs(bx), max(abs(by), abs(bw))))
    ox, oy, ow, best = nx, ny, nw, -math.inf
    dx = dy = dw = 0.0
    k = hx = hy = hw = 0.0
    for steps in range(1, STEPS + 1):
        H, hx, hy, hw, hxx, hxy, hyy, hxw, hyw, hww = square_friction(nx, ny, nw)
        qx, qy, qw = m * nx, m * ny, inertia * nw
        nn = nx * qx + ny * qy + nw * qw
        k = (nx * bx + ny * by + nw * bw - H) / nn
        if only_whether and k > 0.0:
            return k, hx, hy, hw, steps
        gx, gy, gw = bx - hx - k * qx, by - hy - k * qy, bw - hw - k * qw
        residual = max(abs(gx), max(abs(gy), abs(gw)))
        if residual <= (enough if steps <= 10 else 100.0 * enough):  # rounding may leave more
            return k, hx, hy, hw, steps
        value = k * math.sqrt(nn)
        if value < best - 100.0 * RESIDUAL * (1.0 + abs(best)):  # overshot: back, and half the step
            dx, dy, dw = 0.5 * dx, 0.5 * dy, 0.5 * dw
        else:
            best, ox, oy, ow = value, nx, ny, nw
            # (k M + H'' + M n n M/|M n|^2) d = g, positive definite; d is M-orthogonal to n.
            c, t = max(k, 0.0), 1.0 / (qx * qx + qy * qy + qw * qw)
            a11, a21, a31 = hxx + c * m + t * qx * qx, hxy + t * qx * qy, hxw + t * qx * qw
            a22, a32 = hyy + c * m + t * qy * qy, hyw + t * qy * qw
            a33 = hww + c * inertia + t * qw * qw
            l21, l31 = a21 / a11, a31 / a11
            d2, e32 = a22 - l21 * a21, a32 - l31 * a21
            l32 = e32 / d2
            d3 = a33 - l31 * a31 - l32 * e32
            dx, dy = gx, gy - l21 * gx
            dw = (gw - l31 * dx - l32 * dy) / d3
            dy = dy / d2 - l32 * dw
            dx = dx / a11 - l21 * dy - l31 * dw
        nx, ny, nw = ox + dx, oy + dy, ow + dw
        size = math.sqrt(nx * nx + ny * ny + nw * nw)
        nx, ny, nw = nx / size, ny / size, nw / size
    return k, hx, hy, hw, STEPS + 1


@inline
def _inside(bx: float, by: float, bw: float) -> bool:
    """Whether an impulse lies inside the exact set; units as in :func:`square_friction`."""
    g = bx * bx + by * by + bw * bw / (TORQUE * TORQUE)  # 1 on the ellipsoid
    if g <= INNER * INNER:
        return True
    if g > OUTER * OUTER:
        return False
    arm2 = TORQUE * TORQUE  # any metric will do: the ellipsoid's
    return bool(_normal(bx, by, bw, 1.0, arm2, bx, by, bw / arm2, np.bool_(True))[0] <= 0.0)


@apart
def _exact(sx: float, sy: float, sw: float, vx: float, vy: float, w: float, m: float,
           inertia: float, R: float, Q: float, cos: float, sin: float) -> Any:
    """The law for the exact set, from the doubled mean twist s and the trial twist."""
    stop = -m * vx, -m * vy, -inertia * w
    if stop[0] == 0.0 and stop[1] == 0.0 and stop[2] == 0.0:
        return stop
    # Units: impulses in R and R * width, twists in m/s and m/s / width, axes of the tile.
    width = Q / (R * TORQUE)
    m1, i1 = m / R, inertia / (R * width * width)
    bx, by, bw = m1 * (cos * vx + sin * vy), m1 * (cos * vy - sin * vx), i1 * (width * w)
    if _inside(bx, by, bw):
        return stop

    sx, sy, sw = cos * sx + sin * sy, cos * sy - sin * sx, width * sw
    bx, by, bw = m1 * sx, m1 * sy, i1 * sw
    hx, hy, hw = bx, by, bw
    if not _inside(bx, by, bw):  # otherwise the mean twist is zero
        ex, ey, ew = projected(sx, sy, sw, m1, i1, 1.0, TORQUE)
        nx, ny, nw = sx + ex / m1, sy + ey / m1, sw + ew / i1
        if abs(nx) + abs(ny) + abs(nw) <= 1e-9 * (abs(sx) + abs(sy) + abs(sw)):
            nx, ny, nw = bx, by, bw / (TORQUE * TORQUE)
        _, hx, hy, hw, steps = _normal(bx, by, bw, m1, i1, nx, ny, nw, np.bool_(False))
        if steps > STEPS:
            # Not converged: an impulse on the set's surface, shortened until it does no work.
            work = hx * sx + hy * sy + hw * sw
            part = min(1.0, max(0.0, work / ((hx * hx + hy * hy) / m1 + hw * hw / i1)))
            hx, hy, hw = part * hx, part * hy, part * hw
    return -R * (cos * hx - sin * hy), -R * (sin * hx + cos * hy), -R * width * hw
