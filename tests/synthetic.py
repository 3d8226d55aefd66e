"""Tables of a campaign that was never run: its plan, with numbers of the test's own."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pandas as pd

import tbsa
from tbsa.work.plan import read_plan


@cache
def planned(path, _content):
    """The runs of a campaign's file; many tests make tables of the same ones."""
    return read_plan(path)


def tables(path, folder, metrics, version=None, **columns):
    """Write table.csv, curves.csv and wall.csv of a campaign's file; returns the table.

    `metrics` gives of a planned run its curves, {column: values} with `time`, or None: not done.
    """
    plan = planned(path, path.read_bytes())
    rows, curves, walls = [], [], []
    for each in plan:
        found = metrics(each)
        row = {"run": each.name, "group": each.group, "scene": each.base,
               **{name: json.dumps(value) if isinstance(value, list) else value
                  for name, value in each.fields},
               "seed": each.scene.run.seed, "duration": each.scene.run.duration,
               "tiles": each.tiles, "fingerprint": each.mark, "settings": each.settings,
               "version": version or tbsa.__version__,
               "status": "waiting" if found is None else "done", "message": None, **columns}
        if found is not None:
            curve = {name: np.asarray(values) for name, values in found.items()}
            size = curve["size"].astype(float)
            for name in ("errors", "holes"):
                curve[f"{name}_percent"] = np.where(
                    size > 0, 100 * curve[name] / np.maximum(size, 1), np.nan)
            row |= {name: float(values[-1]) for name, values in curve.items()}
            curves.append({"run": np.full(len(size), each.name, dtype=object)} | curve)
            walls.append({"run": each.name, "wall": 10.0, "time": each.scene.run.duration})
        rows.append(row)
    fields = list(dict.fromkeys(name for each in plan for name, _ in each.fields))
    names = list(dict.fromkeys(name for row in rows for name in row if name not in fields))
    table = pd.DataFrame(rows, columns=[*names[:3], *fields, *names[3:]])
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "table.csv", index=False)
    pd.DataFrame({name: np.concatenate([each[name] for each in curves]) for name in curves[0]}
                 if curves else {"run": [], "time": []}).to_csv(folder / "curves.csv", index=False)
    pd.DataFrame(walls, columns=["run", "wall", "time"]).to_csv(folder / "wall.csv", index=False)
    return table


def ending(each, size, errors=0, holes=0, interval=100.0, slope=0.0):
    """Curves that are flat, or have a slope (tiles/s), and end with these numbers."""
    time = np.arange(0.0, each.scene.run.duration + 0.5 * interval, interval)
    sizes = size + slope * (time - time[-1])
    nothing = np.zeros(len(time), dtype=int)
    end = np.arange(len(time)) == len(time) - 1
    return {"time": time, "size": sizes, "errors": np.where(end, errors, 0),
            "holes": np.where(end, holes, 0), "wrongly_turned": nothing, "off_lattice": nothing,
            "total": sizes + len(each.scene.seed.cells), "size_contact": sizes + 2,
            "joined": nothing, "left": nothing}
