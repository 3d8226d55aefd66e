"""The tables of a campaign that was kept, what of its plan is missing, and Markdown."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from paper_runs.paper import SCENES
from tbsa.errors import InputError
from tbsa.model.records import write_atomically
from tbsa.work.plan import Planned, read_plan

HERE = Path(__file__).parent
DATA = HERE / "data"
METRICS = ("size", "errors", "errors_percent", "holes", "holes_percent", "time")


def load(folder: Path) -> pd.DataFrame:
    """The table of a campaign, with the drive of each run; runs that are done and that failed.

    Raises
    ------
    InputError
        Where there is none.
    """
    path = folder / "table.csv"
    try:
        table = pd.read_csv(path)
    except OSError as error:
        raise InputError(f"must be the table of a campaign: {error.strerror}",
                         file=str(path)) from None
    except ValueError as error:
        raise InputError(f"must be the table of a campaign: {error}", file=str(path)) from None
    for name in ("run", "group", "scene", "seed", "status", "duration", "fingerprint"):
        if name not in table:
            raise InputError(f"has no column {name!r}: not the table of a campaign",
                             file=str(path))
    for name in METRICS:  # where no run is done
        if name not in table:
            table[name] = np.nan
    table["drive"] = table["scene"].map(lambda scene: SCENES.get(Path(scene).name, scene))
    return table


def done(folder: Path) -> pd.DataFrame:
    """The rows of a campaign's table whose runs are done."""
    table = load(folder)
    return table[table["status"] == "done"]


def fields(table: pd.DataFrame) -> list[str]:
    """The columns of what the campaign's file has set."""
    names = list(table.columns)
    return names[names.index("scene") + 1 : names.index("seed")]


def curves(folder: Path, rows: pd.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    """One metric of some runs against time: times [k] (s), values [n, k] in the order of `rows`.

    The times are those that all of them have.
    """
    table = pd.read_csv(folder / "curves.csv", usecols=["run", "time", column])
    table = table[table["run"].isin(rows["run"])]
    number = table.groupby("time")["run"].count()
    times = number.index[number == len(rows)]
    wide = table[table["time"].isin(times)].pivot(index="run", columns="time", values=column)
    return times.to_numpy(dtype=float), wide.reindex(rows["run"]).to_numpy(dtype=float)


def against_plan(file: Path, table: pd.DataFrame) -> tuple[list[str], list[Planned]]:
    """What is to be said of the campaign's state, and the runs of its file that are missing."""
    plan = read_plan(file)
    status = {(row.group, row.fingerprint): row.status for row in table.itertuples()}
    known = {(each.group, each.mark) for each in plan}
    missing = [each for each in plan if (each.group, each.mark) not in status]
    failed = table[table["status"] == "failed"]
    ended = int((table["status"] == "done").sum())
    lines = [f"{ended} of {len(plan)} planned runs are done, {len(failed)} failed, "
             f"{len(missing)} are missing."]
    for group in dict.fromkeys(each.group for each in plan):
        mine = [each for each in missing if each.group == group]
        if mine:
            total = sum(each.group == group for each in plan)
            lines.append(f"- missing of {group}: {len(mine)} of {total}")
    lines += [f"- failed: {run}: {message}"
              for run, message in zip(failed["run"], failed["message"], strict=True)]
    foreign = sum(key not in known for key in status)
    if foreign:
        lines.append(f"- {foreign} runs of the table are not in {file.name} as it is now: a scene "
                     "has changed since")
    return lines, missing


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """A table: the first column to the left, the others to the right."""
    marks = [":--", *["--:"] * (len(head) - 1)]
    return [f"| {' | '.join(map(str, row))} |" for row in [head, marks, *rows]]


def command(name: str, description: str, folder: str, report: Callable[[Path, Path], str],
            argv: Sequence[str] | None) -> int:
    """The command line of a report on what was kept of a campaign; returns the exit code."""
    parser = argparse.ArgumentParser(prog=f"python -m paper_runs.{name}", description=description)
    parser.add_argument("--data", type=Path, default=DATA / folder,
                        help=f"what was kept of the campaign (default: paper_runs/data/{folder})")
    parser.add_argument("--plan", type=Path, default=HERE / f"{folder}.toml",
                        help=f"the campaign's file (default: paper_runs/{folder}.toml)")
    parser.add_argument("--out", type=Path, help="also write it there")
    arguments = parser.parse_args(argv)
    try:
        text = report(arguments.data, arguments.plan)
        if arguments.out:
            write_atomically(arguments.out, text.encode())
    except (InputError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    print(text)
    return 0
