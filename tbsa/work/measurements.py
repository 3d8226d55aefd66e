"""Force-distance measurements from a CSV file, and numbers with units."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from tbsa.errors import InputError
from tbsa.model.scene import read_text

Floats = NDArray[np.float64]

LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "um": 1e-6}
FORCES = {"N": 1.0, "mN": 1e-3, "g": 9.80665e-3, "gf": 9.80665e-3, "kgf": 9.80665}
"""g and gf: the weight of a gram."""
MICRO = {0xB5: "u", 0x3BC: "u"}  # the micro sign, and the Greek letter that looks like it
UNITS: dict[str, dict[str, float]] = {  # of a quantity, by its SI unit
    "m": LENGTHS, "N": FORCES, "T": {"T": 1.0, "mT": 1e-3},
    "N m^2": {"Nm2": 1.0, "Ncm2": 1e-4, "Nmm2": 1e-6}, "": {"": 1.0}}
COLUMNS = {"gap": "gap", "centre": "centre", "center": "centre", "distance": "distance",
           "force": "force", "sd": "sd", "sigma": "sd", "uncertainty": "sd"}
HEADER = ("must be a header like  gap (mm),force (N),sd (N)  with gap, centre or distance in "
          f"{', '.join(LENGTHS)}, force and perhaps sd in {', '.join(FORCES)}")
LEAST = 3  # points, at as many distances
MOST = 10_000
SMALLEST = 1e-12  # N, of a mean force and of an uncertainty


class Measurements(NamedTuple):
    """Forces against distances, SI."""

    file: str
    kind: str  # "gap" | "centre" | "distance", as the header says
    unit: str  # of the distances in the file
    distance: Floats
    force: Floats
    sd: Floats | None


def read(path: str | Path) -> Measurements:
    """Read force-distance measurements.

    The first line that is neither empty nor begins with ``#`` is the header: a column ``gap``,
    ``centre`` or ``distance`` in one of `LENGTHS`, one ``force`` in one of `FORCES`, and perhaps
    one ``sd`` (standard deviation) in a unit of force; the unit is in brackets or after an
    underscore, ``gap (mm)`` or ``gap_mm``.  Lines of commas only count as empty, and columns at the
    end that have neither title nor values, as spreadsheets write them, are left out.

    Raises
    ------
    InputError
        For anything else; it names the line, the column, the value and what is allowed.
    """
    file = str(path)
    text = read_text(path, "CSV")
    if "\0" in text:
        raise InputError("must be a CSV file: it holds a NUL, so it is not text", file=file)
    rows = list(_rows(text, file))
    if not rows:
        raise InputError(f"is empty; {HEADER}", file=file)
    number, head = rows[0]
    padding = 0  # columns without a title that spreadsheets leave at the end
    while padding < len(head) - 1 and not head[-1 - padding]:
        padding += 1
    columns = _header(head[:len(head) - padding], file, f"line {number}")
    values: dict[str, list[float]] = {name: [] for name, _, _ in columns}
    for number, row in rows[1:]:
        line = f"line {number}"
        if padding and len(row) == len(head) and not any(row[-padding:]):
            row = row[:-padding]
        if len(row) != len(columns):
            many = len(row) > len(columns) or any(";" in cell for cell in row)
            hint = "; use a decimal point and commas" if many else ""
            raise InputError(f"must have {len(columns)} values, as the header has columns; it has "
                             f"{len(row)}{hint}", file=file, field=line)
        for (name, unit, scale), cell in zip(columns, row, strict=True):
            values[name].append(_value(name, cell, unit, scale, file, line))
    data = {name: np.array(column) for name, column in values.items()}
    kind, unit = next((name, unit) for name, unit, _ in columns if unit in LENGTHS)
    measured = Measurements(file, kind, unit, data[kind], data["force"], data.get("sd"))
    _judge(measured)
    return measured


def _rows(text: str, file: str) -> Iterable[tuple[int, list[str]]]:
    """Line number and cells of every line that holds something."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                (cells,) = csv.reader([line], strict=True, skipinitialspace=True)
            except csv.Error as error:
                raise InputError(f"must be comma-separated values: {error}", file=file,
                                 field=f"line {number}", value=line) from None
            if any(stripped := [cell.strip() for cell in cells]):  # not only commas
                yield number, stripped


