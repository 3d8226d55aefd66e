"""A run on disk: records, checkpoints, and the loop that writes them.

A run's folder holds

    scene.toml      the scene, complete
    drive.py        the module of a user's own drive, if it has one
    run.json        version, fingerprint of the scene, wall time, counters
    layout.npz      what each tile is and where it started
    records.npy     one structured entry a record: time, the six state arrays, and a checksum
    checkpoint.npz  all that the next step needs

Every file is replaced atomically, except that ``records.npy`` grows by appending: an entry
counts once the header says so, and a resumed run writes over what its checkpoint has not seen.  The
file is only made shorter at the end of a run: somebody may be reading the entries.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tbsa.errors import InputError
from tbsa.kernels.state import MORE_ROWS, State
from tbsa.model.layout import Layout
from tbsa.model.scene import (
    LONGEST_RUN,
    Scene,
    check_is_scene,
    dumps,
    engine_source,
    fingerprint,
    load,
    tile_count,
)
from tbsa.model.simulation import Simulation

FORMAT = 2
FIELDS = ("x", "y", "angle", "vx", "vy", "omega")
# Wall time between looks at progress and Ctrl-C (s).
GLANCE = 0.25
# A run's own files that are replaced as wholes.
REPLACED = ("scene.toml", "run.json", "layout.npz", "checkpoint.npz", "drive.py")
# Counters of what a process has done, not of the run: they differ where a run was broken off.
OF_PROCESS = ("lists", "magnet_lists", "magnet_pairs", "still")


@dataclass(frozen=True)
class Records:
    """The records of a run: ``time`` float64[k], the others float64[k, n] (SI units)."""

    scene: Scene
    layout: Layout
    time: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]
    vx: NDArray[np.float64]
    vy: NDArray[np.float64]
    omega: NDArray[np.float64]

    def at(self, time: float, field: str = "time") -> int:
        """Index of the record nearest to `time` (s); an error names `field`.

        Raises
        ------
        InputError
            Where `time` lies outside the records by more than half a step; they are at whole ones.
        """
        first, last, slack = self.time[0], self.time[-1], 0.5 * self.scene.solver.step
        if not first - slack <= time <= last + slack:
            raise InputError(f"is not recorded: this run holds {first:.15g} to {last:.15g} s",
                             field=field, value=time)
        return int(np.argmin(np.abs(self.time - time)))

    def chosen(self, begin: float | None, end: float | None, every: int) -> Sequence[int]:
        """Indices of the records from a time to another (s), one in so many; None: no bound.

        Raises
        ------
        InputError
            Where a time is not recorded, the end before the beginning, or `every` not positive.
        """
        first = 0 if begin is None else self.at(begin, "begin")
        last = self.time.size - 1 if end is None else self.at(end, "end")
        if last < first:
            raise InputError(f"must not be before the beginning, {self.time[first]:.15g} s",
                             field="end", value=end)
        if every < 1:
            raise InputError("must be at least 1", field="every", value=every)
        return range(first, last + 1, every)


def check_is_run(records: object) -> None:
    """They are the records of a run, and not the name of its folder.

    Raises
    ------
    TypeError
        Where they are not.
    """
    if not isinstance(records, Records):
        raise TypeError(f"records must be Records, not {type(records).__name__}: tbsa.read_run "
                        "reads them from a folder")


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have an error of the system name this file: that of a full disk names none."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


@contextlib.contextmanager
def replacing(path: Path, ending: str = "") -> Iterator[Path]:
    """A scratch file, its name ending so, that takes the place of `path` unless there is an error.

    A link stays, and what it leads to is replaced.  What is there and is no regular file, such as a
    pipe, gets the bytes.
    """
    with naming(path):
        if path.exists() and not path.is_file():
            with tempfile.TemporaryDirectory() as folder:
                scratch = Path(folder, f"scratch{ending}")
                yield scratch
                with open(scratch, "rb") as source, open(path, "wb") as stream:
                    shutil.copyfileobj(source, stream)
            return
        place = Path(os.path.realpath(path))
        scratch = place.with_name(f".{place.name}.{os.getpid()}{ending}")
        try:
            yield scratch
            os.replace(scratch, place)
        finally:
            scratch.unlink(missing_ok=True)


def write_atomically(path: Path, data: bytes) -> None:
    """Replace a file by `data` or leave it as it was; see :func:`replacing`."""
    with replacing(path) as scratch, open(scratch, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


OWN = {  # files that a folder depends on, by the one that tells what it is the folder of
    "run.json": ("run", (*REPLACED, "records.npy")),
    "campaign.json": ("campaign", ("campaign.json", "table.csv", "curves.csv", "wall.csv")),
}


def check_not_own(path: Path, field: str) -> None:
    """A file to be written is none that a run or a campaign depends on.

    Raises
    ------
    InputError
        Where it is one, or leads to one.
    """
    place = Path(os.path.realpath(path))
    for mark, (what, names) in OWN.items():
        if place.name in names and (place.parent / mark).exists():
            raise InputError(f"must be another file: it is the {what}'s own", field=field,
                             value=str(path))


def check_may_be_written(path: Path, field: str) -> None:
    """A file can be written as :func:`replacing` does, and is none that others depend on.

    Raises
    ------
    InputError
        Where it cannot, as far as can be told beforehand, or is one.
    """
    place = Path(os.path.realpath(path)) if path.is_symlink() else path
    replaced, wrong = not place.exists() or place.is_file(), ""
    if not place.parent.is_dir():
        wrong = "must be in a folder that exists"
    elif place.is_dir():
        wrong = "must be a file, and is a folder"
    elif not os.access(place.parent if replaced else place, os.W_OK):
        wrong = f"must be {'in a folder' if replaced else 'a file'} that may be written"
    if wrong:
        raise InputError(wrong, field=field, value=str(path))
    check_not_own(path, field)


def may_be_filled(folder: Path) -> bool:
    """Files of a folder can be read and replaced, if it is there."""
    return not folder.is_dir() or os.access(folder, os.R_OK | os.W_OK | os.X_OK)


def _write_arrays(path: Path, arrays: dict[str, Any]) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    write_atomically(path, buffer.getvalue())


def _check_readable(path: Path, missing: str) -> None:
    """A file can be opened: what then goes wrong lies in its bytes.

    Raises
    ------
    InputError
        Where it cannot; where it is not there, with `missing`.
    """
    try:
        open(path, "rb").close()
    except FileNotFoundError:
        raise InputError(missing, file=str(path)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from None


def _read_arrays(path: Path, needed: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    _check_readable(path, "is missing: not the folder of a run, or one that never began")
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except Exception as error:  # a damaged zip raises whatever its bytes happen to mean
        raise InputError(f"is damaged: {error}", file=str(path)) from None
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise InputError(f"has no {missing[0]!r}: not written by tbsa, or by another version",
                         file=str(path))
    return arrays


def entry_type(n: int, *, checked: bool = True) -> np.dtype[Any]:
    """An entry of records.npy; those of runs of before 0.29.0 have no checksum.

    It is of 8 bytes, so that the numbers of all entries are where Numba wants them.
    """
    return np.dtype([("time", "<f8"), *((name, "<f8", (n,)) for name in FIELDS),
                     *[("check", "<u8")] * checked])


def _checksums(entries: NDArray[Any]) -> list[int]:
    """CRC-32 of the bytes of each entry, but for its own checksum."""
    rows = np.asarray(entries).view(np.uint8).reshape(entries.size, -1)  # of a plain array: faster
    return [zlib.crc32(each[:-8].data) for each in rows]


class _Writer:
    """Appends entries to records.npy; the header is rewritten in place after each.

    Of a file that is gone on with the first `keep` entries count.  Those behind them stay until
    they are written over: who has mapped the file and read them when they are gone is killed.
    """

    def __init__(self, path: Path, dtype: np.dtype[Any], keep: int) -> None:
        self.path, self.dtype, self.count = path, dtype, keep
        with naming(path):
            self.file = open(path, "r+b" if keep else "w+b")  # noqa: SIM115
            self._header()
            self.begin = self.file.tell()
            self.file.flush()

    def _header(self) -> None:
        # NumPy pads the header so that the first axis can grow in place.
        header = np.lib.format.header_data_from_array_1_0(np.empty(0, self.dtype))
        header["shape"] = (self.count,)
        self.file.seek(0)
        np.lib.format.write_array_header_1_0(self.file, header)

    def append(self, simulation: Simulation) -> None:
        entry = np.empty(1, self.dtype)
        entry["time"] = simulation.time
        for name in FIELDS:
            entry[name][0] = getattr(simulation, name)
        if "check" in entry.dtype.fields:
            entry["check"] = _checksums(entry)
        with naming(self.path):
            self.file.seek(self.begin + self.count * self.dtype.itemsize)
            self.file.write(entry.tobytes())
            self.file.flush()
            self.count += 1
            self._header()
            self.file.flush()

    def cut(self) -> None:
        """Take away what is behind the entries, of a run that had come further and was killed."""
        with naming(self.path):
            self.file.truncate(self.begin + self.count * self.dtype.itemsize)

    def sync(self) -> None:
        with naming(self.path):
            self.file.flush()
            os.fsync(self.file.fileno())

    def close(self) -> None:
        self.file.close()


def save_checkpoint(path: Path, simulation: Simulation, mark: str) -> None:
    """Write all that the next step needs, and the counters so far; `mark`: the fingerprint.

    Counts of lists and of magnet pairs are left out: they are work of a process, not of the run,
    and without them a resumed run ends in the same file as an uninterrupted one, byte for byte.
    """
    state, impulses = simulation.state, simulation.state.impulses
    size = int(impulses.size[0])
    _write_arrays(path, {
        "format": FORMAT, "fingerprint": mark, "steps": simulation.steps,
        "last": state.last, **{name: getattr(state, name)[:-1] for name in FIELDS},
        **{name: values for name, values in _foreseen(state).items() if values.size > 0},
        **{f"impulse_{name}": getattr(impulses, name)[:size] for name in impulses._fields[1:]},
        **{f"count_{name}": getattr(simulation.counts, name) for name in _kept(simulation)},
    })


def _foreseen(state: State) -> dict[str, NDArray[Any]]:
    """The tiles that hit only after now, and how they go then."""
    number = int(state.early[0])
    return {"early": state.early[1 : number + 1], "goes": state.goes[: 6 * number]}


def _kept(simulation: Simulation) -> list[str]:
    return [name for name in simulation.counts._fields if name not in OF_PROCESS]


def load_checkpoint(path: Path, simulation: Simulation, mark: str) -> None:
    """Put a fresh simulation of the scene with fingerprint `mark` into a checkpoint's state.

    Raises
    ------
    InputError
        Where the file is missing, damaged, or belongs to another scene.
    """
    state, counts = simulation.state, simulation.counts
    names = state.impulses._fields[1:]
    data = _read_arrays(path, ("format", "fingerprint", "steps", "last", *FIELDS,
                               *(f"impulse_{name}" for name in names),
                               *(f"count_{name}" for name in _kept(simulation))))
    if data["format"].tolist() != FORMAT:
        raise InputError(f"must be {FORMAT}: written by another version", file=str(path),
                         field="format", value=data["format"].tolist())
    if str(data["fingerprint"]) != mark:
        raise InputError(
            f"belongs to another scene or seed: this one has {mark[:12]}", file=str(path),
            field="fingerprint", value=str(data["fingerprint"])[:12],
        )
    n, size = simulation.numbers.n, data["impulse_a"].size
    early = data.get("early", np.zeros(0, int))
    goes = data.setdefault("goes", np.zeros(6 * early.size))
    if any(data[name].shape != (n,) or data[name].dtype != float
           or not np.isfinite(data[name]).all() for name in FIELDS):
        raise InputError(f"is damaged: must hold {n} finite numbers a field", file=str(path))
    kinds = {"steps": np.zeros((), int), "last": state.last,
             **{f"impulse_{name}": np.zeros(size, getattr(state.impulses, name).dtype)
                for name in names},
             "goes": np.zeros(6 * early.size),
             **{f"count_{name}": getattr(counts, name) for name in _kept(simulation)}}
    if (early.ndim != 1 or early.dtype != int or np.unique(early).size < early.size
            or not ((early >= 0) & (early < n)).all()):
        raise InputError(f"is damaged: must be different tiles, from 0 to {n - 1}", file=str(path),
                         field="early")
    for name, kind in kinds.items():
        if (data[name].shape != kind.shape or data[name].dtype != kind.dtype
                or not np.isfinite(data[name]).all() or (name == "steps" and data[name] < 0)):
            raise InputError(f"is damaged: must be {kind.size} finite {kind.dtype}", file=str(path),
                             field=name)
    while state.impulses.a.size < size:
        simulation._grow(MORE_ROWS)
        state = simulation.state
    for name in FIELDS:
        getattr(state, name)[:-1] = data[name]
    for name in names:
        getattr(state.impulses, name)[:size] = data[f"impulse_{name}"]
    state.impulses.size[0] = size
    state.last[:] = data["last"]
    state.early[0], state.early[1 : early.size + 1] = early.size, early
    state.goes[: goes.size] = goes
    state.seen[: goes.size] = np.stack([data[name][early] for name in FIELDS], axis=1).ravel()
    for name in _kept(simulation):
        getattr(counts, name)[:] = data[f"count_{name}"]
    simulation.steps = int(data["steps"])


def read_run(folder: str | Path) -> Records:
    """Read the records of a run's folder; arrays are mapped, not loaded.

    Raises
    ------
    InputError
        Where the folder is not a run, or its files do not belong together.
    """
    folder = Path(folder)
    info = _read_info(folder)
    scene = load(folder / "scene.toml")
    if fingerprint(scene) != info["fingerprint"]:
        raise InputError(f"was changed after the run: run.json was written for another scene "
                         f"({info['fingerprint'][:12]})", file=str(folder / "scene.toml"),
                         field="fingerprint", value=fingerprint(scene)[:12])
    layout = _read_layout(folder, scene)
    data = _read_records(folder / "records.npy", layout)
    return Records(scene, layout, np.asarray(data["time"]), *(data[name] for name in FIELDS))


def _read_info(folder: Path) -> dict[str, Any]:
    path = folder / "run.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise InputError("is not the folder of a run: it has no run.json",
                         file=str(folder)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=str(path)) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"is damaged: {error}", file=str(path)) from None
    if not isinstance(info, dict) or info.get("format") != FORMAT:
        raise InputError(f"must be {FORMAT}: not written by this version of tbsa", file=str(path),
                         field="format",
                         value=info.get("format") if isinstance(info, dict) else info)
    for name, kind in (("fingerprint", str), ("wall", float)):
        if not isinstance(info.get(name), kind):
            raise InputError(f"is damaged: must be a {kind.__name__}", file=str(path), field=name,
                             value=info.get(name))
    return info


_LAYOUT = (*FIELDS, "type", "held", "seed")


def _read_layout(folder: Path, scene: Scene) -> Layout:
    path = folder / "layout.npz"
    data = _read_arrays(path, _LAYOUT)
    layout = Layout(*(data[name] for name in _LAYOUT))
    n = tile_count(scene)
    kinds = dict.fromkeys(FIELDS, "f") | {"type": "i", "held": "b", "seed": "b"}
    if any(data[name].shape != (n,) or data[name].dtype.kind != kinds[name] for name in _LAYOUT):
        raise InputError(f"does not belong to this run of {n} tiles", file=str(path))
    if n > 0 and not 0 <= layout.type.min() <= layout.type.max() < len(scene.types):
        raise InputError(f"is damaged: types must be from 0 to {len(scene.types) - 1}",
                         file=str(path), field="type")
    return layout


def _read_records(path: Path, layout: Layout, most: int | None = None) -> np.memmap[Any, Any]:
    """The entries of a records file, or so many at most, checked against the layout that it must
    begin with."""
    _check_readable(path, "is missing")
    try:
        data = _mapped(path, most)
    except Exception as error:  # as in _read_arrays
        raise InputError(f"is damaged: {error}", file=str(path)) from None
    n = layout.x.size
    checked = data.dtype == entry_type(n)
    if not (isinstance(data, np.memmap) and data.ndim == 1
            and (checked or data.dtype == entry_type(n, checked=False))):
        raise InputError(f"does not belong to this run of {n} tiles", file=str(path))
    if data.size == 0:
        raise InputError("holds no record yet", file=str(path))
    if data["time"][0] != 0.0 or any(
            not np.array_equal(data[name][0], getattr(layout, name)) for name in FIELDS):
        raise InputError("does not begin with this run's layout.npz: from another run",
                         file=str(path))
    if not (np.diff(data["time"]) > 0.0).all() or not data["time"][-1] <= LONGEST_RUN:
        raise InputError("is damaged: must go on from record to record, to "
                         f"{LONGEST_RUN:g} s at most", file=str(path), field="time")
    if checked and (wrong := data["check"] != _checksums(data)).any():
        k = int(np.argmax(wrong))
        raise InputError("is damaged: it has another checksum than when it was written",
                         file=str(path), field=f"record {k} ({data['time'][k]:.15g} s)")
    return data


def _mapped(path: Path, most: int | None) -> Any:
    """The entries, or so many at most: where a machine has died the header may tell of more than
    have reached the disk behind those that a checkpoint has seen."""
    if most is None:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    with open(path, "rb") as file:
        np.lib.format.read_magic(file)
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        return np.memmap(file, dtype, "r", file.tell(), (min(most, shape[0]), *shape[1:]))


def _check_interval(folder: Path, info: dict[str, Any], scene: Scene) -> None:
    """The records of a run that goes on come as often as before.

    Those after its checkpoint are written again, and would be lost at other times.
    """
    was = info.get("interval")
    if was is None:  # written before run.json had it
        was = load(folder / "scene.toml").record.interval
    if not isinstance(was, int | float):
        raise InputError("is damaged: must be a float", file=str(folder / "run.json"),
                         field="interval", value=was)
    if not abs(was - scene.record.interval) < 0.5 * scene.solver.step:
        raise InputError(f"s must stay {was!r} s, as in the records of {folder}",
                         file=scene.file or None, field="record.interval",
                         value=scene.record.interval)


def _check_records(path: Path, layout: Layout, keep: int, interval: float) -> np.dtype[Any]:
    """A file that a resumed run goes on with: `keep` entries or more, one every `interval` s;
    returns what an entry is like."""
    data = _read_records(path, layout, keep)  # what is behind them is written again
    if not os.access(path, os.W_OK):
        raise InputError("must be a file that may be written", file=str(path))
    if data.size < keep or not np.allclose(data["time"][:keep], interval * np.arange(keep),
                                           rtol=1e-12, atol=1e-12 * interval):
        raise InputError(f"must hold {keep} records, one every {interval:g} s, to go on from its "
                         "checkpoint", file=str(path))
    header = np.lib.format.header_data_from_array_1_0(np.empty(0, data.dtype))
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, header | {"shape": (keep,)})
    if data.offset != buffer.tell():
        raise InputError("was written by a version of NumPy that laid it out differently",
                         file=str(path))
    dtype: np.dtype[Any] = data.dtype
    return dtype


@dataclass
class Outcome:
    """How a call of :func:`run` ended."""

    finished: bool  # False: interrupted, and saved
    simulation: Simulation
    wall: float  # s, this call
    begun: float  # s, the simulated time that it went on from


@dataclass
class Stop:
    """What Ctrl-C or SIGTERM asks for."""

    asked: bool = False
    patient: bool = True  # the first one only asks; else, and the second time, it breaks off


class Busy(InputError):
    """Another process is at work on the same files."""


@contextlib.contextmanager
def locked(path: Path, *, create: bool = True, wait: float = 0.0, needed: bool = True
           ) -> Iterator[bool]:
    """Hold a file locked against other processes; a process that dies lets go of it.

    Gives whether it is.

    Parameters
    ----------
    path
        The file; what is in it does not matter.
    create
        Make it if it is not there; without, a file that cannot be opened is not locked.
    wait
        How long to wait (s) for another to let go.
    needed
        Refuse a system without locks; else go on unlocked there.

    Raises
    ------
    Busy
        Where another process holds it.
    InputError
        Where it cannot be locked: ``flock`` is of POSIX systems, and network file systems pass
        it on if they are mounted so.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | (os.O_CREAT if create else 0), 0o666)
    except OSError:
        if create:
            raise
        yield False
        return
    _OPEN.add(descriptor)
    try:
        end = time.monotonic() + wait
        while (held := _flock(descriptor)) is not True:
            if held is None and needed:
                raise InputError("must be on a file system with locks (flock)",
                                 file=str(path.parent))
            if held is None:
                break
            if time.monotonic() >= end:
                raise Busy("is in use: another process is at work on it", file=str(path.parent))
            time.sleep(0.05)
        yield held is True
    finally:
        _OPEN.discard(descriptor)
        os.close(descriptor)


