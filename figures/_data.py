"""Where the data are that the figures read; `python -m paper_runs.keep` puts them there."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from figures.style import BLUE, ORANGE
from paper_runs.paper import SELF, SHAKING
from paper_runs.tables import DATA, done
from tbsa.errors import InputError

__all__ = ["BARS", "BEYOND", "CALIBRATION", "CAMPAIGN", "DRIVES", "LOOKS", "MORE_TILES", "Missing",
           "done", "means", "needed", "order", "points", "results", "runs", "seconds"]

# Tables, and a few records, of campaigns.
CAMPAIGN, CALIBRATION = DATA / "campaign", DATA / "calibration"
BEYOND, MORE_TILES = DATA / "beyond", DATA / "more_tiles"
DRIVES = {SELF: SELF, SHAKING: SHAKING}  # drive: label
LOOKS: dict[str, tuple[str, Any, str]] = {  # colour, line, mark
    SELF: (BLUE, "-", "o"), SHAKING: (ORANGE, (0, (4, 1.5)), "s")}


class Missing(FileNotFoundError):
    """What a figure needs and the data do not have."""


def needed(rows: pd.DataFrame, what: str) -> pd.DataFrame:
    """The rows that a figure draws, of which there must be one."""
    if rows.empty:
        raise Missing(what)
    return rows


def results(path: Path) -> dict[str, Any]:
    """What a file of results (a JSON object) has."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"must be JSON: {error}", file=str(path)) from None
    if not isinstance(found, dict) or not found:
        raise InputError("must be a JSON object with results", file=str(path))
    return found


def order(name: str) -> tuple[int, ...]:
    """What versions, or files named by them, are sorted by."""
    return tuple(map(int, re.findall(r"\d+", name)))


def seconds(rows: pd.DataFrame) -> str:
    """How long the runs are (s), in words."""
    return ", ".join(f"{each:g}" for each in sorted(set(rows["duration"])))


def means(rows: pd.DataFrame, over: str) -> pd.DataFrame:
    """Mean size by the values of a column, with the smallest and the largest run, and how many."""
    return rows.groupby(over)["size"].agg(["mean", "min", "max", "count"])


def runs(counts: pd.Series) -> str:
    """How many runs stand behind each value, in words."""
    least, most = int(counts.min()), int(counts.max())
    number = f"{most}" if least == most else f"{least} to {most}"
    return f"{number} run{'s' if most > 1 else ''} each"


BARS = "means; bars from the smallest to the largest run"  # what :func:`points` draws


def points(ax: Axes, at: pd.DataFrame, drive: str, label: str, **look: Any) -> Any:
    """Means with a bar from the smallest to the largest run, if there are several, in the drive's
    look."""
    colour, dash, mark = LOOKS[drive]
    mean = at["mean"].to_numpy()
    bars = None if int(at["count"].max()) == 1 else np.stack([mean - at["min"], at["max"] - mean])
    return ax.errorbar(at.index.to_numpy(dtype=float), mean, bars,
                       **{"color": colour, "linestyle": dash, "marker": mark, "markersize": 4,
                          "capsize": 2, "elinewidth": 0.8, "clip_on": False,
                          "label": f"{label}, {runs(at['count'])}", **look})
