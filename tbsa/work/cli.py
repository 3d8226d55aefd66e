"""The command ``tbsa``: run, campaign, metrics, draw, movie, view, export,
check, fit, bench, warmup.

Exit codes: 0 done; 1 a run could not go on (disk, a state that is not finite); 2 bad input,
nothing written; 130 interrupted, saved.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import shlex
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from tbsa import __version__
from tbsa.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from tbsa.model.scene import Scene
    from tbsa.model.simulation import Simulation


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    with _stderr(), _ended() as signals:
        try:
            with told():  # --help
                arguments = _parser().parse_args(argv)
        except KeyboardInterrupt:
            return 130
        try:
            with told():
                _check_out(arguments)
                code: int = arguments.command(arguments)
            return code
        except InputError as error:
            _say(f"tbsa: {_of_option(error, arguments)}")
            return 2
        except KeyboardInterrupt:
            return 130
        except BrokenPipeError:
            return 1
        except (OSError, RuntimeError) as error:
            if isinstance(error.__cause__, KeyboardInterrupt):  # in an import, up to Python 3.11
                return 130
            _say(f"tbsa: {error}")
            return 1
        except ImportError:  # NumPy makes one of a Ctrl-C in its own imports
            if signals:
                return 130
            raise


@contextlib.contextmanager
def _ended() -> Iterator[list[int]]:
    """Have SIGTERM raise KeyboardInterrupt, as Ctrl-C does, so that no scratch file stays; gives a
    list of those that have come."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return

    def note(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {number: signal.signal(number, note) for number, handler in usual.items()
              if signal.getsignal(number) is handler}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _stderr() -> Iterator[None]:
    """Where it is closed (``2>&-``), one that leads nowhere: a bar fails without, and messages
    would go to the output."""
    if sys.stderr is not None:
        try:
            yield
        finally:
            _drop(sys.stderr)
        return
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stderr(nowhere):
        yield


def _say(what: object) -> None:
    """A message; where it cannot be written the exit code is all that is told."""
    with contextlib.suppress(OSError):
        print(what, file=sys.stderr)


def _drop(stream: TextIO | None) -> None:
    """What cannot be written is dropped: Python would try again at its exit, and end with 120."""
    if stream is None:
        return
    try:
        stream.flush()
    except OSError:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


@contextlib.contextmanager
def told() -> Iterator[None]:
    """What is printed is out at the end, or an OSError says that it is not: Python would find that
    only at its exit."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a title may hold what its encoding does not
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    finally:
        _drop(sys.stdout)


def code_of(command: Callable[[], int]) -> int:
    """The exit code of a command; 130 after Ctrl-C, and 1 where what it prints cannot be written,
    both without a word, the latter where its reader has enough, as head has."""
    try:
        with told():
            return command()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return 1
    except OSError as error:
        _say(error)
        return 1


def _of_option(error: InputError, arguments: argparse.Namespace) -> str:
    """What is wrong, with the option's name in place of that of the argument in Python."""
    name = {"path": "out"}.get(error.field or "", error.field or "")
    if name.startswith("record.") and hasattr(arguments, "run"):
        return f"{arguments.run / 'records.npy'}: {error}"
    if error.file or not hasattr(arguments, name):
        return str(error)
    option = {"begin": "from", "end": "to"}.get(name, name)
    return f"--{option}{str(error).removeprefix(error.field or '')}"


class _OneLine(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything else does; how it is used is in --help."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # A value like -1mm is one, as -1 is: what is allowed tells whoever reads it.
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())}\n")


def _check_out(arguments: argparse.Namespace) -> None:
    """What --out names can be looked up: it is not too long, for one."""
    out: Path | None = getattr(arguments, "out", None)
    # A file is written beside its place first, under a name that is a little longer.
    more = 20 * "_" if arguments.command in (_metrics, _draw, _movie, _view, _export) else ""
    if out is not None:
        _check_written(out, more)


