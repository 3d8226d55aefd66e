"""A run as a trajectory that other programs read: GSD, the format of HOOMD-blue.

OVITO shows such a file as it is, with the tiles as squares; freud, MDAnalysis and garnett read it.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from tbsa.errors import InputError
from tbsa.model.records import Records, check_is_run, replacing
from tbsa.model.tiles import Growth
from tbsa.work.draw import target
from tbsa.work.metrics import assembly, truth_of


def export(records: Records, path: str | Path) -> None:
    """Write the records of a run into a GSD file, schema ``hoomd``; SI units, single precision.

    A particle is a tile: position, orientation (a quaternion about z), velocity, mass, moment of
    inertia, and its tile type with the square as its shape.  The step of a frame is that of the
    solver.  Logged a frame: ``time`` (s), ``size``, ``errors`` and ``holes`` of the assembly; a
    tile: ``particles/spin`` (rad/s), ``particles/held``, ``particles/attached``.  Names of types
    are ASCII there; other letters are escaped.

    Parameters
    ----------
    records
        Of :func:`tbsa.model.records.read_run`.
    path
        A file ending in ``.gsd``; replaced in one go when it is complete.

    Raises
    ------
    InputError
        Where the package gsd is missing, or the path cannot be written.
    TypeError
        Where `records` are none of a run.
    """
    check_is_run(records)
    path = target(path, (".gsd",))
    try:
        hoomd: Any = import_module("gsd.hoomd")
    except ImportError:
        raise InputError("needs the package gsd: pip install 'tbsa[gsd]'", field="path",
                         value=str(path)) from None
    if any("\ud800" <= letter <= "\udfff" for letter in os.path.realpath(path)):
        raise InputError("must be a path that UTF-8 can hold, for gsd", field="path",
                         value=str(path))
    truth, box = truth_of(records.scene), _box(records)
    with replacing(path) as scratch:
        scratch.touch()  # with the mode of other files; gsd's own is another
        with hoomd.open(str(scratch), "w") as file:
            for k in range(records.time.size):
                file.append(_frame(hoomd.Frame(), records, k, truth, box))


def _frame(frame: Any, records: Records, k: int, truth: Growth | None,
           box: tuple[float, float]) -> Any:
    """One record, into an empty frame."""
    scene, layout = records.scene, records.layout
    x, y, angle = (np.asarray(each[k]) for each in (records.x, records.y, records.angle))
    n, width = x.size, scene.material.width
    flat = np.zeros(n)
    half = 0.5 * width
    square = {"type": "Polygon", "rounding_radius": 0,
              "vertices": [[half, half], [-half, half], [-half, -half], [half, -half]]}
    found = assembly(scene, layout, x, y, angle, truth)

    frame.configuration.step = round(float(records.time[k]) / scene.solver.step)
    frame.configuration.dimensions = 2
    frame.configuration.box = [*box, 0.0, 0.0, 0.0, 0.0]
    particles = frame.particles
    particles.N = n
    particles.types = [kind.name.encode("ascii", "backslashreplace").decode()
                       for kind in scene.types]
    particles.type_shapes = [square] * len(scene.types)
    particles.typeid = layout.type
    particles.position = np.stack([x, y, flat], axis=1)
    particles.orientation = np.stack([np.cos(0.5 * angle), flat, flat, np.sin(0.5 * angle)], axis=1)
    particles.velocity = np.stack([records.vx[k], records.vy[k], flat], axis=1)
    particles.mass = np.full(n, scene.material.mass)
    particles.moment_inertia = np.stack(
        [flat, flat, np.full(n, scene.material.mass * width**2 / 6.0)], axis=1)
    particles.diameter = np.full(n, width)
    frame.log = {
        "time": records.time[k : k + 1], "size": np.array([found.size]),
        "errors": np.array([found.errors]), "holes": np.array([found.holes]),
        "particles/spin": np.asarray(records.omega[k]),
        "particles/held": layout.held.astype(np.uint8),
        "particles/attached": found.attached.astype(np.uint8),
    }
    return frame


def _box(records: Records) -> tuple[float, float]:
    """Sides of a box about the origin that holds the reactor, or all tiles ever (m)."""
    wall, width = records.scene.reactor, records.scene.material.width
    if wall is not None and wall.shape == "circle":
        return 2.0 * wall.radius, 2.0 * wall.radius
    if wall is not None:
        return wall.width, wall.height
    return (2.0 * (float(np.abs(records.x).max(initial=0.0)) + width),
            2.0 * (float(np.abs(records.y).max(initial=0.0)) + width))
