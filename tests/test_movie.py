"""A run as a film, a page, and a trajectory for other programs: true, and whole or not there."""

import base64
import json
import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gsd.hoomd
import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from PIL import Image

from tbsa.errors import InputError
from tbsa.model.layout import initial_layout
from tbsa.model.records import Records
from tbsa.model.scene import SETS, Free, Magnet, PlacedTile, Reactor, Scene, Seed, TileType
from tbsa.work import draw as drawing
from tbsa.work import export as exports
from tbsa.work import movie as films
from tbsa.work.cli import main
from tbsa.work.draw import draw
from tbsa.work.export import export
from tbsa.work.metrics import assembly
from tbsa.work.movie import movie
from tbsa.work.viewer import view

W, CENTRE = 0.03, -0.06
ROUND = Reactor("circle", radius=0.15)
SEED = Seed(((0, 0, "black"), (1, 0, "white"), (0, 1, "white")))
TILES = (PlacedTile("black", (W, W)), PlacedTile("black", (CENTRE, CENTRE)))


def records(reactor=ROUND, count=6):
    """A free black tile that goes to the right by half its width a record, turning; one a second.

    Another one is attached to the seed all the time.
    """
    scene = Scene(types=SETS["chessboard"], seed=SEED, free=Free(tiles=TILES), reactor=reactor,
                  magnet=Magnet())
    layout = initial_layout(scene)
    k = np.arange(float(count))[:, None]
    mine = np.where(layout.y < 0.0, 1.0, 0.0)
    still = np.zeros((count, mine.size))
    return Records(scene, layout, k[:, 0], layout.x + 0.5 * W * k * mine, layout.y + still,
                   layout.angle + 0.1 * k * mine, still + 0.5 * W * mine, still, still + 0.1 * mine)


def pictures_of(path):
    """The pictures of a film as arrays uint8[height, width, 3], and its pictures a second."""
    if path.suffix == ".gif":
        with Image.open(path) as film:
            found = []
            for k in range(film.n_frames):
                film.seek(k)
                found.append(np.asarray(film.convert("RGB")))
            return found, 1000.0 / film.info["duration"]
    frames = imageio_ffmpeg.read_frames(path)
    about = next(frames)
    width, height = about["size"]
    return ([np.frombuffer(each, np.uint8).reshape(height, width, 3) for each in frames],
            about["fps"])


def grey_of_the_free_black_tile(picture):
    """Where in a picture (pixels) the colour of a black tile that is not attached is."""
    dark = np.abs(picture.astype(int) - picture.mean(axis=2, keepdims=True)).max(axis=2) < 12
    shade = picture.mean(axis=2)
    rows, columns = np.nonzero(dark & (shade > 115) & (shade < 145))
    return np.median(columns), np.median(rows), columns.size


@pytest.mark.parametrize("name", ["run.gif", "run.mp4", "RUN.GIF"])
def test_a_film_has_a_picture_of_every_record_in_their_order(tmp_path, name):
    shown = []
    count = movie(records(), tmp_path / name, rate=10.0, size=400,
                  progress=lambda done, total: shown.append((done, total)))
    found, rate = pictures_of(tmp_path / name) if name != "RUN.GIF" else pictures_of(
        (tmp_path / name).rename(tmp_path / "run.gif"))
    assert count == len(found) == 6
    assert shown == [(k, 6) for k in range(1, 7)]
    assert rate == pytest.approx(10.0)
    assert {each.shape for each in found} == {(450, 400, 3)}
    places = [grey_of_the_free_black_tile(each) for each in found]
    # The axes show 2 x 1.02 x 15 cm in 0.885 of the width, or less: as high as they are wide.
    pixel = 2.0 * 1.02 * 0.15 / (0.885 * 400)
    steps = np.diff([x for x, _, _ in places]) * pixel / (0.5 * W)
    np.testing.assert_allclose(steps, 1.0, atol=0.12)
    assert np.ptp([y for _, y, _ in places]) <= 1.0
    assert [path.name for path in tmp_path.iterdir()] == [name if name != "RUN.GIF" else "run.gif"]


