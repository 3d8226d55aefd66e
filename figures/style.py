"""The look of all figures, and where they go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from tbsa.model.records import replacing

OUTPUT = Path(__file__).parent / "output"
COLUMN = 3.5  # in, the width of a column of the paper's journal
BLUE, ORANGE, GREY = "#0b5fa5", "#d9730d", "#7a7a7a"
LOOK: dict[str, Any] = {
    "font.size": 8, "axes.labelsize": 8, "xtick.labelsize": 7, "ytick.labelsize": 7,
    "legend.fontsize": 7, "legend.frameon": False, "lines.linewidth": 1.2,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "pdf.fonttype": 42, "savefig.dpi": 300,
}


def figure(height: float, width: float = COLUMN) -> Figure:
    """An empty figure (in) in the common look; to be filled inside :func:`look`."""
    return Figure(figsize=(width, height), layout="constrained")


def look() -> Any:
    """Context in which a figure is made and saved."""
    return matplotlib.rc_context(LOOK)


def save(figure: Figure, name: str) -> list[Path]:
    """Write a figure as PDF and PNG; returns the paths.  The same figure gives the same bytes,
    all of them or, where they cannot be written, those that were there."""
    OUTPUT.mkdir(exist_ok=True)
    paths = [OUTPUT / f"{name}.pdf", OUTPUT / f"{name}.png"]
    for path, metadata in zip(paths, ({"CreationDate": None}, {}), strict=True):
        with replacing(path, path.suffix) as scratch:
            figure.savefig(scratch, metadata=metadata)
    return paths
