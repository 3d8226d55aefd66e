"""Impacts: Poisson's law with Coulomb friction in both phases.

A point that hits alone (its bodies touch nothing else) is solved exactly by Routh's process.
Points that hit together, and what touches their bodies, are solved in two phases (Pfeiffer and
Glocker, "Multibody dynamics with unilateral contacts", 1996): compression, an inelastic contact
problem with friction; then decompression, in which every point gives back at least e times its
normal impulse of compression, with friction of its own bound mu times its own impulse.  Such a
pair of problems may gain energy where friction couples points; the decompression of an island
is then shortened until its kinetic energy does not rise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tbsa.kernels.contacts import Rows
from tbsa.kernels.jit import columns, inline
from tbsa.kernels.routh import routh
from tbsa.kernels.solver import (
    Bodies,
    FloorLaw,
    Numbers,
    apply_impulses,
    approach,
    relax,
)

# Points nearer than this fraction of the width take part in an impact of their tiles.
TOUCHING = 1e-3


class Scratch(NamedTuple):
    """Scratch of the impacts, one entry a body."""

    island: np.ndarray  # int64, union-find over touching tiles
    near: np.ndarray  # int64, touching manifolds of a body
    ux: np.ndarray  # velocities before a phase
    uy: np.ndarray
    uw: np.ndarray
    most: np.ndarray  # J, energy that an island may have
    energy: np.ndarray
    mixed: np.ndarray


def empty_scratch(n: int) -> Scratch:
    """Scratch of `n` tiles and the ground."""
    whole = {"island", "near"}
    return Scratch(*columns(n + 1, [int if f in whole else float for f in Scratch._fields]))


@inline
def root(parent: np.ndarray, i: int) -> int:
    """Representative of a tile's island."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inline
def lone_impact(rows: Rows, i: int, k: Numbers, im: float, ii: float, v: Bodies) -> bool:
    """Routh's impact at the one point of row i that hits; False where a second point would too."""
    second = rows.seen[i] == 2
    if rows.seen[i] == 3:
        return False
    a, b, nx, ny, at, bt = (rows.a[i], rows.b[i], rows.nx[i], rows.ny[i], rows.at[i],
                            rows.bt[i])
    an, bn, knn, vn = rows.an0[i], rows.bn0[i], rows.k00[i], rows.vn0[i]
    gap_other, vn_other = rows.gap1[i], rows.vn1[i]
    if second:
        an, bn, knn, vn = rows.an1[i], rows.bn1[i], rows.k11[i], vn_other
        gap_other, vn_other = rows.gap0[i], rows.vn0[i]
    vx, vy, w = v.vx, v.vy, v.w
    ma, mb = v.mobile[a], v.mobile[b]
    ktt = rows.ktt[i]
    if rows.points[i] == 2:
        # The row's friction acts midway between its points; this impact at the one that hits.
        # An even first id says that the face is a's (see `square_square`).
        aside = 0.25 * (rows.gap1[i] - rows.gap0[i]) * (1.0 if second else -1.0)
        aside *= 1.0 if rows.id0[i] % 2 == 0 else -1.0
        at, bt = at + aside, bt + aside
        ktt = im * (ma + mb) + ii * (ma * at * at + mb * bt * bt)
    knt = ii * (ma * an * at + mb * bn * bt)
    vt = nx * (vy[b] - vy[a]) - ny * (vx[b] - vx[a]) + bt * w[b] - at * w[a]
    wall = b == k.n
    pn, pt = routh(vn, vt, knn, ktt, knt, k.mu_wall if wall else k.mu,
                   k.e_wall if wall else k.e)
    if rows.points[i] == 2:
        an2, bn2 = (rows.an0[i], rows.bn0[i]) if second else (rows.an1[i], rows.bn1[i])
        vn_other += rows.k01[i] * pn + ii * (ma * an2 * at + mb * bn2 * bt) * pt
        if gap_other + k.h * vn_other < 0.0:
            return False
    px, py = nx * pn - ny * pt, ny * pn + nx * pt
    vx[a] -= ma * im * px
    vy[a] -= ma * im * py
    w[a] -= ma * ii * (an * pn + at * pt)
    vx[b] += mb * im * px
    vy[b] += mb * im * py
    w[b] += mb * ii * (bn * pn + bt * pt)
    return True


@inline
def limit_energy(k: Numbers, island: np.ndarray, v: Bodies, ux: np.ndarray, uy: np.ndarray,
                 uw: np.ndarray, most: np.ndarray, energy: np.ndarray,
                 mixed: np.ndarray) -> None:
    """Draw each island's velocities back towards (ux, uy, uw) until its energy is <= `most`.

    Along that line the energy is a parabola, below `most` at the end u; impulses keep their
    place on the line, so momentum is kept and neither cone nor non-penetration is left.
    `energy`, `mixed` are scratch.
    """
    m, inertia = k.mass, k.inertia
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(k.n):
        energy[i] = mixed[i] = 0.0
    for i in range(k.n):
        dx, dy, dw = vx[i] - ux[i], vy[i] - uy[i], w[i] - uw[i]
        most[i] -= 0.5 * (m * (ux[i] * ux[i] + uy[i] * uy[i]) + inertia * uw[i] * uw[i])
        if most[i] == 0.0 and dx == 0.0 and dy == 0.0 and dw == 0.0:
            continue  # no part of any impact
        r = root(island, i)
        energy[r] += 0.5 * (m * (dx * dx + dy * dy) + inertia * dw * dw)
        mixed[r] += m * (dx * ux[i] + dy * uy[i]) + inertia * dw * uw[i]
        if r != i:
            most[r] += most[i]
            most[i] = 0.0
    for i in range(k.n):
        dx, dy, dw = vx[i] - ux[i], vy[i] - uy[i], w[i] - uw[i]
        if dx == 0.0 and dy == 0.0 and dw == 0.0:
            continue
        r = root(island, i)
        room = max(most[r], 0.0)
        if energy[r] + mixed[r] <= room:  # energy s^2 + mixed s <= room at the whole way, s = 1
            continue
        q = math.sqrt(mixed[r] * mixed[r] + 4.0 * energy[r] * room)
        step = min(max((q - mixed[r]) / (2.0 * energy[r]), 0.0), 1.0)
        vx[i], vy[i], w[i] = ux[i] + step * dx, uy[i] + step * dy, uw[i] + step * dw


