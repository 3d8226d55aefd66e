"""Run time against error.

    python -m tests.benchmarks.accuracy                     reference scenes, minutes
    python -m tests.benchmarks.accuracy slide snap-flush    some of them
    python -m tests.benchmarks.accuracy --slow              with all blocks and the creep, an hour
    python -m tests.benchmarks.accuracy --paper 20          both paper scenes for 20 s
    python -m tests.benchmarks.accuracy --statistics 600    12 seeds at h, h/2, h/4, many hours

prints tables and, unless scenes are named, writes them to ``tests/benchmarks/results/`` under the
version of the package.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import tbsa
from tbsa.errors import InputError
from tbsa.kernels import advance as core
from tbsa.kernels.jit import entry
from tbsa.model.scene import Scene
from tbsa.model.simulation import Simulation, SimulationError
from tbsa.work.metrics import size
from tbsa.work.report import aligned
from tests.benchmarks.invariants import Watch
from tests.benchmarks.scenes import (
    STEPS,
    Reference,
    at_step,
    larger,
    references,
)

RESULTS = Path(__file__).parent / "results"
PAPER = Path(__file__).parents[2] / "paper_runs"
LOOSE = 0.1  # m/s, about a pass or two
# s, at which only ours is run: longer ones, and ones between, as errors grow with the step's square
COARSE = tuple(1 / n for n in (10, 20, 30, 40, 50, 70, 80))
BETWEEN = tuple(1 / n for n in (180, 260, 360))
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-9, 1e-12, 1e-14)  # m/s
PASSES = (8, 40, 1000)
TARGET = 1 / 480  # s, the step at which errors are judged
Row = dict[str, Any]


def clock(scene: Scene, seconds: float, *, least: float = 0.05) -> tuple[float, float]:
    """Wall time (s) of `seconds` of simulated time: of the kernels alone, and in all.

    The best of several runs from the same start in the same memory, as the other engines' worlds
    are in memory when their clocks start.  One call from Python does all steps.  The first figure
    is that of the compiled function, less what it takes to be called for no step at all.
    """
    s = Simulation(scene)
    start = [array.copy() for array in s.state[:-1]]  # all but the impulses
    steps = round(seconds / scene.solver.step)
    advance: Any = None

    def kernel(count: int) -> None:
        advance(s.state, s.tiles, s.numbers, s.magnets, s.floor, s.engine, s.parameters,
                s._work, s.counts, 0, count, s._reach)

    def best(call: Callable[[int], object], *counts: int) -> list[float]:
        """By turns, as the clock of a machine may change meanwhile."""
        found, spent, runs = [math.inf] * len(counts), 0.0, 0
        while spent < least or runs < 2:
            for k, count in enumerate(counts):
                for array, value in zip(s.state[:-1], start, strict=True):
                    array[:] = value
                s.state.impulses.size[:] = s.steps = 0
                begin = time.perf_counter()
                call(count)
                took = time.perf_counter() - begin
                found[k], spent = min(found[k], took), spent + max(took, 1e-5)
            runs += 1
        return found

    (whole,) = best(s.advance, steps)  # first: it finds the space that the scene needs
    advance = entry(core.advance)
    alone, none = best(kernel, steps, 0)
    return max(alone - none, 0.01 * alone), whole


def sweep(reference: Reference) -> list[Row]:
    """Errors and run times of one scene over steps, substeps, tolerance and passes."""
    default = reference.scene.solver
    usual, most = (default.tolerance, default.passes), 5000
    coarse, between = (
        tuple(h for h in steps if not reference.slow
              and math.isclose(round(reference.duration / h) * h, reference.duration))
        for steps in (COARSE, BETWEEN))
    cases = [(h, 4, *usual) for h in coarse + reference.steps]
    if not reference.slow or len(reference.steps) == 1:  # few cases are cheap in slow ones, too
        cases += [(h, 1, *effort) for h in coarse + reference.steps
                  for effort in (usual, (LOOSE, default.passes), (LOOSE, 2))]
    if reference.steps == STEPS:
        cases += [(h, 1, tolerance, most) for h in coarse + reference.steps
                  for tolerance in (default.tolerance, *TOLERANCES[-3:])]
        cases += [(h, substeps, LOOSE, default.passes) for h in coarse for substeps in (2, 3)]
        cases += [(h, 2, LOOSE, default.passes) for h in between]
        cases += [(TARGET, 16, *usual)]
        cases += [(TARGET, 4, tolerance, most) for tolerance in TOLERANCES]
        cases += [(TARGET, 4, 1e-9, passes) for passes in PASSES]
    else:  # blocks, where that would take an hour
        cases += [(TARGET, 4, tolerance, 1000) for tolerance in TOLERANCES[1:4]]
        cases += [(h, substeps, tolerance, default.passes) for h in coarse for substeps in (1, 2)
                  for tolerance in (default.tolerance, *TOLERANCES[:2])]
    rows = []
    for h, substeps, tolerance, passes in cases:
        scene = at_step(reference.scene, h, substeps=substeps, tolerance=tolerance, passes=passes)
        try:
            errors = reference.measure(Simulation, scene)
            alone, whole = clock(scene, reference.duration)
        except (InputError, SimulationError):  # too coarse a step
            continue
        rows.append({
            "scene": reference.name, "engine": "tbsa", "step": h, "substeps": substeps,
            "tolerance": tolerance, "passes": passes,
            "errors": {name: float(value) for name, value in errors.items()},
            "alone": alone, "seconds": whole, "simulated": reference.duration,
        })
    return rows


def order(rows: Iterable[Row], quantity: str) -> float:
    """Slope of log error over log step between 1/120 and 1/960 s, by least squares."""
    points = [(math.log(row["step"]), math.log(row["errors"][quantity])) for row in rows
              if 1 / 961 < row["step"] < 1 / 119 and row["errors"][quantity] > 0.0]
    if len(points) < 2:
        return math.nan
    h, error = np.array(points).T
    return float(np.polyfit(h, error, 1)[0])


def summary(reference: Reference, rows: Sequence[Row]) -> list[list[str]]:
    """A line for every quantity: errors over the steps, order, target, reached or not."""
    default = reference.scene.solver
    steps = [row for row in rows if (row["tolerance"], row["passes"], row["substeps"])
             == (default.tolerance, default.passes, 4)]
    lines = []
    for quantity in steps[0]["errors"]:
        target = reference.targets.get(quantity)
        by_step = {round(1 / row["step"]): row["errors"][quantity] for row in steps}
        verdict = "-"
        if target is not None and round(1 / TARGET) in by_step:
            verdict = "yes" if by_step[round(1 / TARGET)] <= target else "NO"
        lines.append([reference.name, quantity,
                      *(f"{by_step[n]:.1e}" if n in by_step else "" for n in
                        (round(1 / h) for h in STEPS)),
                      f"{order(steps, quantity):.2f}", f"{target:g}" if target else "-", verdict])
    times = {round(1 / row["step"]): row["alone"] / row["simulated"] for row in steps}
    lines.append(["", "run time s/s", *(f"{times[n]:.1e}" if n in times else "" for n in
                                        (round(1 / h) for h in STEPS)), "", "", ""])
    return lines


HEAD = ("scene", "error", *(f"1/{round(1 / h)}" for h in STEPS), "order", "target", "reached")


def save(name: str, rows: Any) -> Path:
    """Put a table of this version into the file of that name; other versions stay."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    found = json.loads(path.read_text()) if path.exists() else {}
    found[tbsa.__version__] = rows
    versions = [f'"{version}": [\n' + ",\n".join(map(json.dumps, each)) + "\n]"
                for version, each in found.items()]
    path.write_text("{\n" + ",\n".join(versions) + "\n}\n")
    return path


