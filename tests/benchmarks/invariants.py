"""What must hold in any scene: energy, overlap, walls, the friction cone, complementarity.

NumPy on the public arrays of a simulation; nothing here knows how the solver works.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from tbsa.model.scene import EDGE_ANGLE, Magnet, Material, Scene
from tbsa.model.squares import depth
from theory import magnets

Floats = NDArray[np.float64]


def law_of(magnet: Magnet, width: float = Material().width) -> magnets.Law:
    """The same magnets for theory, in tiles so wide (m)."""
    return magnets.Law(magnet.alpha, magnet.beta, width, magnet.inset, magnet.cutoff,
                       magnet.switch, float(magnet.mismatch))


class MagnetEnergy:
    """Potential energy of all magnets of a scene (J)."""

    def __init__(self, scene: Scene, glues: NDArray[np.int64]) -> None:
        magnet, width = scene.magnet, scene.material.width
        self.glues = glues.reshape(-1, 4)
        self.cutoff = magnet.cutoff if magnet is not None and glues.any() else 0.0
        if magnet is None or self.cutoff == 0.0:
            return
        self.offset, self.mismatch = 0.5 * width - magnet.inset, float(magnet.mismatch)
        law = law_of(magnet, width)
        r = np.linspace(0.0, magnet.cutoff, 4001)
        self.table = CubicSpline(r, [magnets.energy(each, law) for each in r])

    def __call__(self, x: Floats, y: Floats, angle: Floats) -> float:
        if self.cutoff == 0.0:
            return 0.0
        turn = angle[:, None] + 0.5 * math.pi * np.array([1, 0, -1, 2])  # N, E, S, W
        places = np.stack([x[:, None] + self.offset * np.cos(turn),
                           y[:, None] + self.offset * np.sin(turn)], axis=-1).reshape(-1, 2)
        pairs = cKDTree(places).query_pairs(self.cutoff, output_type="ndarray")
        pairs = pairs[pairs[:, 0] // 4 != pairs[:, 1] // 4]
        a, b = self.glues.ravel()[pairs].T
        p = np.where((a == 0) | (b == 0), 0.0, np.where(a == -b, 1.0, self.mismatch))
        r = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T)
        return float(p @ self.table(r))


def glues_of(scene: Scene, kinds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Labels of every tile's N, E, S and W edge, shape (n, 4)."""
    return np.array([scene.types[k].glues for k in kinds], np.int64).reshape(-1, 4)


def drive_loads(scene: Scene, kinds: NDArray[np.int64], time: float,
                angle: Floats) -> tuple[Floats, Floats, Floats]:
    """Forces (N) and torque (N m) of the drive on every tile, as the paper defines them."""
    drive, n = scene.drive, angle.size
    if drive is None:
        return np.zeros(n), np.zeros(n), np.zeros(n)
    if drive.kind == "constant":
        assert isinstance(drive.force, tuple)
        return np.full(n, drive.force[0]), np.full(n, drive.force[1]), np.full(n, drive.torque)
    phase = 2.0 * math.pi * drive.frequency * time
    if drive.kind == "shaking":
        assert isinstance(drive.force, float)
        return (np.full(n, drive.force * math.sin(phase)),
                np.full(n, drive.force * math.cos(phase)), np.zeros(n))
    if drive.kind != "unicycle":
        raise ValueError(f"the work of a drive of kind {drive.kind} is not known")
    assert isinstance(drive.force, float)
    family = np.array([scene.types[k].family for k in kinds], float)
    forward = np.array([EDGE_ANGLE[scene.types[k].forward] for k in kinds])
    push = family * math.sin(phase)
    return (push * drive.force * np.cos(angle + forward),
            push * drive.force * np.sin(angle + forward), push * drive.torque)


def touching(x: Floats, y: Floats, width: float, margin: float = 0.0) -> NDArray[np.int64]:
    """Pairs of tiles whose squares may be nearer than `margin` (m), shape (k, 2)."""
    return cKDTree(np.stack([x, y], axis=1)).query_pairs(
        math.sqrt(2.0) * width + margin, output_type="ndarray")


def deepest(x: Floats, y: Floats, angle: Floats, width: float,
            free: NDArray[np.bool_] | None = None) -> float:
    """Deepest overlap of two tiles, one of which is free (widths; 0 where none overlap)."""
    pairs = touching(x, y, width)
    if free is not None:
        pairs = pairs[free[pairs].any(axis=1)]
    if not pairs.size:
        return 0.0
    a, b = pairs.T
    return max(0.0, float(depth(width, x[b] - x[a], y[b] - y[a], angle[a], angle[b]).max()) / width)


def beyond_wall(scene: Scene, x: Floats, y: Floats, angle: Floats) -> float:
    """How far the farthest corner is beyond the wall (widths; 0 where all are inside)."""
    wall, half = scene.reactor, 0.5 * scene.material.width
    if wall is None:
        return 0.0
    c, s = np.cos(angle), np.sin(angle)
    if wall.shape == "circle":
        reach = np.hypot(np.abs(c * x + s * y) + half, np.abs(c * y - s * x) + half).max()
        out = float(reach) - wall.radius
    else:
        reach = half * (np.abs(c) + np.abs(s))
        out = max(float((np.abs(x) + reach).max()) - 0.5 * wall.width,
                  float((np.abs(y) + reach).max()) - 0.5 * wall.height)
    return max(0.0, out) / scene.material.width