@pytest.mark.parametrize("rate", [0.7, 15.0, 24.0, 40.0, 50.0])
def test_a_gif_keeps_its_rate_though_it_counts_in_10_ms(tmp_path, rate):
    movie(records(count=13), tmp_path / "run.gif", rate=rate, size=200)
    with Image.open(tmp_path / "run.gif") as film:
        lasts = []
        for k in range(film.n_frames):
            film.seek(k)
            lasts.append(film.info["duration"])
    assert len(lasts) == 13
    assert sum(lasts) == pytest.approx(13_000 / rate, abs=5.0)
    assert max(lasts) - min(lasts) <= 10


def test_part_of_a_run_is_chosen_by_time_and_by_how_many_records_are_left_out(tmp_path):
    run = records(count=21)
    for options, times in (({"begin": 4.9, "end": 11.2}, range(5, 12)),
                           ({"every": 7}, (0, 7, 14)),
                           ({"begin": 3.0, "every": 4, "end": 11.0}, (3, 7, 11)),
                           ({"begin": 20.0}, (20,))):
        assert list(run.chosen(options.get("begin"), options.get("end"),
                               options.get("every", 1))) == list(times)
        assert movie(run, tmp_path / "run.gif", size=200, **options) == len(times)
        assert len(pictures_of(tmp_path / "run.gif")[0]) == len(times)


@pytest.mark.parametrize("number", [1, 12, 12345])
@pytest.mark.parametrize(("width", "height"),
                         [(0.4, 0.2), (0.3, 0.3), (0.25, 0.4), (1.2, 0.2), (0.0, 0.0)])
def test_a_film_has_the_shape_of_the_reactor_and_room_for_its_legend_below(
        monkeypatch, width, height, number):
    """Whatever is marked: a circle has no room for it in a corner."""
    monkeypatch.setattr(drawing, "_marks", lambda *_: dict.fromkeys(drawing.MARKS, number))
    reactor = Reactor("rectangle", width=width, height=height) if width else ROUND
    width, height = (width, height) if width else (1.0, 1.0)
    run = records(reactor, count=1)
    (picture,) = films.pictures(run, range(1), 400, False)
    tall, wide, _ = picture.shape
    shape = max(height / width, 0.3)
    assert (tall % 2, wide) == (0, 400)
    assert tall == pytest.approx(400 * (0.2317 + 0.893 * shape), abs=2.0)
    figure, ax = films._canvas(run.scene, run.x[0], run.y[0], 400)
    draw(run.scene, run.layout, run.x[0], run.y[0], run.angle[0], ax=ax, time=1.0)
    FigureCanvasAgg(figure).draw()
    box = ax.get_legend().get_window_extent()
    assert 0.0 < box.y0 < box.y1 < ax.xaxis.label.get_window_extent().y0
    assert 0.0 < box.x0 < box.x1 < wide
    assert ax.title.get_window_extent().y1 < tall


def test_without_a_reactor_all_pictures_show_the_same_place():
    """Axes about the tiles of each picture alone would move with them."""
    run = records(reactor=None, count=5)
    found = [grey_of_the_free_black_tile(each)
             for each in films.pictures(run, range(5), 400, False)]
    assert np.ptp(np.diff([x for x, _, _ in found])) <= 2.0
    assert np.ptp([y for _, y, _ in found]) <= 1.0


def test_what_comes_up_in_a_single_picture_keeps_its_colour(tmp_path):
    """The few colours of a GIF have room for marks that its first and last picture have not got."""
    run = records(count=4)
    run.x[2, -1], run.y[2, -1], run.angle[2, -1] = 2.0 * W, 0.0, 0.0  # bonded by one edge only
    assert assembly(run.scene, run.layout, run.x[2], run.y[2], run.angle[2]).outside.sum() == 1
    movie(run, tmp_path / "run.gif", size=500)
    blue = np.array([33, 102, 172])
    counts = [int((np.abs(each.astype(int) - blue).max(axis=2) < 16).sum())
              for each in pictures_of(tmp_path / "run.gif")[0]]
    assert counts[2] > 50
    assert counts[0] == counts[1] == counts[3] == 0