_OPEN: set[int] = set()  # files that this process holds locked


def _let_go() -> None:
    """Of a process that was forked: what its parent holds is not to stay locked after that one."""
    while _OPEN:
        os.close(_OPEN.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


def _flock(descriptor: int) -> bool | None:
    """Whether the lock was got; None where there are no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


@contextlib.contextmanager
def interrupts() -> Iterator[Stop]:
    """Note Ctrl-C and SIGTERM, instead of being broken off in the middle."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def note(*_: object) -> None:
        again, stop.asked = stop.asked, True  # Python drops what is raised while it tidies up
        if again or not stop.patient:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run(scene: Scene, folder: str | Path, *, resume: bool = False, threads: int = 1,
        progress: Callable[[Simulation, bool], object] | None = None) -> Outcome:
    """Run a scene into a folder, to its duration or to Ctrl-C.

    Parameters
    ----------
    scene
        The scene.
    folder
        The run's folder; it is made.  It must be new or empty, unless `resume`.
    resume
        Go on from the folder's checkpoint, to the same bits as without the break.
    threads
        As of :class:`~tbsa.model.simulation.Simulation`; to the same bits.
    progress
        Called every quarter of a second or so, with the simulation and whether a record has
        just been written.  A true answer saves and ends the run, as Ctrl-C does.

    Raises
    ------
    TypeError
        Where it is no scene.
    InputError
        Where the scene is not valid, or the folder may not be written, holds a run already, or a
        checkpoint that cannot be resumed.
    Busy
        Where another process is at work on the folder.
    SimulationError
        Where the scene cannot be simulated.
    KeyboardInterrupt
        At a second Ctrl-C, or at one during compilation: the last checkpoint stands.
    """
    check_is_scene(scene)
    scene.validate()
    folder, mark, earlier = Path(folder), fingerprint(scene), 0.0
    drive = _drive_of(scene)
    if not may_be_filled(folder):
        raise InputError("must be a folder that may be written", file=str(folder))
    with interrupts() as stop:
        stop.patient = False  # a drive may have to be compiled, and nothing is written yet
        if not resume:
            _check_new(folder, tile_count(scene))
            simulation = Simulation(scene, threads=threads)
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"must be a folder that can be made: {error.strerror}",
                                 file=str(folder)) from None
        with locked(folder / "records.npy", create=not resume, needed=False) as alone:
            if resume:
                simulation, earlier = _resumed(scene, folder, mark, threads)
            if drive is not None and fingerprint(scene) != mark:
                raise InputError("was changed while it was compiled: begin again",
                                 file=scene.file, field="drive.module")
            stop.patient = True
            for path in [] if resume else _check_new(folder, tile_count(scene)):
                path.unlink(missing_ok=True)
            return _write_run(folder, simulation, drive, mark, earlier, resume, alone, progress,
                              stop)


