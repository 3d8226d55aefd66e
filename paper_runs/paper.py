"""What the paper reports (Section V, Results), and how exactly.

A printed number stands for a range of values: one that ours must lie in for the figure to be
reached.  Per cent are given to the half ("0", "0.5", "1.5 %"), read off averaged curves, so that
each stands for a quarter more or less.  "Approximately 35 tiles" is 30 to 40.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from paper_runs.intervals import Estimate

SELF, SHAKING = "self-stabilizing", "shaking"  # groups of campaign.toml
SCENES = {"self_stabilizing.toml": SELF, "shaking.toml": SHAKING}
RUNS, DURATION = 36, 3600.0  # of each drive; s
# The gain over the last third (per cent of the size) beyond which an assembly of either drive
# counts as growing, and up to which as at its limit.  The paper shows curves; the number is ours.
STEADY = 10.0
ENOUGH = 5  # runs; of fewer the scatter itself is unknown, and no figure counts as met or missed


class Figure(NamedTuple):
    """One figure of merit: as printed, its number, and the range that it stands for.

    A range that is open to one side is what lies above or below its other end, without this.
    """

    text: str
    value: float
    low: float
    high: float

    def verdict(self, ours: Estimate) -> str:
        """"reached" if our interval lies inside the range, "not reached" if outside; "open" if it
        reaches across, and of fewer than `ENOUGH` runs."""
        if math.isnan(ours.value):
            return "no data"
        where = "inside" if self._holds(ours.value) else "outside"
        if ours.n < ENOUGH:
            return f"open, {ours.n} {'runs' if ours.n > 1 else 'run'} only, our mean is {where}"
        if math.isnan(ours.low):
            return f"open, there is no interval, our mean is {where}"
        if self._holds(ours.low) and self._holds(ours.high):
            return "reached"
        if ours.high < self.low or ours.low > self.high or (
                ours.low == ours.high and not self._holds(ours.low)):
            return "not reached"
        if math.isinf(ours.high):
            return "open, the interval is unbounded"
        return f"open, our mean is {where}"

    def _holds(self, value: float) -> bool:
        """Whether a value lies in the range."""
        beyond = (value == self.low and math.isinf(self.high)) or (
            value == self.high and math.isinf(self.low))
        return self.low <= value <= self.high and not beyond


END = {  # at 3600 s, by drive and column of the tables
    SELF: {"size": Figure("more than 130", 130.0, 130.0, math.inf),
           "errors": Figure("0 %", 0.0, 0.0, 0.25),
           "holes": Figure("1.5 %", 1.5, 1.25, 1.75)},
    SHAKING: {"size": Figure("about 35", 35.0, 30.0, 40.0),
              "errors": Figure("0.5 %", 0.5, 0.25, 0.75),
              "holes": Figure("0 %", 0.0, 0.0, 0.25)},
}
# Of the gain over the last third, and of what it is less that of the second.
GROWING = Figure("did not reach its limit", math.nan, STEADY, math.inf)
SATURATED = Figure("reaches a limit", 0.0, -STEADY, STEADY)
SLOWING = Figure("at a decreasing rate", math.nan, -math.inf, 0.0)
MORE = Figure("more than shaking", math.nan, 0.0, math.inf)
LESS = Figure("less than shaking", math.nan, -math.inf, 0.0)