def reference_table(names: Sequence[str], slow: bool) -> int:
    """Sweep the reference scenes; returns 1 where one misses a target."""
    chosen = references()
    if slow:
        chosen += larger()
    if names:
        unknown = set(names) - {each.name for each in chosen}
        if unknown:
            raise SystemExit(f"no scene {', '.join(sorted(unknown))}; there are "
                             f"{', '.join(each.name for each in chosen)}")
        chosen = [each for each in chosen if each.name in names]
    rows, lines = [], []
    Simulation(chosen[0].scene).advance(1)  # compiled before anything is timed
    for each in chosen:
        found = sweep(each)
        rows += found
        lines += summary(each, found)
        print(f"\r{each.name:40s}", end="", file=sys.stderr, flush=True)
    print("\r" + 40 * " " + "\r", end="", file=sys.stderr)
    print("\n".join(aligned(HEAD, lines)))
    missed = [line for line in lines if line[-1] == "NO"]
    print(f"\n{sum(line[-1] == 'yes' for line in lines)} targets reached at 1/480 s, "
          f"{len(missed)} missed")
    if not names:
        print(f"written to {save('accuracy', rows)}")
    return 1 if missed else 0


# The paper's scenes.


def paper_scenes() -> dict[str, Scene]:
    """Both drives."""
    return {name: tbsa.load(PAPER / f"{name}.toml") for name in ("self_stabilizing", "shaking")}


def short_horizon(scene: Scene, seconds: float, parts: int = 32) -> float:
    """Root mean square distance (widths) after `seconds` from a run at 1/`parts` of the step."""
    ends = []
    for share in (1, parts):
        s = Simulation(replace(scene, solver=replace(scene.solver,
                                                     step=scene.solver.step / share)))
        s.run(seconds)
        ends.append(np.stack([s.x, s.y]))
    return float(np.sqrt(((ends[0] - ends[1]) ** 2).sum(axis=0).mean())) / scene.material.width


