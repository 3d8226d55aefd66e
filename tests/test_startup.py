"""From the command to the first step: what is imported, what is compiled, and where it is kept."""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import json
import operator
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import llvmlite.binding
import numpy as np
import pytest
from numba.core import types
from numba.core.callconv import CPUCallConv
from numba.core.registry import cpu_target

import tbsa
from tbsa.kernels import arrays, drives, geometry, jit, rows
from tbsa.kernels.jit import U
from tbsa.work import cli
from tbsa.work.report import DONE, LEFT_OUT, work

PACKAGE = Path(tbsa.__file__).parent
ROOT = Path(__file__).parents[1]
# Forces of two tiles, and what the kernels' cache did: true where a kernel came from disk.  Tables
# are what Numba reads to compile.
BOND = """
import json, sys
from tbsa.kernels import drives, jit
from tbsa.model import simulation
from tbsa.model.scene import SETS, Free, Magnet, PlacedTile, Scene
tiles = (PlacedTile("black", (0.0, 0.0)), PlacedTile("white", (0.03, 0.0)))
s = simulation.Simulation(Scene(types=SETS["chessboard"], free=Free((), tiles), magnet=Magnet()))
forces = [list(part) for part in s.magnet_forces()]
used = {name: there for name, there in jit.KERNELS.items() if there is not None}
folder = jit.cache_folder()
print(json.dumps({"forces": forces, "used": used, "folder": folder and str(folder),
                  "tables": "numba.np.linalg" in sys.modules}))
"""


def start(code, folder=ROOT, **environment):
    """A fresh Python at work on some code; what is None in the environment is taken out of it."""
    whole = os.environ | {"PYTHONPATH": str(folder)} | environment
    return subprocess.Popen([sys.executable, "-c", code], cwd=folder, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            env={k: v for k, v in whole.items() if v is not None})


def end(process):
    """What it prints as JSON."""
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err[-3000:]
    return json.loads(out)


def python(code, folder=ROOT, **environment):
    """What a fresh Python prints as JSON."""
    return end(start(code, folder, **environment))


def files(folder):
    """Every file below a folder, with its bytes."""
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*"))
            if path.is_file()}


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """A cache folder with the kernels of the two tiles, and what they gave; not to be changed."""
    folder = tmp_path_factory.mktemp("warm")
    return folder, python(BOND, TBSA_CACHE_DIR=str(folder))


# Imports.


def test_a_run_imports_neither_pandas_nor_matplotlib(tmp_path):
    (tmp_path / "scene.toml").write_text(
        '[tiles]\nset = "chessboard"\n[[free.tile]]\ntype = "black"\nposition = [0, 0]\n'
        "[run]\nduration = 1\n")
    code = """
import json, sys
import tbsa.work.cli
from tbsa.model import records
scene = tbsa.load(sys.path[0] + "/scene.toml")
tbsa.Simulation(scene)
print(json.dumps(sorted(name for name in sys.modules if "." not in name or "scipy" in name)))
"""
    (tmp_path / "code.py").write_text(code)
    loaded = json.loads(subprocess.run(
        [sys.executable, "code.py"], cwd=tmp_path, text=True, capture_output=True, check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)}).stdout)
    assert "numba" in loaded
    # Numba itself imports scipy.linalg where there is SciPy, and that others in old versions of it.
    code = "import numba, scipy.linalg, json, sys; print(json.dumps([*sys.modules]))"
    numba = json.loads(subprocess.run([sys.executable, "-c", code], text=True, capture_output=True,
                                      check=True).stdout)
    assert not {"pandas", "matplotlib", "tqdm", "theory", "scipy.spatial", "scipy.optimize",
                "scipy.sparse"} & (set(loaded) - set(numba))


