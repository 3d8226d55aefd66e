"""The tables of a campaign that was kept, what of its plan is missing, and Markdown."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from paper_runs.paper import SCENES
from tbsa.errors import InputError
from tbsa.model.records import write_atomically
from tbsa.work.plan import Planned, read_plan

HERE = Path(__file__).parent
DATA = HERE / "data"
Row = dict[str, str]
NEEDED = ("run", "group", "scene", "seed", "duration", "fingerprint", "status", "message")
TEXTS = ("run", "group", "scene", "status", "fingerprint")
STATUSES = ("done", "failed", "stopped", "waiting", "elsewhere")
COUNTS = ("size", "errors", "holes")  # of every run that is done
PERCENT = ("errors_percent", "holes_percent")  # none where nothing is attached
POSITIVE = ("duration", "solver.step")
NUMBERS = (*POSITIVE, *COUNTS, *PERCENT, "off_lattice", "time")  # from 0, where they are given


def read(path: Path, needed: Sequence[str] = ("run",), key: Sequence[str] = ("run",)) -> list[Row]:
    """The rows of a table, as text; each has a value for every column, and a key of its own.

    Raises
    ------
    InputError
        Where there is no such table.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, line) for line in reader if line]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"must be the table of a campaign: {reason}", file=str(path)) from None
    if not lines:
        raise InputError("must be the table of a campaign: it is empty", file=str(path))
    names = lines.pop(0)[1]
    for name in (*needed, *key):
        if names.count(name) != 1:
            raise InputError("must be a column, once, as in the tables of a campaign",
                             file=str(path), field=name)
    rows, first = [], {}
    for number, line in lines:
        if len(line) != len(names):
            raise InputError(f"must have {len(names)} values, one for each column, has "
                             f"{len(line)}", file=str(path), field=f"line {number}")
        row = dict(zip(names, line, strict=True))
        mine = tuple(row[name] for name in key)
        if first.setdefault(mine, number) != number:
            raise InputError(f"must be there once: also in line {first[mine]}", file=str(path),
                             field=f"line {number}, {' and '.join(key)}", value=", ".join(mine))
        rows.append(row)
    return rows


def typed(rows: Sequence[Row], columns: Sequence[str]) -> pd.DataFrame:
    """Columns of a table: numbers or truth values where all are, blanks as not a number."""
    def values(name: str) -> pd.Series[Any]:
        column = pd.Series([row[name] for row in rows], dtype=object)
        known = column[column != ""]
        if name not in TEXTS and known.isin(["True", "False"]).all() and len(known):
            return column.map({"True": True, "False": False})
        try:
            found = known if name in TEXTS else pd.to_numeric(known)
        except ValueError:
            found = known
        return found.reindex(column.index) if len(known) else column.map(lambda _: np.nan)

    return pd.DataFrame({name: values(name) for name in columns}, columns=list(columns))


def check(table: pd.DataFrame, path: Path, name: str, least: float = 0.0) -> None:
    """Refuse what is not a number from `least`, or above it where it must be positive."""
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
    positive = name in POSITIVE
    right = np.isfinite(values) & ((values > least) if positive else (values >= least))
    if right.all():
        return
    k = int(np.argmin(right))
    what = "" if least == -np.inf else f" {'above' if positive else 'from'} {least:g}"
    value = table[name].iloc[k]
    raise InputError(f"must be a number{what}", file=str(path),
                     field=f"{name} of {table['run'].iloc[k]}",
                     value="" if pd.isna(value) else getattr(value, "item", lambda: value)())


def given(rows: pd.DataFrame, folder: Path, *names: str) -> pd.DataFrame:
    """The rows of a campaign's table, in each of which these columns must have a value.

    Those of the drive and of free tiles must be numbers.
    """
    path = folder / "table.csv"
    for name in names if len(rows) else ():
        if name not in rows:
            raise InputError("is not there; must be a column", file=str(path), field=name)
        if rows[name].isna().any():
            raise InputError("must not be blank", file=str(path),
                             field=f"{name} of {rows['run'][rows[name].isna()].iloc[0]}")
        if name.startswith(("drive.", "free.")):
            check(rows, path, name, -np.inf)
            rows = rows.assign(**{name: pd.to_numeric(rows[name])})
    return rows


