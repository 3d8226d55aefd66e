"""Force between two aligned magnets against their distance (the paper's figure of that name)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from figures.style import BLUE, GREY, ORANGE, figure
from theory.magnets import Law, force

DATA: tuple[str, ...] = ()
FITTED = Law()  # alpha = 0.18 N cm^2, beta = 0.64 cm
PRINTED = Law(alpha=0.18, beta=0.64)  # the same numbers in N m^2 and m, as printed
OURS = Law(cutoff=0.03, switch=0.1)  # as simulated: gone at one tile width


def make() -> Figure:
    """The fit in units that can be and in those printed, and where the simulator cuts it off."""
    contact, width = 2 * FITTED.inset, FITTED.width
    r = np.linspace(0.0, 0.04, 801)
    fig = figure(2.35)
    ax = fig.add_subplot()
    fade = 100 * (1 - OURS.switch) * OURS.cutoff, 100 * OURS.cutoff
    ax.axvspan(*fade, ymax=0.22, color="#e6e6e6", lw=0)
    for law, colour, dash in ((PRINTED, ORANGE, "--"), (FITTED, GREY, ":"), (OURS, BLUE, "-")):
        ax.plot(100 * r, [force(each, law) for each in r], color=colour, linestyle=dash)
    bond, apart = force(contact, FITTED), force(width, FITTED)
    ax.plot([100 * contact], [bond], "o", color=BLUE, markersize=3.5)
    for text, x, y, colour in (
            ("as printed: 0.18 N m$^2$, 0.64 m", 1.3, 0.44, ORANGE),
            (f"tiles in contact: {bond:.4f} N", 0.45, bond + 0.012, BLUE),
            ("0.18 N cm$^2$, 0.64 cm", 0.85, 0.105, BLUE),
            (f"uncut {apart:.4f} N", 3.04, 0.022, "#606060"),
            ("switched off", 2.58, 0.125, "#606060")):
        ax.text(x, y, text, color=colour, fontsize=7)
    ax.set(xlabel="distance of the magnets (cm)", ylabel="force (N)", xlim=(0, 4), ylim=(0, 0.5))
    ax.spines[["top", "right"]].set_visible(False)
    return fig
