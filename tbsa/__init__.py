"""Magnetically bonded, passive tile self-assembly at the centimetre scale.

>>> import tbsa
>>> scene = tbsa.load("paper_runs/shaking.toml")
>>> simulation = tbsa.Simulation(scene)
>>> simulation.run(1.0)          # s
>>> simulation.x, simulation.y   # m
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.35.0"

# Where the public names live.  They are imported when first used: pandas and matplotlib alone
# take most of a second, and a run needs neither.
_HOME = {
    "InputError": "tbsa.errors",
    "Layout": "tbsa.model.layout",
    "Scene": "tbsa.model.scene",
    "Simulation": "tbsa.model.simulation",
    "SimulationError": "tbsa.model.simulation",
    "load": "tbsa.model.scene",
    "parse": "tbsa.model.scene",
    "dumps": "tbsa.model.scene",
    "initial_layout": "tbsa.model.layout",
    "run": "tbsa.model.records",
    "read_run": "tbsa.model.records",
    "assembly": "tbsa.work.metrics",
    "campaign": "tbsa.work.campaign",
    "table": "tbsa.work.metrics",
    "draw": "tbsa.work.draw",
    "movie": "tbsa.work.movie",
    "view": "tbsa.work.viewer",
    "export": "tbsa.work.export",
}
__all__ = sorted(_HOME)

if TYPE_CHECKING:
    from tbsa.errors import InputError as InputError
    from tbsa.model.layout import Layout as Layout
    from tbsa.model.layout import initial_layout as initial_layout
    from tbsa.model.records import read_run as read_run
    from tbsa.model.records import run as run
    from tbsa.model.scene import Scene as Scene
    from tbsa.model.scene import dumps as dumps
    from tbsa.model.scene import load as load
    from tbsa.model.scene import parse as parse
    from tbsa.model.simulation import Simulation as Simulation
    from tbsa.model.simulation import SimulationError as SimulationError
    from tbsa.work.campaign import campaign as campaign
    from tbsa.work.draw import draw as draw
    from tbsa.work.export import export as export
    from tbsa.work.metrics import assembly as assembly
    from tbsa.work.metrics import table as table
    from tbsa.work.movie import movie as movie
    from tbsa.work.viewer import view as view


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tbsa' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
