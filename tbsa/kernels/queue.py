"""A queue of rows by time: a binary heap that knows where in it each row stands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tbsa.kernels.jit import ZERO, inline


class Queue(NamedTuple):
    """Rows in wait, each at most once; the first of ``heap`` is the next one."""

    heap: np.ndarray  # int64
    place: np.ndarray  # int64, by row: 1 + where in the heap it stands, or 0
    time: np.ndarray  # by row
    size: np.ndarray  # int64[1]


def empty_queue(rows: int) -> Queue:
    """For so many rows."""
    return Queue(np.zeros(rows, np.int64), np.zeros(rows, np.int64), np.zeros(rows),
                 np.zeros(1, np.int64))


@inline
def sooner(queue: Queue, p: int, q: int) -> bool:
    """Whether row p comes before row q; of two at the same time that of the lower number."""
    time = queue.time
    return bool(time[p] < time[q] or (time[p] == time[q] and p < q))


@inline
def sift(queue: Queue, row: int, at: int) -> None:
    """Let a row in, where the heap has a hole: towards its first or its last place."""
    heap, place, size = queue.heap, queue.place, queue.size[0]
    while at > 0:
        up = (at - 1) // 2
        if not sooner(queue, row, heap[up]):
            break
        heap[at] = heap[up]
        place[heap[at]] = at + 1
        at = up
    while 2 * at + 1 < size:
        down = 2 * at + 1
        if down + 1 < size and sooner(queue, heap[down + 1], heap[down]):
            down += 1
        if not sooner(queue, heap[down], row):
            break
        heap[at] = heap[down]
        place[heap[at]] = at + 1
        at = down
    heap[at] = row
    place[row] = at + 1


@inline
def put(queue: Queue, row: int, time: float) -> None:
    """Let a row wait for this time, whether it has waited for another before or not."""
    at = queue.place[row] - 1
    if at < 0:
        at = queue.size[0]
        queue.size[0] += 1
    queue.time[row] = time
    sift(queue, row, at)


@inline
def take(queue: Queue) -> int:
    """The next row, which waits no longer."""
    row = queue.heap[0]
    queue.place[row] = 0
    queue.size[0] -= 1
    if queue.size[0] > 0:
        sift(queue, queue.heap[queue.size[0]], ZERO)
    return int(row)