def test_every_public_name_is_there_and_known_to_type_checkers():
    for name in tbsa.__all__:
        assert getattr(tbsa, name) is not None
    assert set(tbsa.__all__) <= set(dir(tbsa))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = tbsa.nothing
    (block,) = [node for node in ast.parse((PACKAGE / "__init__.py").read_text()).body
                if isinstance(node, ast.If)]
    typed = {alias.asname: node.module for node in block.body
             if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed == tbsa._HOME


# The cache.


def test_kernels_are_compiled_once(warm):
    folder, first = warm
    assert first["used"] == {"build_pairs": False, "magnet_forces": False, "no_drive": False}
    again = python(BOND, TBSA_CACHE_DIR=str(folder))
    assert again["used"] == dict.fromkeys(first["used"], True)
    assert (first["tables"], again["tables"]) == (True, False)  # a third of a cached start
    assert again["forces"] == first["forces"]
    assert again["folder"].startswith(str(folder))


def test_what_is_compiled_after_a_cached_start_has_numbas_tables(warm):
    """A drive of the user's is compiled in every process, with all that Numba knows."""
    folder, first = warm
    code = BOND + """
import numpy as np
from numba import njit
from tbsa.kernels.drives import engine
@njit
def call(f, p, x, family, fx):
    f(1.0, p, x, x, x, x, x, x, family, x, fx, x, x)
def sums(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    fx[:] += np.linalg.norm(np.dot(p.reshape(2, 2), x)) + np.sort(x)[0]
fx = np.zeros(2)
call(engine(sums), np.array([3.0, 0.0, 0.0, 2.0]), np.array([1.0, 2.0]), np.ones(2), fx)
print(json.dumps(list(fx)))
"""
    process = start(code, TBSA_CACHE_DIR=str(folder))
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err[-3000:]
    found, forces = map(json.loads, out.splitlines())
    assert found["used"] == dict.fromkeys(first["used"], True)
    assert forces == [6.0, 6.0]


def test_drives_are_compiled_with_notes_for_debuggers(tmp_path):
    code = "from tbsa.kernels import drives; drives.engine(drives.no_drive); print(1)"
    assert python(code, NUMBA_DEBUGINFO="1", TBSA_CACHE_DIR=str(tmp_path)) == 1


def test_an_edited_helper_of_a_built_in_drive_takes_effect(tmp_path):
    """As for kernels, in test_kernels.py: drives are cached, their helpers stand elsewhere."""
    shutil.copytree(PACKAGE, tmp_path / "tbsa", ignore=shutil.ignore_patterns("__pycache__"))
    code = """
import json
import numpy as np
from numba import njit
from tbsa.kernels import drives, jit
from tbsa.kernels.drives import engine
@njit
def call(f, p, zero, family, fx):
    f(1.0, p, zero, zero, zero, zero, zero, zero, family, zero, fx, zero, zero)
fx = np.zeros(1)
call(engine(drives.unicycle), np.array([1.0, 0.0, 0.25]), np.zeros(1), np.ones(1), fx)
print(json.dumps([fx[0], jit.KERNELS["unicycle"]]))
"""
    place = {"TBSA_CACHE_DIR": str(tmp_path / "cache")}
    assert python(code, tmp_path, **place) == [1.0, False]
    assert python(code, tmp_path, **place) == [1.0, True]
    helper = tmp_path / "tbsa" / "kernels" / "geometry.py"
    text = helper.read_text()
    begin = text.index("def cos_sin")
    cut = text.index("return ", begin)
    helper.write_text(text[:cut] + "return 0.5, 0.0  # " + text[cut:])
    assert python(code, tmp_path, **place) == [0.5, False]


def test_a_read_only_installation(tmp_path, warm):
    package = tmp_path / "site" / "tbsa"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    before = files(package)
    for path in [package, *package.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        found = python(BOND, package.parent, TBSA_CACHE_DIR=str(tmp_path / "cache"),
                       PYTHONDONTWRITEBYTECODE="1")
        again = python(BOND, package.parent, TBSA_CACHE_DIR=str(tmp_path / "cache"),
                       PYTHONDONTWRITEBYTECODE="1")
    finally:
        for path in [package, *(each for each in package.rglob("*") if each.is_dir())]:
            path.chmod(0o755)
    assert files(package) == before  # root could have written
    assert found["forces"] == again["forces"] == warm[1]["forces"]
    assert all(again["used"].values())


def test_a_home_that_cannot_be_written(tmp_path, warm):
    """Kernels are then kept among the temporary files, in a folder of the user's own."""
    (tmp_path / "file").write_text("")  # below a file not even root can make a folder
    (tmp_path / "tmp").mkdir()
    places = {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path / "tmp"),
              "TBSA_CACHE_DIR": None, "XDG_CACHE_HOME": None}
    found = python(BOND, **places)
    assert found["folder"].startswith(str(tmp_path / "tmp"))
    assert found["forces"] == warm[1]["forces"]
    assert not any(found["used"].values())
    assert all(python(BOND, **places)["used"].values())
    (mine,) = (tmp_path / "tmp").iterdir()
    assert mine.stat().st_mode & 0o077 == 0


def test_a_user_without_a_home(tmp_path, monkeypatch):
    """Neither a HOME, nor an entry among the users that would tell of one."""
    for name in ("HOME", "TBSA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", lambda user: {}[user])
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert jit.cache_folder().is_relative_to(tmp_path)


def test_nowhere_to_keep_kernels(tmp_path, warm):
    (tmp_path / "file").write_text("")
    found = python(f"import tempfile\ntempfile.tempdir = {str(tmp_path / 'file')!r}\n{BOND}",
                   TBSA_CACHE_DIR=str(tmp_path / "file"))
    assert found == {"forces": warm[1]["forces"], "used": {}, "folder": None, "tables": True}


def test_two_processes_that_start_cold_at_the_same_time(tmp_path, warm):
    place = {"TBSA_CACHE_DIR": str(tmp_path)}
    both = [start(BOND, **place) for _ in range(2)]
    assert [end(process)["forces"] for process in both] == [warm[1]["forces"]] * 2
    third = python(BOND, **place)
    assert third["forces"] == warm[1]["forces"]
    assert all(third["used"].values())
    assert not [path for path in tmp_path.rglob("*") if ".tmp." in path.name]


# Ctrl-C while LLVM is at work.

LONE = ('[tiles]\nset = "chessboard"\n[[free.tile]]\ntype = "black"\nposition = [0, 0]\n'
         "[run]\nduration = 1\n")
RUN = 'print(tbsa.work.cli.main(["run", "scene.toml", "--out", "run", "--quiet"]))'
# One Ctrl-C as soon as LLVM calls back for what is kept, where Python drops what is raised.
IN_CALLBACK = f"""
import signal, sys
import tbsa.work.cli

def trace(frame, what, _):
    if frame.f_code.co_name == {{name!r}} and what == "call":
        sys.settrace(None)
        signal.raise_signal(signal.SIGINT)
    return trace

sys.settrace(trace)
{RUN}
"""
# One at the start of the fiftieth helper, and which one was the last.
IN_COMPILATION = f"""
import signal, sys
import tbsa.work.cli
from tbsa.kernels import jit
seen, begin, before = [], jit._PartCompiler.define_pipelines, signal.getsignal(signal.SIGINT)

def begins(self):
    seen.append(self)
    if len(seen) == 50:
        signal.raise_signal(signal.SIGINT)
    return begin(self)

jit._PartCompiler.define_pipelines = begins
{RUN}
print(len(seen), signal.getsignal(signal.SIGINT) is before)
"""


def ended(process):
    """What it prints, and on stderr; it has not crashed."""
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err[-3000:]
    return out, err


@pytest.mark.parametrize("name", [
    "_raw_object_cache_getbuffer",
    pytest.param("_raw_object_cache_notify", marks=pytest.mark.slow)])
def test_ctrl_c_while_kernels_are_read_neither_crashes_nor_is_lost(tmp_path, name):
    (tmp_path / "scene.toml").write_text(LONE)
    place = {"PYTHONPATH": str(ROOT)}
    ended(start(f"import tbsa.work.cli\n{RUN}", tmp_path, **place))  # they are there now
    shutil.rmtree(tmp_path / "run")
    code, err = ended(start(IN_CALLBACK.format(name=name), tmp_path, **place))
    assert code == "130\n"
    assert "Traceback" not in err
    assert "ignored" not in err


def test_ctrl_c_while_kernels_are_compiled_does_not_wait_for_the_last(tmp_path):
    (tmp_path / "scene.toml").write_text(LONE)
    out, err = ended(start(IN_COMPILATION, tmp_path, PYTHONPATH=str(ROOT),
                           TBSA_CACHE_DIR=str(tmp_path / "cache")))
    assert out == "130\n50 True\n"
    assert "broken off; go on from the last checkpoint" in err


DAMAGE = {
    "cut off": lambda data: data[: len(data) // 2],
    "of length zero": lambda data: b"",
    "zeroed": lambda data: bytes(len(data)),
    "a flipped bit": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 4])
    + data[len(data) // 2 + 1 :],
    "text": lambda data: b"not a pickle at all",
}


@pytest.mark.parametrize(("kind", "damage"), [
    ("nbc", "a flipped bit"), ("nbi", "cut off"),
    *(pytest.param(kind, damage, marks=pytest.mark.slow) for kind, damage in (
        ("nbc", "cut off"), ("nbc", "of length zero"), ("nbc", "zeroed"), ("nbc", "text"),
        ("nbi", "a flipped bit")))])
def test_what_is_damaged_is_compiled_anew(tmp_path, warm, kind, damage):
    shutil.copytree(warm[0], tmp_path, dirs_exist_ok=True)
    damaged = list(tmp_path.rglob(f"drives.no_drive*.{kind}"))
    assert len(damaged) == 1
    whole = damaged[0].read_bytes()
    damaged[0].write_bytes(DAMAGE[damage](whole))
    found = python(BOND, TBSA_CACHE_DIR=str(tmp_path))
    assert found["forces"] == warm[1]["forces"]
    assert found["used"]["magnet_forces"]
    if not found["used"]["no_drive"]:  # a bit of an index may not matter
        again = python(BOND, TBSA_CACHE_DIR=str(tmp_path))
        assert all(again["used"].values())
    else:
        assert (kind, damage) == ("nbi", "a flipped bit")


def test_a_helper_of_arrays_cannot_be_called_from_python():
    """It has no wrapper for that; without the check this would end the process."""
    with pytest.raises(TypeError, match="remember takes arrays"):
        rows.remember(None, 0, None, 0, 0)
    assert geometry.cos_sin(0.0) == (1.0, 0.0)


def test_numba_is_as_it_was_once_a_kernel_is_compiled():
    """And finds for numbers what it has always found."""
    before, status = types.BaseFunction.get_call_type, CPUCallConv._get_return_status
    context = cpu_target.typing_context
    context.refresh()
    plus = context.resolve_value_type(operator.add)
    with jit._as_kernels_are():
        assert types.BaseFunction.get_call_type is not before
        assert CPUCallConv._get_return_status is not status
        for a, b in itertools.product((types.int64, types.uint64, types.float64, types.boolean),
                                      repeat=2):
            found = [plus.get_call_type(context, (a, b), {}) for _ in range(2)]
            assert found[0] == found[1] == before(plus, context, (a, b), {})
    assert types.BaseFunction.get_call_type is before
    with pytest.raises(RuntimeError), jit._as_kernels_are():
        raise RuntimeError
    assert types.BaseFunction.get_call_type is before
    assert CPUCallConv._get_return_status is status


def test_every_loop_of_a_rolled_helper_is_kept_from_being_unrolled():
    """Each jump back has the note, under a name of its own; what jumps forward has none."""
    code = """define void @two(i64 %n) {
entry:
  br label %outer
outer:
  br label %inner
inner:
  %more = icmp eq i64 %n, 0
  br i1 %more, label %inner, label %end
end:
  %again = icmp eq i64 %n, 1
  br i1 %again, label %outer, label %out
out:
  ret void
}
define void @none() {
inner:
  br label %end
end:
  ret void
}
"""
    marked = jit.keep_loops(code)
    notes = [line.rpartition("!llvm.loop ")[2] for line in marked.splitlines() if "!llvm" in line
             and "br " in line]
    assert len(notes) == len(set(notes)) == 2
    assert "label %inner, label %end, !llvm.loop" in marked
    assert "label %outer, label %out, !llvm.loop" in marked
    module = llvmlite.binding.parse_assembly(marked)
    module.verify()
    assert str(module).count("llvm.loop.unroll.disable") == 1
    assert jit.keep_loops("define void @f() {\n  ret void\n}").count("!") == 0


def mark_deep(r, low):
    some = 0
    for i in range(U(4)):
        deep = (r[i] + r[i + U(4)] < low) & (r[i + U(8)] > 0.5)
        r[i + U(12)] = 1.0 if deep else 0.0
        r[i + U(16)] = 0.0 if r[i] > 0.0 else r[i + U(16)]
        some += 1 if deep else 0
    return some


@pytest.mark.parametrize(("mark", "vectors"), [(jit.rolled, True), (jit.lane, False)])
def test_a_short_loop_of_a_rolled_helper_becomes_vector_code(mark, vectors):
    """Whose arithmetic is on several numbers at a time; unrolled, it is on one after the other."""
    helper, r = mark(mark_deep), np.ones(24)

    def call(r, low):
        r = arrays.lean(r)
        return helper(r, low) + helper(r, -low)

    kernel = jit._compiled(call, jit._SoloCompiler)
    assert kernel(r, 3.0) == 4
    code = "".join(kernel.inspect_llvm().values())
    assert bool(re.search(r"fadd <\d+ x double>", code)) == vectors


# tbsa warmup.


def test_warmup_compiles_everything_and_says_so():
    command = [sys.executable, "-m", "tbsa.work.cli", "warmup"]
    outputs = [subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True,
                              timeout=600).stdout for _ in range(2)]
    folder = str(jit.cache_folder())
    assert all(output.endswith(f"kept in {folder}\n") for output in outputs)
    assert outputs[1].startswith("there already: ")
    assert "; loaded in " in outputs[1]
    named = set(outputs[1].splitlines()[0].partition(": ")[2].partition(";")[0].split(", "))
    kernels = set()
    for path in (PACKAGE / "kernels").glob("*.py"):
        module = importlib.import_module(f"tbsa.kernels.{path.stem}")
        kernels |= {name for name, value in vars(module).items()
                    if isinstance(getattr(value, "_cache", None), jit._Cache)
                    and value.py_func.__module__ == module.__name__}
    engines = {name for name, value in vars(drives).items() if inspect.isfunction(value)
               and list(inspect.signature(value).parameters)[-3:] == ["fx", "fy", "torque"]}
    assert named == kernels | engines


