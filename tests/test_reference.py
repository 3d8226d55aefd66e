"""The reference scenes against their truths, at a step of 1/480 s and default settings.

Scenes, truths and targets are in ``tests/benchmarks/scenes.py``.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tbsa.model.scene import Run, dumps, load
from tbsa.model.simulation import Simulation
from tests.benchmarks import scenes
from tests.benchmarks.accuracy import TARGET, order
from tests.benchmarks.scenes import BOND, GRAVITY, MASS, MU, Block, at_step

REFERENCES = scenes.references()
LARGER = scenes.larger()


def rows(references):
    return [pytest.param(each, quantity, id=f"{each.name}: {quantity}", marks=[
        *([pytest.mark.slow] if each.slow else [])])
        for each in references for quantity in each.targets]


@pytest.fixture(scope="module")
def errors():
    """Errors of a scene at 1/480 s; measured once."""
    found = {}

    def of(reference):
        if reference.name not in found:
            scene = at_step(reference.scene, TARGET)
            found[reference.name] = reference.measure(Simulation, scene)
        return found[reference.name]

    return of


@pytest.mark.parametrize(("reference", "quantity"), rows(
    [*REFERENCES, *LARGER]))
def test_a_reference_scene_is_within_its_target(reference, quantity, errors):
    assert errors(reference)[quantity] <= reference.targets[quantity]


@pytest.mark.parametrize("reference", [each for each in REFERENCES if each.ordered],
                         ids=lambda reference: reference.name)
def test_free_flight_is_of_second_order(reference):
    """Slope of log error over log step between 1/120 and 1/960 s is at least 1.9."""
    steps = [1 / n for n in (120, 240, 480, 960)]
    found = [{"step": h, "errors": reference.measure(Simulation, at_step(reference.scene, h))}
             for h in steps]
    assert order(found, reference.quantity) >= 1.9


@pytest.mark.parametrize("tilt", [0.2, 0.201, 0.202, 0.203, 0.204, 0.205, 0.206, 0.207])
def test_what_rocks_lands_as_fast_as_it_falls_wherever_in_a_substep(tilt):
    """Up to there it keeps its energy, also when its second corner is near."""
    reference = scenes.rocking_drop(tilt=tilt)
    found = reference.measure(Simulation, at_step(reference.scene, TARGET))
    assert found["spin"] < 3e-4
    assert found["next tilt"] < 6e-4


@pytest.mark.parametrize("reference", [*REFERENCES, *LARGER],
                         ids=lambda reference: reference.name)
def test_every_reference_scene_is_a_config_that_can_be_run(reference, tmp_path):
    """Written as TOML beside its drive it is read back as the same scene."""
    scene = reference.scene
    if scene.drive is not None and scene.drive.kind == "user":
        (tmp_path / "ramp.py").write_text((scenes.HERE / "ramp.py").read_text())
    (tmp_path / "scene.toml").write_text(dumps(scene))
    assert replace(load(tmp_path / "scene.toml"), file=scene.file) == scene


def test_names_of_reference_scenes_differ():
    names = [reference.name for reference in [*REFERENCES, *LARGER]]
    assert len(set(names)) == len(names)


# The closed forms of a block's critical load against the table of the statics.


@pytest.mark.parametrize(("n", "angle", "friction", "floor", "rest"), [
    (4, 0, 0.0, False, 0.0509), (4, 45, 0.0, False, 0.0720), (4, 0, MU, False, 0.0637),
    (2, 0, 0.0, False, 0.1019), (2, 45, 0.0, False, 0.1440), (2, 0, MU, False, 0.1273),
    (2, 0, MU, True, 0.1678), (2, 45, MU, True, 0.1833),
    (10, 0, MU, True, 0.0659), (10, 45, MU, True, 0.0680), (10, 22.5, MU, True, 0.0646),
])
def test_the_rest_load_of_a_block_is_that_of_its_statics(n, angle, friction, floor, rest):
    assert Block(n, math.radians(angle), friction, floor).bracket()[1] == pytest.approx(
        rest, abs=6e-5)


def test_slip_can_begin_below_the_rest_load():
    """Along the wall (1 + mu) F_g/n + mu_f m g; n = 10 at 22.5 deg lifts off, at 0.0643 N."""
    slip, rest = Block(2, 0.0, MU, True).bracket()
    assert slip == pytest.approx((1 + MU) * BOND / 2 + MU * MASS * GRAVITY)
    assert slip == pytest.approx(0.1666, abs=5e-5)
    assert slip < rest
    assert Block(10, math.radians(22.5), MU, True).bracket()[0] == pytest.approx(0.0643, abs=5e-5)


def test_the_worst_phase_lies_atan_mu_off_the_axis():
    """F <= (1 + mu) F_g/(n sqrt(1 + mu^2)): 0.0618 N at 14 deg for n = 4."""
    loads = {angle: Block(4, math.radians(angle), MU).bracket()[1] for angle in range(0, 46)}
    assert min(loads, key=loads.get) == 14
    assert loads[14] == pytest.approx(0.0618, abs=5e-5)


def test_the_config_of_a_block_runs_under_its_rising_load():
    """Half a second of the ramp from 97 % of the critical load on lets nothing go."""
    reference = scenes.block(2)
    s = Simulation(replace(reference.scene, run=Run(0.5)))
    x = s.x.copy()
    s.run(0.5)
    assert abs(s.x - x).max() < 1e-3 * scenes.WIDTH
