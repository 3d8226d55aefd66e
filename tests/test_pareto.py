"""The figure of run time against error, from results as the benchmarks write them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from figures import pareto, speed
from figures.__main__ import main
from tests.benchmarks.scenes import references


def rows(factor):
    """Three engines on every scene that is shown; 1e9 is a run that was thrown apart."""
    found = []
    for scene, (_, quantity, _) in pareto.SHOWN.items():
        for n in (60, 480):
            common = {"scene": scene, "simulated": 2.0, "alone": 1e-6 * n}
            errors = {"another": 1.0, quantity: factor / n}
            found.append(common | {"engine": "tbsa", "errors": errors})
            found.append(common | {"engine": "box2d, 8 iterations", "error": 10 * factor / n})
            found.append(common | {"engine": "pymunk, 10 iterations", "error": 1e9})
    return found


def test_the_newest_version_is_drawn(tmp_path):
    path = tmp_path / "peers.json"
    path.write_text(json.dumps({"0.10.0": rows(1.0), "0.9.0": rows(2.0), "0.1.0": rows(3.0)}))
    assert pareto.newest(path) == rows(1.0)


@pytest.mark.parametrize("script", [pareto, speed])
@pytest.mark.parametrize("text", ["{}", "[]", "null", '{"0.1.0": []}'])
def test_a_file_without_results_is_said(script, text, tmp_path, monkeypatch, capsys):
    path = tmp_path / "results.json"
    path.write_text(text)
    monkeypatch.setattr(script, "DATA", (path,))
    name = script.__name__.rpartition(".")[2]
    assert main([name]) == 1
    assert capsys.readouterr().out.startswith(f"{name}: left out, needs ")


def test_every_panel_shows_the_quantity_that_engines_are_compared_by():
    """Of ours a file of results has several; of the others' that one."""
    quantities = {each.name: each.quantity for each in references()}
    assert {scene: quantity for scene, (_, quantity, _) in pareto.SHOWN.items()} == {
        scene: quantities[scene] for scene in pareto.SHOWN}


def test_every_panel_shows_that_error_over_the_time_of_the_engine_alone(tmp_path, monkeypatch):
    path = tmp_path / "peers.json"
    path.write_text(json.dumps({"0.1.0": rows(1.0)}))
    monkeypatch.setattr(pareto, "DATA", (path,))
    axes = pareto.make().axes
    assert len(axes) == len(pareto.SHOWN)
    for ax in axes:
        lines = {line.get_label(): line.get_xydata() for line in ax.lines}
        assert set(lines) == {"tbsa", "Box2D"}
        assert lines["tbsa"] == pytest.approx(np.array([[3e-5, 1 / 60], [2.4e-4, 1 / 480]]))
        assert lines["Box2D"] == pytest.approx(np.array([[3e-5, 10 / 60], [2.4e-4, 10 / 480]]))