def load(folder: Path) -> pd.DataFrame:
    """The table of a campaign, with the drive of each run; runs that are done and that failed.

    Raises
    ------
    InputError
        Where there is none, or one that is damaged; runs that are done have their counts.
    """
    path = folder / "table.csv"
    rows = read(path, NEEDED)
    table = typed(rows, list(rows[0]) if rows else NEEDED)
    for name in TEXTS:
        given(table, folder, name)
    odd = table[~table["status"].isin(STATUSES)]
    if len(odd):
        raise InputError(f"must be one of {', '.join(STATUSES)}", file=str(path),
                         field=f"status of {odd['run'].iloc[0]}", value=odd["status"].iloc[0])
    ended = table[table["status"] == "done"]
    given(table, folder, "duration")
    given(ended, folder, *COUNTS)
    for name in NUMBERS:
        if name in table:
            check(table[table[name].notna()], path, name)
    for name in (*COUNTS, *PERCENT, "time"):  # where no run is done
        if name not in table:
            given(ended, folder, name)
            table[name] = np.nan
    table["message"] = table["message"].astype(object).fillna("")
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


def records(folder: Path, rows: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Metrics of some runs at all their times, from curves.csv: columns run, time, `columns`.

    Raises
    ------
    InputError
        Where one of the runs is not there, or a value is no number.
    """
    path, names = folder / "curves.csv", ("run", "time", *columns)
    table = typed(read(path, names, ("run", "time")), names)
    lacking = rows["run"][~rows["run"].isin(table["run"])]
    if len(lacking):
        raise InputError("is not there; must be, as it is done in table.csv", file=str(path),
                         field="run", value=lacking.iloc[0])
    table = table[table["run"].isin(rows["run"])].reset_index(drop=True)
    for name in names[1:]:
        check(table[table[name].notna()] if name in PERCENT else table, path, name, -np.inf)
    return table


def curves(folder: Path, rows: pd.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    """One metric of some runs against time: times [k] (s), values [n, k] in the order of `rows`.

    The times are those that all of them have; there must be one.
    """
    table = records(folder, rows, column)
    number = table.groupby("time")["run"].count()
    times = number.index[number == len(rows)]
    if not len(times):
        raise InputError("must be in common to the runs: there is none that all have",
                         file=str(folder / "curves.csv"), field="time")
    wide = table[table["time"].isin(times)].pivot(index="run", columns="time", values=column)
    return times.to_numpy(dtype=float), wide.reindex(rows["run"]).to_numpy(dtype=float)


def last_third(folder: Path, rows: pd.DataFrame) -> list[float]:
    """The mean size of every run over the last third of its records' times."""
    sizes = records(folder, rows, "size")
    end = sizes.groupby("run")["time"].max()
    late = sizes[sizes["time"] > 2.0 / 3.0 * sizes["run"].map(end)]
    return [float(each) for each in late.groupby("run")["size"].mean().reindex(rows["run"])]


def walls(folder: Path) -> pd.Series[Any]:
    """The wall time of runs (s), by their names; of none where it was not kept."""
    path = folder / "wall.csv"
    table = typed(read(path, ("wall",)) if path.exists() else [], ("run", "wall"))
    check(table, path, "wall")
    return table.set_index("run")["wall"]


def against_plan(file: Path, table: pd.DataFrame) -> tuple[list[str], list[Planned], int]:
    """What is to be said of the campaign's state, the runs of its file that are not done, and how
    many of the table are not of this file."""
    plan = read_plan(file)
    status = {(row.group, row.fingerprint): row.status for row in table.itertuples()}
    known = {(each.group, each.mark) for each in plan}
    left = [each for each in plan if status.get((each.group, each.mark)) != "done"]
    missing = [each for each in left if status.get((each.group, each.mark)) != "failed"]
    failed = table[table["status"] == "failed"]
    lines = [f"{len(plan) - len(left)} of {len(plan)} planned runs are done, "
             f"{len(left) - len(missing)} failed, {len(missing)} are missing."]
    for group in dict.fromkeys(each.group for each in plan):
        mine = [each for each in missing if each.group == group]
        if mine:
            total = sum(each.group == group for each in plan)
            lines.append(f"- missing of {group}: {len(mine)} of {total}")
    lines += [f"- failed: {run}: {message}"
              for run, message in zip(failed["run"], failed["message"], strict=True)]
    foreign = sum(key not in known for key in status)
    if foreign:
        lines.append(f"- {foreign} runs of the table are not in {file.name} as it is now: they are "
                     "another campaign's, or a scene has changed since")
    return lines, left, foreign


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
