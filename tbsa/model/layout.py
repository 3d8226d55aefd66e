"""Where every tile of a scene is at time zero."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tbsa.errors import InputError
from tbsa.model.scene import Reactor, Scene, check_is_scene
from tbsa.model.squares import Floats, Integers, area, depth, inside, lattice, near

TRIALS = 1_000_000, 300
"""Random positions tried before giving up: a number, and so many more for each tile."""
CROWD = 4096
"""So many random tiles are numbered along a curve that keeps neighbours together: scattered over
memory, 100,000 tiles took twice as long a step."""


KINDS_OF = {"fiu": "numbers", "iu": "whole numbers", "b": "truth values"}


@dataclass(frozen=True)
class Layout:
    """All tiles of a scene at time zero; the arrays have one entry a tile.

    Order: the cells of the seed, the tiles placed explicitly, the ones placed at random in
    the order of ``scene.free.counts`` (more than `CROWD`: by their place).
    """

    x: Floats  # m
    y: Floats  # m
    angle: Floats  # rad
    vx: Floats  # m/s
    vy: Floats  # m/s
    omega: Floats  # rad/s
    type: Integers  # index into scene.types
    held: NDArray[np.bool_]  # never moves
    seed: NDArray[np.bool_]  # belongs to the seed


def check(layout: Layout, scene: Scene) -> None:
    """That the arrays of a layout belong together, and to a scene.

    Raises
    ------
    InputError
        Where one has another length or kind, a place or velocity is not finite, an angle is beyond
        `TURNED`, a type is none of the scene's, or there is no tile.
    TypeError
        Where they are no layout and no scene.
    """
    check_is_scene(scene)
    if not isinstance(layout, Layout):
        raise TypeError(f"layout must be a Layout, not {type(layout).__name__}")
    n = np.size(layout.x)
    if n == 0:
        raise InputError("must hold at least one tile", field="layout")
    for name in (each.name for each in fields(Layout)):
        values = getattr(layout, name)
        kinds = {"type": "iu", "held": "b", "seed": "b"}.get(name, "fiu")
        if not (isinstance(values, np.ndarray) and values.shape == (n,)
                and values.dtype.kind in kinds):
            raise InputError(f"must be an array of {n} {KINDS_OF[kinds]}", field=f"layout.{name}",
                             value=f"{getattr(values, 'dtype', type(values).__name__)} of shape "
                                   f"{np.shape(values)}")
        if "f" in kinds and not np.isfinite(values).all():
            raise InputError("must be finite numbers", field=f"layout.{name}",
                             value=values[~np.isfinite(values)][0])
    if (far := np.abs(layout.angle) > TURNED).any():
        raise InputError(f"must be from {-TURNED:g} to {TURNED:g} rad", field="layout.angle",
                         value=layout.angle[far][0])
    wrong = (layout.type < 0) | (layout.type >= len(scene.types))
    if wrong.any():
        raise InputError(f"must be from 0 to {len(scene.types) - 1}, of the scene's types",
                         field="layout.type", value=layout.type[wrong][0])


TURNED = 1e9
"""Angle (rad) up to which the direction that a number stands for is known to 1e-7."""
DEEPEST = 0.75
"""Overlap of two tiles (widths) beyond which it is no longer told on which side of each other they
are: a solver that moves them apart takes any."""


def check_start(layout: Layout, scene: Scene) -> None:
    """That a layout is one to begin with, be it with overlaps.

    A centre beyond the wall, or a tile in the place of another, is a mistake.

    Raises
    ------
    InputError
        See :func:`check`; or a tile is where none can be.
    """
    check(layout, scene)
    x, y, angle = layout.x, layout.y, layout.angle
    out = ~inside(scene.reactor, 0.0, x, y, angle)
    if out.any():
        k = int(np.flatnonzero(out)[0])
        raise InputError(f"of tile {k} must lie inside the reactor", field="layout.x, layout.y",
                         value=(float(x[k]), float(y[k])))
    width = scene.material.width
    i, j = near(x, y, x, y, width)
    i, j = i[i < j], j[i < j]
    deep = depth(width, x[j] - x[i], y[j] - y[i], angle[i], angle[j]) > DEEPEST * width
    if deep.any():
        k = int(np.flatnonzero(deep)[0])
        raise InputError(f"of tiles {i[k]} and {j[k]} are all but one: they overlap by more than "
                         f"{DEEPEST:g} widths", field="layout.x, layout.y",
                         value=(float(x[i[k]]), float(y[i[k]])))


def stream(seed: int, name: str) -> np.random.Generator:
    """Random numbers of their own for each name, so that no use of them shifts another's."""
    key = np.frombuffer(hashlib.sha256(name.encode()).digest(), "<u4")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(map(int, key))))


