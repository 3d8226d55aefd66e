"""The one place that owns Numba's options and the folder of its disk cache.

Numba's disk cache looks at the file of the function that is called, not at the helpers it
calls from other files; an edited helper would silently not take effect.  The cache folder is
therefore named by a hash over all kernel sources, over the versions of Numba and Python, and over
the processor, so that a kernel has one entry in it, whichever computers share it.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import os
import pickle
import re
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from llvmlite.binding import Linkage
from numba.core import cgutils, event, sigutils, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.callconv import CPUCallConv
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.lowering import Lower
from numba.core.postproc import PostProcessor
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.typed_passes import InlineOverloads
from numba.core.untyped_passes import InlineClosureLikes
from numba.experimental import function_type  # noqa: F401 - what a drive is as an argument

# An index that came out of an array: unsigned, as the constants that places are counted with, or
# Numba would make a float of their sum.
U = np.uintp
# As arguments, or where a number begins that becomes one: a plain 0, True or False has a type of
# its own, and a helper would be compiled once more for it.
ZERO: Any = np.int64(0)
YES: Any = np.bool_(True)
NO: Any = np.bool_(False)

config: Any = numba.config
njit: Any = numba.njit  # its stubs know fewer options than it has

# All that is kept on disk, by name, kernels and the drives in use: whether it was there when it
# was first needed; None before.
KERNELS: dict[str, bool | None] = {}
_LOCK = threading.Lock()  # of Numba's one setting of where it is kept


def source_hash(folder: Path = Path(__file__).parent) -> str:
    """Hash of every kernel source in `folder` and of what compiles them, and for what."""
    cpu = llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:3]} {cpu}".encode())
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path | None:
    """The folder of the compiled kernels; None where nothing can be written.

    Below ``TBSA_CACHE_DIR`` or the user's cache folder, never in the package, which may be
    installed read-only; where that cannot be written (a read-only home), a folder of the user's
    own among the temporary files.
    """
    base = os.environ.get("TBSA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    user = os.getuid() if hasattr(os, "getuid") else ""
    name = source_hash()
    last = Path(tempfile.gettempdir()) / f"tbsa-{user}"
    # Who has no home (no HOME, nor an entry among the users) has "~" as it stands.
    home = Path(os.path.expanduser("~/.cache"))
    for root in (Path(base) if base else home if home.is_absolute() else last, last):
        folder = root / "tbsa" / name
        try:
            root.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            # What is loaded from there is run: it must not be somebody else's, nor in a folder of
            # somebody else's where everybody writes.
            mine = {folder.stat().st_uid, root.lstat().st_uid if root == last else user}
            if user == "" or mine <= {user, 0}:
                return folder
        except OSError:
            continue
    return None


_PUT_OFF: list[int] = []  # signals that have come in `undisturbed`, and wait
_HANDLERS: dict[int, Any] = {}  # what they are for, while it is in charge


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Put off Ctrl-C and SIGTERM while LLVM is at work, to its end or to the next `may_end`.

    An exception of theirs in the middle of what LLVM calls back is lost, or leaves LLVM with half
    of a kernel, and the process crashes where it calls that.  Signals are the main thread's.
    """
    if _HANDLERS or not _in_main_thread():
        yield
        return
    try:
        for number in (int(signal.SIGINT), int(signal.SIGTERM)):
            if signal.getsignal(number) is not None:  # else it is not of Python's
                _HANDLERS[number] = signal.signal(number, lambda each, _: _PUT_OFF.append(each))
        yield
    finally:
        for number, handler in _HANDLERS.items():
            signal.signal(number, handler)
        _HANDLERS.clear()
        put_off = set(_PUT_OFF)
        _PUT_OFF.clear()
        for number in put_off:
            signal.raise_signal(number)


def may_end() -> None:
    """Where compilation may be broken off: what has been put off comes now."""
    while _HANDLERS and _PUT_OFF and _in_main_thread():
        number = _PUT_OFF.pop()
        handler = _HANDLERS[number]
        if callable(handler):
            handler(number, None)
        else:
            signal.signal(number, handler)
            signal.raise_signal(number)


