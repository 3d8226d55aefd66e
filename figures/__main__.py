"""Make all figures whose data are there: python -m figures [NAME ...]."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

from figures._data import Missing
from figures.style import look, save
from tbsa.errors import InputError
from tbsa.work.cli import code_of

HERE = Path(__file__).parent
SCRIPTS = sorted(path.stem for path in HERE.glob("*.py")
                 if path.stem != "style" and not path.stem.startswith("_"))


def main(arguments: list[str]) -> int:
    """Make the figures of these names, or all; the others where the data of one do not serve.

    Returns 1 where they do not, or files of a named one are missing.
    """
    parser = argparse.ArgumentParser(prog="python -m figures", description=(
        "Make figures, as PDF and PNG in figures/output, from the data that are kept."))
    parser.add_argument("name", nargs="*", help=f"default: all; {', '.join(SCRIPTS)}")
    names = parser.parse_args(arguments).name
    if unknown := set(names) - set(SCRIPTS):
        print(f"there is no figure {', '.join(sorted(unknown))}; there are {', '.join(SCRIPTS)}",
              file=sys.stderr)
        return 2
    code = 0
    for name in names or SCRIPTS:
        script = import_module(f"figures.{name}")
        missing = [path for path in script.DATA if not path.exists()]
        if missing:
            print(f"{name}: left out, needs {_shown(missing)}")
            code = 1 if names else code
            continue
        with look():
            try:
                figure = script.make()
            except (Missing, InputError, OSError) as error:
                what = "" if isinstance(error, Missing) else "data that can be read: "
                print(f"{name}: left out, needs {what}{error}")
                code = 1
                continue
            try:
                paths = save(figure, name)
            except OSError as error:
                print(f"figures: {error}", file=sys.stderr)
                return 2
        print(f"{name}: {_shown(paths)}")
    return code


def _shown(paths: Iterable[Path]) -> str:
    """Paths as seen from the folder of the project."""
    root = HERE.parent
    return ", ".join(str(path.relative_to(root) if path.is_relative_to(root) else path)
                     for path in paths)


if __name__ == "__main__":
    sys.exit(code_of(lambda: main(sys.argv[1:])))
