"""Speed: against other engines, over the number of tiles, and what each part of a scene costs.

    pip install -e ".[bench]"
    python -m tests.benchmarks.speed                       everything, 1 1/2 hours
    python -m tests.benchmarks.speed --sizes 550 2200      fewer sizes
    python -m tests.benchmarks.speed --parts start sizes   some parts only; the rest stays as saved
    python -m tests.benchmarks.speed --saved               the tables of the saved results

CPU time of one thread, compile time apart, medians and minima over windows or repeats (`start`: of
the whole process, `threads`: wall time).  Both paper scenes
first evolve at their own settings (kept in a folder, for the next call).  Settings:

    recommended   the [solver] of the scene's file
    fixed         step 1/480 s, one substep, one pass

and each with the switches of [solver] (its booleans) on and off, if it has any.  Box2D and Pymunk
take over the same evolved state, without magnets, and get the drive's forces each step.  Scenes of
other sizes have the same share of their area covered; they are placed at random and evolve for
a few seconds only, the one of 550 tiles among them too, so that sizes can be compared.  What the
unicycle drive does to a tile does not depend on the size; a shaken crowd swings from wall to wall,
and the larger the reactor, the later it is there, the faster, and the deeper it piles up.

Prints tables and writes ``tests/benchmarks/results/speed-VERSION.json``; ``python -m figures
speed`` draws it.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import pickle
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import tbsa
from figures.speed import newest
from tbsa.model.layout import Layout
from tbsa.model.records import write_atomically
from tbsa.model.scene import Free, PlacedTile, Scene, Solver, fingerprint, load
from tbsa.model.simulation import Simulation
from tbsa.work.bench import layout_of
from tbsa.work.report import aligned
from tests.benchmarks.accuracy import PAPER, RESULTS
from tests.benchmarks.peers import Box2D, Peer, Pymunk

SCENES = {"unicycle": "self_stabilizing.toml", "shaking": "shaking.toml"}
SIZES = (550, 2200, 8800, 35200, 100_000)
PEER_STEP = 1 / 240  # s
SPLIT = 0.05  # s of simulated time, so short that a scene without a part is still the same scene
REPEATS = 7
KERNELS = ("whole", "deleted")
TURNS, PROCESSES = 30, 3  # of two kernels
PARTS = ("start", "paper", "peers", "without", "deleted", "sizes", "threads")
ABSENT = {"magnets": "magnet", "wall": "reactor", "floor": "floor", "drive": "drive"}
# What has to be written otherwise in the kernels so that a part of a scene is gone from them: the
# compiler then leaves out all that comes after.
DELETED = {
    "magnets": {"advance.py": [(r"magnets\.cutoff > 0\.0 and reach > 0\.0", "False")],
                "forces.py": [(r"law\.cutoff > 0\.0", "False")]},
    "wall": {"advance.py": [(r"k\.wall != 0", "False")],
             "reach.py": [(r"k\.wall == CIRCLE", "False")],
             "rows.py": [(r"if k\.wall == 0 or", "if True or")],
             "contacts.py": [(r"if end <= pairs:", "if True:"),
                             (r"body\[t \+ LANES\] == k\.n", "False")]},
    "floor": {f"{name}.py": [(r"floor\.law", "0")]
              for name in ("advance", "gains", "solver", "sweeps")},
    "drive": {"forces.py": [(r"k\.driven != 0", "False")]},
}
Row = dict[str, Any]

# Figure: target and ambition; ratios are at least, times and sizes at most.
RATIOS = {
    ("unicycle", "on", "box2d"): (20.0, 40.0), ("unicycle", "off", "box2d"): (8.0, 12.0),
    ("shaking", "on", "box2d"): (4.0, 8.0), ("unicycle", "on", "pymunk"): (16.0, None),
    ("unicycle", "off", "pymunk"): (6.0, None), ("shaking", "on", "pymunk"): (3.0, None),
}
CAMPAIGN = {"fixed": (50.0, 25.0), "recommended": (120.0, 50.0)}  # min


# Scenes and their settings.


def settings(scene: Scene) -> Iterator[tuple[str, str, Scene]]:
    """Name of the setting, "on" or "off", and the scene with it."""
    switches = [each.name for each in fields(Solver) if each.type in ("bool", bool)]
    for name in ("fixed", "recommended"):
        solver = scene.solver
        if name == "fixed":
            solver = replace(solver, step=1 / 480, substeps=1, passes=1)
        for state in ("on", "off") if switches else ("on",):
            values = dict.fromkeys(switches, state == "on")
            yield name, state, replace(scene, solver=replace(solver, **values))


def sized(scene: Scene, tiles: int) -> Scene:
    """The scene with another number of free tiles, and seed and reactor to match.

    The arms of the cross grow like the reactor; the tiles cover the same share of it.
    """
    seed, reactor, before = scene.seed, scene.reactor, scene.free.counts
    assert seed is not None
    assert reactor is not None
    kinds = [kind for kind, _ in before]
    share = math.sqrt(tiles / sum(number for _, number in before))
    arm = round(share * max(i for i, _, _ in seed.cells))
    line = range(-arm, arm + 1)
    cells = sorted({(i, 0) for i in line} | {(0, i) for i in line})
    # The corner types of a chessboard are those of its cross.
    colour = {(i + j) % 2: kind for i, j, kind in seed.cells}
    total = sum(number for _, number in before) + len(seed.cells)
    return replace(
        scene,
        seed=replace(seed, cells=tuple((i, j, colour[(i + j) % 2]) for i, j in cells)),
        free=Free(tuple((kind, (tiles + k) // len(kinds)) for k, kind in enumerate(kinds))),
        reactor=replace(reactor, radius=reactor.radius * math.sqrt((tiles + len(cells)) / total)))


def start(scene: Scene, layout: Layout, begun: float) -> Simulation:
    """A simulation that goes on at time `begun` (s)."""
    s = Simulation(scene, layout)
    s.steps = round(begun / s.h)
    return s


def evolved(scene: Scene, seconds: float, folder: Path) -> Layout:
    """The scene after some time at its own settings; from the folder, if it is there."""
    path = folder / f"{fingerprint(scene)[:16]}-{seconds:g}.npz"
    names = [each.name for each in fields(Layout)]
    if path.exists():
        with np.load(path) as data:
            return Layout(*(data[name] for name in names))
    s = Simulation(scene)
    s.run(seconds)
    found = layout_of(s)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{name: getattr(found, name) for name in names})
    return found


def as_placed(scene: Scene, layout: Layout) -> Scene:
    """The scene with every tile placed explicitly, as other engines take it, without magnets."""
    tiles = tuple(
        PlacedTile(scene.types[kind].name, (x, y), angle, (vx, vy), omega, held=held)
        for kind, x, y, angle, vx, vy, omega, held in zip(
            *(getattr(layout, name).tolist() for name in
              ("type", "x", "y", "angle", "vx", "vy", "omega", "held")), strict=True))
    return replace(scene, seed=None, free=Free((), tiles), magnet=None,
                   solver=replace(scene.solver, step=PEER_STEP, substeps=1))


def without(scene: Scene, layout: Layout, part: str) -> Scene:
    """The scene without one of its parts, for a simulation that begins with this layout.

    Without a wall there is nothing to place random tiles in: they stand in a row, from where the
    layout takes them to their places.
    """
    less = replace(scene, **{ABSENT[part]: None})
    if less.reactor is not None:
        return less
    apart, kinds = 2.0 * scene.material.width, zip(layout.type, layout.held, strict=True)
    return replace(less, seed=None, free=Free((), tuple(
        PlacedTile(scene.types[kind].name, (apart * i, 0.0), held=bool(held))
        for i, (kind, held) in enumerate(kinds))))


# Measurements.


def windows_of(work: Callable[[], float], windows: int) -> Row:
    """Median and minimum of a cost over windows, after one that does not count."""
    work()
    costs = [work() for _ in range(windows)]
    return {"median": statistics.median(costs), "least": min(costs), "windows": windows}


def clock(s: Simulation, steps: int) -> float:
    """CPU time (s) of some steps."""
    begin = time.thread_time()
    s.advance(steps)
    return time.thread_time() - begin


def start_rows(_: argparse.Namespace) -> list[Row]:
    """Cold compile, and the cached start to the first step, each in a process of its own (s)."""
    code = ("import sys, time; begin = time.perf_counter(); import tbsa; "
            "s = tbsa.Simulation(tbsa.load(sys.argv[1])); s.advance(1); "
            "print(time.perf_counter() - begin)")
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"TBSA_CACHE_DIR": folder}
        # A tile in a reactor needs all kernels; a short placement, which is another matter.
        scene = Path(folder) / "scene.toml"
        scene.write_text('[tiles]\nset = "chessboard"\n[magnet]\n[floor]\n'
                         '[reactor]\nshape = "circle"\nradius = 0.1\n'
                         '[drive]\nkind = "shaking"\nforce = 0.1\nfrequency = 1.0\n'
                         '[[free.tile]]\ntype = "black"\nposition = [0, 0]\n'
                         '[[free.tile]]\ntype = "white"\nposition = [0.031, 0]\n'
                         "[run]\nduration = 1\n")

        def once() -> tuple[float, float]:
            before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run([sys.executable, "-c", code, str(scene)], env=environment, check=True,
                           stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return time.perf_counter() - begin, (after.ru_utime + after.ru_stime
                                                 - before.ru_utime - before.ru_stime)

        cold, cached = once(), [once() for _ in range(5)]
    return [{"part": "start", "what": "cold", "wall": cold[0], "cpu": cold[1]},
            {"part": "start", "what": "cached", "wall": min(wall for wall, _ in cached),
             "cpu": min(cpu for _, cpu in cached)}]


def paper_rows(arguments: argparse.Namespace) -> list[Row]:
    """CPU time for a second of simulated time, over windows of a period of the drive."""
    rows = []
    for name, scene, layout in both(arguments):
        for setting, switches, with_it in settings(scene):
            s = start(with_it, layout, arguments.evolve)
            steps = round(period(scene) / s.h)

            def window(s: Simulation = s, steps: int = steps) -> float:
                return clock(s, steps) / (steps * s.h)

            found = windows_of(window, arguments.windows)
            rows.append({
                "part": "paper", "scene": name, "setting": setting, "skips": switches, **found,
                "tiles": layout.x.size, "step": s.h, "substeps": with_it.solver.substeps,
                "passes": with_it.solver.passes, "evolved": arguments.evolve,
                "deepest": float(s.counts.deepest[0]) / scene.material.width,
                "deep": float(s.counts.overlap[2:].sum() / s.counts.overlap.sum())})
    return rows


def peers_rows(arguments: argparse.Namespace) -> list[Row]:
    """The same for the other engines: inside their step, and with the Python that a step needs."""
    rows = []
    makes: dict[str, Callable[[Scene], Peer]] = {
        "box2d": lambda scene: Box2D(scene, 100.0, 8, 3), "pymunk": lambda scene: Pymunk(scene, 10)}
    for name, scene, layout in both(arguments):
        for engine, make in makes.items():
            peer = make(as_placed(scene, layout))
            peer.done = round(arguments.evolve / PEER_STEP)  # the drive goes on where it was
            steps, whole = round(period(scene) / PEER_STEP), []

            def window(peer: Peer = peer, steps: int = steps,
                       whole: list[float] = whole) -> float:
                alone, begin = 0.0, time.thread_time()
                for _ in range(steps):
                    peer.apply(*peer.loads())
                    inside = time.thread_time()
                    peer.step()
                    alone += time.thread_time() - inside
                    peer.after()
                    peer.done += 1
                whole.append((time.thread_time() - begin) / (steps * PEER_STEP))
                return alone / (steps * PEER_STEP)

            found = windows_of(window, arguments.windows)
            rows.append({"part": "peers", "scene": name, "engine": engine, "step": PEER_STEP,
                         **found, "with_python": statistics.median(whole[1:]),
                         "evolved": arguments.evolve})
    return rows


def without_rows(arguments: argparse.Namespace) -> list[Row]:
    """CPU time of a step of the evolved scene, whole and without a part of it; least of a few."""
    rows = []
    for name, scene, layout in both(arguments):
        for setting, switches, with_it in settings(scene):
            for part in ("nothing", *ABSENT):
                less = with_it if part == "nothing" else without(with_it, layout, part)
                costs = []
                for _ in range(REPEATS):
                    s = start(less, layout, arguments.evolve)
                    s.advance(2)  # lists and impulses are there
                    steps = max(round(SPLIT / s.h), 1)
                    costs.append(clock(s, steps) / steps)
                rows.append({"part": "without", "scene": name, "setting": setting,
                             "skips": switches, "without": part, "median":
                             statistics.median(costs), "least": min(costs)})
    return rows


def deleted_rows(arguments: argparse.Namespace) -> list[Row]:
    """CPU time of a step of scenes that lack a part, by the kernels and by kernels from which that
    part has been deleted: two processes by turns, a few times.  Where a process happens to lie in
    memory, and what else the machine does, is worth more than what is measured."""
    rows, root = [], Path(tbsa.__file__).parent
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ABSENT:
            cases = folder / part
            cases.mkdir()
            for scene_name, scene, layout in both(arguments):
                for setting, switches, with_it in settings(scene):
                    if switches == "on":
                        less = without(with_it, layout, part)
                        (cases / f"{scene_name} {setting}").write_bytes(
                            pickle.dumps((less, layout)))
            for kernels in KERNELS:
                shutil.copytree(root, folder / f"{part} {kernels}" / "tbsa")
            for file, changes in DELETED[part].items():
                path = folder / f"{part} deleted" / "tbsa" / "kernels" / file
                text = path.read_text()
                for pattern, instead in changes:
                    text, times = re.subn(pattern, instead, text)
                    assert times > 0, f"{file} has no {pattern}"
                path.write_text(text)
            costs: dict[str, list[list[float]]] = {each.name: [] for each in cases.iterdir()}
            for _ in range(PROCESSES):
                with ExitStack() as both_run:
                    clocks = [both_run.enter_context(Clock(
                        folder / f"{part} {kernels}", cases, arguments.evolve, folder / "cache"))
                        for kernels in KERNELS]
                    for case, found in costs.items():
                        found += [[each.ask(case) for each in clocks] for _ in range(TURNS)]
            for case, found in costs.items():
                scene_name, setting = case.split()
                whole, deleted = (statistics.median(column) for column in zip(*found, strict=True))
                rows.append({"part": "deleted", "scene": scene_name, "setting": setting,
                             "without": part, "whole": whole, "deleted": deleted, "ratio":
                             statistics.median(with_it / less for with_it, less in found)})
    return rows


class Clock(AbstractContextManager["Clock"]):
    """A process with the kernels of a folder, that times a step of any of these cases."""

    def __init__(self, kernels: Path, cases: Path, begun: float, cache: Path) -> None:
        # Not the folder that Python is started in: that has the package, too.
        where = os.pathsep.join([str(kernels), str(Path(tbsa.__file__).parent.parent)])
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", "import sys; from tests.benchmarks import speed; "
             "speed.clock_cases(sys.argv[1], float(sys.argv[2]))", str(cases), str(begun)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": where, "TBSA_CACHE_DIR": str(cache)})

    def ask(self, case: str) -> float:
        """CPU time (s) of a step."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(case, file=self.process.stdin, flush=True)
        return float(self.process.stdout.readline())

    def __exit__(self, *_: object) -> None:
        self.process.communicate()


