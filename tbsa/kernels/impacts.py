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

from tbsa.kernels.contacts import (
    AN0,
    AN1,
    AT,
    BASE,
    BLOCK,
    BN0,
    BN1,
    BODIES,
    BT,
    COLOURS,
    COUNT,
    GAP0,
    GAP1,
    HIT,
    ID0,
    K00,
    K01,
    K11,
    KTT,
    LANES,
    MU,
    NEVER,
    NX,
    NY,
    PN0,
    PN1,
    PT,
    VN0,
    VN1,
    WANT0,
    WANT1,
    E,
    Rows,
)
from tbsa.kernels.jit import U, columns, inline
from tbsa.kernels.routh import routh
from tbsa.kernels.solver import Bodies, FloorLaw, Numbers, apply_impulses, relax

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
def lone_impact(rows: Rows, block: int, lane: int, k: Numbers, im: float, ii: float,
                v: Bodies) -> bool:
    """Routh's impact at the one point of a row that hits; False where a second point would too."""
    r, body = rows.field, rows.body
    i, t = U(block) * BLOCK + U(lane), U(block) * BODIES + U(lane)
    if r[i + HIT] == 3.0:
        return False
    second, two = r[i + HIT] == 2.0, r[i + COUNT] == 2.0
    a, b, nx, ny, at, bt = (U(body[t]), U(body[t + LANES]), r[i + NX], r[i + NY], r[i + AT],
                            r[i + BT])
    an, bn, knn, vn = r[i + AN0], r[i + BN0], r[i + K00], r[i + VN0]
    gap_other, vn_other = r[i + GAP1], r[i + VN1]
    if second:
        an, bn, knn, vn = r[i + AN1], r[i + BN1], r[i + K11], vn_other
        gap_other, vn_other = r[i + GAP0], r[i + VN0]
    vx, vy, w = v.vx, v.vy, v.w
    ma, mb = v.mobile[a], v.mobile[b]
    ktt = r[i + KTT]
    if two:
        # The row's friction acts midway between its points; this impact at the one that hits.
        # An even first id says that the face is a's (see `square_square`).
        aside = 0.25 * (r[i + GAP1] - r[i + GAP0]) * (1.0 if second else -1.0)
        aside *= 1.0 if r[i + ID0] % 2.0 == 0.0 else -1.0
        at, bt = at + aside, bt + aside
        ktt = im * (ma + mb) + ii * (ma * at * at + mb * bt * bt)
    knt = ii * (ma * an * at + mb * bn * bt)
    vt = nx * (vy[b] - vy[a]) - ny * (vx[b] - vx[a]) + bt * w[b] - at * w[a]
    pn, pt = routh(vn, vt, knn, ktt, knt, r[i + MU], r[i + E])
    if two:
        an2, bn2 = (r[i + AN0], r[i + BN0]) if second else (r[i + AN1], r[i + BN1])
        vn_other += r[i + K01] * pn + ii * (ma * an2 * at + mb * bn2 * bt) * pt
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
def find_islands(rows: Rows, n: int, island: np.ndarray, mobile: np.ndarray) -> None:
    """Tiles between which an impulse has passed in this phase: the same root in `island`."""
    r, body, seen = rows.field, rows.body, rows.seen
    for i in range(n + 1):
        island[i] = i
    for block in range(rows.first[COLOURS]):
        if seen[block] <= 0:
            continue  # not solved
        o, t = U(block) * BLOCK, U(block) * BODIES
        for i in range(LANES):
            some = (r[o + PN0 + i] != 0.0) | (r[o + PN1 + i] != 0.0) | (r[o + PT + i] != 0.0)
            a, b = body[t + i], body[t + LANES + i]
            if (some | (r[o + BASE + i] != 0.0)) and mobile[a] * mobile[b] != 0.0:
                p, q = root(island, a), root(island, b)
                island[max(p, q)] = min(p, q)


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
            v: Bodies, scratch: Scratch) -> bool:
    """Impulses of everything that hits in this substep, as marked in ``hit``.

    `floor` must be the law 0: dry friction of the floor is a finite force and does nothing in
    an impact.  Returns whether rows have been used, which then have to be restored.
    """
    im, ii = 1.0 / k.mass, 1.0 / k.inertia
    r, body, hits, seen, mobile = rows.field, rows.body, rows.hits, rows.seen, v.mobile
    blocks = rows.first[COLOURS]
    island, near = scratch.island, scratch.near
    near[:] = 0
    touching = TOUCHING * k.width
    for block in range(blocks):
        o, t = U(block) * BLOCK, U(block) * BODIES
        for i in range(LANES):
            close = (r[o + HIT + i] != 0.0) | (min(r[o + GAP0 + i], r[o + GAP1 + i]) < touching)
            one = 1 if close & (r[o + COUNT + i] != 0.0) else 0
            near[U(body[t + i])] += one
            near[U(body[t + LANES + i])] += one

    together = False
    for block in range(blocks):
        seen[block] = 0
        if hits[block] == 0:
            continue
        t = U(block) * BODIES
        for i in range(LANES):
            if r[U(block) * BLOCK + HIT + i] == 0.0:
                continue
            a, b = U(body[t + i]), U(body[t + LANES + i])
            alone = (mobile[a] == 0.0 or near[a] == 1) and (mobile[b] == 0.0 or near[b] == 1)
            if not (alone and lone_impact(rows, block, i, k, im, ii, v)):
                together = True
                seen[block] = -1  # to be solved first
    if not together:
        return False
    # Compression: an inelastic contact problem; what hits closes its gap now.
    # What ten times the tolerance leaves is closed by the contact solve that follows.
    rough = 10.0 * k.tolerance
    ux, uy, uw, most = scratch.ux, scratch.uy, scratch.uw, scratch.most
    for i in range(k.n):
        ux[i], uy[i], uw[i] = v.vx[i], v.vy[i], v.w[i]
        most[i] = 0.5 * (k.mass * (ux[i] * ux[i] + uy[i] * uy[i]) + k.inertia * uw[i] * uw[i])
    for block in range(blocks):
        o = U(block) * BLOCK
        for i in range(LANES):
            hit, none = r[o + HIT + i], r[o + COUNT + i] == 0.0
            want0, want1 = max(r[o + GAP0 + i], 0.0) / k.h, max(r[o + GAP1 + i], 0.0) / k.h
            want0 = 0.0 if (hit == 1.0) | (hit == 3.0) else want0
            want1 = 0.0 if hit >= 2.0 else want1
            r[o + WANT0 + i], r[o + WANT1 + i] = NEVER if none else want0, NEVER if none else want1
            r[o + PN0 + i] = r[o + PN1 + i] = r[o + PT + i] = r[o + BASE + i] = 0.0
    relax(rows, m, k, floor, im, ii, c, s, v, rough)
    find_islands(rows, k.n, island, mobile)
    limit_energy(k, island, v, ux, uy, uw, most, scratch.energy, scratch.mixed)

    # Decompression: at least e times the normal impulse of compression comes back.
    for i in range(k.n):
        most[i] = 0.5 * (k.mass * (ux[i] * ux[i] + uy[i] * uy[i]) + k.inertia * uw[i] * uw[i])
        ux[i], uy[i], uw[i] = v.vx[i], v.vy[i], v.w[i]
    back = False
    for block in range(blocks):
        o = U(block) * BLOCK
        some = False
        for i in range(LANES):
            e, p0, p1 = r[o + E + i], r[o + PN0 + i], r[o + PN1 + i]
            p0 = e * p0 if p0 * r[o + K00 + i] > k.threshold else 0.0
            p1 = e * p1 if p1 * r[o + K11 + i] > k.threshold else 0.0
            r[o + PN0 + i], r[o + PN1 + i], r[o + PT + i] = p0, p1, 0.0
            r[o + BASE + i] = p0 + p1
            some |= p0 + p1 > 0.0
        seen[block] = -1 if some else 0
        back |= some
    if back:
        apply_impulses(rows, ii / im, v)
        for block in range(blocks):
            o = U(block) * BLOCK
            for i in range(LANES):
                r[o + PN0 + i] = r[o + PN1 + i] = 0.0
        relax(rows, m, k, floor, im, ii, c, s, v, rough)
        find_islands(rows, k.n, island, mobile)
        limit_energy(k, island, v, ux, uy, uw, most, scratch.energy, scratch.mixed)
    return True
