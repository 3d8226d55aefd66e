"""A campaign on disk: many runs, done by an executor, that can be broken off at any time.

A campaign's folder holds

    campaign.json  the plan: every run, and what may not change
    runs/          a folder a run, as `tbsa run` makes it, with metrics.csv beside its records
    table.csv      one row a run: what it was, how it ended
    curves.csv     one row a record: the metrics of every run against time
    wall.csv       wall time of every run; not the same twice, so not in the table
    .locks/        files that working processes hold locked

A run is done when its records have reached its duration, in whole steps, and its metrics.csv is
written.  A metrics.csv that cannot be read is made anew, and so are time and counts of run.json.
The tables are made anew from what the runs' folders hold, so they are the same to the bit however
often the campaign was broken off.

Any `concurrent.futures.Executor` will do whose workers see the same folder.  The process that
hands out the runs holds a file of its own in ``.locks``: where that file is gone, be it that the
process was asked to stop or that its successor found it dead, its workers save and end.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import math
import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, replace
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tbsa.errors import InputError
from tbsa.model.layout import initial_layout
from tbsa.model.records import (
    Busy,
    Stop,
    entry_type,
    interrupts,
    locked,
    may_be_filled,
    read_run,
    run,
    write_atomically,
)
from tbsa.model.scene import LONGEST_RUN, Run, Scene, fingerprint
from tbsa.model.simulation import Simulation, SimulationError, cores
from tbsa.work.plan import Planned, read_plan

if TYPE_CHECKING:
    import pandas as pd

FORMAT = 1
LOCKS = ".locks"
POLL = 0.2  # s between looks at the workers
LOOK = 1.0  # s between looks at the records of the runs that are under way, for the bar
PATIENCE = 60.0  # s that a worker waits for one of a dead campaign to save and let go of a run
REFRESH = 60.0  # s between tables while runs are being done
LIVES = 3  # times that a pool may break without a run done in between
DONE, FAILED, STOPPED, WAITING = "done", "failed", "stopped", "waiting"
ELSEWHERE = "elsewhere"  # done in another folder, whose table was named
Outcomes = dict[str, tuple[str, str]]  # of runs by name: how they ended, and why if they failed


@dataclass(frozen=True)
class Result:
    """How a call of :func:`campaign` ended."""

    table: pd.DataFrame  # as in table.csv
    done: int  # runs of this call's share that are done, now or before
    failed: int  # that raised; their messages are in the table
    left: int  # that it was interrupted before


def campaign(path: str | Path, out: str | Path, *, executor: Executor | None = None,
             jobs: int | None = None, resume: bool = False, part: tuple[int, int] = (1, 1),
             without: str | Path | None = None, progress: bool = False) -> Result:
    """Do the runs of a campaign's file, the longest first.

    Parameters
    ----------
    path
        The campaign's file, see :mod:`tbsa.work.plan`.
    out
        The campaign's folder; new or empty, unless `resume`.
    executor
        What does the runs; by default a pool of processes.  It is not shut down.
    jobs
        Processes of the default pool; by default one a core.
    resume
        Go on with what is in the folder, or begin.  The file may have more runs than before, and
        longer ones.
    part
        (i, n), i from 1 to n: do the i-th of n shares only.
    without
        A table of the same campaign, done in parts: leave out the runs that are done there.
    progress
        Show a bar on a terminal.

    Raises
    ------
    InputError
        Where the file, the folder, or both together are not allowed; nothing has been written.
    Busy
        Where another process is doing some of the same runs.
    RuntimeError
        Where the workers die again and again; in a worker that comes to the call again, as a script
        has no ``if __name__ == "__main__":`` around it.
    TypeError
        Where the executor is none.
    """
    out = Path(out)
    if executor is None and getattr(multiprocessing.current_process(), "_inheriting", False):
        raise RuntimeError("a worker of this campaign's pool has come to the call of campaign() "
                           "as it read the script: that must stand below "
                           'if __name__ == "__main__":')
    if executor is not None and (isinstance(executor, type)
                                 or not callable(getattr(executor, "submit", None))):
        raise TypeError("executor must be a concurrent.futures.Executor, or have its submit, not "
                        + (executor if isinstance(executor, type) else type(executor)).__name__)
    if hasattr(executor, "get_executor"):
        raise TypeError("executor must be a concurrent.futures.Executor: of a dask client that is "
                        "client.get_executor(pure=False)")
    whole = isinstance(jobs, int | np.integer) and not isinstance(jobs, bool)
    if jobs is not None and not (whole and jobs >= 1):
        raise InputError("must be a whole number and at least 1", field="jobs", value=jobs)
    plan = read_plan(path)
    _check_places(out)
    elsewhere = done_in(without, plan) if without is not None else set()
    mine = [each for each in share(plan, part) if each.name not in elsewhere]
    new = _against(plan, _stored(out, resume), str(path))
    _one_version(out, plan)
    left = sorted((each for each in mine if not _is_done(out, each)),
                  key=lambda each: -each.cost * (1.0 - _reached(out, each)))
    for each in _first_of_each(new, lambda each: replace(each.scene, run=Run())):
        _fits(each, str(path))
    with interrupts() as stop:
        if left:
            stop.patient = False  # it may have to compile for half a minute
            _compile(left, str(path))
            stop.patient = True
        outcomes: Outcomes = {}
        before = dict.fromkeys(elsewhere, (ELSEWHERE, ""))

        def tables() -> pd.DataFrame:
            with locked(out / LOCKS / "plan", wait=PATIENCE):
                return _write_tables(out, plan, before | outcomes)

        with _session(out, plan, mine, str(path), resume) as session:
            try:
                _do(left, out, session, executor, jobs, stop, _Bar(out, mine, left, progress),
                    outcomes, tables)
            finally:
                table = tables()
    undone = [each.name for each in mine if not _is_done(out, each)]
    failed = sum(outcomes.get(name, (WAITING, ""))[0] == FAILED for name in undone)
    return Result(table, len(mine) - len(undone), failed, len(undone) - failed)


def share(plan: Sequence[Planned], part: tuple[int, int]) -> list[Planned]:
    """The i-th of n shares of about the same length, longest runs first.

    Of equally long runs one of each setting comes first, then a second seed of each; and the
    groups take turns.  So what is done halfway is half of each.
    """
    whole = (isinstance(part, tuple | list) and len(part) == 2
             and all(isinstance(each, int | np.integer) for each in part))
    if not whole or not 1 <= part[0] <= part[1]:
        shown = "/".join(map(str, part)) if whole else part
        raise InputError("must be I/N, I from 1 to N", field="part", value=shown)
    i, n = part
    place: Counter[tuple[str, ...]] = Counter()
    turns = []
    for each in plan:
        sample = each.group, each.settings
        turns.append((place[sample], place[each.group,]))
        place[sample] += 1
        place[each.group,] += 1
    order = sorted(range(len(plan)), key=lambda k: (-plan[k].cost, turns[k]))
    # Dealt out setting by setting, so that every share has its part of each.
    alike = sorted(order, key=lambda k: (-plan[k].cost, plan[k].group, plan[k].settings))
    mine = set(alike[i - 1 :: n])
    return [plan[k] for k in order if k in mine]


def _seconds(text: str) -> float:
    if not 0.0 <= float(text) <= LONGEST_RUN:
        raise ValueError(f"duration {text} is no number of seconds")
    return float(text)


def done_in(path: str | Path, plan: Sequence[Planned]) -> set[str]:
    """The runs of a plan that a campaign's table, in this folder or another, has as done.

    Raises
    ------
    InputError
        Where the file is not such a table, or has runs that are done and not in the plan, of
        another setting or longer than there, or done by another version: they and those to come
        could not stand in one table.
    """
    import pandas as pd

    from tbsa import __version__

    file = str(path)
    try:
        rows = pd.read_csv(path, dtype=str, keep_default_na=False)
        rows = rows[rows["status"] == DONE]
        names = ("group", "fingerprint", "settings", "duration", "version", "run")
        ended = [(*each, _seconds(duration), version, run)
                 for *each, duration, version, run in zip(*(map(str, rows[name])
                                                            for name in names), strict=True)]
    except (OSError, ValueError, LookupError) as error:
        reason = getattr(error, "strerror", None) or f"{type(error).__name__} {error}"
        raise InputError(f"must be the table.csv of a campaign: {reason}", file=file) from None
    planned = {(each.group, each.mark): each for each in plan}
    found = set()
    for group, mark, settings, duration, version, name in ended:
        each = planned.get((group, mark))
        if each is None:
            raise InputError("is done there and is no run of this campaign: its scene has another "
                             "setting now, or is gone; take the setting back, or leave this table "
                             "aside", file=file, field="run", value=name)
        if version != __version__:
            raise InputError(f"must be {__version__}, this version: runs of two versions do not go "
                             "into one table", file=file, field="version", value=version)
        if settings != each.settings:
            raise InputError("was done there with another record.interval, other colours or "
                             "another temperature, and runs of two settings do not go into one "
                             "table; take the setting back, or leave this table aside", file=file,
                             field="run", value=name)
        if _end(each) < round(duration / each.scene.solver.step):
            raise InputError(f"s is less than the {duration:g} s that {name} has there: a run can "
                             "be made longer, not shorter", file=file, field="run.duration",
                             value=each.scene.run.duration)
        if _reaches_end(each, duration):
            found.add(each.name)
    return found


# ---------------------------------------------------------------------------------------------
# The plan, and what is in the folder already.


def _check_places(out: Path) -> None:
    """What a campaign writes can be written, as far as can be told beforehand."""
    for place in (out, out / "runs", out / LOCKS):
        if place != out and place.exists() and not place.is_dir():
            raise InputError("must be a folder", file=str(place))
        if not may_be_filled(place):
            raise InputError("must be a folder that may be written", file=str(place))
    for name in ("table.csv", "curves.csv", "wall.csv"):
        if (out / name).is_dir():
            raise InputError("must be a file, and is a folder", file=str(out / name))


def _stored(out: Path, resume: bool) -> dict[str, dict[str, Any]] | None:
    """The runs of the plan in the folder; None where no campaign has begun there."""
    path = out / "campaign.json"
    try:
        if out.exists() and not out.is_dir():
            raise InputError("is a file, not a folder", file=str(out))
        if not path.exists():
            if out.exists() and any(each.name != LOCKS for each in out.iterdir()):
                raise InputError("must be a new or an empty folder, or that of a campaign",
                                 file=str(out))
            return None
    except OSError as error:
        raise InputError(f"must be a folder that can be read: {error.strerror}",
                         file=str(out)) from None
    if not resume:
        raise InputError("holds a campaign already: go on with it (--resume) or name another "
                         "(--out)", file=str(out))
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise InputError(f"must be {FORMAT}: written by another version", file=str(path),
                             field="format", value=data["format"])
        return {each["name"]: {"kept": str(each["kept"]), "duration": float(each["duration"])}
                for each in data["runs"]}
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from None
    except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"is damaged: {error!r}", file=str(path)) from None


def _against(plan: list[Planned], stored: dict[str, dict[str, Any]] | None, file: str
             ) -> list[Planned]:
    """The runs that the folder's plan has not got; those that it has got must be the same."""
    if stored is None:
        return plan
    planned = {each.name: each for each in plan}
    for name, was in stored.items():
        if name not in planned:
            raise InputError("is a run of the folder, but not of this file, with its scenes and "
                             "drives, any more: put back what has changed, or name another folder "
                             "(--out)", file=file, field="group", value=name)
        each = planned[name]
        if each.kept != was["kept"]:
            raise InputError("was begun with another record.interval, other colours or another "
                             "temperature: these have to stay what they were", file=file,
                             field="group", value=name)
        if each.scene.run.duration < was["duration"]:
            raise InputError(f"s is less than the {was['duration']:g} s that {name} was begun "
                             "with: a run can be made longer, not shorter", file=file,
                             field="run.duration", value=each.scene.run.duration)
    return [each for each in plan if each.name not in stored]