def clock_cases(folder: str, begun: float) -> None:
    """Print the CPU time (s) of a step of the scene and layout of a folder that are asked for, as
    often as they are."""
    for line in sys.stdin:
        scene, layout = pickle.loads((Path(folder) / line.strip()).read_bytes())
        s = start(scene, layout, begun)
        s.advance(2)  # lists and impulses are there
        steps = max(round(SPLIT / s.h), 1)
        print(clock(s, steps) / steps, flush=True)


def sizes_rows(arguments: argparse.Namespace) -> list[Row]:
    """CPU time per tile and substep, and memory, over the number of tiles."""
    rows = []
    for name, file in SCENES.items():
        for tiles in sorted(arguments.sizes):
            scene = sized(load(PAPER / file), tiles)
            layout = evolved(scene, arguments.settle, arguments.cache)
            for setting, switches, with_it in settings(scene):
                # In a process of its own, for its peak of memory.
                with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
                    found = alone.submit(size_row, with_it, layout, arguments).result()
                rows.append({"part": "sizes", "scene": name, "tiles": tiles, "setting": setting,
                             "skips": switches, "settled": arguments.settle,
                             "span": arguments.span, **found})
    return rows


def size_row(scene: Scene, layout: Layout, arguments: argparse.Namespace) -> Row:
    """Cost of a tile and substep (s), and memory (bytes), of a process that does nothing else."""
    s, total = start(scene, layout, arguments.settle), layout.x.size
    steps = max(round(arguments.span / s.h), 1)
    work = steps * scene.solver.substeps * total
    first, begun = int(s.counts.substeps[0]), s.steps
    found = windows_of(lambda: clock(s, steps) / work, arguments.windows)
    # Of those that the scene asks for: halved where tiles spin fast, joined where it is calm.
    done = (int(s.counts.substeps[0]) - first) / ((s.steps - begun) * scene.solver.substeps)
    return {**found, "done": done, "total": total, "bytes": array_bytes(s) / total,
            "peak": peak_memory()}


