"""Tile sets: glues, the abstract growth that gives the ground truth, and a check for traps.

The abstract Tile Assembly Model (Winfree 1998; paper, section "Abstract Tile Assembly Model"):
tiles sit on a square lattice and do not turn; a tile joins at a free site when its glues that
match the neighbours' have a total strength of at least the temperature.  Matching glues have
strength 1, all others 0.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tbsa.model.scene import EDGES, SETS, Scene, TileType, growth_box, growth_margin
from tbsa.model.squares import inside, lattice

__all__ = [
    "EDGES", "SETS", "STEPS", "Conflict", "Growth", "PartialMatch", "Site", "TileType",
    "attracts", "check", "ground_truth", "grow", "look", "mirrored", "rotated", "strength",
    "symmetry",
]

Site = tuple[int, int]  # column, row
Glues = tuple[int, int, int, int]

STEPS: tuple[Site, ...] = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""From a site to its neighbours at N, E, S, W; the neighbour's facing edge is (i + 2) % 4."""


def attracts(glue_a: int, glue_b: int) -> bool:
    """Whether two glues match: +g and -g do, 0 (no magnet) matches nothing."""
    return glue_a != 0 and glue_a == -glue_b


def rotated(glues: Glues, turns: int) -> Glues:
    """What faces N, E, S, W after `turns` quarter turns counter-clockwise of the tile."""
    k = turns % 4
    a, b, c, d = glues[k:] + glues[:k]  # after one turn the E edge faces N
    return a, b, c, d


def mirrored(tile_type: TileType) -> TileType:
    """The tile type seen in a mirror: E and W change places."""
    n, e, s, w = tile_type.glues
    forward = {"E": "W", "W": "E"}.get(tile_type.forward, tile_type.forward)
    return replace(tile_type, glues=(n, w, s, e), forward=forward)


def symmetry(tile_type: TileType) -> int:
    """The smallest number of quarter turns (1, 2 or 4) that maps the glues to themselves."""
    return next(k for k in (1, 2, 4) if rotated(tile_type.glues, k) == tile_type.glues)


def look(colour: str) -> str:
    """A colour as it is drawn, "#rrggbb", so that "black" and "#000000" are one; text that is no
    colour is left as it is."""
    from matplotlib.colors import is_color_like, to_hex  # when it is needed, as pictures are

    drawn = is_color_like(colour) and colour.lower() != "none"
    return to_hex(colour) if drawn else colour


@dataclass(frozen=True)
class Conflict:
    """A site at which tiles of more than one type, in glues or colour, can come to sit."""

    site: Site
    types: tuple[int, ...]


@dataclass(frozen=True)
class Growth:
    """What grows from a seed.

    Attributes
    ----------
    types
        Index of the tile type at each site, (column, row), the seed's among them.
    conflict
        None when the growth is `directed`, else the first site found to admit several types;
        ``types`` is then one of several possible assemblies, the one in which the type that
        comes first in the set wins.
    seed
        The sites of the seed.
    """

    types: Mapping[Site, int]
    conflict: Conflict | None = None
    seed: frozenset[Site] = frozenset()

    @property
    def directed(self) -> bool:
        """Whether every order of attachments ends in the same assembly."""
        return self.conflict is None


def strength(types: Sequence[TileType], sites: Mapping[Site, int], site: Site, offered: int) -> int:
    """Number of glues with which type `offered` would bind at `site` of an assembly."""
    bonds = 0
    for edge, neighbour in _neighbours(site):
        if neighbour in sites:
            facing = types[sites[neighbour]].glues[(edge + 2) % 4]
            bonds += attracts(types[offered].glues[edge], facing)
    return bonds