def _first_of_each(plan: Iterable[Planned], key: Callable[[Planned], Any]) -> list[Planned]:
    first: dict[Any, Planned] = {}
    for each in plan:
        first.setdefault(key(each), each)
    return list(first.values())


def _fits(each: Planned, file: str) -> None:
    """Its tiles can be placed; tried with one seed of every scene."""
    try:
        initial_layout(each.scene)
    except InputError as error:
        raise InputError(f"does not make a scene of {each.base}: {error.without_file}", file=file,
                         field="group", value=each.group) from None


def _compile(plan: Iterable[Planned], file: str) -> None:
    """Compile every drive with the kernels, so that workers find them in the disk cache."""
    def drive(each: Planned) -> Any:
        found = each.scene.drive
        return found and (found.kind, found.module, found.function, Path(each.scene.file).parent)

    for each in _first_of_each(plan, drive):
        try:
            Simulation(each.scene).advance(1)
        except InputError as error:
            raise InputError(f"does not make a scene of {each.base}: {error.without_file}",
                             file=file, field="group", value=each.group) from None
        except SimulationError:
            pass  # said of the run when it comes to it


def _folder(out: Path, each: Planned) -> Path:
    return out / "runs" / each.name


def _info(out: Path, each: Planned) -> dict[str, Any] | None:
    """The run's run.json, if there is one that is whole; a run that goes on writes another."""
    try:
        info = dict(json.loads((_folder(out, each) / "run.json").read_text(encoding="utf-8")))
        _counted(info["counts"], 1.0)
        whole = (math.isfinite(info["time"]) and math.isfinite(info["wall"])
                 and isinstance(info["version"], str))
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, RecursionError):
        return None
    return info if whole else None