def _resumed(scene: Scene, folder: Path, mark: str, threads: int) -> tuple[Simulation, float]:
    """The simulation as the folder's checkpoint has it, and what it has taken so far (s)."""
    info = _read_info(folder)
    if info["fingerprint"] != mark:
        raise InputError(f"was written for another scene or seed: this one has {mark[:12]}",
                         file=str(folder / "run.json"), field="fingerprint",
                         value=info["fingerprint"][:12])
    if isinstance(info.get("version"), str) and info["version"] != _version():
        raise InputError(
            f"must be {_version()}, this version: another one gives other bits; go on with "
            "that version, or begin anew in another folder (--out)",
            file=str(folder / "run.json"), field="version", value=info["version"])
    _check_interval(folder, info, scene)
    simulation = Simulation(scene, _read_layout(folder, scene), threads=threads)
    load_checkpoint(folder / "checkpoint.npz", simulation, mark)
    if round(scene.run.duration / simulation.h) < simulation.steps:
        raise InputError(f"s is less than the {simulation.time:g} s that {folder} holds: a "
                         "run can be made longer, not shorter", file=scene.file or None,
                         field="run.duration", value=scene.run.duration)
    return simulation, float(info["wall"])


def _check_new(folder: Path, n: int) -> list[Path]:
    """A folder that a new run may have: none yet, an empty one, or one with what is left of a run
    of `n` tiles that was killed before its first checkpoint; returns that, but for records.npy."""
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file, not a folder", file=str(folder))
    if (folder / "run.json").exists():
        raise InputError("holds a run already: resume it (--resume) or name another (--out)",
                         file=str(folder))
    there = list(folder.iterdir()) if folder.exists() else []
    records = folder / "records.npy"  # the first that a run makes
    begun = records in there and records.stat().st_size <= entry_type(n).itemsize + 4096
    left = [path for path in there if path != records]
    if there and not (begun and all((_of_scratch(path) or path.name) in REPLACED
                                    for path in left)):
        lost = ", or that of a run, which has a run.json" if records in there else ""
        raise InputError(f"must be a new or an empty folder{lost}", file=str(folder))
    return left