class _Files(IndexDataCacheFile):
    """Numba's files, with a checksum at their end: a flipped bit in machine code would be run."""

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        data = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(data[:-32]).digest() != data[-32:]:
            raise ValueError(f"{name} is damaged")
        return pickle.loads(data)


class _Cache(FunctionCache):
    """Numba's disk cache, as a help that is never in the way.

    What cannot be read (damaged) is compiled and written anew; what cannot be written (a full
    disk) is compiled again the next time.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file.__class__ = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept for a signature, or None."""
        try:
            with undisturbed():
                # All that compiled code asks of Numba; what compiles reads its tables by itself.
                rtsys.initialize(target_context)
                found = self._load_overload(sig, target_context)
        except Exception:  # a damaged file raises whatever its bytes happen to mean
            found = None
            with contextlib.suppress(OSError):
                self.flush()
        KERNELS[self._py_func.__name__] = found is not None
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for a signature."""
        with contextlib.suppress(OSError), undisturbed():
            super().save_overload(sig, data)


@functools.cache
def _folder() -> str | None:
    found = cache_folder()
    return str(found) if found else None


def _cached(compiled: Any, function: Callable[..., Any]) -> Any:
    """Have what a dispatcher or callback compiles kept on disk."""
    KERNELS[function.__name__] = None
    if _folder() is not None:
        with _LOCK:
            before, config.CACHE_DIR = config.CACHE_DIR, _folder()
            try:
                compiled._cache = _Cache(function)
            finally:
                config.CACHE_DIR = before
    return compiled


class _Raw(JITCodeLibrary):
    """The code of a helper as it was lowered, with that of its own helpers.

    Numba would run all of LLVM's passes over it, again over every helper that calls it, and make
    machine code each time that nobody runs.  Here the passes run once, over the kernel that has
    taken everything in.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        """Make the code small before it is handed on; the rest is for the kernel's passes."""
        before, config.OPT = config.OPT, type(config.OPT)(1)
        try:
            super()._optimize_functions(ll_module)
        finally:
            config.OPT = before

    def finalize(self) -> None:
        """Take in what it calls, and leave it at that."""
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> _Raw:
        """Where Numba sets the environment of what it has compiled, see `set_env`."""
        return self

    def set_env(self, env_name: str, env: Any) -> None:
        """Nothing: helpers need no environment, and there is no machine code that has one."""


class _RawApart(_Raw):
    """The same of a helper that is to stay a function of its own."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Tell LLVM before its helpers are there, which may become part of it."""
        for function in ir_module.functions:
            if not function.is_declaration:
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)


class _RawRolled(_Raw):
    """The same of a helper whose loops are to become vector code."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Tell LLVM before it sees them that short ones are not to be unrolled."""
        module = llvmlite.binding.parse_assembly(keep_loops(str(ll_module)))
        module.name = ll_module.name
        super().add_llvm_module(module)


def keep_loops(code: str) -> str:
    """LLVM's code of a function with the note on every jump back that its loop is not to be
    unrolled: each has a name of its own, which is that of a list that begins with itself."""
    lines, seen = code.splitlines(), set[str]()
    names: list[str] = []
    for i, line in enumerate(lines):
        label = re.match(r'"?([^\s":]+)"?:', line)
        if label:
            seen.add(label.group(1))
        elif line.startswith("define"):
            seen = set()
        elif line.lstrip().startswith("br ") and seen & set(re.findall(r'%"?([^\s",]+)', line)):
            names.append(f"!{10**6 + len(names)}")
            lines[i] = f"{line}, !llvm.loop {names[-1]}"
    note = f"!{10**6 - 1}"
    lines += [f"{name} = distinct !{{{name}, {note}}}" for name in names]
    lines += [f'{note} = !{{!"llvm.loop.unroll.disable"}}'] if names else []
    return "\n".join(lines)


