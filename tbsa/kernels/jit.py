"""The one place that owns Numba's options and the folder of its disk cache.

Numba's disk cache looks at the file of the function that is called, not at the helpers it
calls from other files; an edited helper would silently not take effect.  The cache folder is
therefore named by a hash over all kernel sources, and over Numba's own version.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

# An index that came out of an array: unsigned, or Numba would look at every access whether it
# is negative and counts from the end.
U = np.uintp


def source_hash(folder: Path = Path(__file__).parent) -> str:
    """Hash of every kernel source in `folder` and of the versions that compile them."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:3]}".encode())
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """The folder of the compiled kernels: below the user's cache folder, never the package's."""
    base = os.environ.get("TBSA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    root = Path(base) if base else Path.home() / ".cache"
    folder = root / "tbsa" / source_hash()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # a read-only home
        folder = Path(tempfile.gettempdir()) / f"tbsa-{source_hash()}"
        folder.mkdir(parents=True, exist_ok=True)
    return folder


config: Any = numba.config


class _InFolder:
    """Sets Numba's cache folder while a kernel is being declared, and only then."""

    folder: str | None = None

    def __enter__(self) -> None:
        if _InFolder.folder is None:
            _InFolder.folder = str(cache_folder())
        self.before = config.CACHE_DIR
        config.CACHE_DIR = _InFolder.folder

    def __exit__(self, *exc: object) -> None:
        config.CACHE_DIR = self.before


def kernel(function: Callable[..., Any]) -> Any:
    """Jit a function that others call: cached on disk, runs without the GIL.

    No fastmath: results keep to the bit across builds, and ``isnan`` tells the truth.
    """
    with _InFolder():
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)


def inline(function: Callable[..., Any]) -> Any:
    """Jit a scalar helper of other kernels; compiled into its callers."""
    return numba.njit(nogil=True, error_model="numpy", inline="never")(function)


def lane(function: Callable[..., Any]) -> Any:
    """Jit a scalar helper of a loop over lanes, without branches: always part of its caller,
    so that the loop can become vector code."""
    return numba.njit(nogil=True, error_model="numpy", forceinline=True)(function)


def columns(length: int, kinds: list[type]) -> list[np.ndarray]:
    """Zeroed arrays of one length, one a kind (float or int), laid out against cache conflicts.

    Arrays that each begin on a page of their own fall into the same few sets of the first-level
    cache when they are walked together; here each begins three cache lines further on.
    """
    stride = -(-length // 512) * 512 + 24
    block = np.zeros(stride * len(kinds))
    parts = [block[i * stride : i * stride + length] for i in range(len(kinds))]
    return [part.view(np.int64) if kind is int else part
            for part, kind in zip(parts, kinds, strict=True)]
