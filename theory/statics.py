"""Exact statics of an assembly of tiles on the square lattice, by linear programming.

A load can be borne if there are contact and floor forces within their bounds that balance it and
the magnets on every free tile:

- two contact points on each shared edge, with normal forces N >= 0 and Coulomb friction
  |T| <= mu (N_0 + N_1) (both points lie on one line, so that only the sum of their friction
  matters);
- a floor force within a disc and a floor torque within an interval, on each tile;
- magnet forces as they are at the lattice positions.

The loads that can be borne are a convex set.  The critical factor is the largest multiple of a
load in it: a load beyond it moves the assembly, and a load below it can be borne, if the state
without load can (:meth:`Statics.bears`; a load may also press on what the magnets would part).
Whether it is borne depends, with friction, on forces that the past has left: slip can begin
earlier, see ``theory.scaling.slip_onset``.  Friction does not associate its slip with its bound,
so that the dual of the program is a mode of an assembly that dilates as it slides; it is given as
that only.

Discs are inscribed polygons, refined where it matters, see :class:`Statics`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.optimize import linprog
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from theory.magnets import Glues, Law, force, polarity

Reals = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Site = tuple[int, int]  # column, row

CHESSBOARD: tuple[Glues, Glues] = ((1, 2, 1, 2), (-1, -2, -1, -2))  # black, white; (0, 0) black
ORIENTED: tuple[Glues, Glues] = ((2, 2, -1, -1), (1, 1, -2, -2))  # the second tile set

# Load factors in units of the forces at hand or of the floor's torque: above the first it is asked
# whether there is a bound at all, and above the second that counts as none.
LARGE, UNBOUNDED = 1e3, 1e9
MOST = 1e12  # N, of a floor's torque over half the width: what is more counts as no bound
EXACT = 1e-7  # HiGHS keeps its constraints to this
# Of the force scale: a contact that can carry more than a tenth of it still presses or sticks.
SPARE = 1e-3


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles on lattice sites.

    Attributes
    ----------
    site : int64[n, 2]
        Column and row, each site once; the width of a tile apart.
    glues : int64[n, 4]
        Labels that face N, E, S, W (of a turned tile: after its turn).
    held : bool[n]
    """

    site: Ints
    glues: Ints
    held: Mask

    def __post_init__(self) -> None:
        n = len(self.site)
        if (self.site.shape, self.glues.shape, self.held.shape) != ((n, 2), (n, 4), (n,)):
            raise ValueError("site, glues and held must be of shapes [n, 2], [n, 4] and [n]")
        if (self.held.dtype != bool or self.site.dtype.kind not in "iu"
                or self.glues.dtype.kind not in "iu"):
            raise ValueError("site and glues must be whole numbers, held true or false, not "
                             f"{self.site.dtype}, {self.glues.dtype} and {self.held.dtype}")
        if len(np.unique(self.site, axis=0)) != n:
            raise ValueError("two tiles are at one site")

    @property
    def free(self) -> Ints:
        """Numbers of the tiles that are not held."""
        return np.flatnonzero(~self.held)

    def colour(self) -> Ints:
        """0 and 1 as the fields of a chessboard, (0, 0) has 0."""
        return np.asarray(self.site.sum(axis=1) % 2)


def chessboard(free: Iterable[Site], held: Iterable[Site],
               glues: Sequence[Glues] = CHESSBOARD) -> Tiles:
    """Tiles of the chessboard's pattern: `free` sites, then `held` ones."""
    free, held = list(free), list(held)
    site = np.array(free + held or np.zeros((0, 2), int)).reshape(-1, 2)
    if site.dtype.kind not in "iu":
        raise ValueError(f"sites must be whole numbers, not {site.dtype}")
    facing = np.array(glues, dtype=np.int64)[site.sum(axis=1) % 2]
    return Tiles(site, facing, np.arange(len(site)) >= len(free))


def l_seed(n: int) -> list[Site]:
    """Sites of an L-shaped seed: its corner at (-1, -1) and two sides of n tiles."""
    return [(-1, -1), *((-1, i) for i in range(n)), *((i, -1) for i in range(n))]


