"""What ``tbsa bench`` recommends, and the arithmetic of the benchmark tables."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from scenes import CHESSBOARD, SLIDING, WIDTH, scene, tile

from tbsa.errors import InputError
from tbsa.model.scene import (
    Drive,
    Floor,
    Free,
    Magnet,
    Material,
    Reactor,
    Record,
    Scene,
    Seed,
    Solver,
    dumps,
    parse,
)
from tbsa.model.simulation import Simulation
from tbsa.work.bench import Trial, bench, describe, layout_of, recommend
from tbsa.work.bench import _overlap as new_overlap
from tbsa.work.bench import _run as trial_run
from tbsa.work.cli import main
from tests.benchmarks import accuracy, peers
from tests.benchmarks.scenes import references

SETTING = Solver()


def driven():
    """A tile under the unicycle drive and one that is pushed by it; 4 substeps of 1/480 s."""
    return scene([tile(0, 0), tile(0, 1.5 * WIDTH, 0.3)], body=Material(), floor=Floor(),
                 drive=Drive("unicycle", 3 * SLIDING, 1e-3, 0.5), tolerance=3e-4, passes=40,
                 reactor=Reactor("circle", 0.2))


@pytest.fixture(scope="module")
def trials():
    return bench(driven(), after=0.25, horizon=0.125)  # short: the order shows


def test_shorter_substeps_come_nearer_to_the_finest_run(trials):
    error = {}
    for trial in trials:
        h = trial.solver.step / trial.solver.substeps
        if trial.solver.tolerance == pytest.approx(3e-4):
            error[h] = trial.deviation
    steps = sorted(error)
    assert len(steps) == 5
    assert steps[-1] == pytest.approx(16 * steps[0])
    assert error[steps[-1]] > 100 * error[steps[0]] > 0.0


def test_trials_come_in_the_order_of_their_cost(trials):
    costs = [trial.cost for trial in trials]
    assert costs == sorted(costs)
    assert costs[0] > 0.0


def test_the_cheapest_that_is_exact_enough_is_recommended():
    trials = [Trial(SETTING, 0.1, 0.0, 1.0), Trial(SETTING, 1e-3, 1e-2, 2.0),
              Trial(SETTING, 1e-3, 1e-3, 4.0), Trial(SETTING, 1e-5, 1e-5, 3.0)]
    assert recommend(trials, 0.5) is trials[0]
    assert recommend(trials, 1e-2) is trials[1]
    assert recommend(trials, 5e-3) is trials[3]
    assert recommend(trials, 1e-6) is None
    assert "the least is 1e-05" in describe(trials, 1e-6)


def test_of_what_costs_the_same_the_most_exact_is_recommended():
    """Costs that differ by less than a tenth a clock does not tell apart."""
    trials = [Trial(SETTING, 1e-3, 0.0, 1.0), Trial(SETTING, 1e-5, 0.0, 1.08),
              Trial(SETTING, 1e-7, 0.0, 1.15), Trial(SETTING, 0.5, 0.0, 0.2)]
    assert recommend(trials, 1e-2) is trials[1]
    assert recommend(trials, 1e-6) is trials[2]
    assert recommend(trials, 1.0) is trials[3]


def test_tolerances_are_tried_as_one_would_write_them(trials):
    for trial in trials:
        assert trial.solver.tolerance == float(f"{trial.solver.tolerance:.12g}")


def test_only_steps_that_the_scene_takes_are_tried():
    scene = replace(driven(), record=Record(3 / 480, 3 / 480))
    steps = {trial.solver.step for trial in bench(scene, after=0.25, horizon=0.01)}
    assert sorted(480 * step for step in steps) == pytest.approx([0.25, 0.5, 1.0])


def test_trials_begin_and_end_together_whatever_the_step():
    """0.03 s and 0.25 s are no whole number of steps of 0.02 s, the longest that is tried."""
    lone = scene([tile(0, 0, vx=0.1)], step=0.01, drive=Drive("shaking", 1e-3, 0.0, 1.0))
    trials = bench(lone, after=0.03, horizon=0.25)
    assert max(trial.solver.step for trial in trials) == 0.02
    assert max(trial.deviation for trial in trials) < 2e-3


def test_where_no_trial_can_be_followed_it_says_so():
    assert "cannot be followed" in describe([], 1e-2)


def test_the_recommended_solver_can_be_pasted_into_a_scene(trials):
    text = describe(trials, 0.1)
    part = text[text.index("[solver]"):]
    base = dumps(driven())
    before, after = base.index("[solver]"), base.index("[record]")
    chosen = recommend(trials, 0.1)
    assert chosen is not None
    assert parse(base[:before] + part + "\n\n" + base[after:]).solver == chosen.solver


@pytest.mark.parametrize("more", [
    {}, {"at_rest": 0.025},
    {"keep_lists": False, "skip_converged": False, "join_substeps": False}])
def test_what_is_recommended_is_what_was_tried(more):
    """Also where the scene's solver has what trials do not change."""
    tried = Solver(step=1 / 240, substeps=12, tolerance=2e-2, passes=80, **more)
    text = describe([Trial(tried, 1e-3, 1e-3, 1.0)], 1e-2)
    part = text[text.index("[solver]"):]
    assert part.count("\n") == 4 + len(more)  # and no more than that
    base = dumps(driven())
    before, after = base.index("[solver]"), base.index("[record]")
    assert parse(base[:before] + part + "\n\n" + base[after:]).solver == tried


