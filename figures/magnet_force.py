"""Force between two aligned magnets against their distance (the paper's figure of that name)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from figures.style import BLUE, GREY, ORANGE, figure
from theory.magnets import Law, force
from theory.permanent import coaxial_cylinders

DATA: tuple[Path, ...] = ()
FITTED = Law()  # alpha = 0.18 N cm^2, beta = 0.64 cm
PRINTED = Law(alpha=0.18, beta=0.64)  # the same numbers in N m^2 and m, as printed
OURS = Law(cutoff=0.03, switch=0.1)  # as simulated: gone at one tile width
DIAMETERS = (0.002, 0.003, 0.004)  # m, of real magnets
POLARISATION = 1.3  # T, sintered neodymium


def make() -> Figure:
    """The paper's curve, the one in the printed units, and ideal cylinders of that size.

    Magnets whose faces are flush with the edges and whose centres lie 1.5 mm inside are 3 mm
    high.
    """
    height = contact = 2 * FITTED.inset
    r = np.linspace(contact, 0.04, 741)
    fig = figure(2.9)
    ax = fig.add_subplot()
    for diameter in DIAMETERS:
        f = coaxial_cylinders(r, diameter / 2, height, POLARISATION)
        ax.plot(100 * r, f, color=GREY, lw=0.9)
        ax.annotate(f"{1000 * diameter:.0f}", (100 * contact, f[0]), (-2, 0), va="center",
                    ha="right", textcoords="offset points", color="#606060", fontsize=6.5)
    for law, colour, dash in ((PRINTED, ORANGE, "--"), (FITTED, BLUE, ":"), (OURS, BLUE, "-")):
        ax.plot(100 * r, [force(each, law) for each in r], color=colour, linestyle=dash)
    bond, apart = force(contact, FITTED), force(FITTED.width, FITTED)
    ax.plot([100 * contact], [bond], "o", color=BLUE, markersize=3.5)
    ax.annotate(f"tiles in contact: {bond:.4f} N", (100 * contact, bond), (1.2, bond), color=BLUE,
                fontsize=7, va="center", arrowprops={"arrowstyle": "-", "lw": 0.5, "color": BLUE})
    for text, x, y, colour, side in (
            ("as printed: 0.18 N m$^2$, 0.64 m", 3.95, 0.52, ORANGE, "right"),
            ("0.18 N cm$^2$, 0.64 cm", 1.5, 0.055, BLUE, "left"),
            (f"uncut {apart:.4f} N", 3.02, 0.0165, BLUE, "left"),
            ("cut off", 2.3, 0.0075, BLUE, "left"),
            (f"cylinders of {POLARISATION:g} T,\n{1000 * height:.0f} mm high, diameter in mm",
             0.75, 2.0, "#606060", "left")):
        ax.text(x, y, text, color=colour, fontsize=7, ha=side)
    ax.set(xlabel="distance of the magnets\N{RIGHT SINGLE QUOTATION MARK} centres (cm)",
           ylabel="force (N)", yscale="log", xlim=(0, 4), ylim=(1e-3, 10))
    ax.spines[["top", "right"]].set_visible(False)
    return fig
