"""A run as a film: its records drawn one after the other, as :func:`tbsa.work.draw.draw` draws one.

GIF needs nothing further; MP4 needs ffmpeg, the system's or that of the extra ``movie``.
"""

from __future__ import annotations

import io
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from tbsa.errors import InputError
from tbsa.model.records import Records, check_is_run, replacing, write_atomically
from tbsa.model.scene import Scene
from tbsa.work.draw import aspect, draw, frame, palette, target
from tbsa.work.metrics import Floats, truth_of

FORMATS = (".gif", ".mp4")
INCHES = 7.2  # of a picture's width: text is to the tiles as it is in `draw`
# In widths of a picture: where axes begin, their width, and their height if they show a square;
# below them is a legend of up to two rows.  Likewise what the title takes above.
LEFT, BOTTOM, WIDE, HIGH, TITLE = 0.1, 0.13, 0.885, 0.89345, 0.10165
LEAST, MOST = 200, 3840  # pixels
COLOURS = 128  # of a GIF

Picture = NDArray[np.uint8]


def movie(
    records: Records,
    path: str | Path,
    *,
    begin: float | None = None,
    end: float | None = None,
    every: int = 1,
    rate: float = 15.0,
    size: int = 720,
    glues: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write a film of a run; returns the number of its pictures.

    Parameters
    ----------
    records
        Of :func:`tbsa.model.records.read_run`; a run that still goes on has a film so far.
    path
        A file ending in one of `FORMATS`; replaced in one go when the film is complete.
    begin, end
        The first and the last record (s, the nearest ones); all of the run unless given.
    every
        One in so many records between them.
    rate
        Pictures a second.
    size
        Width of a picture in pixels; its height is that of the reactor's shape, and a title.
    glues
        As in :func:`tbsa.work.draw.draw`.
    progress
        Called with the pictures drawn and their number.

    Raises
    ------
    InputError
        As :func:`tbsa.work.draw.draw`; or a time that is not recorded, an option out of its
        bounds, or a ``.mp4`` without ffmpeg.
    RuntimeError
        Where ffmpeg fails, with what it said.
    TypeError
        Where `records` are none of a run.
    """
    check_is_run(records)
    path = target(path, FORMATS)
    ffmpeg = _ffmpeg(path) if path.suffix.lower() == ".mp4" else ""
    which = records.chosen(begin, end, every)
    if not 0.1 <= rate <= 50.0:
        raise InputError("must be from 0.1 to 50 pictures a second", field="rate", value=rate)
    if not LEAST <= size <= MOST:
        raise InputError(f"must be from {LEAST} to {MOST} pixels", field="size", value=size)

    def counted() -> Iterator[Picture]:
        for done, picture in enumerate(pictures(records, which, size, glues), 1):
            yield picture
            if progress is not None:
                progress(done, len(which))

    if ffmpeg:
        _mp4(counted(), path, rate, ffmpeg)
    else:
        # Few colours, the same in all pictures, so that what does not move is not stored again.
        some = [which[0], which[len(which) // 2], which[-1]]
        few = _palette(records.scene, list(pictures(records, some, size, glues)))
        write_atomically(path, _gif(counted(), len(which), rate, few))
    return len(which)


def pictures(records: Records, which: Sequence[int], size: int, glues: bool) -> Iterator[Picture]:
    """Records drawn one after the other in the same frame, uint8[height, width, 3]."""
    x, y = (np.ravel(each[list(which)]) for each in (records.x, records.y))
    figure, ax = _canvas(records.scene, x, y, size)
    canvas: Any = FigureCanvasAgg(figure)
    truth = truth_of(records.scene)
    for k in which:
        ax.clear()
        draw(records.scene, records.layout, records.x[k], records.y[k], records.angle[k], ax=ax,
             time=float(records.time[k]), glues=glues, truth=truth)
        frame(ax, records.scene, x, y)
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _canvas(scene: Scene, x: Floats, y: Floats, size: int) -> tuple[Figure, Axes]:
    """A figure so wide (pixels), and axes in it of the reactor's shape, or of all tiles'."""
    high = HIGH * aspect(scene, x, y)
    # MP4 wants even ones.
    wide, tall = (2 * round(0.5 * length) for length in (size, (BOTTOM + high + TITLE) * size))
    figure, part = Figure(figsize=(INCHES, INCHES * tall / wide), dpi=wide / INCHES), wide / tall
    return figure, figure.add_axes((LEFT, BOTTOM * part, WIDE, high * part))


def _palette(scene: Scene, samples: Sequence[Picture]) -> Image.Image:
    """The colours that any picture of the scene may have, and shades of these pictures."""
    own = _few(np.rint(255.0 * palette(scene)).astype(np.uint8)[None], COLOURS // 2)
    shades = _few(np.concatenate(samples), COLOURS - len(own))
    few = Image.new("P", (1, 1))
    few.putpalette(np.concatenate([own, shades]).tobytes())
    return few


def _few(picture: Picture, most: int) -> Picture:
    """At most so many colours that a picture is made of, uint8[n, 3]."""
    found = Image.fromarray(picture).quantize(most).getpalette()
    assert found is not None
    return np.array(found, np.uint8).reshape(-1, 3)


def _gif(frames: Iterator[Picture], number: int, rate: float, palette: Image.Image) -> bytes:
    """The bytes of a film of so many frames that begins again at its end."""
    few = (Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE)
           for each in frames)
    first, film = next(few), io.BytesIO()
    # A GIF counts in 10 ms: frames may differ by one, so that the film keeps the rate.
    ends = np.rint(np.arange(number + 1) * (100.0 / rate)).astype(int)
    first.save(film, format="GIF", save_all=True, append_images=few, loop=0,
               duration=(10 * np.diff(ends)).tolist())
    return film.getvalue()


def _ffmpeg(path: Path) -> str:
    """The program, that of the system first."""
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError("needs ffmpeg for .mp4: pip install 'tbsa[movie]', or let the name end "
                         "in .gif", field="path", value=str(path)) from None


def _mp4(frames: Iterator[Picture], path: Path, rate: float, ffmpeg: str) -> None:
    """Hand the pictures to ffmpeg; H.264 in the form that every player knows."""
    first = next(frames)
    with replacing(path, ".mp4") as scratch:
        command = [ffmpeg, "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24",
                   "-s", f"{first.shape[1]}x{first.shape[0]}", "-r", f"{rate:g}", "-i", "-",
                   "-an", "-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p",
                   "-movflags", "+faststart", str(scratch)]
        # A session of its own: Ctrl-C is this process's to answer.
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE,
                              start_new_session=True) as process:
            try:
                assert process.stdin is not None
                assert process.stderr is not None
                _feed(process.stdin, chain([first], frames))
                said = process.stderr.read().decode(errors="replace").strip()
            except BaseException:
                process.kill()
                raise
        if process.returncode != 0:
            raise RuntimeError(f"{path}: ffmpeg failed: "
                               f"{said[-500:] or f'it ended with {process.returncode}'}")


def _feed(pipe: IO[bytes], frames: Iterator[Picture]) -> None:
    try:
        for picture in frames:
            pipe.write(picture.tobytes())
        pipe.close()
    except BrokenPipeError:
        pass  # it has ended, and says why