def grow(
    types: Sequence[TileType],
    seed_cells: Iterable[tuple[int, int, str]],
    allowed: Callable[[Site], bool] | Container[Site],
    temperature: int = 2,
) -> Growth:
    """Abstract growth from a seed.

    Parameters
    ----------
    types
        The tile set.
    seed_cells
        (column, row, type name) of the seed's tiles.
    allowed
        The sites that growth may reach, as a predicate or a container; it must bound the
        growth, or this does not return.
    temperature
        The number of matching glues that a tile needs to join.

    Notes
    -----
    Types of equal glues and colour are one here, as their patterns are.  The assembly is *directed*
    when no site can ever be taken by two types.  That is decided exactly: let A be the assembly
    found.  If another order of attachments can end differently, look at its first tile that A does
    not have: it joins at a site s of A, with a type B other than A's, next to tiles of A that were
    placed without s.  So A is directed unless some B with enough matching glues at some s in A also
    has enough of them among the tiles that can be there without s.  The first half is one pass over
    A; the sites that it leaves in doubt (none in a chessboard, nearly all where tiles compute) need
    the second: :func:`_after` settles most of them, :func:`_needed` the others.
    """
    index = {tile_type.name: i for i, tile_type in enumerate(types)}
    seed = {(column, row): index[name] for column, row, name in seed_cells}
    may = allowed if callable(allowed) else allowed.__contains__

    offers: list[dict[int, list[int]]] = [{}, {}, {}, {}]  # by edge, then by the glue it matches
    for i, tile_type in enumerate(types):
        for edge, glue in enumerate(tile_type.glues):
            if glue != 0:
                offers[edge].setdefault(-glue, []).append(i)

    def able(site: Site, sites: Mapping[Site, int]) -> list[int]:
        facing = ((edge, types[sites[neighbour]].glues[(edge + 2) % 4])
                  for edge, neighbour in _neighbours(site) if neighbour in sites)
        bonds = Counter(i for edge, glue in facing for i in offers[edge].get(glue, ()))
        return sorted(i for i, number in bonds.items() if number >= temperature)

    def first_that_binds(site: Site, sites: Mapping[Site, int]) -> int | None:
        found = able(site, sites)
        return found[0] if found and may(site) else None

    sites = _closure(seed, first_that_binds)
    pattern = [(each.glues, look(each.colour)) for each in types]

    def rivals(site: Site, there: Mapping[Site, int]) -> list[int]:
        return [i for i in able(site, there) if pattern[i] != pattern[sites[site]]]

    doubtful = [site for site in sites if site not in seed and rivals(site, sites)]
    if doubtful:
        after = _after(_matched(types, sites), seed, temperature)
        doubtful = [site for site in doubtful if rivals(site, {
            other: sites[other] for _, other in _neighbours(site)
            if other in sites and other not in after[site]})]
    for k in range(0, len(doubtful), AT_ONCE):
        needed = _needed(types, sites, seed, temperature, doubtful[k : k + AT_ONCE])
        for bit, site in enumerate(doubtful[k : k + AT_ONCE]):
            there = {other: sites[other] for _, other in _neighbours(site)
                     if other in sites and not needed[other] >> bit & 1}
            if others := rivals(site, there):
                return Growth(sites, Conflict(site, tuple(sorted([sites[site], *others]))),
                              frozenset(seed))
    return Growth(sites, None, frozenset(seed))


AT_ONCE = 4096  # sites in doubt that are asked for together, a bit each


def _matched(types: Sequence[TileType], sites: Mapping[Site, int]) -> dict[Site, list[Site]]:
    """The neighbours of each site of an assembly that it matches."""
    return {site: [other for edge, other in _neighbours(site) if other in sites and attracts(
        types[placed].glues[edge], types[sites[other]].glues[(edge + 2) % 4])]
        for site, placed in sites.items()}


def _after(matched: Mapping[Site, Sequence[Site]], seed: Container[Site],
           temperature: int) -> dict[Site, set[Site]]:
    """For each site neighbours that no order of attachments can fill before it; not always all.

    What comes after a site is no help in placing it.  Where without one more too few are left, it
    comes after that one: told from the outermost sites inwards, each looked at a few times.
    """
    after: dict[Site, set[Site]] = {site: set() for site in matched}
    queue = [site for site in matched if site not in seed]
    while queue:
        site = queue.pop()
        before = [other for other in matched[site] if other not in after[site]]
        if len(before) <= temperature:
            new = [other for other in before if site not in after[other]]
            for other in new:
                after[other].add(site)
            queue.extend(other for other in new if other not in seed)
    return after


def _needed(types: Sequence[TileType], sites: Mapping[Site, int], seed: Container[Site],
            temperature: int, doubtful: Sequence[Site]) -> dict[Site, int]:
    """For each site of an assembly which of the doubtful ones it cannot do without, as bits.

    A site needs itself, and what so many of the neighbours that it matches need that too few are
    left; the largest solution, found from above, is what no order of attachments avoids (as the
    dominators of a flow graph are).
    """
    bits = {site: 1 << bit for bit, site in enumerate(doubtful)}
    matched = _matched(types, sites)
    everything = (1 << len(doubtful)) - 1
    needed = {site: 0 if site in seed else everything for site in sites}
    queue = deque(site for site in sites if site not in seed)
    queued = set(queue)
    while queue:
        site = queue.popleft()
        queued.discard(site)
        found = bits.get(site, 0) | _in_at_least(
            len(matched[site]) - temperature + 1, [needed[other] for other in matched[site]])
        if found != needed[site]:
            needed[site] = found
            new = [other for other in matched[site] if other not in seed and other not in queued]
            queue.extend(new)
            queued.update(new)
    return needed


