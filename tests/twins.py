"""Slow, readable twins of the fast kernels: plane vectors as complex numbers, every pair.

Nothing here is shared with the kernels but the rule for blunt corners.
"""

from __future__ import annotations

import cmath
import math
from itertools import combinations

import numpy as np
from scipy.optimize import brentq

from tbsa.kernels.geometry import BLUNT

EAST_FIRST = (1, 1j, -1, -1j)  # outward normals of E, N, W, S, the order of the contact ids


def dot(u, v):
    return u.real * v.real + u.imag * v.imag


def cross(u, v):
    return u.real * v.imag - u.imag * v.real


def vertices(centre, angle, width):
    """Corners of a square, counter-clockwise."""
    return [centre + cmath.rect(width * math.sqrt(0.5), angle + (0.25 + 0.5 * k) * math.pi)
            for k in range(4)]


def overlap_area(p, q):
    """Area common to two convex polygons (counter-clockwise): Sutherland and Hodgman's clip."""
    for k in range(len(q)):
        start, edge = q[k], q[(k + 1) % len(q)] - q[k]
        sides = [cross(edge, v - start) for v in p]
        clipped = []
        for i, v in enumerate(p):
            j = (i + 1) % len(p)
            if sides[i] >= 0.0:
                clipped.append(v)
            if sides[i] * sides[j] < 0.0:
                clipped.append(v + (p[j] - v) * sides[i] / (sides[i] - sides[j]))
        p = clipped
        if not p:
            return 0.0
    return 0.5 * sum(cross(p[i - 1] - p[0], p[i] - p[0]) for i in range(len(p)))


def distance(p, q):
    """Distance of two convex polygons that do not overlap: the nearest vertex and edge."""
    best = math.inf
    for points, polygon in ((p, q), (q, p)):
        for v in points:
            for k in range(len(polygon)):
                start, edge = polygon[k], polygon[(k + 1) % len(polygon)] - polygon[k]
                along = min(max(dot(v - start, edge) / abs(edge) ** 2, 0.0), 1.0)
                best = min(best, abs(v - start - along * edge))
    return best


def separations(a, angle_a, b, angle_b, width):
    """How far apart two squares are along each outward normal of either: [4 of a, 4 of b]."""
    p, q = vertices(a, angle_a, width), vertices(b, angle_b, width)
    found = []
    for own, other, angle in ((p, q, angle_a), (q, p, angle_b)):
        for normal in EAST_FIRST:
            n = cmath.rect(1.0, angle) * normal
            found.append(min(dot(v, n) for v in other) - max(dot(v, n) for v in own))
    return found


def manifold(a, angle_a, b, angle_b, width, margin):
    """Points of two squares nearer than `margin`: ``(normal, {id: (gap, place)})``.

    The face of the largest separation is the reference; the other square's edge that looks at
    it is cut off where the face ends.  `place` is the point's distance along the tangent, a
    quarter turn counter-clockwise of the normal from a to b, from the world's origin.
    The id is (edge of a, edge of b, 1 for the point further along the tangent).  There is none
    where the squares pass each other along the face with less than corners are blunt, and only
    the nearer one of an edge that is shorter than that.
    """
    apart = separations(a, angle_a, b, angle_b, width)
    k = max(range(8), key=lambda i: apart[i])
    if apart[k] > margin:
        return None, {}
    of_a = k < 4
    (own, own_angle), (other, other_angle) = ((a, angle_a), (b, angle_b))[:: 1 if of_a else -1]
    out = cmath.rect(1.0, own_angle) * EAST_FIRST[k % 4]
    facing = min(range(4), key=lambda j: dot(cmath.rect(1.0, other_angle) * EAST_FIRST[j], out))
    looks = cmath.rect(1.0, other_angle) * EAST_FIRST[facing]
    middle = other + 0.5 * width * looks
    ends = [middle + 0.5 * width * 1j * looks, middle - 0.5 * width * 1j * looks]
    normal = out if of_a else -out
    tangent = 1j * normal
    ends.sort(key=lambda v: dot(v, tangent))
    low = dot(own, tangent) - 0.5 * width
    u0, u1 = (dot(v, tangent) for v in ends)
    w0, w1 = max(u0, low), min(u1, low + width)
    reach = 0.5 * width + max(dot(v - other, tangent) for v in vertices(other, other_angle, width))
    if reach - abs(dot(other - own, tangent)) < BLUNT * width or w1 < w0:
        return normal, {}
    found = {}
    for end, w in enumerate((w0, w1)):
        point = ends[0] + (ends[1] - ends[0]) * (w - u0) / (u1 - u0)
        gap = dot(point - own, out) - 0.5 * width
        if gap <= margin:
            edges = (k % 4, facing) if of_a else (facing, k % 4)
            found[(*edges, end)] = gap, w
    if w1 - w0 < BLUNT * width and len(found) == 2:
        del found[max(found, key=lambda each: found[each][0])]
    return normal, found


def near_pairs(x, y, mobile, reach, margin):
    """Every pair (a, b), a < b, nearer than the reach and both margins, that is not held."""
    return [(a, b) for a, b in combinations(range(len(x)), 2)
            if (mobile[a] or mobile[b])
            and math.hypot(x[b] - x[a], y[b] - y[a]) < reach + margin[a] + margin[b]]


def all_magnet_forces(x, y, angle, glues, law, pair_force):
    """Forces and torques on every tile: `pair_force` over all pairs."""
    forces = [[0.0, 0.0, 0.0] for _ in x]
    for a, b in combinations(range(len(x)), 2):
        fx, fy, torque_a, torque_b = pair_force((x[a], y[a], angle[a]), glues[a],
                                                (x[b], y[b], angle[b]), glues[b], law)
        for i, sign, torque in ((a, -1.0, torque_a), (b, 1.0, torque_b)):
            forces[i][0] += sign * fx
            forces[i][1] += sign * fy
            forces[i][2] += torque
    return forces


def wall_points(x, y, angle, width, margin, radius=None, half=None):
    """Corners of one square nearer than `margin` to a circle or a rectangle (half sides).

    Returns [(id, gap, normal, corner from the centre)] with id = 2 corner + side; corners are
    counter-clockwise from that between E and N, side 0 is a wall x = const (or the circle).
    """
    found = []
    for k, v in enumerate(vertices(0j, angle, width)):
        p = complex(x, y) + v
        if radius is not None:
            walls = [(radius - abs(p), p / abs(p))]
        else:
            walls = [(half[0] - abs(p.real), complex(math.copysign(1.0, p.real), 0.0)),
                     (half[1] - abs(p.imag), complex(0.0, math.copysign(1.0, p.imag)))]
        found += [(2 * k + side, gap, normal, v) for side, (gap, normal) in enumerate(walls)
                  if gap <= margin]
    return found




def ellipsoid_impulse(start, trial, mass, inertia, r, q):
    """The floor's impulse under coupled friction, its bounds r (N s) and q (N m s).

    What stops the tile, if that is within the ellipsoid; else minus what stops the mean of the
    twists; else on the ellipsoid, along its normal at minus the mean twist: the multiplier by
    bisection.
    """
    m, bound = np.array([mass, mass, inertia]), np.array([r, r, q])
    for impulse in (-m * trial, -m * (start + trial)):
        if np.sum((impulse / bound) ** 2) <= 1.0:
            return impulse
    b = bound * (start + trial)

    def beyond(k):
        return np.linalg.norm(b / (bound**2 / m + k)) - 1.0

    k = brentq(beyond, 0.0, np.linalg.norm(b), xtol=1e-300, rtol=1e-15)
    return -bound * b / (bound**2 / m + k)