def _check_written(out: Path, more: str = "") -> None:
    """A path can be looked up, also with a longer name."""
    try:
        (out.parent / f"{out.name}{more}").exists()
    except OSError as error:
        raise InputError(f"must be a path that can be written: {error.strerror}", field="--out",
                         value=str(out)) from None


def _parser() -> argparse.ArgumentParser:
    parser = _OneLine(
        prog="tbsa", description="Magnetically bonded, passive tile self-assembly.")
    parser.add_argument("--version", action="version", version=f"tbsa {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="run a scene", description="Run a scene.")
    run.add_argument("config", type=Path, help="the scene, a TOML file")
    run.add_argument("--seed", type=int, help="seed of the random numbers, instead of the scene's")
    run.add_argument("--duration", type=float, metavar="S", help="simulated seconds, likewise")
    run.add_argument("--out", type=Path, metavar="DIR",
                     help="the run's folder (default: runs/NAME-SEED)")
    run.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings",
                     help="a field of the scene, such as drive.force=0.06; may be repeated")
    run.add_argument("--resume", action="store_true", help="go on from the folder's checkpoint")
    run.add_argument("--threads", type=int, default=1, metavar="N",
                     help="threads that share the work, for some thousands of tiles and more; "
                          "same bits (default: 1)")
    run.add_argument("--quiet", action="store_true", help="no progress bar")
    run.add_argument("--report", action="store_true",
                     help="end with a table of what was computed and what was left out")
    run.set_defaults(command=_run)

    campaign = commands.add_parser(
        "campaign", help="do many runs of many scenes",
        description="Do the runs of a campaign's file.")
    campaign.add_argument("config", type=Path, help="the campaign, a TOML file")
    campaign.add_argument("--out", type=Path, metavar="DIR", required=True,
                          help="the campaign's folder")
    campaign.add_argument("--resume", action="store_true",
                          help="go on with what is in the folder, or begin")
    campaign.add_argument("--jobs", type=int, metavar="N",
                          help="runs at a time, each a process (default: one a core)")
    campaign.add_argument("--scheduler", metavar="ADDRESS",
                          help="let the workers of this dask.distributed scheduler do the runs")
    campaign.add_argument("--part", metavar="I/N", default="1/1",
                          help="do the I-th of N shares of the runs, as one job of an array")
    campaign.add_argument("--except", metavar="TABLE", dest="without", type=Path,
                          help="leave out the runs that this table of the same campaign, done in "
                          "parts, has as done")
    campaign.add_argument("--quiet", action="store_true", help="no progress bar")
    campaign.set_defaults(command=_campaign)

    metrics = commands.add_parser("metrics", help="table of a run's metrics",
                                  description="Print a run's metrics and write metrics.csv.")
    metrics.add_argument("run", type=Path, help="the run's folder")
    metrics.add_argument("--out", type=Path, metavar="CSV", help="(default: RUN/metrics.csv)")
    metrics.set_defaults(command=_metrics)

    draw = commands.add_parser("draw", help="picture of a run",
                               description="Draw a run at one time.")
    draw.add_argument("run", type=Path, help="the run's folder")
    draw.add_argument("--time", type=float, metavar="T", help="simulated time in s (default: last)")
    draw.add_argument("--out", type=Path, metavar="FILE",
                      help="png, pdf or svg (default: RUN/tTIME.png)")
    draw.add_argument("--glues", action="store_true", help="glue labels on the edges")
    draw.set_defaults(command=_draw)

    movie = commands.add_parser("movie", help="film of a run",
                                description="Draw the records of a run one after the other.")
    movie.add_argument("run", type=Path, help="the run's folder")
    movie.add_argument("--out", type=Path, metavar="FILE",
                       help="gif, or mp4 with ffmpeg or the extra movie (default: RUN/movie.gif)")
    movie.add_argument("--rate", type=float, default=15.0, metavar="N",
                       help="pictures a second (default: 15)")
    movie.add_argument("--size", type=int, default=720, metavar="N",
                       help="width in pixels (default: 720)")
    movie.add_argument("--glues", action="store_true", help="glue labels on the edges")
    movie.set_defaults(command=_movie)

    view = commands.add_parser("view", help="page of a run, for a browser",
                               description="Write a page on which to play a run, look closer and "
                               "follow a tile; one file, which any browser opens.")
    view.add_argument("run", type=Path, help="the run's folder")
    view.add_argument("--out", type=Path, metavar="FILE", help="(default: RUN/view.html)")
    view.set_defaults(command=_view)
    for each in (movie, view):
        each.add_argument("--from", type=float, metavar="T", dest="begin",
                          help="simulated time of the first record in s (default: all of the run)")
        each.add_argument("--to", type=float, metavar="T", dest="end", help="... of the last one")
        each.add_argument("--every", type=int, default=1, metavar="N",
                          help="one record in so many (default: 1)")

    export = commands.add_parser(
        "export", help="trajectory for other programs",
        description="Write a run's records as a GSD file, which OVITO and others read; needs the "
        "extra gsd.")
    export.add_argument("run", type=Path, help="the run's folder")
    export.add_argument("--out", type=Path, metavar="FILE", help="(default: RUN/run.gsd)")
    export.set_defaults(command=_export)

    check = commands.add_parser(
        "check", help="check a scene and its tile set",
        description="Check a scene, grow its pattern abstractly, and list what could bind wrongly.")
    check.add_argument("config", type=Path, help="the scene, a TOML file")
    check.set_defaults(command=_check)

    fit = commands.add_parser(
        "fit", help="fit a magnet model to measured forces",
        description="Fit F = alpha / (r + beta)^2, or another model, to measured forces; print "
        "the fit, compare the models, draw the residuals and write the [magnet] section of a "
        "scene.  Lengths are given with their unit: 1.5mm.")
    fit.add_argument("csv", type=Path, help="measurements; the header names columns and units, "
                     "such as  gap (mm),force (N),sd (N)")
    fit.add_argument("--model", choices=("law", "power", "cylinder", "cuboid"), default="law",
                     help="the model shown in full (default: law)")
    fit.add_argument("--distance", choices=("gap", "centre"),
                     help="what a column called distance holds")
    fit.add_argument("--inset", metavar="LENGTH", help="depth of the magnets' centres behind the "
                     "surfaces that a gap is measured between: r = gap + 2 inset")
    fit.add_argument("--range", metavar="LOW:HIGH", help="measured distances to use; either end "
                     "may be left out")
    fit.add_argument("--fix", action="append", default=[], metavar="NAME=VALUE",
                     help="a parameter that is known, such as height=5mm")
    fit.add_argument("--bound", action="append", default=[], metavar="NAME=LOW:HIGH",
                     help="limits of a parameter")
    fit.add_argument("--loss", choices=("linear", "soft_l1", "huber", "cauchy"), default="linear",
                     help="a robust loss makes little of outliers (default: linear)")
    weights = fit.add_mutually_exclusive_group()
    weights.add_argument("--unweighted", action="store_true",
                         help="leave the uncertainties out of the fit")
    weights.add_argument("--absolute", action="store_true", help="take the uncertainties at their "
                     "word; otherwise the scatter of the points scales the errors")
    fit.add_argument("--interval", choices=("profile", "bootstrap", "normal"),
                     help="kind of the 95 %% intervals (default: profile; normal "
                     "for a robust loss, which has no other)")
    fit.add_argument("--out", type=Path, metavar="DIR",
                     help="folder for fit.png and magnet.toml (default: fits/NAME-MODEL)")
    fit.add_argument("--scene", type=Path, metavar="TOML",
                     help="a scene whose [magnet] gets the fitted alpha and beta, and "
                     "the inset, if there is one")
    fit.set_defaults(command=_fit)
    bench = commands.add_parser(
        "bench", help="what accuracy costs on a scene",
        description="Try settings of the solver on a scene and recommend one.")
    bench.add_argument("config", type=Path, help="the scene, a TOML file")
    bench.add_argument("--error", type=float, default=1e-2, metavar="W",
                       help="wanted, in widths of a tile (default: 0.01)")
    bench.add_argument("--after", type=float, default=1.0, metavar="S",
                       help="simulated seconds before the trials (default: 1)")
    bench.add_argument("--horizon", type=float, default=0.25, metavar="S",
                       help="simulated seconds of a trial (default: 0.25)")
    bench.set_defaults(command=_bench)
    warmup = commands.add_parser(
        "warmup", help="compile what any scene needs",
        description="Compile all kernels and built-in drives, so that no run has to wait for it.")
    warmup.set_defaults(command=_warmup)
    return parser