# tbsa run --report.

SCENE = tbsa.parse('[tiles]\nset = "chessboard"\n[[free.tile]]\ntype = "black"\n'
                   "position = [0, 0]\n[solver]\nstep = 0.01\nsubsteps = 4\n[run]\nduration = 1\n")


def table(text):
    """The rows of a report: {what: (count, share)}."""
    rows = {}
    for line in text.splitlines():
        what, *rest = re.split(r" {2,}", line)
        if rest:
            rows[what] = rest
    return rows


def test_the_report_of_a_run_has_every_counter_that_is_there():
    counts = {"steps": 100, "substeps": 400, "lists": 5, "rows": 800, "passes": 600,
              "unconverged": 4, "impacts": 40, "projections": 8, "overlap": [300, 60, 20, 16, 4],
              "deepest": 3e-4, "solves": 1000, "unsolved": 600, "magnet_pairs": 300,
              "magnet_lists": 20, "joined": 100, "new_one": 200}
    text = work(counts, SCENE, wall=0.02)
    rows = table(text)
    assert rows["substeps"] == ["400", "50 us of wall time each"]
    assert rows["lists of near pairs built"] == ["5", "0.05 a step"]
    assert rows["manifolds solved"] == ["800", "2 a substep"]
    assert rows["substeps at the limit of passes"] == ["4", "1 %"]
    assert rows["manifolds in all passes"] == ["1000", "2.5 a substep"]
    assert rows["manifolds that had converged, or in flight"] == ["600", "60 % of 1000"]
    assert rows["magnet pairs with a force computed"] == ["300", "3 a step"]
    assert rows["steps with an older list of near pairs, at least"] == ["95", "95 % of 100"]
    # Forces are found twice a step.
    assert rows["times an older list of magnet pairs was used"] == ["180", "90 % of 200"]
    assert rows["time with overlap beyond 0.1 %"] == ["10 %; deepest 1 % of the width"]
    assert rows["substeps joined with others in calm scenes"] == ["100", "20 % of 500"]
    assert rows["new_one"] == ["200", "0.5 a substep"]
    assert text.endswith("not computed: magnets, wall, floor friction, drive")