def test_a_trial_goes_on_where_the_scene_and_its_drive_were():
    """With the scene's own solver it ends where a run without a break does."""
    lone = scene([tile(0, 0)], floor=Floor(), body=Material(), reactor=Reactor("circle", 1.0),
                 drive=Drive("unicycle", 3 * SLIDING, 0.0, 1.0), tolerance=3e-4, passes=40)
    first, whole = Simulation(lone), Simulation(lone)
    first.run(0.625)
    whole.run(0.75)
    (x, y, _), overlap, cost = trial_run(lone, lone.solver, layout_of(first), first.time, 0.125)
    assert (x[0], y[0]) == pytest.approx((whole.x[0], whole.y[0]), abs=1e-15)
    assert abs(y[0]) > WIDTH
    assert overlap == 0.0
    assert cost > 0.0


def test_the_cost_of_a_small_scene_is_that_of_its_steps():
    """Not of the calls that look at it, which take longer than what is done between them."""
    few = scene([tile(x * WIDTH, y * WIDTH) for x in (-4, -2, 0, 2, 4) for y in (-2, 0, 2)],
                floor=Floor(), body=Material(), reactor=Reactor("circle", 1.0), step=1 / 120,
                drive=Drive("unicycle", 3 * SLIDING, 0.0, 1.0), substeps=4)
    first = Simulation(few)
    first.run(0.5)
    start, spent = layout_of(first), []
    for _ in range(5):
        clock = time.perf_counter()
        first.run(2.0)
        spent.append((time.perf_counter() - clock) / 2.0)
    told = {n: trial_run(few, replace(few.solver, step=1 / n), start, 0.5, 0.25)[2]
            for n in (120, 1920)}
    assert told[120] < 5.0 * min(spent)
    assert told[1920] > 3.0 * told[120]


def test_overlap_that_was_there_at_the_start_is_no_settings_own():
    """What the scene's own solver leaves is below its slop, and stays whatever is tried."""
    s = Simulation(scene([tile(), tile(WIDTH), tile(3 * WIDTH)]))
    s.x[1] -= 5e-4 * WIDTH
    before = replace(s.layout, x=s.x.copy())
    assert new_overlap(s, s.layout) == pytest.approx(5e-4, rel=1e-6)
    assert new_overlap(s, before) == 0.0
    s.x[1] -= 3e-4 * WIDTH
    assert new_overlap(s, before) == pytest.approx(3e-4, rel=1e-6)
    s.x[2] = 2 * WIDTH - 1e-3 * WIDTH  # two that were apart
    assert new_overlap(s, before) == pytest.approx(3e-4, rel=1e-6)


def test_the_deviation_is_that_of_the_points_of_a_tile_that_turns_in_place():
    turning = scene([tile(0, 0)], floor=Floor(), body=Material(),
                    drive=Drive("unicycle", 0.0, 1e-2, 4.0), tolerance=3e-4, passes=40,
                    step=1 / 160)
    found = {trial.solver.step: trial.deviation
             for trial in bench(turning, after=0.25, horizon=0.25)}
    assert found[max(found)] > 0.01
    assert found[max(found)] > 10.0 * found[min(found)] > 0.0