def _header(head: Sequence[str], file: str, line: str) -> list[tuple[str, str, float]]:
    """Name, unit and size of the unit of every column."""

    def fail(value: str, message: str) -> NoReturn:
        raise InputError(message, file=file, field=line, value=value)

    columns: list[tuple[str, str, float]] = []
    if len(head) == 1 and (";" in head[0] or "\t" in head[0]):
        fail(head[0], "must be separated by commas, with decimal points")
    for title in head:
        match = re.fullmatch(r"(?P<name>[A-Za-z]+)(?: distance)?"
                             r"(?:\s*\((?P<a>[^()]*)\)|\s*\[(?P<b>[^\[\]]*)\]|_(?P<c>\w+))?", title)
        name = COLUMNS.get(match["name"].lower()) if match else None
        if match is None or name is None:
            fail(title, HEADER)
        units = FORCES if name in ("force", "sd") else LENGTHS
        unit = (match["a"] or match["b"] or match["c"] or "").strip().translate(MICRO)
        if unit not in units:
            fail(title, f"must have its unit, one of {', '.join(units)}, such as "
                 f"{name} ({next(iter(units))})")
        if any(name == other for other, _, _ in columns):
            fail(title, f"must be the only column of {name}")
        columns.append((name, unit, units[unit]))
    names = [name for name, _, _ in columns]
    if sum(name in ("gap", "centre", "distance") for name in names) != 1 or "force" not in names:
        fail(",".join(head), HEADER)
    return columns


def _value(name: str, cell: str, unit: str, scale: float, file: str, line: str) -> float:
    """A cell as SI, within what its column allows."""
    high = 1e6 if name in ("force", "sd") else 10.0
    low = {"force": -high, "sd": SMALLEST}.get(name, 0.0)
    what = f"must be a number from {low / scale:g} to {high / scale:g} {unit}"
    try:
        value = float(cell) * scale if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise InputError(what, file=file, field=f"{line}, {name}", value=cell)
    return value


def _judge(measured: Measurements) -> None:
    """What the columns must hold as a whole."""
    file, d = measured.file, measured.distance
    if d.size > MOST:
        raise InputError(f"points; must be at most {MOST}: give means and their uncertainties",
                         file=file, field="rows", value=d.size)
    if d.size < LEAST:
        raise InputError(f"points; must be at least {LEAST}, to fit two parameters", file=file,
                         field="rows", value=d.size)
    if (different := np.unique(d).size) < LEAST:
        raise InputError(f"different values; must be at least {LEAST}", file=file,
                         field=measured.kind, value=different)


def must_fall(measured: Measurements) -> None:
    """That the forces are those of two magnets: not negative on the whole, and less further off.

    By ranks and medians or by sizes, whichever says so.

    Raises
    ------
    InputError
        Where they are not.
    """
    file, force = measured.file, measured.force
    if np.ptp(force) == 0:
        raise InputError("N at every distance; must fall with the distance", file=file,
                         field="force", value=float(force[0]))
    # Either will do: one wrong point spoils the mean, a far field of zeros the median.
    middle = max(float(np.median(force)), float(np.mean(force)))
    if middle < SMALLEST:
        raise InputError(f"N in mean and median; must be at least {SMALLEST:g} N: give sizes of "
                         "forces, without sign",
                         file=file, field="force", value=float(f"{middle:.4g}"))
    ranks = float(spearmanr(measured.distance, force).statistic)
    slope = float(np.polyfit(measured.distance / np.ptp(measured.distance), force, 1)[0])
    if ranks >= 0 and slope >= 0:
        raise InputError("is the correlation of the ranks of distances and forces; must be "
                         "negative: forces must fall with the distance",
                         file=file, field="force", value=float(f"{ranks:.3g}"))


def quantity(text: str, unit: str, field: str) -> float:
    """A number with its unit, such as ``1.5mm``, in SI; 0 needs none.

    Raises
    ------
    InputError
        Where it is not a finite number with a unit of that kind.
    """
    units = UNITS[unit]
    match = re.fullmatch(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    try:
        number = float(match[1]) if match else math.nan
    except ValueError:
        number = math.nan
    name = match[2].translate(MICRO) if match else ""
    if not math.isfinite(number) or (name not in units and not (number == 0 and name == "")):
        allowed = f"a number with its unit, {', '.join(units)}" if unit else "a number"
        raise InputError(f"must be {allowed}", field=field, value=text)
    return number * units.get(name, 1.0)