def peak_memory() -> int:
    """Most memory (bytes) that this process has had at a time, without that of its parent, which
    what the system counts as its own begins with."""
    try:
        status = Path("/proc/self/status").read_text()
        return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) * 1024
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def threads_rows(arguments: argparse.Namespace) -> list[Row]:
    """Wall time of a step of the largest size by one thread and by two, by turns; same bits."""
    rows, tiles = [], max(arguments.sizes)
    scene = sized(load(PAPER / SCENES["shaking"]), tiles)
    layout = evolved(scene, arguments.settle, arguments.cache)
    for setting, switches, with_it in settings(scene):
        if switches != "on":
            continue
        runs = [Simulation(with_it, layout, threads=threads) for threads in (1, 2)]
        costs: list[list[float]] = [[], []]
        steps = max(round(arguments.span / runs[0].h), 1)
        for s in runs:
            s.steps = round(arguments.settle / s.h)
        for _ in range(arguments.windows + 1):  # the first does not count
            for s, found in zip(runs, costs, strict=True):
                begin = time.perf_counter()
                s.advance(steps)
                found.append((time.perf_counter() - begin) / steps)
        for one, two in zip(runs[0].state[:-1], runs[1].state[:-1], strict=True):
            assert (one == two).all()
        rows += [{"part": "threads", "tiles": tiles, "setting": setting, "threads": threads,
                  "median": statistics.median(found[1:]), "least": min(found[1:])}
                 for threads, found in zip((1, 2), costs, strict=True)]
    return rows