def _in_at_least(number: int, sets: Iterable[int]) -> int:
    """The bits that at least so many (1 or more) of some sets have."""
    counted = [-1] + [0] * number
    for each in sets:
        for k in range(number, 0, -1):
            counted[k] |= counted[k - 1] & each
    return counted[number]


def _neighbours(site: Site) -> Iterator[tuple[int, Site]]:
    column, row = site
    for edge, (c, r) in enumerate(STEPS):
        yield edge, (column + c, row + r)


def _closure(
    seed: Mapping[Site, int], binds: Callable[[Site, Mapping[Site, int]], int | None]
) -> dict[Site, int]:
    """Add tiles until none binds.  A site is looked at only after a neighbour was filled."""
    sites = dict(seed)
    queue = deque(neighbour for site in seed for _, neighbour in _neighbours(site))
    while queue:
        site = queue.popleft()
        if site in sites:
            continue
        offered = binds(site, sites)
        if offered is not None:
            sites[site] = offered
            queue.extend(neighbour for _, neighbour in _neighbours(site))
    return sites


def ground_truth(scene: Scene) -> Growth:
    """What the scene's seed should grow to: abstract growth inside the reactor.

    A site counts when the whole tile is inside.  Without a reactor growth is confined to the
    seed's bounding box, at temperature 1 extended on every side by the number of tiles beside the
    seed (256 at most).  Without a seed nothing grows.  Tiles that are held beside the seed are not
    part of the growth.
    """
    seed, width = scene.seed, scene.material.width
    if seed is None:
        return Growth({})
    left, right, low, high = growth_box(seed, growth_margin(scene))

    def allowed(site: Site) -> bool:
        if scene.reactor is None:
            return left <= site[0] <= right and low <= site[1] <= high
        x, y = lattice(seed, width, *site)
        return bool(inside(scene.reactor, width, x, y, np.asarray(seed.angle)))

    return grow(scene.types, seed.cells, allowed, scene.temperature)


@dataclass(frozen=True)
class PartialMatch:
    """A tile that would bind where another, or the same turned otherwise, belongs."""

    wanted: str  # the type that belongs there
    offered: str  # the type that binds
    turns: int  # quarter turns counter-clockwise of the one offered
    matches: int  # glues that attract the neighbours'
    arrangement: str  # of the matching edges: "single", "adjacent", "opposite", "three", "all four"
    mismatches: int  # pairs of glues that face each other and do not attract
    sites: int  # number of sites where this is so


def check(types: Sequence[TileType], growth: Growth) -> list[PartialMatch]:
    """The traps of a tile set: wrong tiles that bind by at least one glue where it grows.

    At each site that grew and has at least two neighbours, each type is offered in each of its
    orientations, except those that show the right glues and colour.  Equal findings are one row;
    the most dangerous (most matches, fewest mismatches) come first.
    """
    contexts: Counter[tuple[int, tuple[tuple[int, int], ...]]] = Counter()  # equal sites once
    for site, placed in growth.types.items():
        facing = tuple((edge, types[growth.types[neighbour]].glues[(edge + 2) % 4])
                       for edge, neighbour in _neighbours(site) if neighbour in growth.types)
        if site not in growth.seed and len(facing) >= 2:
            contexts[placed, facing] += 1
    found: Counter[tuple[str, str, int, int, str, int]] = Counter()
    looks = [look(each.colour) for each in types]
    views = [(offered, shown, turns, rotated(offered.glues, turns))
             for offered, shown in zip(types, looks, strict=True)
             for turns in range(symmetry(offered))]
    offers: list[dict[int, list[int]]] = [{}, {}, {}, {}]  # by edge, then by the glue it matches
    for i, view in enumerate(views):
        for edge, glue in enumerate(view[3]):
            offers[edge].setdefault(-glue, []).append(i)
    for (placed, facing), sites in contexts.items():
        wanted = types[placed]
        for i in {i for edge, glue in facing if glue != 0 for i in offers[edge].get(glue, ())}:
            offered, shown, turns, glues = views[i]
            if (glues, shown) == (wanted.glues, looks[placed]):
                continue
            edges = [edge for edge, glue in facing if attracts(glues[edge], glue)]
            repelled = sum(glues[edge] != 0 and glue != 0 for edge, glue in facing)
            found[wanted.name, offered.name, turns, len(edges), _arrangement(edges),
                  repelled - len(edges)] += sites
    rows = [PartialMatch(*key, number) for key, number in found.items()]
    return sorted(rows, key=lambda row: (-row.matches, row.mismatches, row.arrangement,
                                         row.wanted, row.offered, row.turns))


def _arrangement(edges: Sequence[int]) -> str:
    if len(edges) == 2:
        return "opposite" if edges[1] - edges[0] == 2 else "adjacent"
    return {1: "single", 3: "three", 4: "all four"}[len(edges)]