def contact_residuals(simulation: Any) -> tuple[float, float]:
    """Worst excess of friction over its cone, and the mean gap under pressure.

    The first over the largest normal force: max(|friction| - mu normal)/max(normal).  The
    second is sum(normal gap)/(sum(normal) width) over pairs of tiles that press: where the
    tiles will be half a substep on, a contact that carries a force must be closed.
    """
    forces, scene = simulation.contact_forces(), simulation.scene
    n, width = simulation.x.size, scene.material.width
    normal = forces["normal0"] + np.where(forces["points"] == 2, forces["normal1"], 0.0)
    if not normal.size or normal.max() <= 0.0:
        return 0.0, 0.0
    walls = forces["b"] >= n
    mu = np.where(walls, scene.reactor.friction if scene.reactor else 0.0,
                  scene.material.friction)
    cone = float(np.maximum(np.abs(forces["friction"]) - mu * normal, 0.0).max() / normal.max())
    a, b = forces["a"][~walls], forces["b"][~walls]
    if not a.size:
        return cone, 0.0
    half = 0.5 * simulation.h / scene.solver.substeps
    x, y = simulation.x + half * simulation.vx, simulation.y + half * simulation.vy
    angle = simulation.angle + half * simulation.omega
    gap = np.abs(depth(width, x[b] - x[a], y[b] - y[a], angle[a], angle[b]))
    press = normal[~walls]
    return cone, float(press @ gap / (press.sum() * width))


@dataclass
class Watch:
    """Follows a simulation step by step and keeps the worst of every invariant.

    The energy gained is that of tiles and magnets less the work of the drive, which floor,
    damping and contacts can only lower; `energy` is its highest rise over any earlier value,
    as a part of `scale`: what was there and was put in by the drive, at least what it does over
    a tenth of a width (a tile that is pushed out of another one moves against it) and what all
    tiles have at a tenth of a width a second.
    """

    simulation: Any
    every: int = 1  # steps between looks at overlap, contacts and magnets
    overlap: float = 0.0  # widths
    outside: float = 0.0  # widths
    cone: float = 0.0
    gap: float = 0.0
    energy: float = 0.0
    finite: bool = True
    steps: int = 0
    depths: list[float] = field(default_factory=list)
    work: float = 0.0  # J, of the drive
    scale: float = 0.0  # J

    def __post_init__(self) -> None:
        s = self.simulation
        self.kinds, self.free = s.layout.type, ~s.layout.held
        self.magnets = MagnetEnergy(s.scene, glues_of(s.scene, self.kinds))
        self.least = self.balance()
        body = s.scene.material
        slow = 0.5 * self.free.size * body.mass * (0.1 * body.width) ** 2
        drive = s.scene.drive
        size = 0.0
        if drive is not None:
            size = math.hypot(*drive.force) if isinstance(drive.force, tuple) else drive.force
        pushed = 0.1 * body.width * size * int(self.free.sum())
        self.scale = max(s.kinetic_energy(), slow, pushed)

    def balance(self) -> float:
        """Energy of tiles and magnets less the drive's work so far (J)."""
        s = self.simulation
        return float(s.kinetic_energy() + self.magnets(s.x, s.y, s.angle) - self.work)

    def restart(self) -> None:
        """Forget the past: a bad start is over."""
        self.least, self.energy, self.overlap, self.outside = self.balance(), 0.0, 0.0, 0.0
        self.depths.clear()

    def advance(self, steps: int) -> None:
        """Advance, and look."""
        s = self.simulation
        for _ in range(steps):
            x, y, angle = s.x.copy(), s.y.copy(), s.angle.copy()
            time = s.time
            s.advance(1)
            self.steps += 1
            middle = 0.5 * (angle + s.angle)
            fx, fy, torque = drive_loads(s.scene, self.kinds, time + 0.5 * s.h, middle)
            powers = fx * (s.x - x) + fy * (s.y - y) + torque * (s.angle - angle)
            self.work += float(powers[self.free].sum())
            self.scale += float(np.abs(powers[self.free]).sum())
            if self.steps % self.every == 0:
                self.look()

    def look(self) -> None:
        """Take all invariants as they are now."""
        s, scene = self.simulation, self.simulation.scene
        self.finite = self.finite and bool(
            np.isfinite([s.x, s.y, s.angle, s.vx, s.vy, s.omega]).all())
        if not self.finite:
            return
        depth_now = deepest(s.x, s.y, s.angle, scene.material.width, self.free)
        self.depths.append(depth_now)
        self.overlap = max(self.overlap, depth_now)
        self.outside = max(self.outside, beyond_wall(scene, s.x, s.y, s.angle))
        cone, gap = contact_residuals(s)
        self.cone, self.gap = max(self.cone, cone), max(self.gap, gap)
        now = self.balance()
        self.scale = max(self.scale, s.kinetic_energy())
        self.energy = max(self.energy, (now - self.least) / self.scale)
        self.least = min(self.least, now)
