"""The paper's comparison in short: 20 s of both drives, metrics, and one picture.

    python -m paper_runs.quick

writes to runs/quick and replaces what an earlier call left there.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import tbsa
from tbsa.errors import InputError
from tbsa.model.scene import Record, Run, Scene
from tbsa.work.cli import Bar, told
from tbsa.work.draw import Snapshot, summary_figure

FOLDER = Path("runs") / "quick"
DRIVES = {"self-stabilizing": "self_stabilizing.toml", "shaking": "shaking.toml"}
SECONDS, EVERY, SHOWN = 20.0, 2.0, 10.0  # of simulated time: duration, records, rows printed
COLUMNS = ["time", "size", "errors_percent", "holes_percent", "largest_free_cluster", "bonds"]


def short(file: str) -> Scene:
    """A scene of the paper, with a shorter duration and more records."""
    scene = tbsa.load(Path(__file__).parent / file)
    scene = replace(scene, record=Record(EVERY, EVERY), run=Run(SECONDS, scene.run.seed))
    scene.validate()
    return scene


def main(argv: Sequence[str] | None = None) -> int:
    """Run both drives; returns 0, or 130 after Ctrl-C."""
    argparse.ArgumentParser(
        prog="python -m paper_runs.quick",
        description="The paper's comparison in short: 20 s of both drives, metrics, and a picture.",
    ).parse_args(argv)
    tables, last = {}, {}
    for name, file in DRIVES.items():
        scene, folder = short(file), FOLDER / Path(file).stem
        if folder.exists():
            shutil.rmtree(folder)
        print(f"{name}: {scene.title}, {SECONDS:g} s of the paper's 3600 s")
        with Bar(scene) as bar:
            outcome = tbsa.run(scene, folder, progress=bar.show)
        if not outcome.finished:
            print("stopped")
            return 130
        records = tbsa.read_run(folder)
        x, y, angle = records.x, records.y, records.angle
        table = tbsa.table(scene, records.layout, records.time, x, y, angle)
        tables[name] = table
        last[name] = scene, Snapshot(records.layout, x[-1], y[-1], angle[-1], records.time[-1])
        rows = table[table["time"] % SHOWN == 0]
        print(rows[COLUMNS].to_string(index=False, float_format="%.1f", na_rep="-"), end="\n\n")
    picture = FOLDER / "summary.png"
    summary_figure(tables, last, picture)
    print(f"picture in {picture}, runs in {FOLDER}")
    return 0


if __name__ == "__main__":
    try:
        with told():
            code = main()
        sys.exit(code)
    except KeyboardInterrupt:
        sys.exit(130)
    except (InputError, OSError) as error:
        sys.exit(f"quick: {error}")
