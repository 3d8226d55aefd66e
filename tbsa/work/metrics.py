"""What has assembled: membership, errors and holes of the assembly that grows on the seed.

The four steps of the paper's data analysis (Section IV-E), at one instant: which tiles belong
to the seed's assembly, which of its cells are holes, how its pattern compares with the ground
truth, and which of its tiles are errors.

Two tiles are *bonded* where an edge of each is close, aligned and attracts the other; they are
in *contact* where the squares are all but touching, whatever their glues.  A scene without
magnets has no bonds.  The assembly is everything that a chain of bonds leads to from a tile of the
seed; its size by mere contact is reported beside it, because a tile that is only pressed against
the assembly is not part of it.

An *error* is an attached tile whose colour disagrees with the ground truth at its lattice site.
Wrongly turned tiles, tiles off the lattice and tiles at a site that the ground truth leaves
empty are counted beside the errors, not among them.  A tile set that is not directed has no
one ground truth; its errors are the attached tiles with a magnet that faces one of the assembly
and does not attract it, and what only a ground truth could tell is not a number.

Percentages of errors and of holes relate to ``size``, the attached tiles without the seed: the
seed is given, so it can neither grow nor err, and the paper's sizes leave it out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tbsa.errors import InputError
from tbsa.model.layout import TURNED, Layout, check
from tbsa.model.scene import EDGE_ANGLE as ANGLE_OF
from tbsa.model.scene import EDGES, Scene
from tbsa.model.squares import depth
from tbsa.model.tiles import Growth, ground_truth, look, symmetry

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

# A bonded pair rests flush: its edge midpoints coincide to the solver's slop, far below either
# tolerance, so a bond at rest is never missed.  A pair this close is as good as bonded: the
# paper's magnets still pull it with more than half their force at contact, three times the
# floor friction.  Opened about a shared corner by 0.1 rad, the midpoints are 0.05 w apart and
# the far corners 0.1 w, so the two tolerances end together; what must not count (a slip by half
# a tile, a tile jammed at some angle) lies several times outside them.
CLOSE = 0.1  # largest distance of two bonded edges' midpoints, tile widths
ALIGNED = 0.1  # largest angle between two bonded edges, rad

# Touching squares are apart, or overlap, by little more than the solver's slop, far below this.
TOUCHING = 0.02  # squares nearer than this are in contact, tile widths

# Every bond may be out by its tolerances, and a chain adds them up.  A quarter of a cell is
# half of what would make the nearest site ambiguous, and more than two bonds can explain.
ON_SITE = 0.25  # largest distance of a tile on the lattice from its site, tile widths
ON_TURN = 0.25  # largest angle of a tile on the lattice from a quarter turn, rad

FARTHEST = 1e9  # places (tile widths) up to which they are known to 1e-7 of one

EDGE_ANGLE = np.array([ANGLE_OF[edge] for edge in EDGES])  # rad, outward normals
CORNERS = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])


def number_of(count: int, what: str) -> str:
    """A count and what it counts: 1 tile, 2 tiles."""
    return f"{count} {what}{'s' * (count != 1)}"


@dataclass(frozen=True, eq=False)
class Assembly:
    """The assembly at one instant.

    Masks are bool[n] over the tiles of the layout and False for the tiles of the seed (save
    `seed` itself) and for tiles that are not attached (save `touching`).
    """

    seed: Mask  # tiles of the seed
    attached: Mask  # a chain of bonds leads to the seed
    touching: Mask  # a chain of contacts leads to the seed
    site: Ints  # [n, 2]: nearest lattice site (column, row), in the seed's frame
    on_lattice: Mask  # attached, near its site and near a quarter turn
    off_lattice: Mask  # attached, and not so
    outside: Mask  # on the lattice, where the ground truth has no tile
    wrong_colour: Mask  # on the lattice, not of the ground truth's colour
    wrongly_turned: Mask  # on the lattice, turned by more than the tile's own symmetry
    mismatched: Mask  # attached, an edge faces one of the assembly that does not attract
    bonded: Ints  # [m, 4]: tile, its edge, other tile, its edge; those within the seed left out
    hole_sites: Ints  # [h, 2]: sites without an attached tile, between four attached or seed tiles
    largest_free_cluster: int  # tiles of the largest bonded group without a seed tile
    directed: bool  # the ground truth is unique

    @property
    def erroneous(self) -> Mask:
        """bool[n]: the errors, wrong in colour or, if not `directed`, mismatched."""
        return self.wrong_colour if self.directed else self.mismatched

    @property
    def size(self) -> int:
        """Attached tiles, without the seed."""
        return int(self.attached.sum())

    @property
    def total(self) -> int:
        """Attached tiles and the seed."""
        return int((self.attached | self.seed).sum())

    @property
    def errors(self) -> int:
        """Erroneous tiles."""
        return int(self.erroneous.sum())

    @property
    def holes(self) -> int:
        """Holes of the assembly."""
        return len(self.hole_sites)

    @property
    def bonds(self) -> int:
        """Bonds of all tiles, those within the seed left out."""
        return len(self.bonded)

    @property
    def bonds_assembly(self) -> int:
        """Those of the assembly, whose tiles are attached, or of the seed."""
        return int((self.attached | self.seed)[self.bonded[:, 0]].sum())

    def percent(self, count: int) -> float:
        """A count in per cent of `size`; not a number while nothing is attached."""
        return 100.0 * count / self.size if self.size else float("nan")

    def _by_truth(self, which: Mask) -> float:
        """How many tiles; not a number where there is no one ground truth to tell."""
        return int(which.sum()) if self.directed else float("nan")

    def row(self) -> dict[str, float]:
        """The row of :func:`table`, without the time."""
        return {
            "size": self.size,
            "total": self.total,
            "errors": self.errors,
            "errors_percent": self.percent(self.errors),
            "holes": self.holes,
            "holes_percent": self.percent(self.holes),
            "wrong_colour": self._by_truth(self.wrong_colour),
            "wrongly_turned": int(self.wrongly_turned.sum()),
            "off_lattice": int(self.off_lattice.sum()),
            "outside": self._by_truth(self.outside),
            "mismatched": int(self.mismatched.sum()),
            "size_contact": int(self.touching.sum()),
            "largest_free_cluster": self.largest_free_cluster,
            "bonds": self.bonds,
            "bonds_assembly": self.bonds_assembly,
            "directed": self.directed,
        }


def truth_of(scene: Scene) -> Growth | None:
    """The ground truth, to be found once for many records; None without a seed."""
    return None if scene.seed is None else ground_truth(scene)


def assembly(
    scene: Scene, layout: Layout, x: Floats, y: Floats, angle: Floats, truth: Growth | None = None
) -> Assembly:
    """The assembly of one record, tile by tile and in total.

    Parameters
    ----------
    x, y, angle
        Positions (m) and angles (rad) of the tiles, float64[n] in the layout's order.
    truth
        :func:`truth_of` the scene, where it is at hand.  A scene without a seed has no assembly;
        its bonds and clusters are counted all the same.

    Raises
    ------
    InputError
        The arrays are not of the layout's length or not finite, or the layout is not of the scene.

    Notes
    -----
    Bonded edges: midpoints within `CLOSE`, normals opposite within `ALIGNED`, glues g and -g.
    A hole is an empty cell of the seed's lattice with four occupied neighbours (paper,
    Section IV-E); only attached tiles on the lattice and the seed occupy a cell.
    """
    x, y, angle = _record(scene, layout, x, y, angle)
    seed, types = layout.seed, scene.types
    flush, matched, repelled = _flush_edges(scene, layout, x, y, angle)
    cluster = _clusters(len(x), flush[matched][:, ::2])
    attached = _reached(cluster, seed)
    member = attached | seed
    bonded = flush[matched & ~(seed[flush[:, 0]] & seed[flush[:, 2]])]
    mismatched = np.zeros_like(seed)
    mismatched[flush[repelled & member[flush[:, 0]] & member[flush[:, 2]]][:, ::2]] = True
    mismatched &= attached

    nothing = np.zeros_like(seed)
    site = np.zeros((len(x), 2), dtype=np.int64)
    on_lattice = outside = wrong_colour = wrongly_turned = touching = nothing
    hole_sites = np.zeros((0, 2), dtype=np.int64)
    directed = True
    if scene.seed is not None:
        truth = ground_truth(scene) if truth is None else truth
        directed = truth.directed
        touching = _reached(_clusters(len(x), _contacts(scene, x, y, angle)), seed)
        site, turn, near = _sites(scene, x, y, angle)
        on_lattice = attached & near
        period = np.array([symmetry(kind) for kind in types])
        wrongly_turned = on_lattice & (turn % period[layout.type] != 0)
        hole_sites = _holes(site[on_lattice | seed])
        if directed:
            colour = _numbered([look(kind.colour) for kind in types])
            there = np.flatnonzero(on_lattice)
            wanted = [truth.types.get((c, r), -1) for c, r in site[there].tolist()]
            want = np.array(wanted, dtype=np.int64)
            outside, wrong_colour = nothing.copy(), nothing.copy()
            outside[there] = want < 0
            wrong_colour[there] = (want >= 0) & (colour[want] != colour[layout.type[there]])

    free = np.bincount(cluster[~np.isin(cluster, cluster[seed])], minlength=1)
    return Assembly(
        seed=seed,
        attached=attached,
        touching=touching,
        site=site,
        on_lattice=on_lattice,
        off_lattice=attached & ~on_lattice,
        outside=outside,
        wrong_colour=wrong_colour,
        wrongly_turned=wrongly_turned,
        mismatched=mismatched,
        bonded=bonded,
        hole_sites=hole_sites,
        largest_free_cluster=int(free.max()),
        directed=directed,
    )


def size(scene: Scene, layout: Layout, x: Floats, y: Floats, angle: Floats) -> int:
    """Number of attached tiles, without the seed; :func:`assembly` without the rest."""
    x, y, angle = _record(scene, layout, x, y, angle)
    flush, matched, _ = _flush_edges(scene, layout, x, y, angle)
    return int(_reached(_clusters(len(x), flush[matched][:, ::2]), layout.seed).sum())


COLUMNS = ("time", "size", "total", "errors", "errors_percent", "holes", "holes_percent",
           "wrong_colour", "wrongly_turned", "off_lattice", "outside", "mismatched",
           "size_contact", "largest_free_cluster", "bonds", "bonds_assembly", "directed",
           "joined", "left")  # of a table


def table(
    scene: Scene, layout: Layout, time: Floats, x: Floats, y: Floats, angle: Floats
) -> pd.DataFrame:
    """One row of :meth:`Assembly.row` a record, after its ``time``, and before its :func:`events`.

    Parameters
    ----------
    time
        Times (s), float64[k].
    x, y, angle
        Positions (m) and angles (rad), float64[k, n].

    Raises
    ------
    InputError
        The arrays do not go together.
    """
    import pandas as pd

    check(layout, scene)
    time, x, y, angle = (_numbers(each, f"table.{name}") for name, each in (
        ("time", time), ("x", x), ("y", y), ("angle", angle)))
    shape = (*time.shape, len(layout.x))
    if time.ndim != 1 or not x.shape == y.shape == angle.shape == shape:
        raise InputError(
            "must be the shapes of time, x, y and angle: [k], and [k, n] of "
            f"n = {len(layout.x)} tiles",
            field="table",
            value=(time.shape, x.shape, y.shape, angle.shape),
        )
    if not np.isfinite(time).all():
        raise InputError("must be finite numbers", field="table.time",
                         value=time[~np.isfinite(time)][0])
    truth = truth_of(scene)
    start = assembly(scene, layout, layout.x, layout.y, layout.angle, truth)
    attached = np.zeros((len(time), len(layout.x)), dtype=np.bool_)
    rows = []
    for k in range(len(time)):
        found = assembly(scene, layout, x[k], y[k], angle[k], truth)
        attached[k] = found.attached
        rows.append({"time": time[k], **found.row()})
    frame = pd.DataFrame(rows, columns=["time", *start.row()])  # named even if there are no rows
    frame["joined"], frame["left"] = events(attached)
    return frame


def events(attached: Mask) -> tuple[Ints, Ints]:
    """Tiles that have joined the assembly, and that have left it, since the record before.

    Parameters
    ----------
    attached
        Which tiles are attached at each record, bool[k, n].

    Returns
    -------
    joined, left
        int64[k] each; 0 at the first record.  What joins and leaves between two records is not
        seen, so that these are lower bounds; their difference is the change in size.
    """
    now, before = attached[1:], attached[:-1]
    joined, left = np.zeros((2, len(attached)), dtype=np.int64)
    joined[1:] = (now & ~before).sum(axis=1)
    left[1:] = (before & ~now).sum(axis=1)
    return joined, left


def _numbers(values: object, field: str) -> Floats:
    """Real numbers as a float64 array, or an InputError."""
    try:
        found = np.asarray(values)
    except ValueError:  # rows of several lengths
        found = np.asarray(None)
    if found.dtype.kind not in "fiu":
        raise InputError("must be an array of numbers", field=field, value=type(values).__name__
                         if found.dtype == object else f"one of {found.dtype}")
    return found.astype(np.float64, copy=False)


def _record(
    scene: Scene, layout: Layout, x: Floats, y: Floats, angle: Floats
) -> tuple[Floats, Floats, Floats]:
    """One record as float64 arrays, or an InputError."""
    check(layout, scene)
    x, y, angle = (_numbers(each, f"record.{name}") for name, each in (
        ("x", x), ("y", y), ("angle", angle)))
    for name, each in (("x", x), ("y", y), ("angle", angle)):
        if each.shape != layout.x.shape:
            raise InputError(
                f"must have the layout's shape {layout.x.shape}",
                field=f"record.{name}",
                value=each.shape,
            )
        if not np.isfinite(each).all():
            raise InputError("must be finite numbers", field=f"record.{name}",
                             value=float(each[~np.isfinite(each)][0]))
        most = TURNED if name == "angle" else FARTHEST * scene.material.width
        if (far := np.abs(each) > most).any():
            raise InputError(f"must be from {-most:g} to {most:g}", field=f"record.{name}",
                             value=float(each[far][0]))
    return x, y, angle


def _numbered(names: list[str]) -> Ints:
    """The same number for the same name."""
    return np.unique(names, return_inverse=True)[1].astype(np.int64)


def _flush_edges(
    scene: Scene, layout: Layout, x: Floats, y: Floats, angle: Floats
) -> tuple[Ints, Mask, Mask]:
    """Pairs of close and aligned edges, int64[m, 4] as `Assembly.bonded`.

    Beside them, bool[m] each: those that attract, and those that have magnets and do not.
    """
    width = scene.material.width
    outward = angle[:, None] + EDGE_ANGLE
    normal = np.stack([np.cos(outward), np.sin(outward)], axis=-1)
    middle = np.stack([x, y], axis=-1)[:, None] + 0.5 * width * normal
    pairs = _pairs(middle.reshape(-1, 2), CLOSE * width)
    (a, b), (edge_a, edge_b) = np.divmod(pairs.T, 4)
    # The sine of half the angle, as the cosine of a small angle loses half the digits.
    off = np.hypot(*(normal[a, edge_a] + normal[b, edge_b]).T)
    aligned = off <= 2.0 * np.sin(0.5 * ALIGNED)
    flush = np.stack([a, edge_a, b, edge_b], axis=-1)[aligned]
    flush = flush[np.lexsort(flush.T[::-1])]
    glue = np.array([kind.glues for kind in scene.types], dtype=np.int64)[layout.type]
    glue_a, glue_b = glue[flush[:, 0], flush[:, 1]], glue[flush[:, 2], flush[:, 3]]
    magnets = (glue_a != 0) & (glue_b != 0) & (scene.magnet is not None)
    attracts = magnets & (glue_a == -glue_b)  # as tiles.attracts, for arrays
    return flush, attracts, magnets & ~attracts


def _pairs(points: Floats, reach: float) -> Ints:
    """Pairs of points float64[n, 2] not further apart than `reach`, int64[m, 2]."""
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)  # built once, asked once
    return np.asarray(tree.query_pairs(reach, output_type="ndarray"), dtype=np.int64)


def _clusters(n: int, pairs: Ints) -> Ints:
    """The group of every tile, int64[n]; `pairs` of tiles, int64[m, 2]."""
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _reached(cluster: Ints, seed: Mask) -> Mask:
    """Tiles in one group with a seed tile, without the seed."""
    return np.isin(cluster, cluster[seed]) & ~seed


def _contacts(scene: Scene, x: Floats, y: Floats, angle: Floats) -> Ints:
    """Pairs of squares nearer than `TOUCHING`, int64[m, 2].

    Disjoint convex polygons are nearest at a vertex of one of them; squares overlap if none of
    the four face normals separates them (C. Ericson, Real-Time Collision Detection, 2005,
    Sections 4.4.1 and 5.1).
    """
    width = scene.material.width
    centre = np.stack([x, y], axis=-1)
    pairs = _pairs(centre, (np.sqrt(2.0) + TOUCHING) * width)
    a, b = pairs.T
    distance = np.minimum(
        _corner_distance(width, centre, angle, a, b), _corner_distance(width, centre, angle, b, a)
    )
    dx, dy = (centre[b] - centre[a]).T
    overlap = depth(width, dx, dy, angle[a], angle[b]) >= 0.0
    return pairs[overlap | (distance <= TOUCHING * width)]


def _corner_distance(width: float, centre: Floats, angle: Floats, a: Ints, b: Ints) -> Floats:
    """Distance of square b's nearest corner from square a, float64[m]."""
    cos, sin = np.cos(angle[a]), np.sin(angle[a])
    dx, dy = (centre[b] - centre[a]).T
    px, py = dx * cos + dy * sin, dy * cos - dx * sin
    cos, sin = np.cos(angle[b] - angle[a]), np.sin(angle[b] - angle[a])
    qx, qy = width * CORNERS.T[:, :, None]
    over_x = np.maximum(np.abs(px + qx * cos - qy * sin) - 0.5 * width, 0.0)
    over_y = np.maximum(np.abs(py + qx * sin + qy * cos) - 0.5 * width, 0.0)
    return np.asarray(np.hypot(over_x, over_y).min(axis=0))


