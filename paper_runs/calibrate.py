"""The calibration of force and torque, and the effect of the readings, from kept campaigns.

    python -m paper_runs.calibrate                  # report, to paper_runs/calibration.md too
    python -m paper_runs.calibrate --finals 4       # and paper_runs/finals.toml: the best, in full

Four campaigns, each of which may be missing or done in part: calibration.toml (maps, short),
finals.toml (the best points of the maps for the paper's 3600 s, written by this command),
refined.toml (torques about the nearest final's, more seeds), and readings.toml.  The choice is
made from the finals where there are any, else from the maps.  Refined runs take the place of a
final's of the same setting, which may have been the nearest by chance.

The rule
--------
A candidate is a law of floor friction, a force and a torque; shaking takes part with the same law
and the same force.  The law is not chosen: the paper's Table I has a linear and an angular
coefficient, which is separate friction; candidates with coupled friction are ranked beside the
others.  Six figures of merit are compared with the paper's: size, errors and holes at
the end, of either drive, each a mean over the runs.  How far one is off is taken in units of what
would be a clear miss,

* sizes: the logarithm of ours over the paper's, a unit for each 25 %, which is about the range in
  which single runs of one setting lie.  Where the paper gives a lower bound only ("more than 130")
  what is above it counts a unit for each doubling: whoever has 300 does not write 130, but it is
  no contradiction.  In runs shorter than the paper's that holds for sizes below, too, as the
  assembly still grows;
* errors and holes: their difference, a unit for each percentage point, which is about one tile
  (attached tiles off the lattice are no errors in the paper's sense; they are shown, not weighed);
* in runs of 3600 s also the trend: what the slope of the last third adds, a unit for each 10 % of
  the size that a shaken assembly gains or loses, or by which a self-stabilizing one falls short of
  gaining 10 %, the least that counts as not having reached its limit,

and the distance of a candidate is the root of the sum of squares.  The smallest is chosen.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from paper_runs.intervals import LEVEL, difference, mean, number, percent
from paper_runs.merit import growth
from paper_runs.paper import DURATION, END, ENOUGH, SELF, SHAKING, STEADY
from paper_runs.tables import DATA, HERE, against_plan, fields, given, load, markdown
from tbsa.errors import InputError
from tbsa.model.records import write_atomically
from tbsa.work.cli import code_of
from tbsa.work.plan import read_plan

QUARTER, DOUBLE, POINT = math.log(1.25), math.log(2.0), 1.0  # units of a miss
LEAST = 0.5  # tiles; stands for an assembly of none in a logarithm
LAW, FORCE, TORQUE = "floor.law", "drive.force", "drive.torque"
PRINTED = "separate"  # the law of the paper's Table I, in which force and torque are chosen
SHOWN = 10  # candidates in the ranking
SEEDS = 2  # of the finals


@dataclass(frozen=True)
class Point:
    """What the runs of one drive at one setting have come to."""

    drive: str
    size: float
    errors: float  # per cent; not a number if nothing was attached
    holes: float
    off: float  # attached tiles off the lattice, which the paper does not tell of; likewise
    gain: float  # over the last third, per cent of the size; likewise if runs are short
    runs: int
    duration: float
    missed: tuple[str, ...]  # the paper's figures that are excluded; none by few runs

    def misses(self) -> dict[str, float]:
        """How far each figure is off, in units of a clear miss."""
        wanted, short = END[self.drive], self.duration < DURATION
        off = math.log(max(self.size, LEAST) / wanted["size"].value)
        bound = math.isinf(wanted["size"].high)
        found = {"size": off / (DOUBLE if bound and (off > 0 or short) else QUARTER)}
        for name in ("errors", "holes"):
            value = getattr(self, name)
            found[name] = 0.0 if math.isnan(value) else (value - wanted[name].value) / POINT
        if not short and not math.isnan(self.gain):
            found["trend"] = (min(self.gain - STEADY, 0.0) if bound else self.gain) / STEADY
        return found


@dataclass(frozen=True)
class Candidate:
    """One setting of both drives."""

    law: str
    force: float
    torque: float
    ours: Point
    theirs: Point

    @property
    def distance(self) -> float:
        """From the paper's figures, see the rule."""
        return math.hypot(*self.ours.misses().values(), *self.theirs.misses().values())

    @property
    def runs(self) -> int:
        """Of the drive that has fewer."""
        return min(self.ours.runs, self.theirs.runs)

    @property
    def missed(self) -> list[str]:
        """The paper's figures that this one does not meet."""
        return [f"{point.drive} {name}" for point in (self.ours, self.theirs)
                for name in point.missed]


