"""The small data of a campaign: its tables, and of the first run of some groups a few records.

    python -m paper_runs.keep runs/campaign paper_runs/data/campaign --group shaking --records 13

What is kept is laid out as a campaign's folder, so that the figures read either.  It cannot be
resumed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

import tbsa
from tbsa.errors import InputError


def keep(source: Path, target: Path, groups: Sequence[str], number: int) -> list[Path]:
    """Copy the tables, and thinned runs; returns what was written."""
    table = pd.read_csv(source / "table.csv")
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for name in ("table.csv", "curves.csv", "wall.csv"):
        written.append(target / name)
        shutil.copyfile(source / name, written[-1])
    for group in groups:
        runs = table[(table["group"] == group) & (table["status"] == "done")]["run"]
        if runs.empty:
            raise InputError("has no run that is done", file=str(source), field="--group",
                             value=group)
        written.append(thin(source / "runs" / runs.iloc[0], target / "runs" / runs.iloc[0], number))
    return written


def thin(source: Path, target: Path, number: int) -> Path:
    """Copy a run with `number` of its records, evenly spaced, the first and the last among them."""
    tbsa.read_run(source)  # whole and undamaged
    target.mkdir(parents=True, exist_ok=True)
    for name in ("scene.toml", "run.json", "layout.npz", "drive.py"):
        if (source / name).exists():
            shutil.copyfile(source / name, target / name)
    records = np.load(source / "records.npy", mmap_mode="r")
    chosen = np.linspace(0, len(records) - 1, number).round().astype(int)
    np.save(target / "records.npy", records[chosen])
    return target


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m paper_runs.keep",
                                     description="Keep the small data of a campaign.")
    parser.add_argument("source", type=Path, help="the campaign's folder")
    parser.add_argument("target", type=Path, help="where the small data go")
    parser.add_argument("--group", action="append", default=[],
                        help="also some records of this group's first run")
    parser.add_argument("--records", type=int, default=13, help="how many (default: 13)")
    arguments = parser.parse_args(argv)
    try:
        if arguments.records < 2:
            raise InputError("must be at least 2", field="--records", value=arguments.records)
        written = keep(arguments.source, arguments.target, arguments.group, arguments.records)
    except (InputError, OSError) as error:
        print(f"keep: {error}", file=sys.stderr)
        return 2
    size = sum(path.stat().st_size for path in arguments.target.rglob("*") if path.is_file())
    print(f"{', '.join(map(str, written))}: {size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