def paper_table(seconds: float) -> int:
    """Invariants of the paper's scenes over steps and passes, and their short horizon."""
    rows, lines = [], []
    for name, paper in paper_scenes().items():
        for share in (1, 2, 4):
            solver = replace(paper.solver, step=paper.solver.step / share)
            scene = replace(paper, solver=solver)
            watch = Watch(Simulation(scene), every=share)
            start = time.perf_counter()
            watch.advance(round(seconds / watch.simulation.h))
            depths = np.array(watch.depths)
            row = {
                "scene": name, "step": watch.simulation.h, "seconds": seconds,
                "overlap": watch.overlap, "beyond half a per cent": float((depths > 5e-3).mean()),
                "beyond 2 per cent": float((depths > 2e-2).mean()), "outside": watch.outside,
                "cone": watch.cone, "gap": watch.gap, "energy": watch.energy,
                "horizon": [short_horizon(scene, t) for t in (0.25, 0.5)],
                "wall": clock(scene, min(seconds, 5.0), least=0.1)[1],
                "looked": time.perf_counter() - start,
            }
            rows.append(row)
            lines.append([name, f"1/{1 / row['step']:.0f}", f"{100 * row['overlap']:.2g}",
                          f"{100 * row['beyond half a per cent']:.2g}",
                          f"{100 * row['beyond 2 per cent']:.2g}", f"{100 * row['outside']:.2g}",
                          f"{row['cone']:.1e}", f"{row['gap']:.1e}", f"{row['energy']:.1e}",
                          *(f"{value:.1e}" for value in row["horizon"]),
                          f"{row['wall'] / min(seconds, 5.0):.2f}"])
            print("\n".join(aligned(PAPER_HEAD, lines[-1:])), flush=True)
    print()
    print("\n".join(aligned(PAPER_HEAD, lines)))
    print(f"written to {save('paper', rows)}")
    return 0


PAPER_HEAD = ("scene", "step", "deepest % w", "> 0.5 %, % of steps", "> 2 %", "outside % w",
              "cone", "gap", "energy gained", "off after 0.25 s, w", "0.5 s", "run time s/s")


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean and half width of its 95 % confidence interval (Student)."""
    from scipy.stats import t

    n = len(values)
    spread = float(np.std(values, ddof=1)) if n > 1 else math.nan
    return float(np.mean(values)), float(t.ppf(0.975, n - 1)) * spread / math.sqrt(n)


def statistics(seconds: float, seeds: int) -> int:
    """Mean size of the assembly over seeds at h, h/2 and h/4, with confidence intervals."""
    rows, lines = [], []
    for name, paper in paper_scenes().items():
        for share in (1, 2, 4):
            sizes = []
            for seed in range(1, seeds + 1):
                solver = replace(paper.solver, step=paper.solver.step / share)
                scene = replace(paper, solver=solver, run=replace(paper.run, seed=seed))
                s = Simulation(scene)
                s.run(seconds)
                sizes.append(int(size(scene, s.layout, s.x, s.y, s.angle)))
                print(f"\r{name} h/{share} seed {seed}: {sizes[-1]}   ", end="",
                      file=sys.stderr, flush=True)
            mean, half = interval(sizes)
            rows.append({"scene": name, "step": s.h, "seconds": seconds, "sizes": sizes,
                         "mean": mean, "half": half})
            lines.append([name, f"1/{1 / s.h:.0f}", f"{mean:.1f} +- {half:.1f}"])
    print()
    print("\n".join(aligned(("scene", "step", f"size after {seconds:g} s, mean of {seeds}"),
                            lines)))
    print(f"written to {save('statistics', rows)}")
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.accuracy",
                                     description="Run time against error.")
    parser.add_argument("scene", nargs="*", help="reference scenes (default: all)")
    parser.add_argument("--slow", action="store_true", help="with every block and 600 s of creep")
    parser.add_argument("--paper", type=float, metavar="S", help="the paper's scenes for S seconds")
    parser.add_argument("--statistics", type=float, metavar="S",
                        help="sizes of the paper's scenes after S seconds")
    parser.add_argument("--seeds", type=int, default=12, help="of the statistics (default: 12)")
    arguments = parser.parse_args(argv)
    if arguments.paper is not None:
        return paper_table(arguments.paper)
    if arguments.statistics is not None:
        return statistics(arguments.statistics, arguments.seeds)
    return reference_table(arguments.scene, arguments.slow)


if __name__ == "__main__":
    sys.exit(main())