def both(arguments: argparse.Namespace) -> Iterator[tuple[str, Scene, Layout]]:
    """The paper's scenes, evolved."""
    for name, file in SCENES.items():
        scene = load(PAPER / file)
        yield name, scene, evolved(scene, arguments.evolve, arguments.cache)


def period(scene: Scene) -> float:
    """Of its drive (s)."""
    assert scene.drive is not None
    return 1.0 / scene.drive.frequency


def array_bytes(s: Simulation) -> int:
    """Memory of all arrays that a simulation holds (bytes), views counted once."""
    seen: dict[int, int] = {}

    def visit(value: object) -> None:
        if isinstance(value, np.ndarray):
            while isinstance(value.base, np.ndarray):
                value = value.base
            seen[id(value)] = value.nbytes
        elif isinstance(value, tuple):
            for each in value:
                visit(each)

    for value in vars(s).values():
        visit(value)
    return sum(seen.values())


# Tables.


def of(rows: Sequence[Row], **values: Any) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row.get(key) == value for key, value in values.items())]


def ratios(rows: Sequence[Row]) -> list[Row]:
    """Every figure that has a target: its value, and whether it is reached.

    Ratios are of medians: simulated seconds per CPU second, ours with magnets over theirs, engine
    alone and without magnets.
    """
    found = []

    def add(figure: str, setting: str, value: float, target: float | None,
            ambition: float | None, most: bool) -> None:
        reached = None if target is None else value <= target if most else value >= target
        found.append({"figure": figure, "setting": setting, "value": value, "target": target,
                      "ambition": ambition, "most": most, "reached": reached})

    for setting in ("fixed", "recommended"):
        for (scene, skips, engine), (target, ambition) in RATIOS.items():
            for ours in of(rows, part="paper", scene=scene, skips=skips, setting=setting):
                for theirs in of(rows, part="peers", scene=scene, engine=engine):
                    add(f"{scene}, skips {skips}, against {engine}", setting,
                        theirs["median"] / ours["median"], target, ambition, False)
    for setting in ("fixed", "recommended"):
        for scene in SCENES:  # the last of a size has its switches off
            last = {row["tiles"]: row
                    for row in of(rows, part="sizes", scene=scene, setting=setting)}
            if 550 in last and 35200 in last:
                add(f"{scene}, 35200 tiles against 550, a tile and substep", setting,
                    last[35200]["median"] / last[550]["median"], 1.4, 1.1, True)
                if "done" in last[550] and "done" in last[35200]:
                    add(f"{scene}, the same, of those that are done", setting,
                        last[35200]["median"] / last[35200]["done"]
                        / (last[550]["median"] / last[550]["done"]), 1.4, 1.1, True)
            if 100_000 in last:
                add(f"{scene}, 100000 tiles, peak memory (GB)", setting,
                    last[100_000]["peak"] / 1e9, 1.0, None, True)
        costs = [row["median"] for scene in SCENES
                 for row in of(rows, part="paper", scene=scene, setting=setting, skips="on")]
        if len(costs) == len(SCENES):
            add("72 runs of 3600 s, 2 processes (min)", setting,
                sum(costs) * 36 * 3600.0 / 2 / 60.0, *CAMPAIGN[setting], True)
    for part in ABSENT:
        for row in of(rows, part="deleted", without=part):
            add(f"{row['scene']} without {part}, against kernels without", row["setting"],
                row["ratio"], 1.03, 1.0, True)
    for one in of(rows, part="threads", threads=1):
        for two in of(rows, part="threads", threads=2, setting=one["setting"]):
            add(f"{one['tiles']} tiles, two threads against one", one["setting"],
                one["median"] / two["median"], 1.5, 1.8, False)
    for what, name, target, ambition in (("cold", "cold compile (s)", 25.0, 12.0),
                                         ("cached", "cached start to first step (s)", 1.0, 0.5)):
        for row in of(rows, part="start", what=what):
            add(name, "", row["wall"], target, ambition, True)
    return found


