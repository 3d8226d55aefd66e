"""Architecture: the storeys, their modules and who imports whom (the paper's figure of its own).

Everything is read from the sources: storeys and what they are from ARCHITECTURE.md, modules from
the folders, imports from the code.  An arrow means that the upper module imports the lower one,
and has the colour of the upper one's storey; arrows that follow from others are left out.  The
arrows of a module run together until they part.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyBboxPatch, Rectangle
from matplotlib.textpath import TextPath

from figures._shapes import canvas, stage, towards
from figures.style import BLUE, COLUMN, ORANGE
from tbsa.work.draw import EDGE

ROOT = Path(__file__).parents[1]
DATA: tuple[Path, ...] = ()
SIZE = 6.5  # pt, of a module's name
ROW, HEAD, GAP = 0.235, 0.34, 0.05  # in: a row of modules, a storey's name, between storeys
HIGH = 0.14  # in, a module
TINTS = {"work": "#dfe9f3", "model": "#e9eef3", "kernels": "#f3f3f3", "tbsa": "#f8f8f8",
         "theory": "#fbeedd"}
LINES = {"work": BLUE, "model": "#a01c5e", "kernels": "#303030", "theory": ORANGE}
HEAD_SIZE = 0.025  # in, of an arrow's head
STARTS, SWEEPS = 20, 60  # orders of modules that are tried
Modules = Mapping[str, Path]
Imports = Mapping[str, set[str]]


class Row(NamedTuple):
    """Modules side by side, and lines that pass between them (in)."""

    names: list[str]
    left: float
    right: float
    y: float


def storeys(text: str) -> dict[str, str]:
    """What every storey of ARCHITECTURE.md is, from above, and theory."""
    order = re.search(r"Imports go down only: (\w+(?: → \w+)+)", text)
    if order is None:
        raise ValueError("ARCHITECTURE.md does not say how imports go")
    found = dict(re.findall(r"\*\*`(?:tbsa/)?(\w+)/`\*\*: (.+?)\.\n", text))
    return {name: found[name] for name in (*order[1].split(" → "), "theory")}


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Every module of the simulator and of theory, by its name."""
    paths = [path for folder in ("tbsa", "tbsa/*", "theory")
             for path in root.glob(f"{folder}/[!_]*.py")]
    return {".".join(path.relative_to(root).with_suffix("").parts): path for path in sorted(paths)}


def imports(found: Modules) -> dict[str, set[str]]:
    """The modules that each one imports when it runs; imports for type checks do not count."""
    return {name: _imported(ast.parse(path.read_bytes())) & set(found) - {name}
            for name, path in found.items()}


def _imported(node: ast.AST) -> set[str]:
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return set()
    if isinstance(node, ast.Import):
        return {each.name for each in node.names}
    if isinstance(node, ast.ImportFrom):
        return {f"{node.module}", *(f"{node.module}.{each.name}" for each in node.names)}
    return set().union(*(_imported(child) for child in ast.iter_child_nodes(node)
                         if not isinstance(child, ast.expr)))


def below(graph: Imports) -> dict[str, set[str]]:
    """All that each module needs, directly or by way of others."""

    @cache
    def reach(name: str) -> frozenset[str]:
        return frozenset().union(graph[name], *map(reach, graph[name]))

    return {name: set(reach(name)) for name in graph}


def reduced(graph: Imports) -> dict[str, set[str]]:
    """The imports that do not follow from others."""
    reach = below(graph)
    return {name: {other for other in needs if not any(other in reach[each] for each in needs)}
            for name, needs in graph.items()}


def storey(name: str) -> str:
    """The storey of a module: the folder that it is in."""
    return name.split(".")[-2]


def levels(members: Iterable[str], graph: Imports) -> list[list[str]]:
    """The modules of a storey in rows, each above what it imports there."""
    members = set(members)

    @cache
    def height(name: str) -> int:
        return 1 + max((height(each) for each in graph[name] & members), default=-1)

    rows: list[list[str]] = [[] for _ in range(1 + max(map(height, members)))]
    for name in sorted(members):
        rows[-1 - height(name)].append(name)
    return rows


