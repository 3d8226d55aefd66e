"""Slow, readable twin of tbsa.work.metrics: every pair of tiles, complex numbers, sets.

Only the tolerances and the ground truth are shared with the original.
"""

from __future__ import annotations

import cmath
import math
from itertools import combinations, product

from tbsa.model.tiles import STEPS, attracts, ground_truth, rotated
from tbsa.work.metrics import ALIGNED, CLOSE, ON_SITE, ON_TURN, TOUCHING

NORMALS = (1j, 1, -1j, -1)  # N, E, S, W


def twin(scene, layout, x, y, angle):
    """The row of ``Assembly.row`` and the sets behind it, by brute force."""
    width = scene.material.width
    tiles = range(len(x))
    z = [complex(a, b) / width for a, b in zip(x, y, strict=True)]  # in tile widths
    turn = [cmath.exp(1j * a) for a in angle]
    kind = [scene.types[k] for k in layout.type]
    seed = {i for i in tiles if layout.seed[i]}

    facing = []
    for i, j in combinations(tiles, 2):
        if abs(z[i] - z[j]) < 2:
            for e, f in product(range(4), repeat=2):
                out_i, out_j = turn[i] * NORMALS[e], turn[j] * NORMALS[f]
                near = abs(z[i] + out_i / 2 - z[j] - out_j / 2) <= CLOSE
                if near and abs(cmath.phase(-out_i / out_j)) <= ALIGNED:
                    facing.append((i, e, j, f))
    bonds = [(i, e, j, f) for i, e, j, f in facing
             if attracts(kind[i].glues[e], kind[j].glues[f])]
    contacts = [(i, j) for i, j in combinations(tiles, 2) if abs(z[i] - z[j]) < 2
                and square_distance(z[i], turn[i], z[j], turn[j]) <= TOUCHING]

    bonded = [(i, j) for i, _, j, _ in bonds]
    attached = reach(seed, bonded) - seed
    touching = reach(seed, contacts) - seed
    member = attached | seed
    loose = set(tiles) - reach(seed, bonded)
    largest = max((len(reach({i}, bonded)) for i in loose), default=0)
    clashing = {t for i, e, j, f in facing if i in member and j in member
                and kind[i].glues[e] and kind[j].glues[f]
                and not attracts(kind[i].glues[e], kind[j].glues[f]) for t in (i, j)}
    mismatched = clashing & attached

    on, wrong, turned, outside, holes, directed = set(), set(), set(), set(), set(), True
    if scene.seed is not None:
        truth = ground_truth(scene)
        directed = truth.directed
        frame = cmath.exp(-1j * scene.seed.angle)
        origin = complex(*scene.seed.centre) / width
        taken = {(c, r) for c, r, _ in scene.seed.cells}
        for i in attached:
            place = (z[i] - origin) * frame
            site = (round(place.real), round(place.imag))
            quarters = cmath.phase(turn[i] * frame) / (math.pi / 2)
            askew = abs(quarters - round(quarters)) * math.pi / 2
            if abs(place - complex(*site)) > ON_SITE or askew > ON_TURN:
                continue
            on.add(i)
            taken.add(site)
            if rotated(kind[i].glues, round(quarters)) != kind[i].glues:
                turned.add(i)
            if directed and site not in truth.types:
                outside.add(i)
            elif directed and scene.types[truth.types[site]].colour != kind[i].colour:
                wrong.add(i)
        for c, r in taken:
            for dc, dr in STEPS:
                cell = (c + dc, r + dr)
                around = {(cell[0] + a, cell[1] + b) for a, b in STEPS}
                if cell not in taken and around <= taken:
                    holes.add(cell)

    errors = wrong if directed else mismatched
    outer = [(i, j) for i, j in bonded if not {i, j} <= seed]
    row = {
        "size": len(attached),
        "total": len(member),
        "errors": len(errors),
        "errors_percent": percent(errors, attached),
        "holes": len(holes),
        "holes_percent": percent(holes, attached),
        "wrong_colour": len(wrong) if directed else math.nan,
        "wrongly_turned": len(turned),
        "off_lattice": len(attached - on),
        "outside": len(outside) if directed else math.nan,
        "mismatched": len(mismatched),
        "size_contact": len(touching),
        "largest_free_cluster": largest,
        "bonds": len(outer),
        "bonds_assembly": len([pair for pair in outer if set(pair) <= member]),
        "directed": directed,
    }
    return row, {"attached": attached, "touching": touching, "erroneous": errors,
                 "on_lattice": on, "wrongly_turned": turned, "mismatched": mismatched,
                 "outside": outside}, holes


def percent(part, whole):
    return 100 * len(part) / len(whole) if whole else math.nan


def reach(start, pairs):
    """Everything that chains of pairs lead to, the start among it."""
    beside = {}
    for i, j in pairs:
        beside.setdefault(i, []).append(j)
        beside.setdefault(j, []).append(i)
    found, queue = set(start), list(start)
    while queue:
        for j in beside.get(queue.pop(), ()):
            if j not in found:
                found.add(j)
                queue.append(j)
    return found


def square_distance(za, ta, zb, tb):
    """Distance of two unit squares; 0 where they overlap."""
    corners = [[z + t * c / 2 for c in (1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j)]
               for z, t in ((za, ta), (zb, tb))]
    for z, t, others in ((za, ta, corners[1]), (zb, tb, corners[0])):
        for corner in others:
            seen = (corner - z) / t
            if max(abs(seen.real), abs(seen.imag)) <= 0.5:
                return 0.0
    sides = [list(zip(c, c[1:] + c[:1], strict=True)) for c in corners]
    return min(segment_distance(*p, *q) for p in sides[0] for q in sides[1])


def segment_distance(a, b, c, d):
    """Distance of two segments; 0 where they cross."""
    def side(p, q, r):
        return ((q - p).conjugate() * (r - p)).imag

    def point(p, q, r):
        along = ((r - p) / (q - p)).real
        return abs(r - p - min(max(along, 0.0), 1.0) * (q - p))

    if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
        return 0.0
    return min(point(a, b, c), point(a, b, d), point(c, d, a), point(c, d, b))
