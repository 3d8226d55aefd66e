"""Analytic studies: NumPy and SciPy only, and nothing of `tbsa`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable


def command(main: Callable[[], None]) -> None:
    """Run a command; with exit code 130 after Ctrl-C, and 1 where what it prints cannot be written,
    without a word where its reader has enough, as head has.  Python would find that only at its
    exit."""
    try:
        main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(130)
    except OSError as error:
        if not isinstance(error, BrokenPipeError):
            print(error, file=sys.stderr)
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        sys.exit(1)
