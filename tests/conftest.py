"""What several files of tests need from pytest."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

# What a test starts in a folder of its own has the package, and its kernels, that the tests have.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])

# Of two processes one compiles the kernels while the other does what needs none.
FIRST = ("test_impacts.py", "test_fit.py")


def pytest_collection_modifyitems(items):
    """Those files first, then the ones with the most tests: what is left at the end is short."""
    number = Counter(item.path for item in items)
    items.sort(key=lambda item: (FIRST.index(item.path.name) if item.path.name in FIRST
                                 else len(FIRST), -number[item.path]))


@pytest.fixture(params=["closed", "full"])
def unwritable(request):
    """An output that cannot be written, and what is to be said of it: its reader has gone, without
    a word, or its disk is full."""
    if request.param == "closed":
        end, place = os.pipe()
        os.close(end)
    elif os.path.exists("/dev/full"):
        place = os.open("/dev/full", os.O_WRONLY)
    else:
        pytest.skip("needs /dev/full")
    yield place, "" if request.param == "closed" else "No space left"
    os.close(place)