def point(folder: Path, rows: pd.DataFrame) -> Point:
    """The mean over the runs of one drive at one setting; they must be of one duration."""
    drive, duration = str(rows["drive"].iloc[0]), float(rows["duration"].iloc[0])
    figures = {"size": mean(rows["size"]), "errors": percent(rows["errors"], rows["size"]),
               "holes": percent(rows["holes"], rows["size"])}
    missed = [name for name, figure in figures.items() if len(rows) >= ENOUGH
              and END[drive][name].verdict(figure) in ("not reached", "no data")]
    gain = math.nan
    if duration >= DURATION:
        gain = float(np.mean(growth(folder, rows).last))
    return Point(drive, figures["size"].value, figures["errors"].value, figures["holes"].value,
                 percent(rows["off_lattice"], rows["size"]).value, gain, len(rows), duration,
                 tuple(missed))


def points(folder: Path, table: pd.DataFrame) -> dict[tuple[str, ...], Point]:
    """The points of maps or finals, by drive, law, force and torque (none of shaking)."""
    ended = given(table[table["status"] == "done"], folder, LAW, FORCE, "off_lattice")
    if ended.empty:
        return {}
    given(ended[ended["drive"] == SELF], folder, TORQUE)
    found = {}
    for (law, force), rows in ended.groupby([LAW, FORCE]):
        for torque, some in rows[rows["drive"] == SELF].groupby(TORQUE):
            found[SELF, law, force, torque] = point(folder, some)
        if len(shaken := rows[rows["drive"] == SHAKING]):
            found[SHAKING, law, force] = point(folder, shaken)
    return found


def candidates(found: dict[tuple[str, ...], Point]) -> list[Candidate]:
    """All settings for which both drives are there, nearest to the paper first."""
    both = [Candidate(law, force, torque, ours, found[SHAKING, law, force])
            for (drive, law, force, *rest), ours in found.items() if drive == SELF
            for torque in rest if (SHAKING, law, force) in found]
    return sorted(both, key=lambda each: (each.distance, each.force, each.torque, each.law))


