"""What several files of tests need from pytest."""

from __future__ import annotations

import os

import pytest


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
