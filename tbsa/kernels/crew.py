"""Several threads at one scene, to the bits of one.

One thread goes through a step, as if alone; the loops that take long are over ranges, of tiles, of
magnet pairs, or of blocks of rows that have no tile in common.  For such a loop it tells the others
what is next (`give`), does its own share of the range, and waits for theirs (`collect`).  No two of
them write to one place, and what one of them finds (a sum of whole numbers, a largest value) does
not depend on who looked for it.  They wait without sleeping: a loop goes to the others and back
within a microsecond.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic

from tbsa.kernels.arrays import place
from tbsa.kernels.jit import ZERO, inline, lane

# What is to be done; see `help_out` in `advance.py`.
(LEAVE, PAIRS, LIST, AHEAD, PULL, REACT, TOTAL, ASSUME, ROWS, KEEP, CLEAR, FILL, RECALL, PACE,
 BEGIN, PLACE, KICK, APPLY, SWEEP, FLOOR, WORK, SCALE, BACK, END, DEEP, PART, BEYOND,
 HANG) = (np.int64(i) for i in range(28))

# Ranges shorter than this are not worth the way to another thread: 0.4 us there and back.
LEAST_TILES, LEAST_BLOCKS, LEAST_ROWS, LEAST_PAIRS, LEAST_ROOM = (
    np.int64(i) for i in (1024, 96, 96, 1024, 8192))
LINE = 8  # numbers of a cache line: what two threads write is this far apart
PATIENCE = 4096  # looks at a number, before another process may have the core


class Crew(NamedTuple):
    """What the threads of a scene tell each other."""

    size: int  # threads, 1: nobody is there to be told
    job: np.ndarray  # int64[1], number of the job that was given out last
    done: np.ndarray  # int64[size * LINE], number of the job that each has done, or 0 has given
    what: np.ndarray  # int64[3], what it is, and its range
    numbers: np.ndarray  # float64[10], what it needs to know, such as the length of the substep (s)
    found: np.ndarray  # int64[size * LINE], what each has found: points that hit, rows, pairs
    deepest: np.ndarray  # float64[size * LINE], likewise: overlap (m), or squares of speeds


def empty_crew(size: int) -> Crew:
    """A crew of so many threads, without a job."""
    lines = size * LINE
    return Crew(size, np.zeros(1, np.int64), np.zeros(lines, np.int64), np.zeros(3, np.int64),
                np.zeros(10), np.zeros(lines, np.int64), np.zeros(lines))


@lane
def nobody(crew: Crew) -> Crew:
    """A crew of one, as a constant: the compiler leaves out what is for others."""
    return Crew(1, crew.job, crew.done, crew.what, crew.numbers, crew.found, crew.deepest)


@intrinsic
def _acquire(_: Any, array: Any, index: Any) -> Any:
    """A number that another thread may have written, and what it wrote before (acquire)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(place(context, builder, signature.args, arguments), "acquire", 8)

    return types.int64(array, index), generate


@intrinsic
def _release(_: Any, array: Any, index: Any, value: Any) -> Any:
    """Write a number for other threads, after all that was written before (release)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        where = place(context, builder, signature.args, arguments)
        builder.store_atomic(arguments[2], where, "release", 8)
        return context.get_dummy_value()

    return types.none(array, index, types.int64), generate


# Their first argument is the compiler's.  Where there is no such call a thread goes on looking.
load: Any = _acquire
store: Any = _release
_yield: Any = types.ExternalFunction("sched_yield", types.intc())
YIELDS = hasattr(os, "sched_yield")


@inline
def wait_for(numbers: np.ndarray, index: int, value: int) -> None:
    """Wait until another thread has written this value, or a later one."""
    looks = 0
    while load(numbers, index) < value:
        looks += 1
        if YIELDS and looks > PATIENCE:
            _yield()


@lane
def give(crew: Crew, what: int, first: int, last: int, least: int) -> Any:
    """Tell the others to do their shares of a range, unless it is shorter than `least`; returns
    first and last of what is left to this one."""
    if crew.size == 1 or last - first < least:
        return first, last
    crew.what[0], crew.what[1], crew.what[2] = what, first, last
    crew.done[0] = crew.job[0] + 1
    store(crew.job, 0, crew.job[0] + 1)
    return share(crew, ZERO, first, last)


@lane
def share(crew: Crew, me: int, first: int, last: int) -> Any:
    """First and last of a thread's share of a range, by whole cache lines."""
    each = (last - first) // crew.size
    each -= each % LINE if each >= LINE else 0
    return first + me * each, last if me == crew.size - 1 else first + (me + 1) * each


@lane
def collect(crew: Crew) -> None:
    """Wait until the others have done their shares of what was given last."""
    for other in range(1, crew.size):
        wait_for(crew.done, other * LINE, crew.done[0])