class _Whole(JITCodeLibrary):
    """The code of a kernel, with that of all its helpers."""

    def _optimize_final_module(self) -> None:
        """Nobody else calls the helpers: they are handed only what they need.

        A tuple of 25 arrays is 175 arguments otherwise, and a step of a single tile took three
        times as long.  Their names go with it: LLVM's linker takes a function that another module
        brings along for the first of that name, internal or not, and would call this one with
        arguments that it no longer has.
        """
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal
                function.name = f"{self.name}.{function.name}"
        super()._optimize_final_module()
        may_end()


NEEDLESS = {InlineClosureLikes, InlineOverloads}


class _PartCompiler(Compiler):
    """Numba's compiler, for helpers.

    What differs between kernels and helpers is set only here: Numba compiles `min`, `max` and the
    like once for each set of options that it meets.
    """

    kind: type[JITCodeLibrary] = _Raw
    always_inline, called_by_python = False, False

    def define_pipelines(self) -> Any:
        """What Numba does with every function, but for looking for closures and for functions that
        are to become part of another one before types are known; nobody writes either."""
        may_end()
        state = self.state
        state.library = self.kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        state.flags.forceinline = self.always_inline
        state.flags.no_cpython_wrapper = not self.called_by_python
        pipelines = super().define_pipelines()
        for each in pipelines:
            each.passes = [one for one in each.passes if one[0] not in NEEDLESS]
        return pipelines


class _LaneCompiler(_PartCompiler):
    always_inline = True


class _RolledCompiler(_LaneCompiler):
    kind = _RawRolled


class _ApartCompiler(_PartCompiler):
    kind = _RawApart


# The types of what operations and functions make of numbers.
_TYPED: dict[tuple[Any, tuple[Any, ...]], Any] = {}


def _nothing(*_: Any, **__: Any) -> None:
    """Instead of what need not be done."""


@contextlib.contextmanager
def _as_kernels_are() -> Iterator[None]:
    """While a kernel is compiled, leave out what it does not need, a quarter of the time.

    The type of an operation on numbers is found once for all its places: Numba looks through
    NumPy's tables at each of them, though there are a few hundred kinds of tens of thousands.
    Nothing tells where a variable is not needed any more, as no references are counted; nobody asks
    LLVM for the size of a variable, which is for debuggers, or listens to when LLVM is called.
    Python does not look for garbage again and again among what is all in use (200 MB more).  After
    a call of a helper nobody asks whether it has raised, which none does: loops over lanes would
    have several ways back, until LLVM finds out, and by then has lost the note that `keep_loops`
    makes.
    """
    of_all: Any = types.BaseFunction
    find_type, status_of = of_all.get_call_type, CPUCallConv._get_return_status

    def remembered(self: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        if kws or not all(isinstance(each, (types.Number, types.Boolean)) for each in args):
            return find_type(self, context, args, kws)
        if (self, args) not in _TYPED:
            _TYPED[self, args] = find_type(self, context, args, kws)
        return _TYPED[self, args]

    def no_error(self: Any, *args: Any) -> Any:
        return status_of(self, *args)._replace(is_error=cgutils.false_bit)

    def space(self: Any, name: str, kind: Any, **_: Any) -> Any:
        return cgutils.alloca_once(self.builder, kind, name=name, zfill=False)

    changes: list[tuple[Any, str, Any]] = [
        (of_all, "get_call_type", remembered), (CPUCallConv, "_get_return_status", no_error),
        (PostProcessor, "_insert_var_dels", _nothing), (event, "broadcast", _nothing),
        (Lower, "alloca_lltype", space)]
    collecting = gc.isenabled()
    with contextlib.ExitStack() as stack:
        if collecting:
            stack.callback(gc.enable)
            gc.disable()
        for place, name, instead in changes:
            stack.callback(setattr, place, name, getattr(place, name))
            setattr(place, name, instead)
        yield


class _KernelCompiler(_PartCompiler):
    kind, called_by_python = _Whole, True

    def compile_extra(self, func: Any) -> Any:
        """What Numba does under its lock: nothing else is compiled meanwhile."""
        with undisturbed(), _as_kernels_are():
            return super().compile_extra(func)


class _SoloCompiler(_KernelCompiler):
    def define_pipelines(self) -> Any:
        """What Numba does with every function, where no two arguments share memory."""
        pipelines = super().define_pipelines()
        self.state.flags.noalias = True
        return pipelines


class _Part(CPUDispatcher):
    """A function that other kernels call."""

    def __call__(self, *args: Any) -> Any:
        """A helper of numbers is compiled once more, by itself, as in tests.

        The wrapper of one that takes arrays, many of them in tuples, would take as long to
        compile as the helper.
        """
        if not _of_numbers(self.py_func):
            raise TypeError(f"{self.py_func.__name__} takes arrays and is part of other kernels: "
                            "it can only be called by jitted functions")
        return _alone(self.py_func)(*args)


def _of_numbers(function: Callable[..., Any]) -> bool:
    kinds = {kind for name, kind in function.__annotations__.items() if name != "return"}
    return kinds <= {"int", "float", "bool"}


def _jit(function: Callable[..., Any], **options: Any) -> Any:
    """Jit without the GIL, without the wrapper for C, which nobody calls, and without a search for
    arithmetic of whole arrays, which nobody writes.

    No fastmath: results keep to the bit across builds, and ``isnan`` tells the truth.
    """
    return njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_rewrites=True,
                **options)(function)