def test_the_report_of_a_resumed_run_divides_what_this_process_did_by_its_own_steps():
    rows = table(work({"steps": 100, "substeps": 400, "lists": 5, "magnet_lists": 20,
                       "magnet_pairs": 300, "surprises": 10}, SCENE, wall=0.02, since=60))
    assert rows["lists of near pairs built"] == ["5", "0.125 a step since step 60"]
    assert rows["magnet pairs with a force computed"] == ["300", "7.5 a step since step 60"]
    assert rows["steps with an older list of near pairs, at least"] == ["35", "87.5 % of 40"]
    assert rows["times rows were added or found again within a step"] == ["10", "0.1 a step"]


def test_the_report_of_a_run_passes_over_counters_that_are_not_there():
    text = work({"substeps": 0, "rows": 0}, SCENE, wall=0.0)
    assert set(table(text)) == {"work done", "substeps", "manifolds solved"}
    assert "left out" not in text


def test_every_counter_of_the_core_has_its_words():
    from tbsa.kernels.state import Counts
    from tbsa.work.report import _SHOWN_WITH_OTHERS

    assert set(Counts._fields) <= {*DONE, *LEFT_OUT, *_SHOWN_WITH_OTHERS}


def test_run_with_a_report(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = ('[tiles]\nset = "chessboard"\n[magnet]\n[floor]\n'
            '[[free.tile]]\ntype = "black"\nposition = [0, 0]\nvelocity = [0.2, 0]\n'
            '[[free.tile]]\ntype = "white"\nposition = [0.04, 0]\n'
            "[record]\ninterval = 0.1\n[run]\nduration = 0.2\n")
    (tmp_path / "scene.toml").write_text(text)
    assert cli.main(["run", "scene.toml", "--quiet"]) == 0
    assert "work done" not in capsys.readouterr().out
    assert cli.main(["run", "scene.toml", "--out", "out", "--quiet", "--report"]) == 0
    out = capsys.readouterr().out
    counts = json.loads((tmp_path / "out" / "run.json").read_text())["counts"]
    rows = table(out)
    assert rows["substeps"][0] == str(counts["substeps"])
    assert rows["manifolds solved"][0] == str(counts["rows"])
    assert counts["rows"] > 0
    assert np.isclose(float(rows["manifolds solved"][1].split()[0]),
                      counts["rows"] / counts["substeps"], rtol=1e-2)
    assert "not computed: wall, drive" in out
