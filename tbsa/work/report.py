"""Reports as text: what a scene holds and what its tile set can do (``tbsa check``), and what a
run has computed and left out (``tbsa run --report``)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from tbsa.errors import InputError, printable
from tbsa.kernels.projection import SLOP
from tbsa.model.layout import Layout, initial_layout
from tbsa.model.scene import EDGES, Drive, Scene
from tbsa.model.simulation import floor_limits
from tbsa.model.squares import area
from tbsa.model.tiles import check, ground_truth
from theory.floor import MEAN_DISTANCE, share
from theory.magnets import Law
from theory.magnets import force as magnet_force

ROWS = 40  # of the table of wrong tiles; the most dangerous come first

# Counters of a run, see `tbsa.kernels.state.Counts`: what each counts, and of what it is a share
# or by what it is divided.  The first are of work done, the others of work left out.
DONE = {
    "steps": ("steps", ""),
    "substeps": ("substeps", ""),
    "lists": ("lists of near pairs built", "a step since"),
    "magnet_lists": ("lists of magnet pairs built", "a step since"),
    "magnet_pairs": ("magnet pairs with a force computed", "a step since"),
    "surprises": ("times rows were added or found again within a step", "a step"),
    "rows": ("manifolds solved", "a substep"),
    "passes": ("passes of the contact solver", "a substep"),
    "solves": ("manifolds in all passes", "a substep"),
    "unconverged": ("substeps at the limit of passes", "of substeps"),
    "impacts": ("points that hit", "a substep"),
    "projections": ("substeps with deep overlap moved back", "of substeps"),
}
LEFT_OUT = {
    "still": ("steps not done, as nothing changes any more", "of steps_here"),
    "joined": ("substeps joined with others in calm scenes", "of all_substeps"),
    "kept_lists": ("steps with an older list of near pairs, at least", "of steps_here"),
    "kept_magnet_lists": ("times an older list of magnet pairs was used", "of looks"),
    "unsolved": ("manifolds that had converged, or in flight", "of solves"),
}
_SHOWN_WITH_OTHERS = {"overlap", "deepest", "all_substeps", "steps_here", "looks"}


def describe(scene: Scene) -> str:
    """A scene in words and numbers, then the check of its tile set.

    The random tiles are placed, so that a scene whose tiles do not fit is refused here as it
    would be by a run.

    Raises
    ------
    InputError
        Where the random tiles do not fit.
    """
    layout = initial_layout(scene)
    head = [printable(line) for line in (scene.title, scene.file) if line]
    parts = [
        ("tiles", _tiles(scene, layout)),
        ("reactor", _reactor(scene, layout)),
        ("magnets", _magnets(scene)),
        ("drive", _drive(scene.drive)),
        ("floor", _floor(scene, layout)),
        ("solver", _solver(scene)),
        ("run", _run(scene)),
        ("pattern", _pattern(scene)),
    ]
    width = max(len(name) for name, _ in parts) + 2
    body = [
        (name if k == 0 else "").ljust(width) + line
        for name, lines in parts
        for k, line in enumerate(lines)
    ]
    text = "\n".join([*head, *([""] if head else []), *body])
    return "\n".join(map(printable, text.split("\n")))


def aligned(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """A table in plain text: words to the left, numbers to the right."""
    rows = list(rows)
    cells = [list(head), *([str(value) for value in row] for row in rows)]
    columns = list(zip(*cells, strict=True))
    number = [all(isinstance(row[k], int) for row in rows) for k in range(len(head))]
    widths = [max(map(len, column)) for column in columns]
    return [
        "  ".join(
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(line, widths, number, strict=True)
        ).rstrip()
        for line in cells
    ]


def work(counts: Mapping[str, Any], scene: Scene, wall: float, since: int = 0) -> str:
    """What a run has computed, and what it has left out.

    Parameters
    ----------
    counts
        The counters of the run, as in its ``run.json``; those that are not there are passed over.
    scene
        Its scene.
    wall : float
        Wall time of the run (s).
    since : int
        Steps of the run before it was last gone on with: what is counted of a process begins there.
    """
    known = {name: int(value) for name, value in counts.items() if np.ndim(value) == 0}
    substeps = max(known.get("substeps", 0), 1)
    known["steps_here"] = known.get("steps", 0) - since
    known["looks"] = known["steps_here"] * (2 - scene.solver.substeps % 2)  # at the magnets
    for name, most in (("lists", "steps_here"), ("magnet_lists", "looks")):
        if known.get(name, 0) > 0:
            known[f"kept_{name}"] = max(known[most] - known[name], 0)
    if "joined" in known:
        known["all_substeps"] = known["joined"] + known.get("substeps", 0)
    by = {"a substep": substeps, "a step": max(known.get("steps", 0), 1),
          "a step since": max(known["steps_here"], 1)}

    def row(name: str, what: str, per: str) -> tuple[str, int, str]:
        number = known[name]
        if name == "substeps":
            return what, number, f"{1e6 * wall / substeps:.3g} us of wall time each"
        if per in by:
            after = f" since step {since}" if per.endswith("since") and since else ""
            return what, number, f"{number / by[per]:.3g} {per.removesuffix(' since')}{after}"
        total = known.get(per.removeprefix("of "), 0)
        share = f"{100 * number / total:.3g} %" if total else ""
        return what, number, f"{share} of {total}" if share and per != "of substeps" else share

    rows: list[tuple[str, object, str]] = [
        row(name, *text) for name, text in DONE.items() if name in known]
    if "overlap" in counts and "deepest" in counts:
        deep, total = sum(counts["overlap"][2:]), max(sum(counts["overlap"]), 1)
        rows.append(("time with overlap beyond 0.1 %", "",
                     f"{100 * deep / total:.3g} %; deepest "
                     f"{100 * counts['deepest'] / scene.material.width:.3g} % of the width"))
    rows += [row(name, name, "a substep") for name in known
             if name not in {*DONE, *LEFT_OUT, *_SHOWN_WITH_OTHERS}]
    skipped = [row(name, *text) for name, text in LEFT_OUT.items() if name in known]
    table = aligned(("work done", "count", ""), rows)
    if skipped:
        table += ["", *aligned(("left out", "count", ""), skipped)]
    glues = any(any(kind.glues) for kind in scene.types)
    missing = [name for name, there in (
        ("magnets", scene.magnet is not None and glues), ("wall", scene.reactor is not None),
        ("floor friction", any(floor_limits(scene))), ("drive", scene.drive is not None),
    ) if not there]
    if missing:
        table += ["", f"not in the scene, not computed: {', '.join(missing)}"]
    return "\n".join(table)


def _tiles(scene: Scene, layout: Layout) -> list[str]:
    seed = int(layout.seed.sum())
    held = int((layout.held & ~layout.seed).sum())
    total = layout.x.size
    free = total - seed - held
    parts = f"{seed} of the seed, {free} free" + (f", {held} held beside it" if held else "")
    edges = " ".join(EDGES)
    rows = []
    for k, kind in enumerate(scene.types):
        mine = layout.type == k
        glues = " ".join(f"{glue:+d}" if glue else " 0" for glue in kind.glues)
        rows.append((printable(kind.name), glues, printable(kind.colour),
                     f"{kind.family:+d}" if kind.family else " 0", kind.forward,
                     int((mine & layout.seed).sum()), int((mine & ~layout.seed).sum())))
    head = ("type", f"glues {edges}", "colour", "family", "forward", "seed", "beside it")
    body = scene.material
    return [
        f"{total}: {parts}; {body.width:g} m wide, {body.mass:g} kg",
        *aligned(head, rows),
        *_undrawable(scene),
    ]


def _undrawable(scene: Scene) -> list[str]:
    from tbsa.work.draw import check_colours  # takes its time

    try:
        check_colours(scene)
    except InputError as error:
        return [f"warning: {error.without_file}"]
    return []


def _reactor(scene: Scene, layout: Layout) -> list[str]:
    wall = scene.reactor
    if wall is None:
        return ["none: the floor has no end"]
    if wall.shape == "circle":
        what = f"circle, radius {wall.radius:g} m"
    else:
        what = f"rectangle, {wall.width:g} m x {wall.height:g} m"
    share = layout.x.size * scene.material.width**2 / area(wall)
    return [f"{what}; the tiles cover {100 * share:.1f} % of it"]


def _magnets(scene: Scene) -> list[str]:
    magnet = scene.magnet
    if magnet is None:
        return ["none: tiles do not bond"]
    law = Law(magnet.alpha, magnet.beta, cutoff=magnet.cutoff, switch=magnet.switch)
    contact = magnet_force(2 * magnet.inset, law)
    other = "repels" if magnet.mismatch else "does nothing"
    glues = {glue for kind in scene.types for glue in kind.glues if glue}
    if not any(-glue in glues for glue in glues):
        return [f"no glue attracts another: tiles do not bond; what does not attract {other}"]
    return [f"{contact:.4g} N between the two magnets of a bond, none beyond {magnet.cutoff:g} m; "
            f"what does not attract {other}"]


def _drive(drive: Drive | None) -> list[str]:
    if drive is None:
        return ["none"]
    if drive.kind == "user":
        values = ", ".join(f"{value:g}" for value in drive.parameters)
        return [f"{drive.function} of {drive.module}, parameters ({values})"]
    if drive.kind == "constant":
        assert isinstance(drive.force, tuple)
        return [f"constant, ({drive.force[0]:g}, {drive.force[1]:g}) N and {drive.torque:g} N m"]
    turn = f", {drive.torque:g} N m" if drive.kind == "unicycle" else ""
    return [f"{drive.kind}, {drive.force:g} N{turn}, {drive.frequency:g} Hz"]


def _idle(drive: Drive, scene: Scene, layout: Layout) -> str:
    """Why a drive moves nothing, if it does not; else no words."""
    family = np.array([kind.family for kind in scene.types])[layout.type]
    if drive.kind == "unicycle" and drive.frequency == 0.0:
        return "the drive moves nothing: its frequency is 0, and it begins at 0"
    if drive.kind == "unicycle" and not family[~layout.held].any():
        return "the drive moves nothing: no free tile has a family"
    return ""


def _floor(scene: Scene, layout: Layout) -> list[str]:
    floor, drive = scene.floor, scene.drive
    if floor is None:
        return ["no friction"]
    limit, torque = floor_limits(scene)
    lines = [f"{floor.law} friction, at most {limit:.4g} N and {torque:.4g} N m on a tile"]
    if drive is None or drive.kind == "user":
        return lines
    if idle := _idle(drive, scene, layout):
        return [*lines, idle]
    most = math.hypot(*drive.force) if isinstance(drive.force, tuple) else drive.force
    turning = abs(drive.torque)
    if floor.law != "separate" and min(most, turning, limit, torque) > 0.0:
        return [*lines, _together(floor.law, most / limit, turning / torque, drive.kind)]
    lines.append(_against("force", most, limit, "move"))
    if drive.kind != "shaking":
        lines.append(_against("torque", turning, torque, "turn"))
    return lines


def _together(law: str, force: float, torque: float, drive: str) -> str:
    """A verdict on force and torque at once, each as a multiple of the floor's bound, where these
    are one: of a unicycle along a forward edge's normal, of a constant load in any direction."""
    ends = [math.hypot(force, torque)]
    if law == "exact":
        angles = (0.0, 0.25 * math.pi) if drive == "constant" else (0.0,)
        ends = sorted(share(force, torque * MEAN_DISTANCE, angle) for angle in angles)
    size = " to ".join(dict.fromkeys(f"{end:.3g}" for end in ends))
    verdict = "they move a lone tile at rest"
    if ends[-1] <= 1.0:
        verdict = "they do not move a lone tile at rest"
    elif ends[0] <= 1.0:
        verdict = "its angle decides whether they move a lone tile at rest"
    return (f"the drive's force is {force:.3g} x the floor's, its torque {torque:.3g} x, both "
            f"together {size} x: {verdict}")