def initial_layout(scene: Scene) -> Layout:
    """Place the tiles of a scene.

    Random tiles take uniform positions in the reactor and uniform angles, one after another
    and each where it overlaps none before it (random sequential placement); the types are
    shuffled over that sequence, so that no type gets only the gaps that were left.

    Parameters
    ----------
    scene
        A validated scene; the random numbers are the stream "layout" of ``scene.run.seed``.

    Raises
    ------
    InputError
        When the random tiles do not fit: at once if their area exceeds the free area, else
        after `TRIALS` random positions.
    TypeError
        Where it is no scene.
    """
    check_is_scene(scene)
    index = {tile_type.name: i for i, tile_type in enumerate(scene.types)}
    cells = scene.seed.cells if scene.seed else ()
    tiles = scene.free.tiles
    kinds = [index[name] for _, _, name in cells] + [index[tile.type] for tile in tiles]
    kinds += [index[name] for name, number in scene.free.counts for _ in range(number)]
    placed, total = len(cells) + len(tiles), len(kinds)

    x, y, angle, vx, vy, omega = np.zeros((6, total))
    held, seed = np.zeros((2, total), np.bool_)
    if scene.seed is not None:
        at = slice(len(cells))
        x[at], y[at] = lattice(
            scene.seed, scene.material.width, [c[0] for c in cells], [c[1] for c in cells])
        angle[at], held[at], seed[at] = scene.seed.angle, True, True
    for i, tile in enumerate(tiles, len(cells)):
        (x[i], y[i]), angle[i], (vx[i], vy[i]) = tile.position, tile.angle, tile.velocity
        omega[i], held[i] = tile.spin, tile.held
    if total > placed:
        numbers = stream(scene.run.seed, "layout")
        sequence = placed + numbers.permutation(total - placed)
        x[sequence], y[sequence], angle[sequence] = _place(
            scene, numbers, total - placed, x[:placed], y[:placed], angle[:placed])
    layout = Layout(x, y, angle, vx, vy, omega, np.array(kinds, np.int64), held, seed)
    if total - placed > CROWD:
        order = np.arange(total)
        order[placed:] = placed + _along_curve(x[placed:], y[placed:], 2.0 * scene.material.width)
        layout = Layout(*(getattr(layout, each.name)[order] for each in fields(Layout)))
    return layout


def _along_curve(x: Floats, y: Floats, cell: float) -> NDArray[np.int64]:
    """Order of points along a Z-curve through square cells: near points, near numbers."""
    key = np.zeros(len(x), np.int64)
    for shift, place in enumerate((x, y)):
        number = ((place - place.min()) / cell).astype(np.int64)
        for bit in range(20):
            key |= (number >> bit & 1) << (2 * bit + shift)
    return np.argsort(key, kind="stable")


def _place(
    scene: Scene, numbers: np.random.Generator, wanted: int, x: Floats, y: Floats, angle: Floats
) -> tuple[Floats, Floats, Floats]:
    """Random sequential placement of `wanted` squares beside those at `x`, `y`, `angle`.

    Batches of random positions are tested at once but accepted in their order, and each takes
    three random numbers: the size of a batch makes no difference but to time.  It is no less than
    the number of tiles that are sorted for it.
    """
    reactor, width, before = scene.reactor, scene.material.width, len(x)
    assert reactor is not None  # the scene is validated
    room = area(reactor) / width**2
    if wanted + before > room:
        raise _too_many(scene, wanted, f"they and the others would cover "
                        f"{(wanted + before) / room:.2f} of it; the area left is that of "
                        f"{math.floor(room - before)} tiles, and random placement ends near 0.5")
    reach = math.sqrt(2) * width
    left = TRIALS[0] + TRIALS[1] * wanted
    while len(x) < before + wanted:
        if left <= 0:
            raise _too_many(scene, wanted, f"{len(x) - before} found a place at random without "
                            f"overlap; the tiles would cover {(wanted + before) / room:.2f} of "
                            "the reactor, and random placement ends near 0.5, or earlier where "
                            "walls leave tiles no room to turn")
        batch = min(max(2 * (before + wanted - len(x)), len(x), 256), 65536, left)
        left -= batch
        u, v, turn = numbers.random((batch, 3)).T
        p, q = _point(reactor, u, v)
        turn = 2 * math.pi * turn
        fits = inside(reactor, width, p, q, turn, tolerance=0.0)
        p, q, turn = p[fits], q[fits], turn[fits]
        i, j = near(p, q, x, y, reach)
        fits = np.ones(len(p), np.bool_)
        fits[i[depth(width, x[j] - p[i], y[j] - q[i], turn[i], angle[j]) > 0]] = False
        p, q, turn = p[fits], q[fits], turn[fits]
        i, j = near(p, q, p, q, reach)
        i, j = i[j < i], j[j < i]
        clash = depth(width, p[j] - p[i], q[j] - q[i], turn[i], turn[j]) > 0
        accepted = [True] * len(p)
        for later, earlier in zip(i[clash].tolist(), j[clash].tolist(), strict=True):
            if accepted[earlier]:  # final, since the pairs are sorted by the later one
                accepted[later] = False
        keep = np.flatnonzero(accepted)[:before + wanted - len(x)]
        x, y, angle = np.append(x, p[keep]), np.append(y, q[keep]), np.append(angle, turn[keep])
    return x[before:], y[before:], angle[before:]


def _point(reactor: Reactor, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Uniform points in the reactor from uniform numbers in [0, 1)."""
    if reactor.shape == "circle":
        r, phi = reactor.radius * np.sqrt(u), 2 * math.pi * v
        return r * np.cos(phi), r * np.sin(phi)
    return reactor.width * (u - 0.5), reactor.height * (v - 0.5)


def _too_many(scene: Scene, wanted: int, reason: str) -> InputError:
    return InputError(f"random tiles must fit into the reactor: {reason}",
                      file=scene.file or None, field="free", value=wanted)
