"""Many steps without coming back to Python.

One step of length H, of second order in free flight, has two halves (one part, where the number of
substeps is odd), each of length P:

    lists   near pairs of magnets, for the middle of the half (kept while nobody has moved too far)
    forces  magnets and drive, at x + P/2 v: the middle of the half; where tiles turn far
            as seen from each other, the mean of their way      (magnets.py, mean_forces.py)

after the forces of the first half, once a step:

    lists   near pairs of tiles, likewise
    rows    which tiles may touch in this step, at their speeds and under these forces; and
            after an impact what a tile may touch besides that it has thrown

and the substeps of a half, of length h:

    drift   x += h/2 v                                      to the middle of the substep
    damp    v *= exp(-h/2 c)
    rows    where they touch                                (contacts.py)
    impacts what hits in this substep, as fast as it then is (impacts.py)
    kick    v += h F/m; at the end of a half what magnets have added to the angular momentum, as
            contacts have brought tiles elsewhere than to the middle's places, is taken back
    solve   contacts and floor friction at the velocity level (solver.py)
    damp    v *= exp(-h/2 c)
    drift   x += h/2 v
    project deep overlap out of the positions, if any       (projection.py)

A substep is h, or h/2, h/4 or h/8 where a tile that may touch another spins fast: rows foresee the
arc of what goes on turning, but not what an impact makes of it.  It is longer, up to 8 h within a
half, where the scene is calm: next to nothing overlaps, and tiles that may touch are slow.

A free tile goes as if a half were one substep, so that the forces, which change slowly, are
found twice a step; contacts converge better, and spinning tiles meet more exactly, in more and
shorter substeps than in more passes.  The state at the end of a step, with the contact impulses,
is all that the next one needs.  What hits only after that is shown where it is until then, and how
it goes is kept beside (`look_back`, `foresee`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.arrays import copy, lean, set_all
from tbsa.kernels.bodies import Bodies, Numbers, with_substep
from tbsa.kernels.contacts import place_rows
from tbsa.kernels.crew import (
    AHEAD,
    APPLY,
    ASSUME,
    BACK,
    BEGIN,
    BEYOND,
    CLEAR,
    DEEP,
    END,
    FILL,
    FLOOR,
    HANG,
    KEEP,
    KICK,
    LEAST_BLOCKS,
    LEAST_TILES,
    LEAVE,
    LINE,
    LIST,
    PACE,
    PAIRS,
    PART,
    PLACE,
    PULL,
    REACT,
    RECALL,
    ROWS,
    SCALE,
    SWEEP,
    TOTAL,
    WORK,
    Crew,
    collect,
    give,
    share,
    store,
    wait_for,
)
from tbsa.kernels.early import foresee, forget_early, look_back, spread_early
from tbsa.kernels.floor import EXACT, FloorLaw
from tbsa.kernels.forces import find_forces, find_magnets, find_pairs, look_ahead, strongest
from tbsa.kernels.hits import Loads
from tbsa.kernels.impacts import impacts, keep_together
from tbsa.kernels.jit import NO, YES, ZERO, U, inline, kernel, lane, solo
from tbsa.kernels.magnets import MagnetLaw, add_up, magnets_from, pull, react
from tbsa.kernels.mean_forces import any_turns_far
from tbsa.kernels.motion import (
    balance,
    damp,
    damping,
    drift,
    drift_back,
    find_stopped,
    kick,
    note_lag,
    turn,
    turn_again,
)
from tbsa.kernels.neighbours import pairs_from, place_of
from tbsa.kernels.projection import find_deep, part_listed, project
from tbsa.kernels.reach import (
    CALM,
    FEW,
    TICKS,
    assume,
    beyond,
    fastest,
    mark_beyond,
    ticks_at,
    widest,
)
from tbsa.kernels.rows import (
    ALL,
    BETWEEN,
    COLOURS,
    LATE,
    SCALED,
    SIZES,
    Rows,
    about_the_same,
    add_rows,
    clear_blocks,
    colour_rows,
    fill_lanes,
    find_islands,
    find_rows,
    recall,
    recall_all,
    remember,
    remember_all,
    rows_from,
)
from tbsa.kernels.solver import find_scales, limit_work, relax, scale_impulses, work_on
from tbsa.kernels.squeeze import ease
from tbsa.kernels.state import (
    MORE_ROWS,
    NOT_FINITE,
    OK,
    TOO_FAST,
    TOO_MANY,
    Counts,
    State,
    Tiles,
    Work,
    by_itself,
    note_overlap,
    note_still,
    so_far,
)
from tbsa.kernels.sweeps import apply_blocks, apply_impulses, floor_tiles, sweep_blocks, turn_round

# Where forces may come on from one moment to the next, no substep is joined in which they would
# bring a point further than this (widths).
SUDDEN = 0.03
# Where no tile goes further than this in a step (widths), all are at rest.
STILL = 1e-15
# The last substep's impulses tell what contacts give in this one if loads give so many tolerances
# in it; and bring nothing further than this in half a step (widths), or they are others then.
TOLD, STEADY = 10.0, 0.01
# Up to one tile in so many that comes further than assumed, and in the substep of an impact so many
# of a small scene, has its rows added; for more, all rows are found anew.
FEW_TILES = 8
# What an impact throws may hit, in the same substep, what it had no row with, so many times.
THROWN = 4


@lane
def place_all(k: Numbers, ahead: float, gain: float, x: np.ndarray, y: np.ndarray, work: Work,
              begin: int, end: int) -> Any:
    """Where the rows of these blocks touch; see `place_rows`."""
    return place_rows(work.rows, with_substep(k, ahead), x, y, work.c, work.s, work.bodies, gain,
                      begin, end)


@inline
def scale_to(rows: Rows, ticks: int) -> None:
    """Make the impulses of all rows those of a substep of so many eighths of h."""
    before = rows.size[SCALED]
    if before > 0 and ticks != before:
        scale_impulses(rows, ticks / before)
        rows.size[SCALED] = ticks


@lane
def update_rows(k: Numbers, reach: float, left: int, further: int, tiles: Tiles, state: State,
                work: Work, counts: Counts) -> Any:
    """Bring the rows up to date for the rest of a step, of so many eighths of h, in which so many
    tiles, marked in ``moved``, come further than was assumed.

    Returns an error word, and the deepest overlap, where all rows have been found anew; else -1.
    """
    n, x, y, angle, v, rows = k.n, state.x, state.y, state.angle, work.bodies, work.rows
    c, s, far, way, crew = work.c, work.s, work.far, work.way, work.crew
    first = left == k.substeps * TICKS
    few = not first and further <= n // FEW_TILES
    rest = left * (k.h / TICKS)
    if few:
        set_all(work.turned, n + 1, math.nan)  # `add_rows` takes cosines of what it looks at
        assume(k, rest, NO, x, y, angle, work, ZERO, n)
    else:
        crew.numbers[5] = rest
        low, high = give(crew, ASSUME, ZERO, n, LEAST_TILES)
        assume(k, rest, YES, x, y, angle, work, low, high)
        collect(crew)
    if few and add_rows(rows, work.pairs, k, x, y, angle, c, s, v.mobile, v.moved, way, far,
                        widest(n, x, y, work.pairs, way)) >= 0:
        return OK, -1.0
    ahead = np.int64(1) if first else ZERO
    if reach > 0.0:
        error = find_pairs(k, reach, tiles, x, y, way, ahead, work, counts)
        if error != OK:
            return error, -1.0
    if work.pairs.start[n] > 0 or k.wall != 0:  # else nobody asks
        turn(ZERO, n, angle, work.turned, c, s)
    found, others, overlap = find_rows(rows, work.pairs, k, x, y, c, s, tiles.mobile, way, far,
                                       ahead, crew)
    if found < 0:
        return MORE_ROWS, -1.0
    # As if rows had not been there before: a run may go on from here.
    known = rows.size[SCALED] > 0
    if others or not known or (first and rows.size[LATE] > 0):
        ticks = rows.size[SCALED] if known else np.int64(TICKS)
        keep_impulses(k, rows, state, crew)
        if not colour_rows(rows, found, k, v.mobile, crew):
            rows.size[SCALED] = 0
            return MORE_ROWS, -1.0
        recall_all(rows, found, n, state.impulses, crew)
        rows.size[SCALED] = TICKS
        scale_to(rows, ticks)
    return OK, overlap


@inline
def keep_impulses(k: Numbers, rows: Rows, state: State, crew: Crew) -> None:
    """Note the impulses of the rows, if there are any, in the state, as those of a whole h."""
    if rows.size[SCALED] > 0:
        scale_to(rows, np.int64(TICKS))
        remember_all(rows, rows.size[0], k.n, state.impulses, crew)


@inline
def count_all(k: Numbers, mobile: np.ndarray) -> int:
    """How many rows there can be where no wall is, else -1."""
    free = 0
    for i in range(U(k.n)):
        free += 1 if mobile[i] != 0.0 else 0
    return free * (2 * k.n - free - 1) // 2 if k.wall == 0 else -1


@inline
def all_known(rows: Rows) -> bool:
    """Whether every pair that there is has its row: nothing else can be hit."""
    return bool(rows.size[0] == rows.size[ALL])


@inline
def add_thrown(k: Numbers, time: float, state: State, work: Work, counts: Counts) -> bool:
    """Rows that tiles need which an impact has thrown further than was assumed for the rest of the
    step, of this length (s); whether there are any that they had not got.

    Where they are many, or do not fit, all rows are found anew after the substep.
    """
    n, x, y, angle, v, z = k.n, state.x, state.y, state.angle, work.bodies, work.scratch
    if all_known(work.rows):
        return False
    # Of what an impact may have reached, which is little of a large scene.
    further = ZERO
    set_all(v.moved, n + 1, ZERO)
    for j in range(z.size[2]):
        further += mark_beyond(k, time, x, y, angle, work, z.pulled[j], z.pulled[j] + 1)
    if further == 0 or further > max(n // FEW_TILES, FEW_TILES):
        return False
    for j in range(z.size[2]):
        i = z.pulled[j]
        if v.moved[i] != 0:
            assume(k, time, YES, x, y, angle, work, i, i + 1)
    found = add_rows(work.rows, work.pairs, k, x, y, angle, work.c, work.s, v.mobile, v.moved,
                     work.way, work.far, widest(n, x, y, work.pairs, work.way))
    counts.surprises[0] += 1
    for i in range(n if found < 0 else 0):  # still beyond what is assumed, after the substep
        work.way[i] = -1.0 if v.moved[i] != 0 else work.way[i]
    return bool(found > 0)


@inline
def hit(k: Numbers, ahead: float, left: float, loads: Loads, state: State, work: Work,
        counts: Counts) -> int:
    """Impacts from the middle of a substep on, over a time `ahead` (s), with `left` (s) of the step
    still to go; returns how many points have hit.

    What has been thrown may reach within the substep what it was too slow for: it gets the rows
    that it has not got, and what hits there follows, so many times at most.
    """
    rows, v, x, y, c, s = work.rows, work.bodies, state.x, state.y, work.c, work.s
    ka, points = with_substep(k, ahead), 0
    set_all(work.scratch.since, k.n + 1, 0.0)
    set_all(work.turned, k.n + 1, math.nan)  # impacts move tiles, and take cosines there
    for _ in range(THROWN):
        points += impacts(rows, ka, loads, v, work.scratch, x, y, state.angle, c, s)
        blocks = rows.first[COLOURS]
        if not add_thrown(k, left, state, work, counts):
            break
        struck, _ = place_rows(rows, ka, x, y, c, s, v, loads.gain, blocks, rows.first[COLOURS])
        if struck == 0:
            break
    return points


@inline
def any_live(rows: Rows) -> bool:
    """Whether a solve may have anything to do: what flies past each other needs none."""
    live, some = rows.live, 0
    for block in range(U(rows.first[COLOURS])):
        some |= live[block]
    return some != 0


@inline
def hardly_moves(k: Numbers, v: Bodies) -> bool:
    """Whether no tile goes further than `STILL` in a step; mostly the first ones say no."""
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(k.front), U(k.n)):
        pace = abs(vx[i]) + abs(vy[i]) + k.width * abs(w[i])
        if not k.substeps * k.h * pace <= STILL * k.width:  # what is no number moves
            return False
    return True


@lane
def bring_to_rest(k: Numbers, state: State, v: Bodies, place: Bodies) -> None:
    """Take away what is left of velocities, which is rounding, and note where the tiles are."""
    set_all(v.vx, k.n + 1, 0.0)
    set_all(v.vy, k.n + 1, 0.0)
    set_all(v.w, k.n + 1, 0.0)
    copy(state.x, place.startx, k.n)
    copy(state.y, place.starty, k.n)
    copy(state.angle, place.startw, k.n)


@lane
def stays(k: Numbers, state: State, work: Work) -> bool:
    """Whether no tile has gone further than `STILL` from where it was noted, or is about to, and
    impulses are those noted, but for rounding; if so, puts all back, or roundings would add up."""
    v, place, rows, least = work.bodies, work.shift, work.rows, STILL * k.width
    for i in range(U(k.n)):
        if not (abs(state.x[i] - place.startx[i]) <= least
                and abs(state.y[i] - place.starty[i]) <= least
                and k.width * abs(state.angle[i] - place.startw[i]) <= least):
            return False
    if not (hardly_moves(k, v) and about_the_same(rows, rows.size[0], k.n, state.impulses)):
        return False
    copy(place.startx, state.x, k.n)
    copy(place.starty, state.y, k.n)
    copy(place.startw, state.angle, k.n)
    recall(rows, k.n, state.impulses, ZERO, rows.size[0])
    return True


@lane  # or it is handed some hundred arguments, of a tile or two as well
def substep(k: Numbers, kh: Numbers, ticks: int, middle: float, known: bool, ends: bool,
            ahead: float, left: float, seen: bool, pull: float, slow: float, slow_spin: float,
            floor: FloorLaw, state: State, work: Work, counts: Counts) -> float:
    """A substep of length kh.h, so many eighths of k.h, from whose `middle` (s from its beginning)
    a time `ahead` counts for what may touch; with `left` (s) of the step to go when it begins, and
    nothing sped up by more than `pull` (m/s^2).  `known`: there, angles are those of the middle of
    the half, which `ends` with it.  `seen`: the tiles are looked at when it ends.

    Damping leaves `slow` and `slow_spin` of velocities in half of it.  Returns the deepest overlap
    (m).
    """
    n, h, x, y, angle, last = k.n, kh.h, state.x, state.y, state.angle, state.last
    v, rows, c, s, before, crew = (work.bodies, work.rows, work.c, work.s, work.shift,
                                   work.crew)
    m, overlap = rows.size[0], 0.0
    numbers = crew.numbers
    gain = 2.0 * pull * h * ahead
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = h, ahead, slow, slow_spin, gain
    numbers[6], numbers[9] = middle, known
    work.scratch.size[5] = 0
    counts.substeps[0] += 1
    counts.joined[0] += max(ticks // TICKS - 1, 0)
    counts.rows[0] += m

    low, high = give(crew, BEGIN, k.front, n, LEAST_TILES)
    drift(low, high, middle, v, x, y, angle)
    damp(low, high, slow, slow_spin, v)
    if m > 0 or floor.law == EXACT:
        turn_again(low, high, known, angle, work)
    collect(crew)

    half = 0.5 * k.substeps * k.h
    told = pull * k.h > TOLD * k.tolerance and pull * half * half <= STEADY * k.width
    loads = Loads(h, gain, told, work.fx, work.fy, work.torque, floor,
                  h - middle if seen else math.inf, slow, slow_spin, state.early, state.seen)
    if m > 0:
        blocks = rows.first[COLOURS]
        low, high = give(crew, PLACE, ZERO, blocks, LEAST_BLOCKS)
        struck, overlap = place_all(k, ahead, gain, x, y, work, low, high)
        collect(crew)
        for other in range(1, crew.size if high < blocks else 1):
            struck += crew.found[other * LINE]
            overlap = max(overlap, crew.deepest[other * LINE])
        note_overlap(overlap, k.width, ticks, counts)
        last[2] = 0
        if struck > 0:
            last[2] = hit(k, ahead, left - middle, loads, state, work, counts)
            counts.impacts[0] += last[2]
            counts.unconverged[0] += work.scratch.size[5]
            m = rows.size[0]
    else:
        counts.overlap[0] += ticks
        last[2] = 0

    low, high = give(crew, KICK, k.front, n + 1, LEAST_TILES)
    kick(k, h, work.fx, work.fy, work.torque, v, before, m > 0 or floor.law != 0, low, high)
    collect(crew)
    if work.magnets.size[0] > 0 and not (known and last[2] == 0):
        note_lag(k, h, x, y, work)  # of the whole half, though rows may come in its middle
        if ends and m > 0:
            balance(k, work)
    live = m > 0 and (k.skip_converged == 0 or any_live(rows))
    last[0] = 0
    rows.effort[0] += 0 if live else m
    rows.effort[1] += 0 if live else m
    if live or floor.law != 0:
        if live:
            if rows.size[BETWEEN] > 0:
                ease(rows, k, v)
            apply_impulses(rows, k.per_mass, v, crew)
        passes = relax(rows, m if live else ZERO, kh, floor, c, s, v, crew)
        last[0] = passes if passes >= 0 else -1 - passes
        counts.unconverged[0] += 1 - work.scratch.size[5] if passes < 0 else 0
        counts.passes[0] += last[0]
        if live:
            limit_work(rows, kh, floor, c, s, v, before, crew)
        if floor.law != 0:
            turn_round(rows, floor, kh, c, s, v)
            drift_back(kh, floor, before, v, x, y, angle, crew)

    if state.early[0] > 0:
        spread_early(rows, k, loads, v, before, x, y, angle)
    low, high = give(crew, END, k.front, n, LEAST_TILES)
    damp(low, high, slow, slow_spin, v)
    drift(low, high, h - middle, v, x, y, angle)
    collect(crew)
    if live and project(rows, with_substep(k, ahead), ahead - (h - middle), v, work.shift, x, y,
                         angle, c, s, crew):
        counts.projections[0] += 1
        if state.early[0] > 0:
            forget_early(rows, k.n, loads, work.shift)
    if work.scratch.size[3] > 0:
        keep_together(rows, k, work.scratch)
    return overlap


@lane
def go_on(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
          drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
          begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance by `steps` steps; the run has `begun` with so many.  Nearer than `reach` (m) from
    centre to centre two tiles may act on each other; 0 where there are no two.

    Returns the error word and the steps done; on MORE_PAIRS, MORE_ROWS and MORE_MAGNETS the state
    is that before the step that failed, and the caller goes on with more space.  TOO_MANY: pairs
    have multiplied within a step.
    """
    n, x, y, angle, last, v, rows = (k.n, state.x, state.y, state.angle, state.last, work.bodies,
                                     work.rows)
    foresee(state)
    copy(state.vx, v.vx, n + 1)
    copy(state.vy, v.vy, n + 1)
    copy(state.omega, v.w, n + 1)
    copy(tiles.mobile, v.mobile, n + 1)
    vx, vy, w = v.vx, v.vy, v.w
    contacts, magnetic = reach > 0.0 or k.wall != 0, magnets.cutoff > 0.0 and reach > 0.0
    parts, all_ticks, tick = (2 if k.substeps % 2 == 0 else 1), k.substeps * TICKS, k.h / TICKS
    part_length = k.substeps * k.h / parts
    set_all(work.turned, n + 1, math.nan)
    set_all(work.mid_turned, n + 1, math.nan)
    set_all(rows.first, np.int64(COLOURS + 1), ZERO)
    set_all(rows.size, np.int64(SIZES), ZERO)
    rows.size[ALL] = count_all(k, v.mobile)
    rows.effort[0] = rows.effort[1] = 0
    error, done, wanted, overlap = OK, 0, TICKS, 0.0
    fresh = last[1] == 0  # nothing has looked ahead yet
    loaded, counted = YES, so_far(rows, counts)  # loaded by what was there before
    promised = max(last[1], 1)
    kh = with_substep(k, k.h)
    slow, slow_spin = damping(kh)
    for step in range(steps):
        # A step depends on the state alone: one that leaves it as it is need not be done again.
        rests = not fresh and hardly_moves(k, v)
        if rests:
            bring_to_rest(k, state, v, work.shift)
            keep_impulses(k, rows, state, work.crew)
            counted = so_far(rows, counts)
        before = (promised, last[0], last[2])
        left = all_ticks
        further: Any = np.int64(n if contacts else 0)  # tiles that come further than assumed
        late = rows.size[LATE]
        for part in range(parts):
            turns_far = magnetic and any_turns_far(n, w, part_length, work.magnets.turns)
            if magnetic:
                error = find_magnets(k, 0.5 * part_length, reach, tiles, magnets, x, y, angle,
                                     turns_far, np.int64(1) if part == 0 else ZERO, work, counts)
                if error != OK:
                    break
            loaded = find_forces(
                (begun + step) * (k.substeps * k.h) + (part + 0.5) * part_length, k,
                0.5 * part_length, tiles, magnets, drive, drive_parameters, x, y, angle, turns_far,
                loaded, work)
            counts.magnet_pairs[0] += work.magnets.size[0]
            hardest: float = -1.0  # not asked for yet
            most: Any = all_ticks
            end = left - all_ticks // parts
            while left > end:
                if further > 0:
                    error, found = update_rows(k, reach, left, further, tiles, state, work, counts)
                    overlap = found if found >= 0.0 else overlap
                # Where there can be no other rows, nobody asks who comes further than assumed.
                others = further > 0 or rows.size[LATE] > late
                if others or (all_known(rows) and rows.size[0] > 0):
                    if error != OK:
                        break
                    pace = ticks_at(k, rows, x, y, v,
                                    last[0] <= FEW and overlap <= CALM * k.width, work.crew)
                    if pace == 0:
                        error = TOO_FAST
                        break
                    wanted = pace if others or last[2] > 0 else min(wanted, pace)
                if hardest < 0.0 and rows.size[0] > 0:
                    hardest = strongest(k, floor, work, loaded)
                    way = hardest * tick * tick if k.driven > 1 else 0.0  # in an eighth of h
                    while most > TICKS and way * most * most > SUDDEN * k.width:
                        most = max(most >> 1, np.int64(TICKS))
                # What has just hit is where it is to be only after the time that was foreseen.
                ticks = min(promised, left - end)
                ticks = ticks if last[2] > 0 else min(min(wanted, most), ticks)
                rest = left - end - ticks
                promised = min(min(wanted, most), rest if rest > 0 else all_ticks // parts)
                scale_to(rows, ticks)
                if ticks * tick != kh.h:
                    kh = with_substep(k, ticks * tick)
                    slow, slow_spin = damping(kh)
                # From the middle of this substep to that of the next; the first looks at once.
                middle = 0.0 if fresh else 0.5 * ticks * tick
                ahead = (ticks + 0.5 * promised) * tick - middle
                fresh = False
                late = rows.size[LATE]
                known = (left - end == all_ticks // parts and middle == 0.5 * part_length
                         and magnetic and work.magnets.size[0] > 0)
                overlap = substep(k, kh, ticks, middle, known, left - ticks == end, ahead,
                                  left * tick, step + 1 == steps and left == ticks, hardest, slow,
                                  slow_spin, floor, state, work, counts)
                wanted = min(wanted, TICKS) if overlap > CALM * k.width else wanted
                wanted >>= 1 if last[0] > FEW and wanted > TICKS else 0
                left -= ticks
                missing = contacts and left > 0 and not all_known(rows)
                further = beyond(k, left * tick, x, y, angle, work) if missing else 0
                counts.surprises[0] += 1 if further > 0 else 0
            if error != OK:
                break
        if error != OK:
            if left < all_ticks and error != TOO_FAST:
                return TOO_MANY if error != NOT_FINITE else NOT_FINITE, done
            break
        # A call may end here, and the next begins like this; to scale by 6 and back is not exact.
        scale_to(rows, np.int64(TICKS))
        done += 1
        counts.steps[0] += 1
        if (rests and stays(k, state, work) and k.skip_still != 0
                and promised == before[0] and last[0] == before[1] and last[2] == before[2]):
            note_still(steps - done, counted, rows, counts)
            done = steps
            break
    last[1] = 0 if fresh else promised  # of a first step that lacked space it is still to come
    keep_impulses(k, rows, state, work.crew)
    copy(vx, state.vx, n + 1)
    copy(vy, state.vy, n + 1)
    copy(w, state.omega, n + 1)
    look_back(state)
    counts.solves[0] += rows.effort[0]
    counts.unsolved[0] += rows.effort[1]
    for i in range(n):
        if not (np.isfinite(vx[i]) and np.isfinite(vy[i]) and np.isfinite(w[i])):
            error = NOT_FINITE
    return error, done


@solo
def advance(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
            drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
            begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance a scene in one thread, see `go_on`."""
    state, tiles, work, counts = lean(state), lean(tiles), lean(work), lean(counts)
    error, done = go_on(state, tiles, k, magnets, floor, drive, drive_parameters,
                        by_itself(work), counts, begun, steps, reach)
    return error, done


@kernel
def advance_together(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
                     drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
                     begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance a scene as thread 0 of its crew, see `go_on`; the others run `help_out`."""
    state, tiles, work, counts = lean(state), lean(tiles), lean(work), lean(counts)
    error, done = go_on(state, tiles, k, magnets, floor, drive, drive_parameters, work, counts,
                        begun, steps, reach)
    return error, done


@kernel
def help_out(me: int, job: int, state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw,
             floor: FloorLaw, work: Work) -> None:
    """Thread `me` > 0 of a crew: do shares of what thread 0 gives out after job number `job`,
    until it is told to leave."""
    state, tiles, work = lean(state), lean(tiles), lean(work)
    x, y, angle, v, rows, crew = (state.x, state.y, state.angle, work.bodies, work.rows,
                                  work.crew)
    while True:
        job += 1
        wait_for(crew.job, 0, job)
        what = crew.what[0]
        if what == LEAVE:
            return
        h, ahead_time, slow, slow_spin, gain = (crew.numbers[0], crew.numbers[1],
                                                crew.numbers[2], crew.numbers[3],
                                                crew.numbers[4])
        first, last = share(crew, me, crew.what[1], crew.what[2])
        if what == PAIRS:
            crew.found[me * LINE] = pairs_from(
                work.pairs, x, y, tiles.mobile, crew.numbers[0], work.margin,
                crew.numbers[1], first, last, place_of(work.pairs.room, first, k.n),
                place_of(work.pairs.room, last, k.n))
        elif what == BEGIN:
            drift(first, last, crew.numbers[6], v, x, y, angle)
            damp(first, last, slow, slow_spin, v)
            turn_again(first, last, crew.numbers[9] != 0.0, angle, work)
        elif what == PLACE:
            struck, deepest = place_all(k, ahead_time, gain, x, y, work, first, last)
            crew.found[me * LINE], crew.deepest[me * LINE] = struck, deepest
        elif what == KICK:
            kick(k, h, work.fx, work.fy, work.torque, v, work.shift, True, first, last)
        elif what == APPLY:
            apply_blocks(rows, k.per_mass, v, first, last)
        elif what == SWEEP:
            crew.found[me * LINE], crew.deepest[me * LINE] = sweep_blocks(
                rows, with_substep(k, h), v, first, last)
        elif what == FLOOR:
            floor_tiles(floor, with_substep(k, h), work.c, work.s, v, first, last)
        elif what == WORK:
            work_on(k, v, work.shift, first, last)
        elif what == SCALE:
            crew.found[me * LINE] = find_scales(rows, v, work.shift, first, last)
        elif what == BACK:
            crew.found[me * LINE] = find_stopped(k, v, work.shift, first, last)
        elif what == DEEP:
            find_deep(rows, with_substep(k, ahead_time), first, last)
        elif what == PART:
            part_listed(rows, with_substep(k, ahead_time), v, work.shift, x, y, angle, work.c,
                        work.s, crew.numbers[7], crew.numbers[8], first, last)
        elif what == END:
            damp(first, last, slow, slow_spin, v)
            drift(first, last, h - crew.numbers[6], v, x, y, angle)
        elif what == LIST:
            pairs, left = magnets_from(
                magnets, work.pairs, k.n, tiles.glues, x, y, work.c, work.s, work.need,
                work.turning, work.magnets, me, crew.size, first, last)
            crew.found[me * LINE], crew.found[me * LINE + 1] = pairs, left
        elif what == ASSUME:
            assume(k, crew.numbers[5], YES, x, y, angle, work, first, last)
        elif what == BEYOND:
            crew.found[me * LINE] = mark_beyond(k, crew.numbers[5], x, y, angle, work, first, last)
        elif what == PACE:
            turn2, past2, all2 = fastest(k, rows, x, y, v, first, last)
            crew.deepest[me * LINE], crew.deepest[me * LINE + 1] = turn2, past2
            crew.deepest[me * LINE + 2] = all2
        elif what == KEEP:
            crew.found[me * LINE] = remember(rows, k.n, state.impulses, first, last)
        elif what == CLEAR:
            clear_blocks(rows, k.n, first, last)
        elif what == HANG:
            if me == 1:
                find_islands(rows, crew.what[2], k.n, tiles.mobile)
        elif what == FILL:
            fill_lanes(rows, k, tiles.mobile, first, last)
        elif what == RECALL:
            recall(rows, k.n, state.impulses, first, last)
        elif what == ROWS:
            m, deepest = rows_from(rows, work.pairs, k, x, y, work.c, work.s, tiles.mobile,
                                   work.way, work.far, me, crew.size, first, last)
            crew.found[me * LINE], crew.deepest[me * LINE] = m, deepest
        elif what == AHEAD:
            look_ahead(h, magnets, x, y, angle, work, first, last)
        elif what == PULL:
            pull(magnets, work.magnets, crew.what[1], first, last)
        elif what == REACT:
            react(work.magnets, k.n, False, crew.what[1], crew.what[2], False, me == 1)
        elif what == TOTAL:
            add_up(work.magnets, k.n, False, work.fx, work.fy, work.torque, first, last)
        store(crew.done, me * LINE, job)


@kernel
def dismiss(crew: Crew) -> None:
    """Let the helpers of a crew leave."""
    crew = lean(crew)
    crew.what[0] = LEAVE
    store(crew.job, 0, crew.job[0] + 1)