def _against(what: str, load: float, limit: float, verb: str) -> str:
    if load == 0.0:
        return f"the drive has no {what}"
    if limit == 0.0:
        return f"the drive's {what} meets no friction"
    verdict = f"{verb}s" if load > limit else f"does not {verb}"
    return (f"the drive's {what} is {load / limit:.3g} x the floor's: "
            f"it {verdict} a lone tile at rest")


def _solver(scene: Scene) -> list[str]:
    solver = scene.solver
    h = solver.step / solver.substeps
    part = solver.tolerance * h / scene.material.width
    lines = [f"substep {h:.4g} s ({solver.substeps} in {solver.step:.4g} s), at most "
             f"{solver.passes} passes to {solver.tolerance:g} m/s"]
    if part > SLOP:
        lines += [f"that tolerance lets tiles come into each other by {100 * part:.2g} % of their "
                  f"width in a substep, more than the {100 * SLOP:g} % that are left alone: "
                  "take a smaller one"]
    return lines


def _run(scene: Scene) -> list[str]:
    run, record = scene.run, scene.record
    return [f"{run.duration:g} s, random seed {run.seed}; a record every {record.interval:g} s, "
            f"a checkpoint every {record.checkpoint:g} s"]


def _pattern(scene: Scene) -> list[str]:
    if scene.seed is None:
        return ["no seed, so nothing to grow from"]
    if scene.magnet is None:
        return ["no magnets, so nothing grows"]
    from tbsa.work.metrics import number_of  # takes its time

    types = scene.types
    growth = ground_truth(scene)
    sites = len(growth.types) - len(growth.seed)
    at = f"at temperature {scene.temperature}"
    if growth.conflict is None:
        lines = [f"directed {at}: the seed grows by {number_of(sites, 'site')}, "
                 "to one ground truth"]
    else:
        column, row = growth.conflict.site
        rivals = " or ".join(types[k].name for k in growth.conflict.types)
        lines = [
            f"not directed {at}: site (column {column}, row {row}) can take {rivals};",
            "errors are then the attached tiles that do not match all their neighbours",
            f"(one of the patterns that can grow has {number_of(sites, 'site')} beside the seed's)",
        ]
    found = check(types, growth)
    if not found:
        return [*lines, "no wrong tile and no wrong turn could bind at a site with two neighbours"
                if sites else "no site grew at which wrong tiles and turns could be looked for"]
    head = ("in place of", "type", "turned", "glues", "matching edges", "repelled", "sites")
    rows = [
        (trap.wanted, trap.offered, f"{90 * trap.turns} deg", trap.matches, trap.arrangement,
         trap.mismatches, trap.sites)
        for trap in found[:ROWS]
    ]
    counts = np.bincount([trap.matches for trap in found], minlength=3)
    lines += [
        f"wrong tiles or turns that could bind: {counts[1]} by one glue, "
        f"{counts[2:].sum()} by two or more",
        *aligned(head, rows),
    ]
    if len(found) > ROWS:
        lines.append(f"and {len(found) - ROWS} more")
    return lines