def block(n: int, glues: Sequence[Glues] = CHESSBOARD) -> Tiles:
    """The paper's n x n block in the corner of an L-shaped seed with sides of n tiles."""
    return chessboard([(i, j) for j in range(n) for i in range(n)], l_seed(n), glues)


def magnet_wrench(tiles: Tiles, law: Law, *, mating: bool) -> Reals:
    """Force and torque of the magnets on every tile: float64[n, 3] (N, N, N m).

    `mating`: only the two magnets of a shared edge, as in the paper's argument (whether they
    attract or repel); else every pair within the law's cut-off, with its switch, as the
    simulator has it.  Two magnets at one point do not push each other.
    """
    d = 0.5 * law.width - law.inset
    arm = d * np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])
    place = (law.width * tiles.site[:, None] + arm).reshape(-1, 2)
    gap = 2.0 * law.inset
    reach = min(law.cutoff, 1e3 * law.width) if not mating else gap
    pairs = cKDTree(place).query_pairs(reach * (1.0 + 1e-9), output_type="ndarray")
    p, q = pairs[pairs[:, 0] // 4 != pairs[:, 1] // 4].T  # rigid: a tile's own do not count
    apart = np.hypot(*(place[q] - place[p]).T) > 1e-9 * law.width
    p, q = p[apart], q[apart]
    way = place[q] - place[p]
    distance = np.hypot(*way.T)
    # On a lattice there are few distances.
    nearby, which = np.unique(np.round(distance / law.width, 12), return_inverse=True)
    size = np.array([force(r * law.width, law) for r in nearby])[which] if len(p) else distance
    label = tiles.glues.ravel()
    sign = [polarity(int(a), int(b), law) for a, b in zip(label[p], label[q], strict=True)]
    pull = (size * sign / distance)[:, None] * way
    wrench = np.zeros((len(tiles.site), 3))
    for magnet, each in ((p, pull), (q, -pull)):
        lever = arm[magnet % 4]
        turn = lever[:, 0] * each[:, 1] - lever[:, 1] * each[:, 0]
        np.add.at(wrench, magnet // 4, np.column_stack([each, turn]))
    return wrench


class Contacts(NamedTuple):
    """A state of rest, and what is at its limit in every state of rest at this load."""

    normal: Reals  # [m, 2], N, at the two points of each edge
    friction: Reals  # [m], N, along the tangent, on the second tile
    floor: Reals  # [n, 3], N, N, N m, on each tile
    opens: Mask  # [m, 2]: no pressure left
    slips: Mask  # [m]: pressed, and friction at its limit
    slides: Mask  # [n]: the floor's force at its limit
    turns: Mask  # [n]: the floor's torque at its limit


class Rest(NamedTuple):
    """The critical multiple of a load."""

    factor: float  # inf: no bound; 0: no multiple of it is borne, to 1e-7 of the forces
    error: float  # the exact factor is between factor and factor + error
    contacts: Contacts | None  # just below the critical load
    mode: Reals | None  # [n, 3], m/s, m/s, rad/s for a power of 1 W of the load; see the text above


class Phase(NamedTuple):
    """The worst phase of a load cos(phase) a + sin(phase) b."""

    factor: float  # as of :class:`Rest`
    phase: float  # rad
    error: float


class Statics:
    """The states of rest of an assembly.

    Parameters
    ----------
    tiles
    law
        Of the magnets; ``Law()`` has no cut-off, the simulator's default is
        ``Law(cutoff=0.03, switch=0.1)``.
    mating
        Which magnets count, see :func:`magnet_wrench`.
    mu
        Friction between tiles.
    floor
        Largest force (N) and torque (N m) of the floor on a tile; the torque may be infinite.
    rigid
        Tiles of one number (int64[n]) move as one body, whatever holds them together; by default
        each on its own.
    tolerance
        Relative, of a floor's disc.

    Raises
    ------
    ValueError
        No free tile, a negative friction, or numbers of rigid bodies that are not whole.

    Notes
    -----
    A floor force is a sum of at most 1 of forces at the corners of a polygon inscribed in its
    disc, at first a regular 16-gon, which may be 2 % short.  The dual gives a velocity to every
    tile, and so what the load could gain if the polygons were discs: sum of R |v| less what the
    corners give.  That bounds the error, since the factor with polygons is borne, and no load
    of more than the factor plus the gain is.  Corners are added along those velocities until the
    bound is below `tolerance` (columns generated, after Dantzig and Wolfe).  Where the polygons
    bear nothing at all, corners are added in the same way for the largest share of the magnets and
    of what else is there that is borne.  Every call begins with the 16-gons.
    """

    def __init__(self, tiles: Tiles, law: Law, *, mating: bool, mu: float = 0.0,
                 floor: tuple[float, float] = (0.0, 0.0), rigid: ArrayLike | None = None,
                 tolerance: float = 1e-4) -> None:
        if tiles.held.all():
            raise ValueError("there is no free tile")
        if not 0.0 <= mu < math.inf or not 0.0 <= floor[0] < math.inf or not floor[1] >= 0.0:
            raise ValueError(f"mu and floor must be finite, but for the floor's torque, and at "
                             f"least 0, not {mu:g} and {floor[0]:g} N, {floor[1]:g} N m")
        if not 0.0 <= tolerance < math.inf:
            raise ValueError(f"the tolerance must be at least 0 and finite, not {tolerance}")
        self.tiles, self.mu, self.floor = tiles, mu, floor
        self.tolerance = tolerance
        self.width = law.width
        n = len(tiles.site)
        given = np.arange(n) if rigid is None else np.asarray(rigid)
        if given.shape != (n,) or not np.array_equal(given, np.floor(given)):
            raise ValueError(f"rigid must be a whole number for each of {n} tiles, not {given}")
        body = np.unique(given, return_inverse=True)[1].reshape(n)  # from 0
        self._body = np.where(tiles.held, -1, body)  # held: one body that does not move
        self.magnets = magnet_wrench(tiles, law, mating=mating)
        self.edges = _shared_edges(tiles, self._body)
        # Not of the floor's torque, whose bound may be as good as none; see :meth:`_wide`.
        self.scale = (max(float(np.abs(self.magnets[:, :2]).max()), floor[0])
                      or min(2.0 * floor[1] / law.width, MOST) or 1.0)
        self._prepare()

    def _prepare(self) -> None:
        self._gather = self._equations(self._body)
        self._columns = self._gather @ self._forces()
        self._begin()

    def _begin(self) -> None:
        """A regular 16-gon for each floor's disc."""
        f = len(self.tiles.free)
        self._corner_of = np.repeat(np.arange(f), 16)  # which free tile, and where: [k, 2]
        angle = np.tile(2.0 * np.pi * np.arange(16) / 16, f)
        self._corners = np.column_stack([np.cos(angle), np.sin(angle)])

    def _equations(self, body: Ints) -> Any:
        """Sums wrenches over each body, the torque about its middle in units of width/2."""
        tiles, n = self.tiles, len(self.tiles.site)
        free = tiles.free
        number = np.unique(body[free], return_inverse=True)[1]
        count = np.bincount(number)
        middle = np.column_stack([np.bincount(number, tiles.site[free, k]) / count
                                  for k in (0, 1)])
        x, y = 2.0 * (tiles.site[free] - middle[number]).T  # in units of width/2
        one, row, column = np.ones(len(free)), 3 * number, 3 * free
        parts = ((one, row, column), (one, row + 1, column + 1),
                 (one * 2.0 / self.width, row + 2, column + 2),
                 (-y, row + 2, column), (x, row + 2, column + 1))
        values, rows, columns = (np.concatenate(each) for each in zip(*parts, strict=True))
        return sparse.csr_array((values, (rows, columns)), shape=(3 * len(count), 3 * n))

    def _forces(self) -> Any:
        """Wrench on every tile of each unknown: N_0 and N_1 of the edges, T, floor torque."""
        half, n, m, f = 0.5 * self.width, len(self.tiles.site), len(self.edges), self.tiles.free
        a, b, north = self.edges.T
        nx, ny = 1.0 - north, 1.0 * north  # from a to b; the tangent is (-ny, nx)
        edge, one = np.arange(m), np.ones(m)
        # A floor torque is counted in units of force, as a torque over half the width.
        parts = [(np.full(len(f), half), 3 * f + 2, 3 * m + np.arange(len(f)))]
        for tile, sign in ((a, -1.0), (b, 1.0)):
            for point, side in ((0, -1.0), (1, 1.0)):  # at -half and +half along the tangent
                for k, value in enumerate((sign * nx, sign * ny, -sign * side * half * one)):
                    parts.append((value, 3 * tile + k, 2 * edge + point))
            for k, value in enumerate((-sign * ny, sign * nx, -half * one)):
                parts.append((value, 3 * tile + k, 2 * m + edge))
        values, rows, columns = (np.concatenate(each) for each in zip(*parts, strict=True))
        return sparse.csr_array((values, (rows, columns)), shape=(3 * n, 3 * m + len(f)))

    def _program(self, others: Any, least: Any, most: Any, spare: bool) -> tuple[Any, ...]:
        """Matrices and bounds in units of `scale`: A_ub, b_ub, A_eq, bounds.

        The unknowns are those of :meth:`_forces`, the weights of the corners, and `others` between
        `least` and `most`, which are given by their columns.  With `spare` they are a number for
        each bound (of N, T, floor force, floor torque) that keeps the others off it.
        """
        m, f, k = len(self.edges), len(self.tiles.free), len(self._corners)
        force = self.floor[0] / self.scale
        torque = self._turning() / self.scale
        if spare:  # more than any state of rest has a use for would be at the cost of its digits
            torque = min(torque, 10.0 * len(self.tiles.site) ** 2)
        row = np.repeat(3 * self.tiles.free[self._corner_of], 2) + np.tile([0, 1], k)
        corners = self._gather @ sparse.csr_array(
            (force * self._corners.ravel(), (row, np.repeat(np.arange(k), 2))),
            shape=(3 * len(self.tiles.site), k))
        equal = sparse.hstack([self._columns, corners, others])
        rest, eye = others.shape[1], sparse.eye_array
        low = np.concatenate([np.zeros(2 * m), np.full(m, -np.inf), np.full(f, -torque),
                              np.zeros(k), np.full(rest, least)])
        high = np.concatenate([np.full(3 * m, np.inf), np.full(f, torque), np.full(k, np.inf),
                               np.full(rest, most)])
        press = sparse.kron(eye(m), [[self.mu, self.mu]])
        weights = sparse.csr_array((np.ones(k), (self._corner_of, np.arange(k))), shape=(f, k))
        rows = [[-press, eye(m), sparse.csr_array((m, f)), None], [-press, -eye(m), None, None],
                [None, None, None, weights]]
        above = np.concatenate([np.zeros(2 * m), np.ones(f)])
        if not spare:
            none = sparse.csr_array((2 * m + f, rest))
            return sparse.hstack([sparse.block_array(rows), none]), above, equal, low, high
        rows += [[-eye(2 * m), None, None, None], [None, None, eye(f), None],
                 [None, None, -eye(f), None]]
        # Of N, T, floor force, floor torque, in the order of the rows.
        kept = [[None, eye(m), None, None], [None, eye(m), None, None], [None, None, eye(f), None],
                [eye(2 * m), None, None, None], [None, None, None, eye(f)],
                [None, None, None, eye(f)]]
        matrix = sparse.hstack([sparse.block_array(rows), sparse.block_array(kept)])
        above = np.concatenate([above, np.zeros(2 * m), np.full(2 * f, torque)])
        return matrix, above, equal, low, high

    def _solve(self, gain: Reals, program: tuple[Any, ...], load: Reals) -> Any:
        """Maximise gain . (the last unknowns) under a load; None: no solution."""
        matrix, above, equal, low, high = program
        right = -(self._gather @ load.ravel()) / self.scale
        goal = np.zeros(len(low))
        goal[len(low) - len(gain):] = -gain
        for method in ("highs-ipm", "highs-ds"):  # the first is faster, the second sturdier
            result = linprog(goal, A_ub=matrix, b_ub=above, A_eq=equal, b_eq=right,
                             bounds=np.column_stack([low, high]), method=method)
            if result.status in (0, 2):
                break
        if result.status == 2:
            return None
        if result.status != 0:
            raise RuntimeError(f"the linear program was not solved: {result.message}")
        return result

    def _optimum(self, gain: Reals, others: Any, bounds: tuple[Any, Any], load: Reals,
                 allowed: Callable[[float], float], *, spare: bool = False) -> Any:
        """As :meth:`_solve`, with corners added until the gain is short by what is `allowed` of it.

        The result, by how much its gain may be short of that with discs, and the dual's velocities.
        Where a disc bears a load at its very rim and nothing beside it, corners are halved until
        HiGHS cannot tell them apart: what it has found before is returned, short by more.
        """
        f, m = len(self.tiles.free), len(self.edges)
        radius = self.floor[0] / self.scale
        asked, found = False, None
        while True:
            try:
                result = self._solve(gain, self._program(others, *bounds, spare), load)
            except RuntimeError:
                if found is None:
                    raise
                return found
            if result is None:
                if asked or not self._bears(load, *((None,) if spare else (others, bounds))):
                    return None
                asked = True
                continue
            power = (self._gather.T @ result.eqlin.marginals).reshape(-1, 3)
            speed = np.hypot(*power[self.tiles.free, :2].T)
            short = radius * speed + result.ineqlin.marginals[2 * m:2 * m + f]
            short = np.maximum(short, 0.0) if radius > 0.0 else np.zeros(f)
            most = max(allowed(-result.fun), EXACT)
            found = result, float(short.sum()), -power
            if short.sum() <= most:
                return found
            self._refine(np.flatnonzero(short > 0.1 * most / f),
                         power[self.tiles.free, :2] / np.maximum(speed, 1e-300)[:, None])

    def _bears(self, load: Reals, others: Any = None,
               bounds: tuple[float, float] = (0.0, 0.0)) -> bool:
        """Whether `load`, magnets and all, is borne with some of the `others`; of discs, to EXACT.

        By the largest share of it that is: none of it always is, as all bounds hold 0.
        """
        column = sparse.csr_array((self._gather @ load.ravel())[:, None] / self.scale)
        columns = column if others is None else sparse.hstack([others, column])
        gain = np.eye(columns.shape[1])[-1]
        ends = [np.where(gain, end, each) for end, each in zip((0.0, 1.0), bounds, strict=True)]
        result, _, _ = self._optimum(gain, columns, (ends[0], ends[1]), np.zeros_like(load),
                                     lambda share: 0.5 * (1.0 - share))
        return bool(result.x[-1] >= 1.0 - EXACT)

    def _support(self, loads: Sequence[Reals], gain: Reals, low: float, high: float,
                 dead: Reals | float = 0.0) -> tuple[Reals, float, Reals] | None:
        """The borne combination of loads (in units of `scale`) that gains most.

        Its coefficients, by how much its gain may be short of the largest, and the mode; None
        where nothing is borne.
        """
        others = sparse.csr_array(np.column_stack([self._gather @ load.ravel() for load in loads]))
        found = self._optimum(gain, others, (low, high), self.magnets + dead,
                              lambda best: self.tolerance * abs(best))
        if found is None:
            return None
        result, short, mode = found
        return result.x[-len(loads):], short, mode

    def _ray(self, load: Reals, dead: Reals | float = 0.0) -> tuple[float, float, Reals] | None:
        """As :meth:`_support`, of one load; UNBOUNDED where it is that or more."""
        found = self._support([load], np.ones(1), 0.0, LARGE, dead)
        if found is not None and found[0][0] > 0.99 * LARGE:
            if self._endless(load):
                return UNBOUNDED, 0.0, found[2]
            found = self._support([load], np.ones(1), 0.0, UNBOUNDED, dead)
        return None if found is None else (float(found[0][0]), *found[1:])

    def _endless(self, load: Reals) -> bool:
        """Whether contacts alone, and a floor of any torque, bear a load of size 1, to EXACT.

        They then bear any multiple of it, and else there is a bound.
        """
        m, f = len(self.edges), len(self.tiles.free)
        torque = math.inf if math.isinf(self._turning()) else 0.0
        low = np.concatenate([np.zeros(2 * m), np.full(m, -np.inf), np.full(f, -torque)])
        high = np.concatenate([np.full(3 * m, np.inf), np.full(f, torque)])
        press = sparse.kron(sparse.eye_array(m), [[self.mu, self.mu]])
        one, none = sparse.eye_array(m), sparse.csr_array((m, f))
        matrix = sparse.block_array([[-press, one, none], [-press, -one, none]])
        result = linprog(np.zeros(len(low)), A_ub=matrix, b_ub=np.zeros(2 * m),
                         A_eq=self._columns, b_eq=-(self._gather @ load.ravel()),
                         bounds=np.column_stack([low, high]), method="highs-ds")
        return bool(result.status == 0)

    def _refine(self, which: Ints, way: Reals) -> None:
        """New corners of some free tiles' polygons, on either side of their best one at `way`.

        One is along `way`, the other its mirror image: the corner was already best for a range of
        directions, of which the dual shows one alone.
        """
        gain = np.sum(self._corners * way[self._corner_of], axis=1)
        order = np.lexsort((gain, self._corner_of))
        last = order[np.append(np.diff(self._corner_of[order]) > 0, True)]
        best, way = self._corners[last][which], way[which]
        mirror = 2.0 * np.sum(best * way, axis=1)[:, None] * best - way
        self._corner_of = np.concatenate([self._corner_of, which, which])
        self._corners = np.concatenate([self._corners, way, mirror])

    def _turning(self) -> float:
        """Largest torque of the floor over half the width (N)."""
        turning = 2.0 * self.floor[1] / self.width
        return turning if turning < MOST else math.inf

    def _wide(self) -> Statics | None:
        """The same in units of the floor's torque, if that is the largest of all; else None.

        A load that it alone meets can be far beyond all forces, and yet bounded.
        """
        turning = self._turning()
        return self._in_units(turning) if self.scale < turning < math.inf else None

    def _in_units(self, scale: float) -> Statics:
        """The same with another unit of force (N)."""
        other = copy(self)
        other.scale = scale
        return other

    def _load(self, load: ArrayLike) -> tuple[Reals, float]:
        """A load of size 1 and its size (N)."""
        load = np.asarray(load, dtype=np.float64)
        if load.shape != self.magnets.shape or not np.all(np.isfinite(load)):
            raise ValueError("a load must be force and torque of every tile, finite and of shape "
                             f"{self.magnets.shape}")
        load = np.where(self.tiles.held[:, None], 0.0, load)
        size = max(float(np.abs(load[:, :2]).max()), 2.0 * float(np.abs(load[:, 2]).max())
                   / self.width)
        return (load / size if size > 0.0 else load), size

    def rest(self, load: ArrayLike, *, dead: ArrayLike | None = None,
             contacts: bool = True) -> Rest:
        """The largest factor by which `load` (float64[n, 3], N, N, N m) can be multiplied.

        `dead` is a load that is there as it is.  `contacts`: also find a state of rest there, and
        what it leaves no freedom.

        Raises
        ------
        ValueError
            No load, or one that is not of shape [n, 3] or not finite.
        """
        unit, size = self._load(load)
        if size == 0.0:
            raise ValueError("there is no load")
        fixed = np.zeros_like(unit) if dead is None else np.multiply(*self._load(dead))
        self._begin()
        found = self._ray(unit, fixed)
        if found is None:
            return Rest(0.0, 0.0, None, None)
        factor, error, power = found
        if factor > 0.99 * UNBOUNDED:
            wide = self._wide()
            return Rest(math.inf, 0.0, None, None) if wide is None else wide.rest(
                load, dead=dead, contacts=contacts)
        factor, ratio = max(0.0, factor), self.scale / size  # it may be -0
        work = float(np.sum(power * unit)) * size
        near = fixed + factor * (1.0 - 1e-6) * self.scale * unit
        state = self._contacts(near) if contacts else None
        mode = power / work if work > 0.0 else None
        return Rest(factor * ratio, error * ratio, state, mode)

    def bears(self, load: ArrayLike) -> bool:
        """Whether there is a state of rest under `load` (float64[n, 3]), to 1e-7 of the forces."""
        self._begin()
        return self._bears(self.magnets + np.multiply(*self._load(load)))

    def contacts(self, load: ArrayLike) -> Contacts | None:
        """A state of rest under `load` with as many contacts inside their bounds as can be.

        None where there is none.  Maximising the sum of min(spare, SPARE) over all bounds finds
        a point inside every bound that some state of rest leaves open, so that what is at its
        limit here is at its limit in all of them, to SPARE of the largest force.
        """
        self._begin()
        return self._contacts(np.multiply(*self._load(load)))

    def _contacts(self, load: Reals) -> Contacts | None:
        largest = self._load(load)[1]
        if largest > self.scale:
            return self._in_units(largest)._contacts(load)
        m, f = len(self.edges), len(self.tiles.free)
        others = sparse.csr_array((self._columns.shape[0], 3 * m + 2 * f))
        found = self._optimum(np.ones(3 * m + 2 * f), others, (0.0, SPARE), self.magnets + load,
                              lambda _: 0.01 * SPARE, spare=True)
        if found is None:
            return None
        normal, friction, torque, weight, spare = np.split(
            found[0].x, np.cumsum([2 * m, m, f, len(self._corners)]))
        tight = spare < 0.1 * SPARE
        opens, slips, slide, turn = np.split(tight, np.cumsum([2 * m, m, f]))
        n, free = len(self.tiles.site), self.tiles.free
        floor, slides, turns = np.zeros((n, 3)), np.zeros(n, bool), np.zeros(n, bool)
        np.add.at(floor[:, :2], free[self._corner_of],
                  self.floor[0] * weight[:, None] * self._corners)
        floor[free, 2] = 0.5 * self.width * self.scale * torque
        slides[free], turns[free] = slide & (self.floor[0] > 0.0), turn & (self.floor[1] > 0.0)
        opens = opens.reshape(m, 2)
        return Contacts(normal.reshape(m, 2) * self.scale, friction * self.scale, floor,
                        opens, slips & ~opens.all(axis=1), slides, turns)

    def worst_phase(self, a: ArrayLike, b: ArrayLike) -> Phase:
        """The worst phase of the load cos(phase) a + sin(phase) b (each float64[n, 3]).

        Raises
        ------
        ValueError
            No load, or one that is not of shape [n, 3] or not finite.

        Notes
        -----
        The pairs of coefficients that are borne are a convex set about the origin, and the worst
        phase leads to its nearest edge.  A polygon of borne points is grown outwards from its
        nearest edge: where no point lies beyond this, it is an edge of the set itself, and no
        phase is worse.  Each island has a set of its own, with fewer edges than all have together;
        the weakest of them decides.
        """
        loads = [np.multiply(*self._load(load)) for load in (a, b)]
        if not any(load.any() for load in loads):
            raise ValueError("there is no load")
        worst, least = Phase(math.inf, math.nan, 0.0), math.inf
        for island, (part_a, part_b) in self._islands(loads):
            if part_a.any() or part_b.any():
                found = island._worst_phase(part_a, part_b, worst.factor)
                least = min(least, float(found.factor + found.error))
                worst = min(worst, found, key=lambda phase: phase.factor)
            elif not island.bears(part_a):
                return Phase(0.0, math.nan, 0.0)
        return worst._replace(error=least - worst.factor if worst.error else 0.0)

    def _islands(self, loads: Sequence[Reals]) -> list[tuple[Statics, list[Reals]]]:
        """Parts that share no contact and no body, with their loads; of equal ones the first.

        The magnets of all tiles act on each as they are.
        """
        tiles, body, (a, b, _) = self.tiles, self._body, self.edges.T
        inner = (body[a] >= 0) & (body[b] >= 0)
        most = int(body.max()) + 1
        joined = sparse.coo_array((np.ones(inner.sum()), (body[a[inner]], body[b[inner]])),
                                  shape=(most, most))
        number = np.where(tiles.held, -1, connected_components(joined, directed=False)[1][body])
        names = np.unique(number[tiles.free])
        if len(names) == 1:
            return [(self, list(loads))]
        size = max(self._load(load)[1] for load in loads)
        found: dict[tuple[bytes, ...], tuple[Statics, list[Reals]]] = {}
        for name in names:
            edges = self.edges[(number[a] == name) | (number[b] == name)]
            which = np.union1d(np.flatnonzero(number == name), edges[:, :2])  # held neighbours too
            part = copy(self)
            part.tiles = Tiles(tiles.site[which], tiles.glues[which], tiles.held[which])
            part.magnets, part._body = self.magnets[which], body[which]
            part.edges = np.column_stack([np.searchsorted(which, edges[:, :2]), edges[:, 2]])
            part._prepare()
            here = [load[which] for load in loads]
            forces = np.hstack([part.magnets / self.scale, *(load / size for load in here)])
            forces = np.round(forces, 12) + 0.0  # no -0
            same = (part.tiles.site - part.tiles.site.min(axis=0), part.tiles.held,
                    np.unique(part._body, return_inverse=True)[1], forces)
            found.setdefault(tuple(each.tobytes() for each in same), (part, here))
        return list(found.values())

    def _worst_phase(self, a: Reals, b: Reals, enough: float) -> Phase:
        """As :meth:`worst_phase`, of one island; some phase that is not the worst and a factor of
        `enough` or more, as soon as no phase is below that.
        """
        unit_a, size_a = self._load(a)
        unit_b, size_b = self._load(b)
        size = max(size_a, size_b)
        ratio = self.scale / size
        loads = [unit_a * (size_a / size), unit_b * (size_b / size)]
        # From four rays; what lies further out than twice the shortest does not matter.
        axes = [np.array(axis, float) for axis in ((1, 0), (0, 1), (-1, 0), (0, -1))]
        self._begin()
        rays = [self._ray(axis[0] * loads[0] + axis[1] * loads[1]) for axis in axes]
        if any(ray is None for ray in rays):
            return Phase(0.0, math.nan, 0.0)
        length = [ray[0] for ray in rays if ray is not None]
        if min(length) > 0.99 * UNBOUNDED:
            wide = self._wide()
            return Phase(math.inf, math.nan, 0.0) if wide is None else wide._worst_phase(
                a, b, enough)
        far = 2.0 * min(length)
        points = [min(r, far) * axis for r, axis in zip(length, axes, strict=True)]
        while True:
            points = [p for p, q in zip(points, points[1:] + points[:1], strict=True)
                      if np.abs(p - q).max() > 1e-6]
            if len(points) < 2:
                return Phase(0.0, math.nan, 0.0)
            way = np.array(points[1:] + points[:1]) - np.array(points)
            normal = np.column_stack([way[:, 1], -way[:, 0]]) / np.hypot(*way.T)[:, None]
            height = np.sum(normal * np.array(points), axis=1)
            k = int(np.argmin(height))
            if height[k] * ratio >= enough:
                return Phase(float(height[k]) * ratio, math.nan, math.inf)
            found = self._support(loads, normal[k], -far, far)
            assert found is not None
            point, error, _ = found
            beyond = float(normal[k] @ point) - height[k]
            if beyond <= max(2.0 * self.tolerance * abs(height[k]), 1e-6):
                return Phase(max(float(height[k]), 0.0) * ratio,
                             math.atan2(normal[k, 1], normal[k, 0]),
                             (max(beyond, 0.0) + error) * ratio)
            points.insert(k + 1, point)


def _shared_edges(tiles: Tiles, body: Ints) -> Ints:
    """Neighbours in different bodies, int64[m, 3]: a tile, the one at E or N of it, 0 or 1."""
    at = {site: i for i, site in enumerate(map(tuple, tiles.site.tolist()))}
    found = [(i, j, north) for (c, r), i in at.items()
             for north, other in enumerate(((c + 1, r), (c, r + 1)))
             if (j := at.get(other)) is not None and body[i] != body[j]]
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def uniform(tiles: Tiles, fx: float, fy: float, torque: float = 0.0) -> Reals:
    """The same load on every free tile, float64[n, 3] (N, N, N m)."""
    return np.where(tiles.held[:, None], 0.0, np.array([fx, fy, torque]))