def _end(each: Planned) -> int:
    """The step at which a run ends: `tbsa.model.records` rounds its duration to whole steps."""
    return round(each.scene.run.duration / each.scene.solver.step)


def _reaches_end(each: Planned, time: float) -> bool:
    return time > (_end(each) - 0.5) * each.scene.solver.step


def _ended(out: Path, each: Planned) -> tuple[dict[str, Any], list[dict[str, Any]]] | None:
    """The run.json and the rows of metrics.csv of a run that is done; else None."""
    from tbsa.work.metrics import COLUMNS

    info = _info(out, each)
    if (info is None or info.get("fingerprint") != each.mark
            or not _reaches_end(each, info["time"])):
        return None
    path = _folder(out, each) / "metrics.csv"
    try:
        if info.get("metrics") != _digest(path.read_bytes()):
            return None
        rows = _read_csv(path, COLUMNS)
        whole = abs(rows[-1]["time"] - info["time"]) < 0.5 * each.scene.solver.step
    except (OSError, ValueError, LookupError, ArithmeticError):
        return None
    return (info, rows) if whole else None


def _is_done(out: Path, each: Planned) -> bool:
    return _ended(out, each) is not None


def _reached(out: Path, each: Planned) -> float:
    """What share of the run's duration is done."""
    info = _info(out, each)
    if info is None:
        return 0.0
    return 1.0 if _reaches_end(each, info["time"]) else info["time"] / each.scene.run.duration