def _run(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import run
    from tbsa.model.scene import load, of_run
    from tbsa.model.simulation import cores

    if not 1 <= arguments.threads <= cores():
        raise InputError(f"must be from 1 to {cores()}, the cores that there are",
                         field="--threads", value=arguments.threads)
    if arguments.settings:
        from tbsa.work.plan import changed

        for name in ("seed", "duration"):
            given = getattr(arguments, name)
            if given is not None and any(text.partition("=")[0].strip() == f"run.{name}"
                                         for text in arguments.settings):
                raise InputError(f"must be left out where --set gives run.{name}",
                                 field=f"--{name}", value=given)
        scene = changed(arguments.config, arguments.settings)
    else:
        scene = load(arguments.config)
    try:
        scene = of_run(scene, arguments.seed, arguments.duration)
    except InputError as error:  # what the file gives has been accepted
        raise error.of(scene.file, f"{error.field}, by the command line") from None
    folder = arguments.out or Path("runs") / f"{arguments.config.stem}-{scene.run.seed}"
    _check_written(folder)
    again = shlex.join(["tbsa", "run", _operand(folder / "scene.toml"), "--out", _operand(folder),
                        *_given("--duration", arguments.duration),
                        *_given("--threads", arguments.threads, 1), "--resume"])
    try:
        with Bar(scene, arguments.quiet) as bar:
            outcome = run(scene, folder, resume=arguments.resume, threads=arguments.threads,
                          progress=bar.show)
    except KeyboardInterrupt:
        if (folder / "run.json").exists():
            _say(f"broken off; go on from the last checkpoint with\n  {again}")
        return 130
    except OSError as error:
        if isinstance(error, BrokenPipeError) or not (folder / "run.json").exists():
            raise
        _say(f"tbsa: {error}; go on from the last checkpoint with\n  {again}")
        return 1
    simulation = outcome.simulation
    if not outcome.finished:
        _say(f"stopped at {simulation.time:.1f} s and saved; go on with\n  {again}")
        return 130
    print(summary(scene, simulation, outcome.wall, outcome.begun))
    if arguments.report:
        from tbsa.work.report import work

        info = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        print("", work(info["counts"], scene, info["wall"], info["since"]), "", sep="\n")
    print(f"run in {folder}")
    return 0


def _campaign(arguments: argparse.Namespace) -> int:
    from tbsa.work.campaign import ELSEWHERE, FAILED, campaign
    from tbsa.work.metrics import number_of

    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", arguments.part)
    if match is None:
        raise InputError("must be I/N, I from 1 to N", field="--part", value=arguments.part)
    again = shlex.join(["tbsa", "campaign", _operand(arguments.config),
                        "--out", _operand(arguments.out),
                        *_given("--jobs", arguments.jobs),
                        *_given("--scheduler", arguments.scheduler),
                        *_given("--part", arguments.part, "1/1"),
                        *_given("--except", arguments.without), "--resume"])
    try:
        with contextlib.ExitStack() as stack:
            executor = None
            if arguments.scheduler is not None:
                if arguments.jobs is not None:
                    raise InputError("must be left out with --scheduler: its workers are its own",
                                     field="--jobs", value=arguments.jobs)
                executor = stack.enter_context(_cluster(arguments.scheduler))
            result = campaign(
                arguments.config, arguments.out, executor=executor, jobs=arguments.jobs,
                resume=arguments.resume, part=(int(match[1]), int(match[2])),
                without=arguments.without, progress=not arguments.quiet)
    except KeyboardInterrupt:
        _say(f"broken off; go on with\n  {again}")
        return 130
    rows = result.table[result.table["status"] == FAILED]
    for name, message in zip(rows["run"], rows["message"], strict=True):
        _say(f"tbsa: {name} failed: {message}")
    if result.left:
        _say(f"stopped and saved, {number_of(result.left, 'run')} to go; go on with\n  {again}")
        return 130
    others = int((result.table["status"] == ELSEWHERE).sum())
    print(f"{number_of(result.done, 'run')} done, {result.failed} failed"
          f"{f', {others} done elsewhere' if others else ''}; table in "
          f"{arguments.out / 'table.csv'}")
    return 1 if result.failed else 0


def _operand(path: str | Path) -> str:
    """A path as an argument: one that begins with a dash would be taken for an option."""
    return f"./{path}" if str(path).startswith("-") else str(path)


def _given(option: str, value: Any, default: Any = None) -> tuple[str, ...]:
    """An option as it was given, to be given again; nothing if it has its default."""
    return () if value == default else (option, str(value))


@contextlib.contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    """The workers of a dask.distributed scheduler."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError("needs the package distributed: pip install 'tbsa[cluster]'",
                         field="--scheduler", value=address) from None
    try:
        client = distributed.Client(address, timeout="10s")
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError("must be the address of a dask.distributed scheduler, such as "
                         f"tcp://host:8786: {reason}", field="--scheduler", value=address,
                         ) from None
    try:
        # Not pure: a run submitted again must be done, not answered from the cluster's memory.
        yield client.get_executor(pure=False)
    finally:
        client.close()


SELDOM = 0.1  # per cent of the time, with an overlap beyond 2 % of the width


def summary(scene: Scene, simulation: Simulation, wall: float, begun: float = 0.0) -> str:
    """A few lines on a run that has ended, and that has gone on from a time (s) for a wall time."""
    from tbsa.work.metrics import assembly, number_of

    found = assembly(scene, simulation.layout, simulation.x, simulation.y, simulation.angle)
    counts = simulation.counts
    substeps = max(int(counts.substeps[0]), 1)
    width = scene.material.width
    shares = 100 * counts.overlap / max(int(counts.overlap.sum()), 1)
    lines = [
        f"{simulation.time - begun:g} s simulated in {wall:.1f} s of wall time"
        + f", from {begun:g} to {simulation.time:g} s" * (begun > 0.0),
        f"assembly {number_of(found.size, 'tile')} and {found.total - found.size} of the seed, "
        f"{found.errors} wrong, {number_of(found.holes, 'hole')}, "
        f"{number_of(found.bonds_assembly, 'bond')}",
        f"deepest overlap {100 * counts.deepest[0] / width:.3g} % of the width; beyond 0.1 % in "
        f"{shares[2:].sum():.3g} % of the time, 0.5 % in {shares[3:].sum():.3g} %, "
        f"2 % in {shares[4]:.3g} %",
        f"solver: {counts.rows[0] / substeps:.0f} manifolds a substep, "
        f"{counts.passes[0] / substeps:.2f} passes, "
        f"{100 * counts.unconverged[0] / substeps:.2g} % of substeps at the limit of passes",
    ]
    if shares[4] > SELDOM:
        lines.append("warning: tiles are deep in each other; a shorter step, more substeps or more "
                     "passes of [solver] follow this scene better (tbsa bench tells which)")
    return "\n".join(lines)


@contextlib.contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar that goes away when it is done, and what moves it: how many are done, of how many.

    Shown on a terminal only.
    """
    from tqdm import tqdm

    with tqdm(total=1, desc=what, disable=None, leave=False) as bar:
        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show


class Bar:
    """Progress: simulated time, times real time, size of the assembly.

    Shown on a terminal only; its clock starts when the kernels have been compiled.
    """

    def __init__(self, scene: Scene, quiet: bool = False) -> None:
        from tqdm import tqdm

        self.scene = scene
        self.bar = tqdm(
            total=scene.run.duration, unit="s", disable=quiet or None, dynamic_ncols=True,
            bar_format="{l_bar}{bar}| {n:.0f}/{total:.0f} s [{elapsed}<{remaining}{postfix}]",
        )
        self.bar.set_postfix_str("compiling, some 20 s the first time")
        self.size: int | None = None
        self.start: float | None = None

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.close()

    def show(self, simulation: Simulation, recorded: bool) -> None:
        """Move the bar; the size is looked up at records."""
        if self.bar.disable:
            return
        if self.start is None:
            self.start = self.bar.initial = simulation.time
            self.bar.start_t = time.time()
        if (recorded or self.size is None) and self.scene.seed is not None:
            from tbsa.work.metrics import size

            self.size = size(self.scene, simulation.layout, simulation.x, simulation.y,
                             simulation.angle)
        self.bar.n = simulation.time
        elapsed = self.bar.format_dict["elapsed"]
        rate = (simulation.time - self.start) / elapsed if elapsed > 0 else 0.0
        text = f"{rate:.1f} x real time"
        if self.size is not None:
            text += f", {self.size} attached"
        self.bar.set_postfix_str(text, refresh=False)
        self.bar.refresh()


def _metrics(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import check_may_be_written, read_run, write_atomically
    from tbsa.work.metrics import table

    records = read_run(arguments.run)
    if arguments.out is not None:
        check_may_be_written(arguments.out, "--out")
        if arguments.out.suffix.lower() != ".csv":
            raise InputError("must end in .csv", field="--out", value=str(arguments.out))
    out = arguments.out or arguments.run / "metrics.csv"
    frame = table(records.scene, records.layout, records.time, records.x, records.y,
                  records.angle)
    try:  # first: whoever reads what is printed may stop before its end, as head does
        check_may_be_written(out, "--out")
        write_atomically(out, frame.to_csv(index=False).encode())
    finally:
        print(frame.to_string(index=False))  # of use where the file cannot be written, too
    print(f"written to {out}")
    return 0


def _draw(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import read_run
    from tbsa.work.draw import draw

    records = read_run(arguments.run)
    k = records.at(float(records.time[-1]) if arguments.time is None else arguments.time)
    time = float(records.time[k])
    out = arguments.out or arguments.run / f"t{time:.15g}.png"
    draw(records.scene, records.layout, records.x[k], records.y[k], records.angle[k], path=out,
         time=time, glues=arguments.glues)
    print(f"t = {time:.15g} s, written to {out}")
    return 0


def _movie(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import read_run
    from tbsa.work.movie import movie

    records = read_run(arguments.run)
    out = arguments.out or arguments.run / "movie.gif"
    with _progress("pictures") as show:
        movie(records, out, begin=arguments.begin, end=arguments.end, every=arguments.every,
              rate=arguments.rate, size=arguments.size, glues=arguments.glues, progress=show)
    print(f"written to {out}")
    return 0


def _view(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import read_run
    from tbsa.work.metrics import number_of
    from tbsa.work.viewer import view

    records = read_run(arguments.run)
    out = arguments.out or arguments.run / "view.html"
    count = view(records, out, begin=arguments.begin, end=arguments.end, every=arguments.every)
    print(f"{number_of(count, 'record')}, written to {out}: open it in a browser")
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import read_run
    from tbsa.work.export import export
    from tbsa.work.metrics import number_of

    records = read_run(arguments.run)
    out = arguments.out or arguments.run / "run.gsd"
    export(records, out)
    print(f"{number_of(records.time.size, 'record')}, written to {out}")
    return 0


def _check(arguments: argparse.Namespace) -> int:
    from tbsa.model.scene import load
    from tbsa.work.report import describe

    print(describe(load(arguments.config)))
    return 0


def _fit(arguments: argparse.Namespace) -> int:
    from tbsa.model.records import (
        check_may_be_written,
        check_not_own,
        may_be_filled,
        write_atomically,
    )
    from tbsa.model.scene import load
    from tbsa.work import fit
    from tbsa.work.measurements import read

    measured = read(arguments.csv)
    with _progress("fits") as show:
        result = fit.fit(
            measured, arguments.model, distance=arguments.distance, inset=arguments.inset,
            within=arguments.range, fixed=arguments.fix, bounds=arguments.bound,
            loss=arguments.loss, absolute=arguments.absolute, unweighted=arguments.unweighted,
            method=arguments.interval, progress=show)
    folder = arguments.out or Path("fits") / f"{arguments.csv.stem}-{arguments.model}"
    if folder.exists() and not folder.is_dir():
        raise InputError("must be a folder", field="--out", value=str(folder))
    if not may_be_filled(folder):
        raise InputError("must be a folder that may be written", field="--out", value=str(folder))
    files, warnings, scene = {}, [], arguments.scene
    made = fit.into(scene, result) if scene is not None else b""
    mode = scene.stat().st_mode if scene is not None else 0o600
    if scene is not None and not (mode & 0o222 and os.access(scene, os.W_OK)
                                  and os.access(scene.resolve().parent, os.W_OK)):
        raise InputError("must be a file that may be written", file=str(scene), field="--scene")
    if scene is not None:
        check_not_own(scene, "--scene")
    if arguments.model == "law":
        try:
            files[folder / "magnet.toml"] = fit.section(result).encode()
        except InputError as error:
            warnings.append(f"a scene does not take this law: {error}")
        if cut := fit.fading(result, None if scene is None else load(scene)):
            warnings.append(f"{'a scene' if scene is None else scene}: {cut}")
    files[folder / "fit.png"] = fit.picture(result)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"must be a folder that can be made: {error.strerror}", field="--out",
                         value=str(folder)) from None
    for path in (folder / "magnet.toml", folder / "fit.png"):
        check_may_be_written(path, "--out")
    print(fit.describe(result), *(f"warning: {each}" for each in warnings), "", sep="\n")
    for path, data in files.items():
        write_atomically(path, data)
    if folder / "magnet.toml" not in files and fit.is_section(folder / "magnet.toml"):
        (folder / "magnet.toml").unlink()  # of an earlier fit
    if scene is not None:  # last: it is not the fit's own, and stays as it was if those fail
        write_atomically(scene, made)
        scene.chmod(stat.S_IMODE(mode))
    print(f"written: {', '.join(map(str, [*files, *([scene] if scene is not None else [])]))}")
    return 0


def _bench(arguments: argparse.Namespace) -> int:
    from tbsa.model.scene import load
    from tbsa.work.bench import bench, describe

    scene = load(arguments.config)
    if not 0.0 < arguments.error < float("inf"):
        raise InputError("must be a positive number of widths", field="error",
                         value=arguments.error)
    with _progress("trials") as show:
        trials = bench(scene, horizon=arguments.horizon, after=arguments.after, progress=show)
    print(describe(trials, arguments.error))
    return 0


def _warmup(arguments: argparse.Namespace) -> int:
    start = time.perf_counter()
    from tbsa.kernels.jit import KERNELS, cache_folder
    from tbsa.model.scene import SETS, Drive, Free, Magnet, PlacedTile, Scene
    from tbsa.model.simulation import Simulation

    tiles = PlacedTile("black", (0.0, 0.0)), PlacedTile("white", (0.03, 0.0))
    for drive in (None, Drive("constant", (0.0, 0.0)), Drive("shaking", 0.1, 0.0, 1.0),
                  Drive("unicycle", 0.1, 0.0, 1.0)):
        simulation = Simulation(Scene(SETS["chessboard"], free=Free((), tiles), magnet=Magnet(),
                                      drive=drive))
        simulation.advance(1)
    simulation.magnet_forces()
    Simulation(simulation.scene, threads=2).advance(1)
    new = [name for name, there in KERNELS.items() if not there]
    took, folder = time.perf_counter() - start, cache_folder()
    if new:
        print(f"compiled in {took:.1f} s: {', '.join(new)}")
    if kept := [name for name in KERNELS if name not in new]:
        print(f"there already: {', '.join(kept)}" + ("" if new else f"; loaded in {took:.1f} s"))
    print(f"kept in {folder}" if folder else
          "not kept: neither the cache folder nor that of temporary files can be written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
