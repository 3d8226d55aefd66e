"""The small data of a campaign: what is done of it joins what is kept of it already.

    python -m paper_runs.keep runs/campaign
    python -m paper_runs.keep runs/campaign --group self-stabilizing --group shaking

A campaign can be done in parts, over days and on several machines, each in a folder of its own:
every call adds to paper_runs/data/NAME the rows of the runs that are done, or that failed, and
`tbsa campaign ... --except paper_runs/data/NAME/table.csv` leaves out those that are done.  Parts
must be of one version and of one plan, in which groups may have got more settings, but not others.
A run that is kept stays as it is, unless it has been made longer, and with it all of its setting.
While a campaign goes on its table can be newer than its curves: a run whose curve or wall time is
not there to the end is left for the next call.

With --group some records of the group's first run are kept too, of each of its scenes.  What is
kept is laid out as a campaign's folder, so that the figures read either.  It cannot be resumed.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import tbsa
from paper_runs.tables import DATA, Row, read
from tbsa.errors import InputError
from tbsa.model.records import write_atomically
from tbsa.work.cli import code_of
from tbsa.work.metrics import number_of

NEEDED = ("run", "group", "scene", "seed", "duration", "fingerprint", "settings", "version",
          "status", "message")
EMPTY = {"table": NEEDED, "curves": ("run", "time"), "wall": ("run", "wall", "time")}
KEYS = {"table": ("run",), "curves": ("run", "time"), "wall": ("run",)}


def keep(source: Path, target: Path, groups: Sequence[str], number: int) -> list[Path]:
    """Add the tables of a campaign's runs, and thinned runs; returns what was written."""
    if target.resolve() == source.resolve():
        raise InputError("must be another folder than the campaign's, whose tables it would "
                         "replace", file=str(target))
    new = _tables(source)
    old = _tables(target) if (target / "table.csv").exists() else {name: [] for name in EMPTY}
    listed, whole, right = new["table"], _whole(new), _whole(old)
    before = {row["run"]: row for row in old["table"]}
    taken = {row["run"]: row for row in listed
             if (row["run"] in whole and (row["run"] not in right or _longer(
                 row, before[row["run"]]))) or (
                 row["status"] == "failed" and before.get(row["run"], row)["status"] == "failed")}
    rows = before | taken
    # In the order of the campaign's file, which the source's table lists in full.
    order = dict.fromkeys([*(row["run"] for row in listed if row["run"] in rows), *rows])
    _one_provenance([rows[run] for run in order], source, target)
    _one_plan(listed, old["table"], source, target)

    chosen = [(row["run"], source / "runs" / row["run"])
              for row in _first([row for run, row in before.items() if run not in taken],
                                [row for row in listed if row["run"] in rows], groups, source,
                                target)]
    ended = {run for run, row in taken.items() if row["status"] == "done"}
    files = {}
    for name in ("curves", "wall"):
        parts: dict[str, list[Row]] = {}
        for row in old[name]:
            if row["run"] not in ended:
                parts.setdefault(row["run"], []).append(row)
        for row in new[name]:
            if row["run"] in ended:
                parts.setdefault(row["run"], []).append(row)
        files[name] = [row for run in order for row in parts.get(run, [])
                       if rows[run]["status"] == "done"]
    files["table"] = [rows[run] for run in order]  # last: what it has as done is there

    target.mkdir(parents=True, exist_ok=True)
    written = []
    for run, folder in chosen:
        written.append(thin(folder, target / "runs" / run, number))
    for name, lines in files.items():
        written.append(target / f"{name}.csv")
        write_atomically(written[-1], _text(lines, name).encode())
    return written


def _tables(folder: Path) -> dict[str, list[Row]]:
    """The three tables, as text: what is kept is kept to the bit.

    In the order in which a campaign that goes on writes them: what is read later may be newer, or
    of before it wrote the first.
    """
    return {name: read(folder / f"{name}.csv", EMPTY[name], KEYS[name]) for name in EMPTY}


def _whole(tables: dict[str, list[Row]]) -> set[str]:
    """The runs that are done and whose curve and wall time are there to the end."""
    times: dict[str, list[float]] = {}
    for row in tables["curves"]:
        times.setdefault(row["run"], []).append(_number(row["time"]))
    curve = {run: each[-1] for run, each in times.items() if _even(each)}
    wall = {row["run"]: _number(row["time"]) for row in tables["wall"]}
    ended = {row["run"]: _number(row.get("time", "")) for row in tables["table"]
             if row["status"] == "done"}
    return {run for run, time in ended.items()
            if curve.get(run) == time and wall.get(run, -math.inf) >= time}


def _even(times: Sequence[float]) -> bool:
    """Whether no record is missing: one every so often from 0 on, and at the end."""
    gaps = np.diff(times)
    return times[0] == 0.0 and bool(len(gaps) == 0 or (
        np.allclose(gaps[:-1], gaps[0], rtol=1e-6) and 0.0 < gaps[-1] < 1.000001 * gaps[0]))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _longer(row: Row, kept: Row) -> bool:
    return _number(row["duration"]) > _number(kept["duration"])


