"""The one exception that bad input raises."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Any
from unicodedata import category


def at_most(bound: float, digits: int = 6) -> str:
    """A bound in so many digits, rounded down: who types what is shown is let in."""
    return f"{float(Context(digits, ROUND_FLOOR).create_decimal_from_float(bound)):g}"


def at_least(bound: float, digits: int = 6) -> str:
    """The same of a lower bound, rounded up."""
    return f"{float(Context(digits, ROUND_CEILING).create_decimal_from_float(bound)):g}"


class InputError(ValueError):
    """Bad input: one sentence that names the file, the field, the value and what is allowed.

    Parameters
    ----------
    message
        What is wrong and what is allowed, e.g. ``"must be a positive number (m)"``.
    file
        The file that the value was read from, if any.
    field
        The dotted name of the field, e.g. ``"tiles.type[1].glues"``, if any.
    value
        The offending value; left out of the sentence when it is not given.
    """

    _absent = object()

    def __init__(
        self,
        message: str,
        *,
        file: str | None = None,
        field: str | None = None,
        value: Any = _absent,
    ) -> None:
        self.message, self.file, self.field = message, file, field
        if value is not self._absent:
            self.value = value
        where = ": ".join(part for part in (file, field) if part)
        what = message if value is self._absent else f"{_short(value)} {message}"
        # One line, whatever a key of the file or another library's message may hold.
        lines = (f"{where}: {what}" if where else what).splitlines()
        super().__init__(printable("\\n".join(lines)))

    def of(self, file: str | None, field: str | None = None) -> InputError:
        """The same error, of another file and perhaps of another field."""
        value = {"value": self.value} if hasattr(self, "value") else {}
        return InputError(self.message, file=file, field=field or self.field, **value)

    @property
    def without_file(self) -> str:
        """The sentence without the file's name, which differs between machines."""
        return str(self).removeprefix(f"{printable(self.file)}: ") if self.file else str(self)


def printable(text: str) -> str:
    """One line of text with its control characters escaped, which a terminal would obey."""
    return "".join(ascii(each)[1:-1] if category(each) == "Cc" else each for each in text)


def _short(value: Any) -> str:
    try:
        # A number of NumPy's as the number that it is.
        text = repr(value.item() if getattr(value, "ndim", 1) == 0 else value)
    except ValueError:  # an integer of more digits than Python prints
        text = "a number of thousands of digits"
    return text if len(text) <= 80 else text[:77] + "..."
