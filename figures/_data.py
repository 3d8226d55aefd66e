"""Where the data are that the figures read."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

ROOT = Path(__file__).parents[1]
# Tables, and a few records, of campaigns; `python -m paper_runs.keep` puts them there.
CAMPAIGN = ROOT / "paper_runs" / "data" / "campaign"
CALIBRATION = ROOT / "paper_runs" / "data" / "calibration"
DRIVES = {"self-stabilizing": "self-stabilizing", "shaking": "shaking"}  # group: label


def done(folder: Path) -> pd.DataFrame:
    """The rows of a campaign's table whose runs are done."""
    table = pd.read_csv(folder / "table.csv")
    return table[table["status"] == "done"]