def _one_version(out: Path, plan: Iterable[Planned]) -> None:
    """The runs that are there are of this version: others do not go into one table with new ones.

    Raises
    ------
    InputError
        Where one is not.
    """
    from tbsa import __version__

    for each in plan:
        info = _info(out, each)
        if info is not None and info["version"] != __version__:
            raise InputError(f"must be {__version__}, this version: runs of two versions do not go "
                             "into one table; go on with that version, or name another folder "
                             "(--out)", file=str(_folder(out, each) / "run.json"),
                             field="version", value=info["version"])


@contextlib.contextmanager
def _session(out: Path, plan: list[Planned], mine: list[Planned], file: str, resume: bool
             ) -> Iterator[Path]:
    """Claim runs for this process; gives the file that is there as long as it goes on.

    Claims of dead processes are removed, which stops workers that they have left behind.
    """
    locks = out / LOCKS
    try:
        (locks / "sessions").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"must be a folder that can be made: {error.strerror}",
                         file=str(out)) from None
    session = locks / "sessions" / uuid.uuid4().hex
    names = [each.name for each in mine]
    with contextlib.ExitStack() as stack:
        with locked(locks / "plan", wait=PATIENCE):
            alive = list(_alive(session.parent))
            stored = _stored(out, resume)
            for who, theirs in alive:
                if not theirs.isdisjoint(names):
                    raise Busy(f"is in use: {who} is doing its runs", file=str(out))
            new = _against(plan, stored, file)
            if new or stored is None or any(
                    stored[each.name]["duration"] != each.scene.run.duration for each in plan):
                if alive:
                    raise Busy(f"is in use: {alive[0][0]} is at work with another plan, and it "
                               "cannot be changed meanwhile", file=str(out))
                _write_plan(out, plan)
            stack.enter_context(locked(session))
            session.write_text(json.dumps({
                "who": f"process {os.getpid()} on {socket.gethostname()}", "runs": names}))
        try:
            yield session
        finally:
            session.unlink(missing_ok=True)