def test_the_finest_run_is_exact_enough_for_a_crowd_that_is_solved_coarsely(tmp_path):
    """With a hundredth of the tolerance it was off by three times what the best trial was told."""
    (tmp_path / "stir.py").write_text(
        "import math\n\n\n"
        "def stir(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):\n"
        "    force = p[0] * math.sin(2.0 * math.pi * t / p[1])\n"
        "    for i in range(x.size):\n"
        "        r = math.hypot(x[i], y[i])\n"
        "        if r > 0.0:\n"
        "            fx[i] -= force * y[i] / r\n"
        "            fy[i] += force * x[i] / r\n")
    crowd = Scene(
        CHESSBOARD, free=Free((("black", 10), ("white", 10))), magnet=Magnet(), floor=Floor(),
        seed=Seed(((0, 0, "black"), (1, 0, "white"), (0, 1, "white"))),
        reactor=Reactor("circle", 0.15), solver=Solver(1 / 240, 1, 2e-3, 5),
        drive=Drive("user", module=str(tmp_path / "stir.py"), function="stir",
                    parameters=(0.07, 4.0)))
    best = min(bench(crowd), key=lambda trial: trial.deviation)
    first = Simulation(crowd)
    first.run(1.0)
    start = layout_of(first)
    ours, truth = (trial_run(crowd, solver, start, 1.0, 0.25, 0)[0] for solver in (
        best.solver, Solver(1 / 240 / 128, 1, 1e-8, 10_000)))
    miss = np.sqrt(((ours - truth) ** 2).sum(axis=0)[~start.held].mean()) / WIDTH
    assert best.deviation > 0.6 * miss > 0.0


def test_where_nothing_moves_nothing_is_recommended(tmp_path, capsys):
    """A tile that the floor holds."""
    config = tmp_path / "scene.toml"
    config.write_text(dumps(scene([tile(0, 0)], floor=Floor(), tolerance=3e-4,
                                  drive=Drive("unicycle", 0.5 * SLIDING, 0.0, 0.5))))
    assert main(["bench", str(config)]) == 2
    assert capsys.readouterr().err.startswith("tbsa: --after: 1.0 s: no free tile moves from there "
                                              "to 1.25 s, so that nothing can be compared;")


@pytest.mark.parametrize(("option", "value", "field"), [
    ("--error", "0", "error"), ("--error", "nan", "error"), ("--horizon", "1e-9", "horizon"),
    ("--after", "-1", "after")])
def test_bad_options_are_refused(tmp_path, capsys, option, value, field):
    config = tmp_path / "scene.toml"
    config.write_text(dumps(driven()))
    assert main(["bench", str(config), option, value]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"tbsa: {option}: ")
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_the_command_prints_a_table_and_a_setting(tmp_path, capsys):
    config = tmp_path / "scene.toml"
    config.write_text(dumps(driven()))
    assert main(["bench", str(config), "--error", "0.5", "--after", "0.2", "--horizon", "0.1"]) == 0
    out = capsys.readouterr().out
    assert "deviation w" in out
    assert "[solver]" in out


def test_the_least_horizon_that_is_told_may_be_asked_for():
    short = driven()
    short = replace(short, solver=replace(short.solver, step=1 / 480))  # 0.0083333...
    with pytest.raises(InputError, match="must be a number from") as refused:
        bench(short, after=0.25, horizon=1e-9)
    least = float(str(refused.value).split("from ")[1].split(" to")[0])
    assert bench(short, after=0.25, horizon=least)


def test_bench_itself_refuses_a_bad_horizon():
    with pytest.raises(InputError, match="horizon"):
        bench(driven(), horizon=math.nan)


@pytest.mark.parametrize(("name", "solver"), [
    ("step", Solver(step=2e-9)), ("tolerance", Solver(tolerance=1e-323))])
def test_what_nothing_is_finer_than_is_told_of_the_scenes_own_value(name, solver):
    times = Record(2e-9, 2e-9) if name == "step" else Record()
    tiny = replace(driven(), solver=solver, record=times)
    with pytest.raises(InputError, match=rf"^solver.{name}: {getattr(solver, name)} is too small"):
        bench(tiny, after=0.0, horizon=4e-9 if name == "step" else 0.125)


# Tables.


def test_the_order_is_the_slope_between_a_120th_and_a_960th_of_a_second():
    steps = [1 / n for n in (60, 120, 240, 480, 960, 1920)]
    rows = [{"step": h, "errors": {"e": 3.0 * h**1.5 if 1 / 961 < h < 1 / 119 else 1.0}}
            for h in steps]
    assert accuracy.order(rows, "e") == pytest.approx(1.5)
    assert math.isnan(accuracy.order(rows[:1], "e"))


def test_the_interval_is_students():
    values = [1.0, 2.0, 3.0, 4.0]
    mean, half = accuracy.interval(values)
    assert mean == 2.5
    assert half == pytest.approx(3.182446 * np.std(values, ddof=1) / 2.0, rel=1e-6)


