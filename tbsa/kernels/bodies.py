"""What all kernels of contacts know: the scalars of a scene, and the bodies' velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns
from tbsa.kernels.jit import inline


class Numbers(NamedTuple):
    """The scalars of a scene that its contacts need."""

    n: int  # tiles
    front: int  # held tiles that come first: loops over what moves begin after them
    width: float  # m
    h: float  # s, the substep
    substeps: int  # in a step
    mass: float  # kg
    inertia: float  # kg m^2
    im: float  # 1/kg, inverse mass
    ii: float  # 1/(kg m^2), inverse inertia
    per_mass: float  # 1/m^2, ii / im
    linear_damping: float  # 1/s
    angular_damping: float  # 1/s
    mu: float  # friction, tile-tile
    mu_wall: float
    e: float  # restitution, tile-tile
    e_wall: float
    threshold: float  # m/s, slower impacts are plastic
    tolerance: float  # m/s
    at_rest: float  # part of it that tiles at rest have
    passes: int
    keep_lists: int  # 1, or 0: find pairs and magnet pairs anew every step
    skip_converged: int  # 1, or 0: solve every row in every pass
    join_substeps: int  # 1, or 0: never a longer one than h
    skip_still: int  # 1, or 0: do every step; 0, too, where loads depend on time
    driven: int  # 0: nothing drives the tiles; 1, or 2 where loads may come on at any moment
    wall: int  # 0 none, 1 circle, 2 rectangle
    wall_x: float  # m, radius or half the width
    wall_y: float  # m, half the height


class Bodies(NamedTuple):
    """Velocities of the tiles and, last, of the ground, and what the solve notes of each."""

    vx: np.ndarray
    vy: np.ndarray
    w: np.ndarray
    mobile: np.ndarray  # 1.0, or 0.0 for held tiles and the ground
    startx: np.ndarray  # velocity at the start of the substep
    starty: np.ndarray
    startw: np.ndarray
    floorx: np.ndarray  # floor impulse of this substep
    floory: np.ndarray
    floort: np.ndarray
    change: np.ndarray  # by which the floor changed the velocity
    moved: np.ndarray  # int64, scratch: whether something has moved it
    stirred: np.ndarray  # int64, scratch: a list of those that it has moved


def empty_bodies(n: int) -> Bodies:
    """Bodies of `n` tiles and the ground."""
    whole = {"moved", "stirred"}
    return Bodies(*columns(n + 2, [int if f in whole else float for f in Bodies._fields]))


@inline
def with_substep(k: Numbers, h: float) -> Numbers:
    """The numbers of a scene with another substep.

    What a solve leaves is a velocity, and moves tiles into each other for as long as the substep
    is: the tolerance of a longer one is less.
    """
    return Numbers(k.n, k.front, k.width, h, k.substeps, k.mass, k.inertia, k.im, k.ii, k.per_mass,
                   k.linear_damping, k.angular_damping, k.mu, k.mu_wall, k.e, k.e_wall, k.threshold,
                   min(k.h / h, 1.0) * k.tolerance, k.at_rest, k.passes, k.keep_lists,
                   k.skip_converged, k.join_substeps, k.skip_still, k.driven, k.wall, k.wall_x,
                   k.wall_y)