def _sites(scene: Scene, x: Floats, y: Floats, angle: Floats) -> tuple[Ints, Ints, Mask]:
    """Nearest site int64[n, 2], quarter turns int64[n], near both bool[n], in the seed's frame."""
    assert scene.seed is not None
    (x0, y0), turned = scene.seed.centre, scene.seed.angle
    dx, dy = (x - x0) / scene.material.width, (y - y0) / scene.material.width
    place = np.stack(
        [
            dx * np.cos(turned) + dy * np.sin(turned),
            dy * np.cos(turned) - dx * np.sin(turned),
        ],
        axis=-1,
    )
    site, turn = np.rint(place), np.rint((angle - turned) / (0.5 * np.pi))
    near = np.hypot(*(place - site).T) <= ON_SITE
    near &= np.abs(angle - turned - turn * (0.5 * np.pi)) <= ON_TURN
    return site.astype(np.int64), turn.astype(np.int64), near


def _holes(occupied: Ints) -> Ints:
    """Empty sites between four occupied ones, int64[h, 2] in order of column and row."""
    low = occupied.min(axis=0, initial=0) - 1
    rows = int((occupied[:, 1] - low[1]).max(initial=0)) + 2
    key = np.unique((occupied[:, 0] - low[0]) * rows + occupied[:, 1] - low[1])
    beside = np.concatenate([key + 1, key - 1, key + rows, key - rows])
    cell, neighbours = np.unique(beside, return_counts=True)
    hole = cell[(neighbours == 4) & ~np.isin(cell, key)]
    column, row = np.divmod(hole, rows)
    return np.stack([column + low[0], row + low[1]], axis=-1)