def test_the_front_holds_what_nothing_beats_in_both():
    assert peers.front([(1, 5), (2, 6), (3, 1), (3, 2), (4, 0.5)]) == [(1, 5), (3, 1), (4, 0.5)]


def test_engines_are_compared_at_equal_error_and_at_equal_time():
    """At the worst of their settings 2 times as fast and 10 times as exact; 7.5 at their best."""
    ours = [(1.0, 1e-2), (4.0, 1e-4)]
    theirs = [(2.0, 1e-1), (30.0, 2e-3), (40.0, 1e-1)]
    assert peers.compare(ours, theirs) == pytest.approx((2.0, 7.5, 10.0))
    assert peers.compare(ours, [(0.5, 1e-6)]) == (0.0, 0.0, 0.0)
    assert peers.compare([(1.0, 0.0)], [(5.0, 1e-17)]) == (5.0, 5.0, 1.0)


def test_a_row_keeps_its_best_time(monkeypatch):
    """Of every round of ours and of theirs, at the settings that the row was taken with."""
    asked = []

    def clock(scene, seconds, *, least):
        solver = scene.solver
        asked.append((solver.step, solver.substeps, solver.tolerance, solver.passes))
        return 2.0, 5.0

    def engine_clock(make, scene, seconds, *, least):
        asked.append((make, scene.solver.step, scene.solver.substeps))
        return 1.0, 9.0

    monkeypatch.setattr(peers, "clock", clock)
    monkeypatch.setattr(peers, "engine_clock", engine_clock)
    monkeypatch.setattr(peers, "settings", lambda: [("box2d, quick", "maker")])
    slide = next(each for each in references() if each.name == "slide")
    rows = [{"engine": "tbsa", "step": 1 / 60, "substeps": 2, "tolerance": 1e-3, "passes": 7,
             "alone": 3.0, "seconds": 4.0},
            {"engine": "box2d, quick", "step": 1 / 30, "alone": 0.5, "seconds": 10.0}]
    peers.clock_again(slide, rows)
    assert asked == [(1 / 60, 2, 1e-3, 7), ("maker", 1 / 30, 1)]
    assert [(row["alone"], row["seconds"]) for row in rows] == [(2.0, 4.0), (0.5, 9.0)]


def test_results_of_other_versions_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(accuracy, "RESULTS", tmp_path / "results")
    rows = [{"scene": "slide", "errors": {"distance": 1e-6}}, {"scene": "spin"}]
    monkeypatch.setattr(accuracy.tbsa, "__version__", "0.0.1")
    accuracy.save("accuracy", rows[:1])
    monkeypatch.setattr(accuracy.tbsa, "__version__", "0.0.2")
    accuracy.save("accuracy", rows[1:])
    path = accuracy.save("accuracy", rows)
    assert json.loads(path.read_text()) == {"0.0.1": rows[:1], "0.0.2": rows}


def paper_like():
    """A seed and some tiles about it, shaken."""
    placed = [tile(kind="black", held=True),
              *(tile(1.2 * i * WIDTH, 1.2 * j * WIDTH, 0.3, kind=("black", "white")[(i + j) % 2])
                for i in range(-2, 3) for j in range(-2, 3) if i or j)]
    return scene(placed, types=CHESSBOARD, magnet=Magnet(), floor=Floor(), body=Material(),
                 drive=Drive("shaking", 0.06, 0.0, 0.33), reactor=Reactor("circle", 0.15),
                 step=1 / 60, substeps=4, tolerance=1e-2, passes=40)


def test_the_tables_of_chaotic_scenes_have_a_line_for_each_step(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(accuracy, "RESULTS", tmp_path)
    monkeypatch.setattr(accuracy, "paper_scenes", lambda: {"small": paper_like()})
    for arguments in (["--paper", "0.2"], ["--statistics", "0.2", "--seeds", "2"]):
        assert accuracy.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    invariants, sizes = (json.loads((tmp_path / f"{name}.json").read_text())[accuracy.tbsa
                         .__version__] for name in ("paper", "statistics"))
    for rows in (invariants, sizes):
        assert [round(1 / row["step"]) for row in rows] == [60, 120, 240]
    for n in (60, 120, 240):
        assert sum(line.startswith("small") and f"1/{n}" in line for line in lines) >= 2
    # A horizon so short that a run at 1/32 of the step has hardly another fate.
    assert all(0.0 < row["horizon"][0] < 0.1 for row in invariants)
    assert all(len(row["sizes"]) == 2 for row in sizes)