def eligible(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Those with the paper's law of floor friction, of which one is chosen."""
    return [each for each in ranked if each.law == PRINTED]


# ---------------------------------------------------------------------------------------------
# The report.


def maps(found: dict[tuple[str, ...], Point]) -> list[str]:
    """Size, errors and holes by force and torque, a table a law."""
    lines = []
    for law in sorted({key[1] for key in found}, reverse=True):  # separate first
        mine = {key: each for key, each in found.items() if key[1] == law}
        forces = sorted({key[2] for key in mine})
        torques = sorted({key[3] for key in mine if key[0] == SELF})
        best = {(each.force, each.torque): each.distance for each in candidates(mine)}
        rows = [[f"{torque:g}", *(_cell(mine.get((SELF, law, force, torque))) for force in forces)]
                for torque in reversed(torques)]
        rows.append(["shaking", *(_cell(mine.get((SHAKING, law, force))) for force in forces)])
        far = [[f"{torque:g}", *(f"{best[force, torque]:.1f}" if (force, torque) in best else "–"
                                 for force in forces)] for torque in reversed(torques)]
        head = [f"{force:g}" for force in forces]
        lines += [f"### {law.capitalize()} floor friction", "",
                  "Attached tiles, errors in %, holes in %; F_mag (N) across, T_mag (N m) down:",
                  "", *markdown(["T_mag", *head], rows), "",
                  "Distance from the paper's figures:", "", *markdown(["T_mag", *head], far), ""]
    return lines


def _cell(each: Point | None) -> str:
    if each is None:
        return "–"
    return ", ".join([f"{each.size:.0f}", *("–" if math.isnan(value) else f"{value:.1f}"
                                           for value in (each.errors, each.holes))])


def ranking(ranked: Sequence[Candidate]) -> list[str]:
    """The nearest candidates."""
    rows = []
    for k, each in enumerate(ranked[:SHOWN]):
        misses = {**{f"{SELF} {name}": off for name, off in each.ours.misses().items()},
                  **{f"{SHAKING} {name}": off for name, off in each.theirs.misses().items()}}
        worst = max(misses, key=lambda name: abs(misses[name]))
        rows.append((k + 1, each.law, f"{each.force:g}", f"{each.torque:g}",
                     f"{each.distance:.2f}", _cell(each.ours), _cell(each.theirs),
                     ", ".join("–" if math.isnan(point.off) else f"{point.off:.1f}"
                               for point in (each.ours, each.theirs)),
                     f"{each.ours.runs} and {each.theirs.runs}",
                     f"{worst} ({number(misses[worst])})"))
    return markdown(("", "floor", "F_mag", "T_mag", "distance", SELF, SHAKING,
                     "off the lattice (%)", "runs", "furthest off (units)"), rows)


def choice(ranked: Sequence[Candidate], final: bool, whole: bool) -> list[str]:
    """What is chosen once the finals are `whole`, and whether the paper's figures can be met
    together."""
    others = [each for each in ranked if each.law != PRINTED]
    ranked = eligible(ranked)
    if not ranked:
        return [f"No setting with {PRINTED} friction has runs of both drives yet: nothing can be "
                "chosen."]
    best = ranked[0]
    lines = [f"**{'Chosen' if final and whole else 'Nearest so far'}: F_mag = {best.force:g} N, "
             f"T_mag = {best.torque:g} N m, {best.law} floor friction** (distance "
             f"{best.distance:.2f})."]
    if len(ranked) > 1:
        second = ranked[1]
        lines.append(f"Runner-up: {second.force:g} N, {second.torque:g} N m, {second.law} "
                     f"(distance {second.distance:.2f}).")
    if others:
        other = others[0]
        lines.append(f"With {other.law} friction the nearest is {other.force:g} N, "
                     f"{other.torque:g} N m (distance {other.distance:.2f}).")
    told = [each for each in ranked if each.runs >= ENOUGH]
    full = [each for each in told if not each.missed]
    if not final:
        lines.append(f"Runs of {best.ours.duration:g} s cannot tell whether the paper's figures at "
                     f"{DURATION:g} s are met; they rank candidates for the finals.")
    elif not told:
        lines.append("Whether the paper's six end values are met together at a setting cannot be "
                     f"told: none has {ENOUGH} runs of both drives, and fewer exclude nothing. "
                     "Those of the setting chosen are judged by its campaign, in `merit.md`.")
    elif full:
        nearest = full[0]
        lines.append("The paper's six end values can be met together, in the sense that our 95 % "
                     f"intervals do not exclude them, at {len(full)} of {len(told)} settings "
                     f"with {ENOUGH} runs of both drives or more"
                     + (", the chosen one among them." if nearest is best else
                        f"; the nearest of these is {nearest.force:g} N, {nearest.torque:g} N m, "
                        f"{nearest.law}."))
    else:
        nearest = told[0]
        fewest = min(told, key=lambda each: (len(each.missed), each.distance))
        lines.append("**The paper's six end values are not met together by any of the "
                     f"{len(told)} settings with {ENOUGH} runs of both drives or more.** Closest "
                     f"by the rule is {nearest.force:g} N, {nearest.torque:g} N m, {nearest.law}; "
                     f"it misses {_and(nearest.missed)}."
                     + ("" if fewest is nearest else
                        f" Fewest are missed at {fewest.force:g} N, {fewest.torque:g} N m, "
                        f"{fewest.law}: {_and(fewest.missed)}."))
    return lines


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def readings(table: pd.DataFrame) -> list[str]:
    """Each reading against the base: size with its difference, errors, holes, and the rest."""
    ended = table[table["status"] == "done"]
    base = {drive: rows[rows["group"] == "base"] for drive, rows in ended.groupby("drive")}
    if all(rows.empty for rows in base.values()):
        return ["There is no run of the group base yet to compare with."]
    names, rows, apart, compared = fields(table), [], 0, 0
    for group in dict.fromkeys(ended["group"]):
        mine = ended[ended["group"] == group]
        varied = [name for name in names if mine[name].nunique(dropna=True) > 1]
        keys = mine["group"]
        for name in varied:
            keys = keys + " " + mine[name].map(
                lambda value: f"{value:g}" if isinstance(value, float) else str(value))
        for value in dict.fromkeys(keys):
            for drive in (SELF, SHAKING):
                some = mine[(keys == value) & (mine["drive"] == drive)]
                if some.empty:
                    continue
                reference = base[drive]
                off = "–"
                if group != "base" and len(reference):
                    estimate = difference(some["size"], reference["size"])
                    clear = estimate.low > 0.0 or estimate.high < 0.0
                    compared += not math.isnan(estimate.low)  # one run has no interval
                    apart += clear
                    off = f"{estimate}{' *' if clear else ''}"
                spread = number(float(some["size"].std())) if len(some) > 1 else "–"
                rows.append((value, drive, len(some),
                             f"{number(float(some['size'].mean()))} ± {spread}", off,
                             *(number(float(some[name].mean())) for name in
                               ("errors_percent", "holes_percent")),
                             *(number(float(some[name].mean())) if name in some else "–"
                               for name in ("wrongly_turned", "size_contact"))))
    times = ", ".join(f"{each:g}" for each in sorted(set(ended["duration"])))
    return [f"Means over the seeds after {times} s; ± is the standard deviation between seeds. "
            f"{_about(ended)}".strip(), "",
            *markdown(("reading", "drive", "runs", "size", "less the base (95 %)", "errors (%)",
                       "holes (%)", "wrongly turned", "size by contact"), rows), "",
            f"\\* The interval leaves out 0: {apart} of {compared}, of which {0.05 * compared:.0f} "
            "would by chance. The ground truth has 400 sites with a seed of 41 tiles, 81 with 19 "
            "and 64 with 36; tiles outside it count, too. Membership by contact instead of by "
            "bonds is the last column. With families that do not follow the colours, errors are "
            "tiles that face a tile of the assembly with magnets that do not attract."]


def _about(ended: pd.DataFrame) -> str:
    """Force and torque of the base, where its runs are those of the file as it is now."""
    ours = set(ended[ended["group"] == "base"]["fingerprint"])
    base = [each for each in read_plan(FILES["readings"]) if each.mark in ours]
    said = {}
    for each in base:
        drive, floor = each.scene.drive, each.scene.floor
        if drive is not None and floor is not None:
            said[drive.kind] = (f"{drive.kind} {drive.force:g} N"
                                + f" and {drive.torque:g} N m" * (drive.torque > 0)
                                + f" on {floor.law} floor friction")
    return f"The base: {', '.join(said.values())}." if said else ""


def noise(folder: Path, table: pd.DataFrame, ranked: Sequence[Candidate] = ()) -> str:
    """How much the distance scatters between single runs of one setting, from the base; how many
    of the `ranked`, of one run each, that does not tell from the first."""
    base = table[(table["status"] == "done") & (table["group"] == "base")]
    singles = {drive: [point(folder, base.loc[[k]]) for k in base.index[base["drive"] == drive]]
               for drive in (SELF, SHAKING)}
    far = [math.hypot(*a.misses().values(), *b.misses().values())
           for a, b in zip(singles[SELF], singles[SHAKING], strict=False)]
    if len(far) < 2:
        return ""
    spread = float(np.std(far, ddof=1))
    # Of a difference of two: root 2, and as the scatter is known from few seeds, Student's t.
    apart = float(stats.t.ppf(0.5 + LEVEL / 2, len(far) - 1)) * math.sqrt(2.0) * spread
    near = sum(each.distance - ranked[0].distance < apart for each in ranked[1:])
    return (f"Between single seeds of one setting the distance has a standard deviation of "
            f"{spread:.2f} (group base of the readings, {len(far)} seeds): two candidates of one "
            f"run each are told apart (95 %) if their distances differ by more than {apart:.2f}."
            + (f" Nearer than that to the first: {near} of the {len(ranked) - 1} other settings of "
               "the maps." if ranked else ""))


def report(folders: dict[str, Path]) -> tuple[str, list[Candidate]]:
    """The whole report in Markdown, and the ranked candidates of the maps."""
    tables = {name: load(folder) for name, folder in folders.items()
              if (folder / "table.csv").exists()}
    lines = ["# Calibration", "",
             "The paper prints neither the drive's force nor its torque. One force is chosen for "
             "both drives, and a torque for the self-stabilizing one.", "", "## What is there", ""]
    whole = True
    for name, file in FILES.items():
        if name not in tables:
            missing = "" if file.exists() else f" (nor {file.name}, which --finals writes)"
            lines.append(f"- {name}: nothing yet{missing}")
        elif file.exists():
            said, left, _ = against_plan(file, tables[name])
            whole &= name not in ("finals", "refined") or not left
            lines += [f"- {name}: {said[0]}", *(f"  {line}" for line in said[1:])]
        else:
            lines.append(f"- {name}: {(tables[name]['status'] == 'done').sum()} runs")
    mapped = points(folders["maps"], tables["maps"]) if "maps" in tables else {}
    last: dict[tuple[str, ...], Point] = {}
    for name in ("finals", "refined"):
        last |= points(folders[name], tables[name]) if name in tables else {}
    ranked, finalists = candidates(mapped), candidates(last)
    lines += ["", "## Choice", "", *choice(finalists or ranked, bool(finalists), whole)]
    if "readings" in tables and (
            said_ := noise(folders["readings"], tables["readings"], ranked)):
        lines += ["", said_]
    if finalists:
        lines += ["", "## Finals", "", *ranking(finalists)]
    if ranked:
        lines += ["", "## Ranking of the maps", "", *ranking(ranked)]
    lines += ["", "## Rule", "", _rule()]
    if mapped:
        lines += ["", "## Maps", "", *maps(mapped)]
    if "readings" in tables:
        lines += ["", "## Readings, one at a time", "",
                  *readings(tables["readings"])]
    return "\n".join(lines).rstrip() + "\n", ranked


def _rule() -> str:
    """The rule, as it stands at the top of this file."""
    assert __doc__ is not None
    return __doc__.partition("--------\n")[2].strip()


def finals(ranked: Sequence[Candidate], number: int) -> str:
    """A campaign's file: the nearest settings for the paper's duration."""
    chosen = eligible(ranked)[:number]
    shaken = list(dict.fromkeys((each.law, each.force) for each in chosen))

    def array(values: Sequence[str | float]) -> str:
        return "[" + ", ".join(f'"{each}"' if isinstance(each, str) else repr(float(each))
                               for each in values) + "]"

    return f'''# The settings that came closest to the paper in the maps, run in full.
# Written by  python -m paper_runs.calibrate --finals {number}
#
#     tbsa campaign paper_runs/finals.toml --out runs/finals
#     python -m paper_runs.keep runs/finals
#     python -m paper_runs.calibrate

title = "Finals of the calibration"
seeds = {{first = 1, number = {SEEDS}}}
set = {{"run.duration" = {DURATION}}}

[[group]]
name = "final-unicycle"
scene = "self_stabilizing.toml"
[group.list]
"{LAW}" = {array([each.law for each in chosen])}
"{FORCE}" = {array([each.force for each in chosen])}
"{TORQUE}" = {array([each.torque for each in chosen])}

[[group]]
name = "final-shaking"
scene = "shaking.toml"
[group.list]
"{LAW}" = {array([law for law, _ in shaken])}
"{FORCE}" = {array([force for _, force in shaken])}
'''


FILES = {"maps": HERE / "calibration.toml", "finals": HERE / "finals.toml",
         "refined": HERE / "refined.toml", "readings": HERE / "readings.toml"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m paper_runs.calibrate",
                                     description="Choose force and torque; tabulate the readings.")
    parser.add_argument("--data", type=Path, default=DATA, metavar="DIR",
                        help="folder of what was kept: calibration, finals, refined, readings "
                        "(default: paper_runs/data)")
    parser.add_argument("--out", type=Path, default=HERE / "calibration.md",
                        help="the report (default: paper_runs/calibration.md)")
    parser.add_argument("--finals", type=int, metavar="N",
                        help="also write paper_runs/finals.toml, the N nearest of the maps")
    arguments = parser.parse_args(argv)
    folders = {name: arguments.data / file.stem for name, file in FILES.items()}
    try:
        text, ranked = report(folders)
        files = {arguments.out: text}
        if arguments.finals is not None:
            most = len(eligible(ranked))
            if not 1 <= arguments.finals <= most:
                raise InputError(f"must be from 1 to {most}, the settings of the maps with "
                                 f"{PRINTED} friction for which both drives are there",
                                 field="--finals", value=arguments.finals)
            kept = folders["finals"] / "table.csv"
            if kept.exists():
                raise InputError(f"are kept already in {kept}: their plan stays what it is",
                                 field="--finals", value=arguments.finals)
            files[FILES["finals"]] = finals(ranked, arguments.finals)
        for path, content in files.items():
            write_atomically(path, content.encode())
    except (InputError, OSError) as error:
        print(f"calibrate: {error}", file=sys.stderr)
        return 2
    print(text)
    print(f"written: {', '.join(map(str, files))}")
    return 0


if __name__ == "__main__":
    sys.exit(code_of(main))