def make() -> Figure:
    """The storeys above each other, theory below them."""
    graph = imports(modules())
    what = storeys((ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"))
    *house, theory = what
    refuse_upward(graph, house)
    shared = sorted({name for name in graph if storey(name) not in what})
    users = {storey(name) for name, needs in graph.items() if needs & set(shared)}
    purpose = "for " + " and ".join(name for name in house if name in users)
    what = {name: what[name] for name in house} | {"tbsa": purpose, theory: what[theory]}
    floors = {each: levels([m for m in graph if storey(m) == each], graph) for each in what}
    # A storey of one row has its name beside it, others above.
    head = {each: HEAD * (len(rows) > 1) for each, rows in floors.items()}
    tall = {each: head[each] + ROW * len(rows) + 0.02 for each, rows in floors.items()}
    height = sum(tall.values()) + GAP * (len(tall) + 1)
    fig = canvas(height)
    ax = stage(fig, (0.0, 0.0, COLUMN, height), 1.0)
    rows: list[Row] = []
    top, right = height - GAP, COLUMN - 2 * GAP
    for each, text in what.items():
        ax.add_patch(Rectangle((GAP, top - tall[each]), COLUMN - 2 * GAP, tall[each], lw=0,
                               facecolor=TINTS[each], zorder=0))
        at = (2 * GAP, top - 0.25) if head[each] else (3 * GAP + _inches(each, 8.0, "bold"),
                                                       top - 0.115)
        ax.text(2 * GAP, top - 0.115, each, fontsize=8, weight="bold", va="center_baseline")
        ax.text(*at, text, fontsize=SIZE, va="center_baseline")
        beside = at[0] + _inches(text, SIZE) + GAP
        if head[each]:
            rows.append(Row([], beside, right, top - 0.24))  # upright lines beside the text
        rows += [Row(list(names), 2 * GAP if head[each] else beside, right,
                     top - head[each] - (k + 0.5) * ROW) for k, names in enumerate(floors[each])]
        top -= tall[each] + GAP
    lines = reduced(graph)
    _draw(ax, rows, {name: lines[name] - set(shared) for name in lines})
    return fig


def refuse_upward(graph: Imports, house: Sequence[str]) -> None:
    """Raise ValueError if a module imports one of a higher storey."""
    for name, needs in graph.items():
        for other in needs:
            if {storey(name), storey(other)} <= set(house) and (
                    house.index(storey(other)) < house.index(storey(name))):
                raise ValueError(f"{name} imports {other}, but imports go down only")


def _draw(ax: Axes, rows: Sequence[Row], graph: Imports) -> None:
    """Modules and lines between them, bent where they pass a row.

    What passes a row has a place there as a module has, so that it runs between modules; all lines
    of a module have it in common.  Places are then moved, row by row, towards the mean of what they
    are joined to, from several orders, and those where the fewest lines cross are kept.
    """
    row_of = {name: k for k, row in enumerate(rows) for name in row.names}
    lines = []
    for name in row_of:
        for other in sorted(graph[name] & set(row_of)):
            passed = range(row_of[name] + 1, row_of[other])
            bends = [f"{name}:{k}" for k in passed]
            for k, bend in zip(passed, bends, strict=True):
                if bend not in rows[k].names:
                    rows[k].names.append(bend)
            lines.append([name, *bends, other])
    x = _places(tuple((tuple(row.names), row.left, row.right) for row in rows),
                tuple(sorted({piece for line in lines for piece in pairwise(line)})))
    place = {name: (x[name], row.y) for row in rows for name in row.names}
    for line in lines:  # straight down past a row, across between rows
        ends = [(px, py + side * 0.5 * HIGH) for px, py in (place[name] for name in line)
                for side in (1.0, -1.0)]
        colour = LINES[storey(line[0])]
        ax.plot(*zip(*ends[1:-1], strict=True), color=colour, lw=0.6, zorder=2,
                solid_joinstyle="round")
        (px, py), (qx, qy) = ends[-3:-1]
        along = np.array([qx - px, qy - py]) / np.hypot(qx - px, qy - py)
        towards(ax, tuple(np.array([qx, qy]) - HEAD_SIZE * along), math.atan2(along[1], along[0]),
                colour, HEAD_SIZE, 2.5)
    for name in row_of:
        _chip(ax, name, *place[name])


@cache
def _places(rows: Sequence[tuple[Sequence[str], float, float]],
            pieces: Sequence[tuple[str, str]]) -> dict[str, float]:
    """Where in its row (names, left, right) everything is, so that the fewest pieces cross."""
    joined: dict[str, list[str]] = {}
    for a, b in pieces:
        joined.setdefault(a, []).append(b)
        joined.setdefault(b, []).append(a)
    level = {name: k for k, (names, _, _) in enumerate(rows) for name in names}
    between = [[piece for piece in pieces if level[piece[0]] == k] for k in range(len(rows))]
    filled = [row for row in rows if row[0]]
    best: dict[str, float] = {}
    least, random = (np.inf, np.inf), np.random.default_rng(3)
    for _ in range(STARTS):
        x: dict[str, float] = {}
        for names, left, right in filled:
            places = np.linspace(left, right, len(names) + 2)[1:-1]
            x |= zip(random.permutation(names).tolist(), places.tolist(), strict=True)
        for sweep in range(SWEEPS):
            for names, left, right in filled[::1 if sweep % 2 else -1]:
                wish = {name: sum(x[other] for other in beside) / len(beside)
                        for name in names for beside in [joined.get(name, [name])]}
                order = sorted(names, key=lambda name: (wish[name], name))
                x |= zip(order, _apart([wish[n] for n in order], [_width(n) for n in order],
                                       left, right), strict=True)
            cost = (sum(_crossings(x, each) for each in between),
                    sum(abs(x[a] - x[b]) for a, b in pieces))
            if cost < least:
                best, least = dict(x), cost
    return best


def _crossings(x: Mapping[str, float], pieces: Sequence[tuple[str, str]]) -> int:
    """How many pairs of lines between two rows cross."""
    above, below = (np.array([x[piece[end]] for piece in pieces]) for end in (0, 1))
    return int((np.subtract.outer(above, above) * np.subtract.outer(below, below) < -1e-12).sum()
               ) // 2


def _apart(wish: Sequence[float], width: Sequence[float], left: float, right: float) -> list[float]:
    """Places near the wished ones, in their order, that leave each its width."""
    need = [0.5 * (a + b) for a, b in pairwise(width)]
    first, last = left + 0.5 * width[0], right - 0.5 * width[-1]

    def onwards(x: list[float]) -> list[float]:
        x[0] = max(x[0], first)
        for k, each in enumerate(need):
            x[k + 1] = max(x[k + 1], x[k] + each)
        return x

    def backwards(x: list[float]) -> list[float]:
        x[-1] = min(x[-1], last)
        for k in reversed(range(len(need))):
            x[k] = min(x[k], x[k + 1] - need[k])
        return x

    # Either order alone would push everything to one side.
    both = zip(backwards(onwards(list(wish))), onwards(backwards(list(wish))), strict=True)
    return [0.5 * (a + b) for a, b in both]


@cache
def _inches(text: str, size: float, weight: str = "normal") -> float:
    return float(TextPath((0.0, 0.0), text, size=size, prop=FontProperties(weight=weight)
                          ).get_extents().width) / 72.0


def _width(name: str) -> float:
    """Of a module with the space beside it, or of a line that passes (in)."""
    if ":" in name:
        return 0.1
    return _inches(name.split(".")[-1], SIZE) + 0.16


def _chip(ax: Axes, name: str, x: float, y: float) -> None:
    w, h = _width(name) - 0.06, HIGH
    ax.add_patch(FancyBboxPatch((x - 0.5 * w, y - 0.5 * h), w, h, facecolor="white", edgecolor=EDGE,
                                boxstyle="round,pad=0,rounding_size=0.03", lw=0.5, zorder=3))
    ax.text(x, y, name.split(".")[-1], fontsize=SIZE, ha="center", va="center_baseline", zorder=4)