def _alive(sessions: Path) -> Iterator[tuple[str, set[str]]]:
    """Who is at work, and on which runs."""
    for path in sorted(sessions.iterdir()):
        with contextlib.suppress(FileNotFoundError):  # it has just ended
            try:
                with locked(path, create=False):
                    path.unlink()
            except Busy:
                data = json.loads(path.read_text())
                yield data["who"], set(data["runs"])


def _write_plan(out: Path, plan: list[Planned]) -> None:
    data = {"format": FORMAT, "runs": [
        {"name": each.name, "kept": each.kept, "duration": each.scene.run.duration}
        for each in plan]}
    write_atomically(out / "campaign.json", json.dumps(data, indent=1).encode())


# ---------------------------------------------------------------------------------------------
# The runs.


class Job(NamedTuple):
    """One run, as a worker gets it."""

    scene: Scene
    mark: str  # its fingerprint, as it was planned
    folder: Path
    lock: Path
    session: Path


_pooled = False  # in a process of the default pool


def work(job: Job) -> tuple[str, str]:
    """Do a run or go on with it; how it ended, and why if it failed."""
    how = _work(job)
    if _pooled and ((how[0] == STOPPED and job.session.exists()) or _orphaned()):
        # Told to end by a signal, or the campaign was killed, perhaps in a run's last moments,
        # which took the watcher's signal for itself: saved, and nobody to report to.
        os._exit(1)
    return how


def _work(job: Job) -> tuple[str, str]:
    if not job.session.exists():
        return STOPPED, ""
    try:
        with locked(job.lock, wait=PATIENCE):
            ended = _run(job)
    except KeyboardInterrupt:
        ended = False
    except Exception as error:
        return FAILED, _message(error, job.folder)
    return (DONE if ended else STOPPED), ""