def _of_scratch(path: Path) -> str:
    """The file that a scratch file of `write_atomically`, ``.NAME.PID``, was to become; or ""."""
    found = re.fullmatch(r"\.(.+)\.\d+", path.name)
    return found[1] if found else ""


def _write_run(folder: Path, simulation: Simulation, drive: bytes | None, mark: str,
               earlier: float, resume: bool, alone: bool,
               progress: Callable[[Simulation, bool], object] | None, stop: Stop) -> Outcome:
    begin, begun = time.perf_counter(), simulation.time
    scene = simulation.scene
    every = round(scene.record.interval / scene.solver.step)
    save_every = every * round(scene.record.checkpoint / scene.record.interval)
    end = round(scene.run.duration / scene.solver.step)
    path = folder / "records.npy"
    # An end off the grid of record times leaves an entry of its own; going on drops it.
    keep, frame = simulation.steps // every + 1 if resume else 0, entry_type(simulation.numbers.n)
    if resume:
        frame = _check_records(path, simulation.layout, keep, every * scene.solver.step)
        for left in folder.glob(".*.*") if alone else ():  # by one that was killed while it wrote
            if _of_scratch(left) in REPLACED:
                left.unlink(missing_ok=True)
    else:
        _write_arrays(folder / "layout.npz",
                      {name: getattr(simulation.layout, name) for name in _LAYOUT})
    records = _Writer(path, frame, keep)
    since = simulation.steps  # OF_PROCESS counts from here

    def save() -> None:
        records.sync()
        save_checkpoint(folder / "checkpoint.npz", simulation, mark)
        counts = {name: np.asarray(value).tolist()
                  for name, value in simulation.counts._asdict().items()}
        info = {
            "format": FORMAT, "version": _version(), "fingerprint": mark, "since": since,
            "time": simulation.time, "finished": simulation.steps >= end,
            "interval": scene.record.interval,
            "wall": earlier + time.perf_counter() - begin,
            "counts": {k: v[0] if len(v) == 1 else v for k, v in counts.items()},
        }
        write_atomically(folder / "run.json", json.dumps(info, indent=1).encode())

    try:
        if not resume or (simulation.steps >= end and simulation.steps % every != 0):
            records.append(simulation)
        _write_scene(folder, scene, drive)
        save()
        chunk, stop.patient = 1, False  # the first call may have to compile for half a minute
        while simulation.steps < end and not stop.asked:
            ahead = min(end, (simulation.steps // every + 1) * every) - simulation.steps
            size = min(chunk, ahead)
            started = time.perf_counter()
            simulation.advance(size)
            stop.patient = True
            spent = max(time.perf_counter() - started, 1e-6)
            chunk = max(1, min(2 * chunk, int(size * GLANCE / spent)))
            recorded = simulation.steps % every == 0 or simulation.steps == end
            if recorded:
                records.append(simulation)
            if simulation.steps % save_every == 0 and simulation.steps < end:
                save()
            if progress is not None and progress(simulation, recorded):
                stop.asked = True
        if simulation.steps >= end:
            records.cut()
        save()
    finally:
        with naming(path):
            records.close()
    return Outcome(simulation.steps >= end, simulation, time.perf_counter() - begin, begun)


def _drive_of(scene: Scene) -> bytes | None:
    """The module of a user's own drive, if there is one."""
    own = scene.drive is not None and scene.drive.kind == "user"
    return engine_source(scene) if own else None


def _write_scene(folder: Path, scene: Scene, drive: bytes | None) -> None:
    """Write scene.toml, and beside it the module of a user's own drive."""
    if drive is not None:
        assert scene.drive is not None
        write_atomically(folder / "drive.py", drive)
        scene = replace(scene, drive=replace(scene.drive, module="drive.py"))
    write_atomically(folder / "scene.toml", dumps(scene).encode())


def _version() -> str:
    import tbsa

    return tbsa.__version__
