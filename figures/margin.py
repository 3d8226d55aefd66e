"""Stability margin against size along a run of each drive.

The margin is the factor by which the drive's worst phase could be larger and the assembly as
recorded still have a state of rest (``theory.stability``): tile by tile, tile by tile without the
drive's torques, and of the largest group of attached tiles as one body.  Below 1 something moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import tbsa
from figures._data import DRIVES
from figures._records import KEPT, first_run
from figures._shapes import law
from figures.style import BLUE, GREY, ORANGE, figure
from paper_runs.paper import SELF
from tbsa.model.scene import EDGE_ANGLE, Scene
from tbsa.model.simulation import floor_limits
from tbsa.model.tiles import ground_truth
from theory.stability import Loads, Margin, Numbers, margin, recorded, shaking, unicycle
from theory.statics import Tiles

DATA = KEPT
RECORDS = 37  # of a run, evenly in time; a margin of 300 tiles takes seconds
# Margins beyond are drawn there, hollow: those without bound, and the 0 of what cannot rest.
BOTTOM, TOP = 0.1, 30.0


def numbers(scene: Scene) -> Numbers:
    """What holds the tiles of a scene, for theory: every pair of magnets in range."""
    if scene.magnet is None:
        raise tbsa.InputError("must be there: without magnets nothing is held", field="magnet")
    if scene.floor is not None and scene.floor.law != "separate":
        raise tbsa.InputError('must be "separate" for a margin, whose statics bound force and '
                              "torque of the floor apart", file=scene.file, field="floor.law",
                              value=scene.floor.law)
    return Numbers(law(scene), False, scene.material.friction, floor_limits(scene))


def attached(run: Any, k: int, truth: Any) -> tuple[Tiles, np.ndarray, np.ndarray]:
    """Seed and attached tiles of record `k` on their sites: tiles, family, heading (rad).

    Only tiles on the lattice that hang on the seed by way of such tiles; of two at one site one.
    """
    scene, layout = run.scene, run.layout
    found = tbsa.assembly(scene, layout, run.x[k], run.y[k], run.angle[k], truth)
    member = found.seed | found.on_lattice
    keep = np.flatnonzero(member)
    keep = keep[np.argsort(~found.seed[keep], kind="stable")]
    keep = keep[np.sort(np.unique(found.site[keep], axis=0, return_index=True)[1])]
    reached, inside = found.seed.copy(), np.isin(np.arange(len(member)), keep)
    bonds = found.bonded[:, ::2]
    bonds = bonds[inside[bonds].all(axis=1)]
    while (new := bonds[reached[bonds].any(axis=1) & ~reached[bonds].all(axis=1)]).size:
        reached[new] = True
    keep = keep[reached[keep]]
    turns = np.rint((run.angle[k] - scene.seed.angle) / (0.5 * np.pi)).astype(np.int64)[keep]
    kind = layout.type[keep]
    tiles = recorded(found.site[keep], kind, turns, found.seed[keep],
                     [each.glues for each in scene.types])
    family = np.array([each.family for each in scene.types], float)[kind]
    forward = np.array([EDGE_ANGLE[each.forward] for each in scene.types])[kind]
    return tiles, family, forward + 0.5 * np.pi * turns


def loads(scene: Scene, tiles: Tiles, family: np.ndarray, heading: np.ndarray,
          torque: bool = True) -> Loads:
    """The drive's loads at full strength."""
    drive = scene.drive
    if drive is not None and drive.kind == "shaking":
        return shaking(tiles, float(drive.force))
    if drive is not None and drive.kind == "unicycle":
        return unicycle(tiles, family, heading, float(drive.force), drive.torque * torque)
    raise tbsa.InputError('must be "shaking" or "unicycle" for a margin', file=scene.file,
                          field="drive.kind", value=drive and drive.kind)


def margins(folder: str | Path, records: int | None = None) -> pd.DataFrame:
    """Margins along a run, at so many records (`RECORDS`): columns time, size, tiles, no_torque,
    body, net."""
    run = tbsa.read_run(folder)
    scene = run.scene
    truth, held = ground_truth(scene), numbers(scene)
    rows = []
    for k in np.unique(np.linspace(0, len(run.time) - 1, records or RECORDS).astype(int)):
        tiles, family, heading = attached(run, int(k), truth)
        if tiles.held.all():
            continue
        found = margin(tiles, loads(scene, tiles, family, heading), held)
        quiet: Margin = found
        if scene.drive.kind == "unicycle":
            quiet = margin(tiles, loads(scene, tiles, family, heading, torque=False), held)
        rows.append((run.time[k], len(tiles.free), found.tiles, quiet.tiles, found.body, found.net))
    return pd.DataFrame(rows, columns=["time", "size", "tiles", "no_torque", "body", "net"])


def make(folders: Sequence[str | Path] = ()) -> Figure:
    """Margin against size, a panel for each run, or for the kept one of each drive.

    Hollow marks are off the scale.
    """
    folders = folders or [first_run(DATA[0].parent, group) for group in reversed(DRIVES)]
    fig = figure(2.6, 1.0 + 2.6 * len(folders))
    panels = fig.subplots(1, len(folders), sharey=True, squeeze=False)[0]
    for ax, folder in zip(panels, folders, strict=True):
        table = margins(folder)
        drive = tbsa.read_run(folder).scene.drive.kind
        series = [("body", "largest group as one body", GREY, "^"),
                  ("tiles", "tile by tile", BLUE, "o")]
        if drive == "unicycle":
            series.insert(1, ("no_torque", "tile by tile, no torque", ORANGE, "s"))
        ax.axhline(1.0, color="k", lw=0.6)
        for column, label, colour, marker in series:
            inside = table[column].between(BOTTOM, TOP)
            look: dict[str, Any] = {"color": colour, "marker": marker, "markersize": 3,
                                    "linestyle": "none", "clip_on": False,
                                    "in_layout": False}  # a line without points is at pixel 0, 0
            ax.plot(table["size"], table[column].where(inside), label=label, **look)
            if len(beyond := table[~inside]):
                ax.plot(beyond["size"], beyond[column].clip(BOTTOM, TOP), **look,
                        markerfacecolor="white")
        ax.set(yscale="log", xlabel="attached tiles")
        ax.set_title({"unicycle": SELF}.get(drive, drive), fontsize=8)
        ax.legend()
        ax.spines[["top", "right"]].set_visible(False)
    panels[0].set(ylabel="stability margin", ylim=(BOTTOM, TOP))
    fig.supxlabel(f"hollow: above {TOP:g}, or below {BOTTOM:g}", fontsize=7)
    return fig