_alone = functools.cache(_jit)


def _compiled(function: Callable[..., Any], compiler: type[_PartCompiler]) -> Any:
    """Jit a kernel or a helper; they allocate nothing, so that no references are counted."""
    return _jit(function, no_cpython_wrapper=True, _nrt=False, pipeline_class=compiler)


def kernel(function: Callable[..., Any]) -> Any:
    """Jit a function that Python calls: cached on disk, runs without the GIL."""
    return _cached(_compiled(function, _KernelCompiler), function)


def solo(function: Callable[..., Any]) -> Any:
    """Jit a kernel of which no two arrays overlap, and none is written by another thread meanwhile.

    LLVM takes that for granted; else it asks before every loop of vector code which of its arrays
    overlap: 100 to 150 of the 1,400 ns that an impact of two tiles takes.
    """
    return _cached(_compiled(function, _SoloCompiler), function)


def inline(function: Callable[..., Any], compiler: type[_PartCompiler] = _PartCompiler) -> Any:
    """Jit a helper of other kernels; compiled into its callers."""
    part = _compiled(function, compiler)
    if isinstance(part, CPUDispatcher):  # not with Numba switched off
        part.__class__ = _Part
    return part


def lane(function: Callable[..., Any]) -> Any:
    """Jit a helper that is always part of its caller: scalar code of a loop over lanes, so that the
    loop can become vector code; loops that threads share; and what a single impact goes through, as
    a call that hands on dozens of arrays takes 30 to 90 ns."""
    return inline(function, _LaneCompiler)


def rolled(function: Callable[..., Any]) -> Any:
    """Jit a helper like `lane`, whose loops over the lanes of a block, or over tiles, are to become
    vector code.

    LLVM unrolls a loop of four before it looks for vectors, unless it is long, and then finds none:
    what `projection.find_deep` does took more than twice as long.
    """
    return inline(function, _RolledCompiler)


def apart(function: Callable[..., Any]) -> Any:
    """Jit a helper that runs seldom and stays out of its callers: what is in a loop is slower for
    all that stands beside it."""
    return inline(function, _ApartCompiler)


def entry(compiled: Any) -> Any:
    """What a kernel with one signature runs, without a look at the types of its arguments.

    For the caller who knows them: looking at tuples of 150 arrays takes 26 of the 31 us of a call.
    A kernel that has not run yet, has several signatures, or is not compiled, is returned as it is.
    """
    overloads = list(getattr(compiled, "overloads", {}).values())
    return overloads[0].entry_point if len(overloads) == 1 else compiled