def test_a_tile_that_attaches_in_between_has_its_colour_and_a_green_bond(tmp_path):
    """The pictures that the few colours of a GIF are chosen by show the tile faded, and no bond."""
    green = TileType("green", (-1, -1, -1, -1), "#00c000", 0)
    scene = Scene((TileType("seed", (1, 1, 1, 1), "black", 0), green), magnet=Magnet(),
                  seed=Seed(((0, 0, "seed"),)), reactor=ROUND,
                  free=Free(tiles=(PlacedTile("green", (3 * W, 0.0)),)))
    layout = initial_layout(scene)
    x, still = np.tile(layout.x, (5, 1)), np.zeros((5, 2))
    x[1, 1] = W
    run = Records(scene, layout, np.arange(5.0), x, still, still, still, still, still)
    movie(run, tmp_path / "run.gif", size=400)
    found = pictures_of(tmp_path / "run.gif")[0]
    for colour, least in ((green.colour, 100), (drawing.BOND, 10), (drawing.OUTLINES[1], 50)):
        near = [int((np.abs(each - np.rint(255.0 * np.array(to_rgb(colour)))).max(axis=2) < 6)
                    .sum()) for each in found]
        assert near[1] > least


def test_a_film_of_more_colours_than_a_gif_has_room_for_is_made(tmp_path):
    kinds = tuple(TileType(f"{k}", (0, 0, 0, 0), f"#{k:02x}{255 - k:02x}80") for k in range(150))
    scene = Scene(kinds, reactor=ROUND, free=Free(tiles=(PlacedTile("7", (0.0, 0.0)),)))
    layout = initial_layout(scene)
    still = np.zeros((1, 1))
    run = Records(scene, layout, np.zeros(1), *6 * [still])
    assert movie(run, tmp_path / "run.gif", size=200) == 1