def split(rows: Sequence[Row]) -> list[list[str]]:
    """What each part of a scene costs of a step: whole less without it (us, and share)."""
    lines = []
    for whole in of(rows, part="without", without="nothing"):
        key = {name: whole[name] for name in ("scene", "setting", "skips")}
        less = {row["without"]: row["least"] for row in of(rows, part="without", **key)}
        rest, cells = whole["least"], []
        for part in ABSENT:
            cost = whole["least"] - less[part]
            rest -= cost
            cells.append(f"{1e6 * cost:.3g} ({100 * cost / whole['least']:.0f} %)")
        lines.append([*key.values(), f"{1e6 * whole['least']:.4g}", *cells, f"{1e6 * rest:.4g}"])
    return lines


def tables(rows: Sequence[Row]) -> str:
    """All results as text."""
    parts = []
    ours = [[row["scene"], row["setting"], row["skips"], f"1/{1 / row['step']:.0f}",
             str(row["substeps"]), str(row["passes"]), f"{1e3 * row['median']:.3g}",
             f"{1e3 * row['least']:.3g}", f"{1 / row['median']:.1f}",
             f"{1e6 * row['median'] * row['step'] / row['substeps']:.3g}",
             f"{100 * row['deepest']:.2g} %", f"{100 * row['deep']:.2g} %"]
            for row in of(rows, part="paper")]
    if ours:
        parts.append(aligned(("scene", "setting", "skips", "step s", "substeps", "passes",
                              "ms CPU for 1 s", "least", "x real time", "us a substep",
                              "deepest overlap", "time beyond 0.1 %"), ours))
    theirs = [[row["scene"], row["engine"], f"{1e3 * row['median']:.3g}",
               f"{1e3 * row['least']:.3g}", f"{1 / row['median']:.1f}",
               f"{1e6 * row['median'] * row['step']:.3g}", f"{1e3 * row['with_python']:.3g}"]
              for row in of(rows, part="peers")]
    if theirs:
        parts.append(aligned(("scene", "engine", "ms CPU for 1 s", "least", "x real time",
                              "us a step", "with its Python, ms for 1 s"), theirs))
    if lines := split(rows):
        parts.append(aligned(("scene", "setting", "skips", "us a step",
                              *(f"less without {part}" for part in ABSENT), "rest"), lines))
    sizes = [[row["scene"], str(row["tiles"]), row["setting"], row["skips"],
              f"{1e9 * row['median']:.3g}", f"{1e9 * row['least']:.3g}",
              f"{row['done']:.3g}" if "done" in row else "", f"{row['bytes']:.0f}",
              f"{row['peak'] / 1e6:.0f}"]
             for row in of(rows, part="sizes")]
    if sizes:
        parts.append(aligned(("scene", "tiles", "setting", "skips", "ns a tile and substep",
                              "least", "substeps done", "bytes a tile", "peak memory MB"), sizes))
    verdicts = {True: "yes", False: "NO", None: ""}
    figures = [[row["figure"], row["setting"], f"{row['value']:.3g}",
                *("" if row[name] is None else f"{'<=' if row['most'] else '>='} {row[name]:g}"
                  for name in ("target", "ambition")), verdicts[row["reached"]]]
               for row in ratios(rows)]
    if figures:
        parts.append(aligned(("figure", "setting", "value", "target", "ambition", "reached"),
                             figures))
    return "\n\n".join("\n".join(part) for part in parts)