def _first(kept: Iterable[Row], listed: Iterable[Row], groups: Sequence[str], source: Path,
           target: Path) -> list[Row]:
    """The first run that is done of each group and scene, if there are no records of one yet."""
    there = {(row["group"], row["scene"]) for row in kept
             if (target / "runs" / row["run"] / "records.npy").exists()}
    first: dict[tuple[str, str], Row] = {}
    for group in groups:
        mine = [row for row in listed if row["group"] == group and row["status"] == "done"]
        if not mine and group not in {name for name, _ in there}:
            raise InputError("has no run that is done", file=str(source), field="--group",
                             value=group)
        for row in mine:
            if (row["group"], row["scene"]) not in there:
                first.setdefault((row["group"], row["scene"]), row)
    return list(first.values())


def _one_plan(listed: Sequence[Row], kept: Sequence[Row], source: Path, target: Path) -> None:
    """The settings of a group and scene in the one are all in the other, or the other way round."""
    def settings(rows: Sequence[Row]) -> dict[tuple[str, str], dict[str, str]]:
        found: dict[tuple[str, str], dict[str, str]] = {}
        for row in rows:
            found.setdefault((row["group"], row["scene"]), {}).setdefault(row["settings"],
                                                                          row["run"])
        return found

    ours, theirs = settings(listed), settings(kept)
    for (group, scene), mine in ours.items():
        other = theirs.get((group, scene), {})
        if mine.keys() - other.keys() and other.keys() - mine.keys():
            first, second = (runs[min(runs.keys() - rest.keys())]
                             for runs, rest in ((mine, other), (other, mine)))
            raise InputError(
                f"of {source} and of what is kept must be those of one plan; {first} has a setting "
                f"that is not kept, {second} one that is not there: keep them apart, in another "
                "target", file=str(target), field=f"settings of group {group}")


def _one_provenance(rows: Sequence[Row], source: Path, target: Path) -> None:
    """One version in all; one setting for all runs of a group, but for their seeds."""
    begun = [row for row in rows if row["version"]]  # what failed at once has none
    for row in begun:
        if row["version"] != begun[0]["version"]:
            raise InputError(f"of {source} and of what is kept must be one; {row['run']} and "
                             f"{begun[0]['run']} have {row['version']} and {begun[0]['version']}: "
                             "keep them apart, in another target",
                             file=str(target), field="version")
    known: dict[tuple[str, ...], Row] = {}
    for row in rows:
        names = list(row)
        set_ = names[names.index("scene") + 1 : names.index("seed")]
        what = (row["group"], row["scene"], *(f"{name}={row[name]}" for name in sorted(set_)
                                              if row[name] and name != "run.duration"))
        first = known.setdefault(what, row)
        for name in ("settings", "duration"):
            if row[name] != first[name]:
                raise InputError(
                    f"of {source} and of what is kept must be one in each group; {row['run']} and "
                    f"{first['run']} have {row[name]} and {first[name]}: keep them apart, in "
                    "another target", file=str(target), field=name)


def _text(rows: Sequence[Row], name: str) -> str:
    """Rows as CSV; of the tables' columns the fields that were set stay before the seed."""
    names = list(dict.fromkeys(each for row in rows for each in row))
    if name == "table" and rows:
        head = dict.fromkeys(each for row in rows for each in list(row)[: list(row).index("seed")])
        names = [*head, *(each for each in names if each not in head)]
    out = io.StringIO()
    writer = csv.DictWriter(out, names or EMPTY[name], restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def thin(source: Path, target: Path, number: int) -> Path:
    """Copy a run with `number` of its records, evenly spaced, the first and the last among them."""
    tbsa.read_run(source)  # whole and undamaged
    part = target.with_name(f"{target.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    for name in ("scene.toml", "run.json", "layout.npz", "drive.py"):
        if (source / name).exists():
            shutil.copyfile(source / name, part / name)
    records = np.load(source / "records.npy", mmap_mode="r")
    chosen = np.unique(np.linspace(0, len(records) - 1, number).round().astype(int))
    buffer = io.BytesIO()  # np.save loses the end of a file on a full disk without a word
    np.save(buffer, records[chosen])
    write_atomically(part / "records.npy", buffer.getvalue())
    shutil.rmtree(target, ignore_errors=True)
    part.rename(target)
    return target


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m paper_runs.keep",
                                     description="Keep the small data of a campaign, or of a part.")
    parser.add_argument("source", type=Path, help="the campaign's folder")
    parser.add_argument("target", type=Path, nargs="?",
                        help="where the small data go (default: paper_runs/data/NAME)")
    parser.add_argument("--group", action="append", default=[],
                        help="also some records of this group's first run")
    parser.add_argument("--records", type=int, default=37, help="how many (default: 37)")
    arguments = parser.parse_args(argv)
    target = arguments.target or DATA / arguments.source.resolve().name
    try:
        if arguments.records < 2:
            raise InputError("must be at least 2", field="--records", value=arguments.records)
        written = keep(arguments.source, target, arguments.group, arguments.records)
    except (InputError, OSError) as error:
        print(f"keep: {error}", file=sys.stderr)
        return 2
    ended = {row["run"]: row["status"] == "done" for row in read(target / "table.csv")}
    left = sum(row["status"] == "done" and not ended.get(row["run"])
               for row in read(arguments.source / "table.csv"))
    size = sum(path.stat().st_size for path in target.rglob("*") if path.is_file())
    print(f"{', '.join(map(str, written))}")
    fine = sum(ended.values())
    print(f"{number_of(fine, 'run')} done, {len(ended) - fine} failed, {size / 1e6:.2f} MB")
    if left:
        print(f"{left} more are done, but without a curve and a wall time yet: keep again later")
    return 0


if __name__ == "__main__":
    sys.exit(code_of(main))