@pytest.mark.parametrize("name", ["run.gif", "run.mp4"])
def test_a_film_that_is_broken_off_leaves_the_one_before(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"before")

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        movie(records(), path, size=300, progress=stop)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_what_ffmpeg_says_is_passed_on(tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('no such codec')\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"run\.mp4: ffmpeg failed: no such codec"):
        movie(records(), tmp_path / "run.mp4", size=300)
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.exit(3)\n")
    with pytest.raises(RuntimeError, match=r"run\.mp4: ffmpeg failed: it ended with 3"):
        movie(records(), tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == [program]


@pytest.mark.parametrize(("options", "words"), [
    ({"rate": 0.0}, "rate: 0.0 must be from 0.1 to 50"),
    ({"rate": math.nan}, "rate: nan must be"),
    ({"size": 199}, "size: 199 must be from 200 to 3840"),
    ({"every": 0}, "every: 0 must be at least 1"),
    ({"begin": 3.0, "end": 2.0}, "end: 2.0 must not be before the beginning, 3 s"),
    ({"end": 7.0}, "end: 7.0 is not recorded: this run holds 0 to 5 s"),
])
def test_options_out_of_their_bounds_are_refused(tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        movie(records(), tmp_path / "run.gif", **options)
    assert not list(tmp_path.iterdir())


def test_a_missing_program_or_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setitem(sys.modules, "gsd.hoomd", None)
    with pytest.raises(InputError, match=r"needs ffmpeg for \.mp4: pip install 'tbsa\[movie\]'"):
        movie(records(), tmp_path / "run.mp4")
    with pytest.raises(InputError, match=r"needs the package gsd: pip install 'tbsa\[gsd\]'"):
        export(records(), tmp_path / "run.gsd")
    assert not list(tmp_path.iterdir())


def test_the_box_of_a_trajectory_is_looked_for_once(tmp_path, monkeypatch):
    """Without a reactor it takes all records; once a frame, time would grow as their square."""
    found = []
    monkeypatch.setattr(exports, "_box", lambda run: found.append(run) or (1.0, 1.0))
    export(records(None), tmp_path / "run.gsd")
    assert len(found) == 1


def shown_on(page):
    """What a page has to show, as its script decodes it: the data, places and angles, states."""
    text = page.read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    run = json.loads(data)
    n = len(run["type"])
    raw = np.frombuffer(base64.b64decode(run["poses"]), "<u2").reshape(-1, n, 3)
    pose = np.stack([run["low"][0] + run["span"] * raw[..., 0] / 65535,
                     run["low"][1] + run["span"] * raw[..., 1] / 65535,
                     2.0 * np.pi * raw[..., 2] / 65536])
    return run, pose, np.frombuffer(base64.b64decode(run["states"]), np.uint8).reshape(-1, n)


@pytest.mark.parametrize("reactor", [ROUND, Reactor("rectangle", width=0.4, height=0.5), None])
def test_a_page_shows_what_the_records_say(tmp_path, reactor):
    run = records(reactor)
    run.angle[:, -1] -= 40.0  # rad: many turns, the other way
    assert view(run, tmp_path / "run.html", begin=1.0, every=2) == 3
    data, (x, y, angle), states = shown_on(tmp_path / "run.html")
    which = [1, 3, 5]
    assert data["time"] == [1.0, 3.0, 5.0]
    fine = data["span"] / 65535
    np.testing.assert_allclose(x, run.x[which], atol=0.51 * fine)
    np.testing.assert_allclose(y, run.y[which], atol=0.51 * fine)
    np.testing.assert_allclose(np.exp(1j * angle), np.exp(1j * run.angle[which]), atol=1e-4)
    assert fine < 1e-3 * W
    assert [data["types"][k]["name"] for k in data["type"]] == [
        run.scene.types[k].name for k in run.layout.type]
    assert (states[:, run.layout.seed] == 2).all()
    assert (states[:, ~run.layout.seed] == [1, 0]).all()  # attached, and free
    assert data["size"] == [1, 1, 1]
    assert data["wall"] == (None if reactor is None else {
        "radius": reactor.radius, "width": reactor.width, "height": reactor.height})


def test_a_page_marks_holes_and_what_is_outside_the_pattern(tmp_path):
    run = records(count=2)
    run.x[1, -1], run.y[1, -1], run.angle[1, -1] = 2.0 * W, 0.0, 0.0  # bonded by one edge only
    view(run, tmp_path / "run.html")
    data, _, states = shown_on(tmp_path / "run.html")
    (outside,) = [mark["bit"] for mark in data["marks"] if mark["corners"] == 3]
    assert states[0, -1] == 0
    assert states[1, -1] & outside
    found = assembly(run.scene, run.layout, run.x[1], run.y[1], run.angle[1])
    assert [len(sites) for sites in data["sites"]] == data["holes"]
    assert data["holes"][1] == found.holes


def test_a_page_plots_a_run_of_any_length():
    """A call with an argument a record fails beyond some 120,000 of them."""
    page = (Path(films.__file__).parent / "viewer.html").read_text(encoding="utf-8")
    assert not re.findall(r"\(\.\.\.run\b[^)]*\)", page)
    drawing = re.search(r"const most = (.+);\n", page)[1]
    if shutil.which("node") is None:
        pytest.skip("needs node")
    for each in ("size", "errors", "holes"):  # all three are drawn
        program = ("const many = () => new Array(300000).fill(2);"
                   "const run = {size: many(), errors: many(), holes: many()};"
                   f"run.{each}[7] = 9; process.stdout.write(String({drawing}))")
        assert subprocess.run(["node", "-e", program], capture_output=True, text=True,
                              check=True).stdout == "9"


def test_a_page_leaves_the_browser_its_own_keys():
    """Ctrl-0 is its zoom and Alt-left goes back, though 0 and left alone are the page's."""
    page = (Path(films.__file__).parent / "viewer.html").read_text(encoding="utf-8")
    listener = re.search(r'^addEventListener\("keydown".+?^}\);$', page, re.M | re.S)[0]
    program = """
        let record = 5, last = 9, playing = 0, pressed;
        const go = k => { record = k; }, home = () => { record = 0; }, play = () => {};
        const addEventListener = (_, f) => { pressed = f; };
        """ + listener + """
        const press = (key, more) => {
          record = 5;
          pressed({key, target: {tagName: "BODY"}, preventDefault() { record += 100; }, ...more});
          return record;
        };
        process.stdout.write([press("0", {ctrlKey: true}), press("0", {metaKey: true}),
                              press("ArrowLeft", {altKey: true}), press("x"),
                              press("ArrowLeft"), press("0")].join(" "));
        """
    if shutil.which("node") is None:
        pytest.skip("needs node")
    assert subprocess.run(["node", "-e", program], capture_output=True, text=True,
                          check=True).stdout == "5 5 5 5 104 0"


def test_a_page_reads_its_records_in_about_the_time_of_their_letters():
    """A list of all letters took 25 times as long, and broke off beyond some 100 MB."""
    page = (Path(films.__file__).parent / "viewer.html").read_text(encoding="utf-8")
    bytes_of = re.search(r"^const bytes = .+?\n(?=const poses)", page, re.M | re.S)[0]
    program = bytes_of + """
        const text = Buffer.from(Uint8Array.from({length: 6e6}, (_, k) => k)).toString("base64");
        const time = f => Math.min(...[1, 2, 3].map(() => {
          const begun = performance.now(); f(text); return performance.now() - begun;
        }));
        const found = bytes(text), letters = text => {
          let sum = 0;
          const raw = atob(text);
          for (let k = 0; k < raw.length; k++) sum += raw.charCodeAt(k);
          return sum;
        };
        process.stdout.write([found.length, found[0], found[255], found[5999999] === 5999999 % 256,
                              time(bytes) < 6 * time(letters)].join(" "));
        """
    if shutil.which("node") is None:
        pytest.skip("needs node")
    assert subprocess.run(["node", "-e", program], capture_output=True, text=True,
                          check=True).stdout == "6000000 0 255 true true"


# A browser's objects as far as the page's script needs them; what it strokes is in `strokes`.
BROWSER = """
    const strokes = [], listeners = {}, nothing = () => {};
    const pen = new Proxy({stroke: () => strokes.push([pen.strokeStyle, pen.lineWidth])},
                          {get: (own, name) => name in own ? own[name] : nothing});
    const canvas = {getContext: () => pen, addEventListener: nothing, width: 1, height: 1};
    canvas.parentElement = {getBoundingClientRect: () => ({width: 800, height: 600})};
    const elements = {data: {textContent: DATA}};
    const document = {querySelector: () => ({}), getElementById: id => elements[id] ??= {
      checked: true, value: "15", firstElementChild: canvas, addEventListener: nothing}};
    const devicePixelRatio = 1, addEventListener = nothing, requestAnimationFrame = f => f();
"""


def test_a_page_marks_tiles_so_that_they_show_on_tiles_of_their_colour(tmp_path):
    run = records(count=1)
    run.x[0, -1], run.y[0, -1], run.angle[0, -1] = 2.0 * W, 0.0, 0.0  # outside the pattern
    view(run, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    (data,) = re.findall(r'id="data">(.*?)</script>', page, re.S)
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.S)
    if shutil.which("node") is None:
        pytest.skip("needs node")
    program = (BROWSER.replace("DATA", json.dumps(data)) + script
               + "process.stdout.write(JSON.stringify(strokes));")
    strokes = json.loads(subprocess.run(["node", "-"], input=program, capture_output=True,
                                        text=True, check=True).stdout)
    at = [look for look, _ in strokes].index(drawing.MARKS["outside the pattern"][0])
    assert strokes[at - 1][0] == "#fff"
    assert strokes[at - 1][1] > strokes[at][1]


def test_no_title_gets_out_of_its_place_in_the_page(tmp_path):
    run = records()
    title = "a </script><script>alert(1)</script> & <b> __DATA__"
    view(replace(run, scene=replace(run.scene, title=title)), tmp_path / "run.html")
    assert shown_on(tmp_path / "run.html")[0]["title"] == title
    text = (tmp_path / "run.html").read_text()
    assert text.count("</script>") == 2
    assert "<title>a &lt;/script&gt;" in text


def test_names_of_types_that_are_not_ascii_are_escaped_in_a_trajectory(tmp_path):
    run = records()
    named = tuple(replace(kind, name=f"{kind.name} é") for kind in run.scene.types)
    export(replace(run, scene=replace(run.scene, types=named, seed=None)), tmp_path / "run.gsd")
    with gsd.hoomd.open(tmp_path / "run.gsd", "r") as file:
        assert file[0].particles.types == [rf"{kind.name} \xe9" for kind in run.scene.types]


@pytest.mark.parametrize(("reactor", "box"), [
    (ROUND, (0.3, 0.3)),
    (Reactor("rectangle", width=0.4, height=0.5), (0.4, 0.5)),
    (None, None),
])
def test_a_trajectory_says_what_the_records_say(tmp_path, reactor, box):
    run = records(reactor)
    export(run, tmp_path / "run.gsd")
    with gsd.hoomd.open(tmp_path / "run.gsd", "r") as file:
        frames = list(file)
    assert len(frames) == 6
    for k, frame in enumerate(frames):
        tiles, cell = frame.particles, frame.configuration.box
        assert frame.configuration.step == k * 480  # of 1/480 s
        assert frame.configuration.dimensions == 2
        np.testing.assert_allclose(tiles.position, np.stack([run.x[k], run.y[k], 0 * run.x[k]], 1),
                                   atol=1e-7)
        assert (2.0 * np.abs(tiles.position[:, :2]) <= cell[:2]).all()
        if box is not None:
            np.testing.assert_allclose(cell[:2], box, rtol=1e-6)
        # A quaternion (w, x, y, z) turns x to where the tile's own x is.
        w, x, y, z = tiles.orientation.T
        np.testing.assert_allclose(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
                                   run.angle[k], atol=1e-6)
        np.testing.assert_allclose(tiles.velocity[:, 0], run.vx[k], rtol=1e-6)
        np.testing.assert_allclose(tiles.mass, 0.016, rtol=1e-6)
        np.testing.assert_allclose(tiles.moment_inertia[:, 2], 0.016 * W**2 / 6, rtol=1e-6)
        assert [tiles.types[i] for i in tiles.typeid] == [
            run.scene.types[i].name for i in run.layout.type]
        corners = np.array(tiles.type_shapes[0]["vertices"])
        assert np.ptp(corners, axis=0) == pytest.approx([W, W])
        assert frame.log["time"] == pytest.approx([float(k)])
        assert frame.log["size"] == [1]
        assert list(frame.log["particles/held"]) == list(run.layout.held)
        np.testing.assert_allclose(frame.log["particles/spin"], run.omega[k])


def test_the_commands_write_into_the_runs_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text("""
[tiles]
set = "chessboard"
[[free.tile]]
type = "black"
position = [0.0, 0.0]
velocity = [0.1, 0.0]
[record]
interval = 0.1
checkpoint = 0.5
[run]
duration = 0.5
""")
    assert main(["run", "scene.toml", "--out", "run", "--quiet"]) == 0
    assert main(["movie", "run", "--from", "0.1", "--to", "0.4", "--size", "300"]) == 0
    assert main(["view", "run", "--every", "2"]) == 0
    assert main(["export", "run"]) == 0
    assert len(pictures_of(Path("run/movie.gif"))[0]) == 4
    assert len(shown_on(Path("run/view.html"))[0]["time"]) == 3
    assert Path("run/run.gsd").exists()
    assert "written to run/movie.gif" in capsys.readouterr().out
    before = sorted(tmp_path.rglob("*"))
    for arguments, words in (
            (["movie", "run", "--out", "a.avi"], "must end in .gif, .mp4"),
            (["movie", "run", "--to", "0.6"], "--to: 0.6 is not recorded"),
            (["movie", "run", "--out", "no/a.gif"], "must be in a folder that exists"),
            (["movie", "run", "--out", 250 * "x" + ".gif"], "must be a path that can be written"),
            (["view", "run", "--out", "a.htm"], "must end in .html"),
            (["view", "run", "--every", "-1"], "every: -1 must be at least 1"),
            (["export", "run", "--out", "run"], "must end in .gsd"),
            (["export", "."], "is not the folder of a run")):
        assert main(arguments) == 2
        assert words in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