@inline
def impacts(rows: Rows, m: int, k: Numbers, floor: FloorLaw, c: np.ndarray, s: np.ndarray,
            v: Bodies, scratch: Scratch) -> int:
    """Impulses of everything that hits in this substep; returns the number of points that hit.

    `floor` must be the law 0: dry friction of the floor is a finite force and does nothing in
    an impact.  The rows must be prepared; their impulses are used as scratch.
    """
    im, ii = 1.0 / k.mass, 1.0 / k.inertia
    ra, rb, gap0, gap1, count = rows.a, rows.b, rows.gap0, rows.gap1, rows.points
    vn0, vn1, hit, want0, want1 = rows.vn0, rows.vn1, rows.seen, rows.want0, rows.want1
    pn0, pn1, k00, k11, mobile = rows.pn0, rows.pn1, rows.k00, rows.k11, v.mobile
    # What closes within the substep, faster than the threshold: bit 1 and 2 for the two points.
    approach(rows, m, v)
    struck = 0
    for i in range(m):
        hit[i] = 0
        if vn0[i] < -k.threshold and gap0[i] + k.h * vn0[i] < 0.0:
            hit[i] = 1
            struck += 1
        if count[i] == 2 and vn1[i] < -k.threshold and gap1[i] + k.h * vn1[i] < 0.0:
            hit[i] += 2
            struck += 1
    if struck == 0:
        return 0
    island, near = scratch.island, scratch.near
    near[:] = 0
    touching = TOUCHING * k.width
    for i in range(m):
        if hit[i] != 0 or gap0[i] < touching or gap1[i] < touching:
            a, b = ra[i], rb[i]
            near[a] += 1
            near[b] += 1

    together = False
    for i in range(m):
        a, b = ra[i], rb[i]
        alone = (mobile[a] == 0.0 or near[a] == 1) and (mobile[b] == 0.0 or near[b] == 1)
        if hit[i] != 0 and not (alone and lone_impact(rows, i, k, im, ii, v)):
            together = True
    if not together:
        return struck
    for i in range(k.n + 1):
        island[i] = i
    for i in range(m):
        a, b = ra[i], rb[i]
        if mobile[a] * mobile[b] != 0.0:
            p, q = root(island, a), root(island, b)
            island[max(p, q)] = min(p, q)

    # Compression: an inelastic contact problem; what hits closes its gap now.
    # What ten times the tolerance leaves is closed by the contact solve that follows.
    rough = 10.0 * k.tolerance
    ux, uy, uw, most = scratch.ux, scratch.uy, scratch.uw, scratch.most
    for i in range(k.n):
        ux[i], uy[i], uw[i] = v.vx[i], v.vy[i], v.w[i]
        most[i] = 0.5 * (k.mass * (ux[i] * ux[i] + uy[i] * uy[i]) + k.inertia * uw[i] * uw[i])
    for i in range(m):
        want0[i] = 0.0 if hit[i] & 1 else max(gap0[i], 0.0) / k.h
        want1[i] = 0.0 if hit[i] & 2 else max(gap1[i], 0.0) / k.h
        hit[i] = -1 if hit[i] != 0 else 0  # now: rows to solve first
    pn0[:m] = 0.0
    pn1[:m] = 0.0
    rows.pt[:m] = 0.0
    rows.base[:m] = 0.0
    relax(rows, m, k, floor, im, ii, c, s, v, rough)
    limit_energy(k, island, v, ux, uy, uw, most, scratch.energy, scratch.mixed)

    # Decompression: at least e times the normal impulse of compression comes back.
    for i in range(k.n):
        most[i] = 0.5 * (k.mass * (ux[i] * ux[i] + uy[i] * uy[i]) + k.inertia * uw[i] * uw[i])
        ux[i], uy[i], uw[i] = v.vx[i], v.vy[i], v.w[i]
    base = rows.base
    back = False
    for i in range(m):
        e = k.e_wall if rb[i] == k.n else k.e
        pn0[i] = e * pn0[i] if pn0[i] * k00[i] > k.threshold else 0.0
        pn1[i] = e * pn1[i] if pn1[i] * k11[i] > k.threshold else 0.0
        base[i] = pn0[i] + pn1[i]
        hit[i] = -1 if base[i] > 0.0 else 0
        back = back or base[i] > 0.0
    rows.pt[:m] = 0.0
    if back:
        apply_impulses(rows, m, im, ii, v)
        pn0[:m] = 0.0
        pn1[:m] = 0.0
        relax(rows, m, k, floor, im, ii, c, s, v, rough)
        limit_energy(k, island, v, ux, uy, uw, most, scratch.energy, scratch.mixed)
    return struck