def _with_helpers(found: Any, seen: list[Any]) -> list[Any]:
    """What Numba has noted of a function and of all jitted ones that it calls."""
    if not any(found is each for each in seen):
        seen.append(found)
        for kind in getattr(found, "typemap", {}).values():
            if isinstance(kind, types.Dispatcher):
                for overload in kind.dispatcher.overloads.values():
                    _with_helpers(overload.type_annotation, seen)
    return seen


def _may_write(found: Any) -> bool:
    """Whether a function does what Numba lets write into what is read-only."""
    if isinstance(found, str):  # of one that was on disk
        return re.search(r"attr=flat|nditer|fill_diagonal|function dot", found) is not None
    kinds, calls = found.typemap, found.calltypes
    over = [array for kind in kinds.values() for array in (
        [kind.array_type] if isinstance(kind, types.NumpyFlatType)
        else kind.arrays if isinstance(kind, types.NumpyNdIterType) else ())]
    called = [(repr(kinds[call.func.name]), signature.args) for call, signature in calls.items()
              if getattr(call, "op", "") == "call"]
    return (any(not getattr(array, "mutable", True) for array in over)
            or any("function fill_diagonal" in name and not arguments[0].mutable
                   for name, arguments in called)
            or any("function dot" in name and len(arguments) == 3 for name, arguments in called))


class _OfUser(CFunc):
    """A function of a user's as a callback: its indices are checked, and it can raise anything.

    What is made of more than fixed text needs objects of Python, the environment, which Numba sets
    for functions that Python calls, but not for callbacks; without them it would wait for ever,
    with the GIL.
    """

    def __init__(self, function: Callable[..., Any], signature: Any) -> None:
        super().__init__(function, sigutils.normalize_signature(signature), locals={},
                         options={"error_model": "numpy", "boundscheck": True})

    def _compile_uncached(self) -> Any:
        result = super()._compile_uncached()  # type: ignore[misc]
        result.library.finalize()  # or the place of its environment is not known
        result.library.codegen.set_env(result.fndesc.env_name, result.environment)
        self.writes = any(map(_may_write, _with_helpers(result.type_annotation, [])))
        return result


@undisturbed()
def callback(signature: Any, function: Callable[..., Any], guarded: Any) -> Any:
    """Compile `function` as a first-class function of one signature.

    The package's own are cached on disk; a user's may call what no hash of ours sees change.  It
    is compiled as `guarded`, the same signature in which arrays that are not to be written are
    read-only.

    Raises
    ------
    TypeError
        Where a user's function does what a run cannot bear; what Numba cannot compile raises
        whatever Numba does.
    """
    if config.DISABLE_JIT:
        return function
    if Path(function.__code__.co_filename).parent == Path(__file__).parent:
        compiled: Any = CFunc(function, sigutils.normalize_signature(signature), locals={},
                         options={"error_model": "numpy", "boundscheck": False})
        _cached(compiled, function)
        compiled.compile()
        return compiled
    compiled = _OfUser(function, guarded)
    try:
        compiled.compile()
    except Exception:  # of many kinds and words, where it writes into what is read-only
        _OfUser(function, signature).compile()
        raise TypeError("it must not write into anything but fx, fy and torque") from None
    if compiled.writes:
        raise TypeError("it must not use .flat, np.nditer, np.fill_diagonal or a third argument of "
                        "np.dot, which may write into anything, but for fx, fy and torque")
    code = compiled.inspect_llvm()
    if "PySys_FormatStdout" in code:
        raise TypeError("it must not print")
    if "PyObject_Call" in code:
        raise TypeError("it must not go back to Python, as with objmode")
    if re.search(r"@numba_\w*random", code):
        raise TypeError("it must not use random numbers: the same scene gives the same run")
    compiled._sig = signature  # to whoever calls it there is no difference
    return compiled