def saved(path: Path) -> list[Row]:
    """The rows of a file of results; none if it is not there."""
    rows: list[Row] = json.loads(path.read_text())["rows"] if path.exists() else []
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.speed",
                                     description="Speed of the simulator and of its peers.")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="(default: all)")
    parser.add_argument("--sizes", nargs="+", type=int, default=SIZES, metavar="N")
    parser.add_argument("--evolve", type=float, default=300.0, metavar="S",
                        help="simulated seconds of the paper's scenes before (default: 300)")
    parser.add_argument("--settle", type=float, default=4.0, metavar="S",
                        help="the same for the scenes of all sizes (default: 4)")
    parser.add_argument("--span", type=float, default=0.25, metavar="S",
                        help="simulated seconds of a window there (default: 0.25)")
    parser.add_argument("--windows", type=int, default=5, metavar="N", help="(default: 5)")
    parser.add_argument("--cache", type=Path, metavar="DIR",
                        default=Path(tempfile.gettempdir()) / "tbsa-evolved",
                        help="folder of the evolved states")
    parser.add_argument("--out", type=Path, metavar="JSON", help="(default: by this version)")
    parser.add_argument("--saved", action="store_true", help="the tables of the saved results")
    arguments = parser.parse_args(argv)
    out = arguments.out or (newest(RESULTS) if arguments.saved
                            else RESULTS / f"speed-{tbsa.__version__}.json")
    rows = saved(out)
    if not arguments.saved:
        measure = {"start": start_rows, "paper": paper_rows, "peers": peers_rows,
                   "without": without_rows, "deleted": deleted_rows, "sizes": sizes_rows,
                   "threads": threads_rows}
        Simulation(load(PAPER / SCENES["shaking"])).advance(1)  # compiled before anything is timed
        for part in arguments.parts:
            begin = time.perf_counter()
            rows = [row for row in rows if row["part"] != part] + measure[part](arguments)
            rows.sort(key=lambda row: PARTS.index(row["part"]))
            lines = ",\n".join(map(json.dumps, rows))
            write_atomically(out, (f'{{"version": "{tbsa.__version__}", "rows": [\n'
                                   f"{lines}\n]}}\n").encode())
            print(f"{part}: {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    print(tables(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
