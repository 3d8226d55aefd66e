"""A run as a page that any browser opens: play it, turn it back, look closer, follow a tile.

One file, `viewer.html` with the records in it; nothing is fetched from anywhere, so that it can be
mailed, or put beside a paper.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_hex

from tbsa.model.records import Records, check_is_run, write_atomically
from tbsa.model.scene import EDGES
from tbsa.model.squares import lattice
from tbsa.work import draw as pictures
from tbsa.work.draw import CM, MARKS, target
from tbsa.work.metrics import EDGE_ANGLE, assembly, truth_of

# Bits of a tile's state, and how its marks look: rings with so many corners, or a cross.
ATTACHED, SEED = 1, 2
MARK_BITS = {"error": (4, 0), "wrongly turned": (8, 32), "off the lattice": (16, 4),
             "outside the pattern": (32, 3)}


def view(records: Records, path: str | Path, *, begin: float | None = None,
         end: float | None = None, every: int = 1) -> int:
    """Write the page of a run; returns the number of records in it.

    Places are kept to 1/65535 of the picture's side, angles to 1/65536 of a turn: 7 bytes a tile
    and record, with what it is marked as, which are 9.3 letters of the page.

    Parameters
    ----------
    records
        Of :func:`tbsa.model.records.read_run`.
    path
        A file ending in ``.html``; replaced in one go.
    begin, end, every
        As in :func:`tbsa.work.movie.movie`.

    Raises
    ------
    InputError
        As :func:`tbsa.work.movie.movie`.
    TypeError
        Where `records` are none of a run.
    """
    check_is_run(records)
    path = target(path, (".html",))
    which = records.chosen(begin, end, every)
    page = files("tbsa.work").joinpath("viewer.html").read_text(encoding="utf-8")
    head, tail = page.split("__DATA__")
    head = head.replace("__TITLE__", html.escape(records.scene.title or "A run"))
    # A title could end the script, or begin a comment in it.
    data = json.dumps(_data(records, which), separators=(",", ":")).replace("<", "\\u003c")
    write_atomically(path, "".join([head, data, tail]).encode())
    return len(which)


def _data(records: Records, which: Sequence[int]) -> dict[str, Any]:
    """What the page shows, as `viewer.html` takes it (SI units)."""
    scene, layout, wall = records.scene, records.layout, records.scene.reactor
    x, y, angle = (np.asarray(each[list(which)]) for each in (records.x, records.y, records.angle))
    truth = truth_of(scene)
    found = [assembly(scene, layout, x[k], y[k], angle[k], truth) for k in range(len(which))]
    low, high = (np.array(side) / CM for side in pictures.extent(scene, x, y))
    span = float(max(high - low))
    turn = np.floor(angle * (65536 / (2.0 * np.pi)) + 0.5)
    poses = np.stack([np.rint((x - low[0]) / span * 65535).clip(0, 65535),
                      np.rint((y - low[1]) / span * 65535).clip(0, 65535), turn % 65536], axis=-1)
    error, turned, off, outside = (bit for bit, _ in MARK_BITS.values())
    states = np.array([
        ATTACHED * each.attached + SEED * each.seed + error * each.erroneous
        + turned * each.wrongly_turned + off * each.off_lattice + outside * each.outside
        for each in found])
    colour = pictures.colours(scene)
    shown = {"colour": colour, "faded": pictures.faded(colour)}
    ink = {"ink": pictures.ink(colour), "faded_ink": pictures.ink(shown["faded"])}
    sites: list[Any] = [[]] * len(found)
    if scene.seed is not None:
        sites = [np.stack(lattice(scene.seed, scene.material.width, *each.hole_sites.T), axis=-1)
                 .tolist() for each in found]
    return {
        "title": scene.title or "A run", "width": scene.material.width,
        "time": [float(each) for each in records.time[list(which)]],
        "types": [{"name": kind.name, "family": kind.family,
                   "forward": float(EDGE_ANGLE[EDGES.index(kind.forward)]),
                   **{name: to_hex(tuple(each[k])) for name, each in (shown | ink).items()}}
                  for k, kind in enumerate(scene.types)],
        "type": layout.type.tolist(), "held": layout.held.astype(int).tolist(),
        "wall": None if wall is None else {
            "radius": wall.radius, "width": wall.width, "height": wall.height},
        "floor": pictures.FLOOR, "hole": MARKS["hole"][0],
        "marks": [{"bit": bit, "colour": MARKS[name][0], "corners": corners}
                  for name, (bit, corners) in MARK_BITS.items()],
        "low": low.tolist(), "high": high.tolist(), "span": span,
        "poses": base64.b64encode(poses.astype("<u2").tobytes()).decode(),
        "states": base64.b64encode(states.astype(np.uint8).tobytes()).decode(),
        "seeded": scene.seed is not None, "turned": scene.seed.angle if scene.seed else 0.0,
        "sites": sites, "size": [each.size for each in found],
        "errors": [int(each.errors) for each in found],
        "holes": [int(each.holes) for each in found],
    }