def _run(job: Job) -> bool:
    """Whether the run came to its end."""
    from tbsa.work.metrics import table

    if fingerprint(job.scene) != job.mark:
        assert job.scene.drive is not None
        raise InputError("was changed after the campaign was begun: put it back, and go on with "
                         "--resume", field="drive.module", value=job.scene.drive.module)
    begun = (job.folder / "run.json").exists()
    metrics = job.folder / "metrics.csv"
    if begun:
        metrics.unlink(missing_ok=True)
    outcome = run(job.scene, job.folder, resume=begun,
                  progress=lambda *_: not job.session.exists())
    if not outcome.finished:
        return False
    records = read_run(job.folder)
    frame = table(records.scene, records.layout, records.time, records.x, records.y,
                  records.angle)
    data = frame.to_csv(index=False).encode()
    write_atomically(metrics, data)
    path = job.folder / "run.json"  # last: the run is done once it knows its metrics
    info = json.loads(path.read_text(encoding="utf-8")) | {"metrics": _digest(data)}
    write_atomically(path, json.dumps(info, indent=1).encode())
    return True


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _message(error: Exception, folder: Path | None = None) -> str:
    """What went wrong, without names of folders, which differ between machines, and times that
    differ between calls of one run; a file of the run's own has its name."""
    if isinstance(error, InputError):
        file = Path(error.file or "")
        return f"{file.name}: {error.without_file}" if file.parent == folder else error.without_file
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, SimulationError):
        return error.reason
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _in_pool() -> None:
    """Of a process of the default pool: end when the campaign's process has died."""
    global _pooled
    _pooled = True
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        wait_for([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)  # a run saves first

    threading.Thread(target=watch, daemon=True).start()


def _orphaned() -> bool:
    """Whether the process that began this one has died."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()


def _do(left: list[Planned], out: Path, session: Path, executor: Executor | None,
        jobs: int | None, stop: Stop, bar: _Bar, ended: Outcomes,
        tables: Callable[[], object]) -> None:
    """Have the runs done; `ended` is told how those ended that did."""
    home = out.resolve()
    # The scene's file by its own name, be it a link: the module of its drive is beside that.
    todo = {each.name: Job(
        replace(each.scene, file=str(Path(each.scene.file).absolute())), each.mark,
        _folder(home, each),
        home / LOCKS / each.name.replace("/", "."), session.resolve()) for each in left}
    lives = LIVES
    with bar:
        while todo and not stop.asked:
            before = len(todo)
            try:
                with _pool(executor, min(jobs or cores(), len(todo))) as workers:
                    try:
                        _hand_out(workers, todo, ended, session, stop, bar, tables)
                    except KeyboardInterrupt:  # or the pool would wait for whole runs
                        session.unlink(missing_ok=True)
                        raise
                break
            except BrokenExecutor as error:
                lives = LIVES if len(todo) < before else lives - 1
                if executor is not None or not lives:
                    raise RuntimeError(f"workers died, the runs that are done are kept; go on "
                                       f"with --resume ({error})") from error


@contextlib.contextmanager
def _pool(executor: Executor | None, processes: int) -> Iterator[Executor]:
    if executor is not None:
        yield executor
        return
    # Spawned, not forked: a fork would take over locks and threads in whatever state they are.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _in_pool) as pool:
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _hand_out(workers: Executor, todo: dict[str, Job], ended: Outcomes,
              session: Path, stop: Stop, bar: _Bar, tables: Callable[[], object]) -> None:
    """Submit all, longest first, and take back what is done, until all is or a stop is asked.

    The tables are brought up to date now and then: a campaign that is killed leaves those of the
    runs that it had done.
    """
    processes = isinstance(workers, ProcessPoolExecutor)
    futures: dict[Future[tuple[str, str]], str] = {}
    with _deaf() if processes else contextlib.nullcontext():
        for name, job in todo.items():
            future = workers.submit(work, job)  # which may do it on the spot
            futures[future] = name
            if stop.asked or _stopped(future):
                break
    waiting = set(futures)
    written, known = time.monotonic(), len(ended)
    while waiting:
        done, waiting = wait(waiting, timeout=POLL, return_when=FIRST_COMPLETED)
        for future in done:
            try:
                outcome = future.result()
            except CancelledError:
                if not stop.asked:
                    raise RuntimeError("the executor lost its runs; go on with --resume") from None
                continue
            except BrokenExecutor:
                raise
            except Exception as error:  # of the executor's own: a worker died too often
                outcome = FAILED, _message(error)
            if outcome[0] == STOPPED:
                stop.asked = True
            else:
                ended[futures[future]] = outcome
                del todo[futures[future]]
        if stop.asked:
            session.unlink(missing_ok=True)
            for future in waiting:
                future.cancel()
        bar.show(ended)
        if len(ended) > known and time.monotonic() > written + REFRESH:
            with contextlib.suppress(OSError, Busy):  # of a full disk the end will tell
                tables()
            written, known = time.monotonic(), len(ended)


def _stopped(future: Future[tuple[str, str]]) -> bool:
    """Whether a run was asked to stop, and has ended."""
    return (future.done() and not future.cancelled() and future.exception() is None
            and future.result()[0] == STOPPED)


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Processes begun meanwhile never hear Ctrl-C: it is this process that stops them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Bar:
    """Progress over all runs, by tiles times substeps, and the time left."""

    def __init__(self, out: Path, mine: list[Planned], left: list[Planned], shown: bool) -> None:
        self.out, self.mine, self.left, self.shown = out, mine, left, shown
        self.reached: dict[str, float] = {}  # of the runs not ended, at the last look
        self.looked = -math.inf

    def __enter__(self) -> _Bar:
        from tqdm import tqdm

        total = sum(each.cost for each in self.mine)
        waiting = sum(each.cost for each in self.left)
        self.before = total - waiting
        self.bar = tqdm(
            total=total, initial=self.before + self._under_way({}), smoothing=0.0,
            disable=None if self.shown and sys.stderr is not None else True, dynamic_ncols=True,
            bar_format="{percentage:5.1f} %|{bar}| [{elapsed}<{remaining}{postfix}]")
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.close()

    def show(self, ended: Outcomes) -> None:
        """Move the bar to where the runs' records are."""
        if self.bar.disable:
            return
        done = sum(each.cost for each in self.left if each.name in ended)
        failed = sum(status == FAILED for status, _ in ended.values())
        number = len(self.mine) - len(self.left) + len(ended) - failed
        self.bar.n = self.before + done + self._under_way(ended)
        self.bar.set_postfix_str(f"{number}/{len(self.mine)} runs done"
                                 + f", {failed} failed" * bool(failed), refresh=False)
        self.bar.refresh()

    def _under_way(self, ended: Outcomes) -> float:
        """Of the runs not ended: what is done, by the size of their records."""
        if time.monotonic() >= self.looked + LOOK:
            self.reached, self.looked = {}, time.monotonic()
            for each in self.left:
                if each.name not in ended:
                    with contextlib.suppress(OSError):
                        size = (_folder(self.out, each) / "records.npy").stat().st_size
                        last = size // entry_type(each.tiles).itemsize - 1
                        end = each.scene.record.interval * last
                        share = min(max(end / each.scene.run.duration, 0.0), 1.0)
                        self.reached[each.name] = each.cost * share
        return math.fsum(done for name, done in self.reached.items() if name not in ended)


# ---------------------------------------------------------------------------------------------
# The tables.


def _write_tables(out: Path, plan: list[Planned], outcomes: Outcomes) -> pd.DataFrame:
    """table.csv, curves.csv and wall.csv, from the folders of the runs."""
    import pandas as pd

    rows, curves, walls = [], [], []
    outcomes = _failures(out / "table.csv") | outcomes
    for each in plan:
        info, ended = _info(out, each), _ended(out, each)
        status, message = outcomes.get(each.name, (WAITING, ""))
        if ended or status == DONE:  # what the folder holds counts, not what a worker said
            status, message = DONE if ended else WAITING, ""
        row: dict[str, Any] = {
            "run": each.name, "group": each.group, "scene": each.base,
            **{name: json.dumps(value) if isinstance(value, list | dict) else value
               for name, value in each.fields},
            "seed": each.scene.run.seed, "duration": each.scene.run.duration,
            "tiles": each.tiles, "fingerprint": each.mark, "settings": each.settings,
            "version": info["version"] if info else None, "status": status, "message": message}
        if ended:
            frame = pd.DataFrame(ended[1])
            row |= {str(name): frame[name].iloc[-1] for name in frame}
            row |= {f"mean_{name}": _mean(frame[name]) for name in MEANS}
            row |= _counted(ended[0]["counts"], each.scene.material.width)
            frame.insert(0, "run", each.name)
            curves.append(frame.astype(object))
        rows.append(row)
        if info:
            walls.append({"run": each.name, "wall": info["wall"], "time": info["time"]})
    first = ["run", "group", "scene"]
    fields = list(dict.fromkeys(name for each in plan for name, _ in each.fields))
    names = list(dict.fromkeys(name for row in rows for name in row if name not in fields))
    # As objects (curves, too): an integer stays one, whether another run has the value or not.
    table = pd.DataFrame(rows, columns=[*first, *fields, *names[len(first):]], dtype=object)
    for name, frame in (
            ("table", table),
            ("curves", pd.concat(curves) if curves else pd.DataFrame(columns=["run", "time"])),
            ("wall", pd.DataFrame(walls, columns=["run", "wall", "time"]))):
        write_atomically(out / f"{name}.csv", frame.to_csv(index=False).encode())
    return table.infer_objects()


def _read_csv(path: Path, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    """Rows of a table of numbers, to the last bit; pandas' own reader may be off by one.

    Raises
    ------
    ValueError
        Where it has other columns or something that is no number.
    """
    def number(text: str) -> Any:
        if text in ("True", "False"):
            return text == "True"
        return int(text) if text.lstrip("-").isdigit() else float(text or "nan")

    with open(path, newline="", encoding="utf-8") as file:
        try:
            head, *rows = csv.reader(file)
        except csv.Error as error:
            raise ValueError(*error.args) from None
    if tuple(head) != columns:
        raise ValueError("other columns")
    return [{name: number(text) for name, text in zip(head, row, strict=True)} for row in rows]


def _failures(path: Path) -> Outcomes:
    """The failed runs of an earlier table; another share's process may have written it.

    A table that cannot be read tells of none: all else in it is made anew.
    """
    import pandas as pd

    try:
        rows = pd.read_csv(path, dtype=str, keep_default_na=False)
        rows = rows[rows["status"] == FAILED]
        return {run: (FAILED, why) for run, why in zip(rows["run"], rows["message"], strict=True)}
    except (OSError, ValueError, LookupError):
        return {}


MEANS = ("size", "errors_percent", "holes_percent")  # over all records of a run


def _mean(values: pd.Series[float]) -> float:
    """Mean of the numbers, summed exactly: in no order that another version might change."""
    numbers = [float(value) for value in values if not math.isnan(value)]
    return math.fsum(numbers) / len(numbers) if numbers else float("nan")


def _counted(counts: dict[str, Any], width: float) -> dict[str, float]:
    """The counters of a run, a substep or in per cent; overlap in per cent of the time."""
    substeps = max(counts["substeps"], 1)
    time = max(sum(counts["overlap"]), 1)
    shares = [100.0 * number / time for number in counts["overlap"]]
    return {
        "substeps": counts["substeps"],
        "deepest_percent": 100.0 * counts["deepest"] / width,
        "beyond_0.1_percent": math.fsum(shares[2:]),
        "beyond_0.5_percent": math.fsum(shares[3:]),
        "beyond_2_percent": shares[4],
        "manifolds": counts["rows"] / substeps,
        "passes": counts["passes"] / substeps,
        "unconverged_percent": 100.0 * counts["unconverged"] / substeps,
    }
