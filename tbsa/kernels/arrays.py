"""Arrays as kernels see them, and what is done to whole ones.

Python hands kernels NumPy's arrays, many of them in tuples.  A kernel makes `lean` ones of them
first, and its helpers know no others.  Numba's own array has seven parts, and an index of it may
count from the end; all of that is handed on and looked at wherever an array is used, which was half
of the code that LLVM got.  A lean one is a place in memory: a third less time to compile, and a
tenth less for a step of one or two tiles.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    register_model,
)

from tbsa.kernels.jit import U, config, inline

NAMED: Any = types.BaseNamedTuple


class Lean(types.Type):
    """The type of an array inside kernels: where its numbers begin.

    It has ``a[i]`` with whole numbers from 0 on, unchecked; nothing else.
    """

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(f"lean({dtype})")


register_model(Lean)(models.PointerModel)


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of ``a[i]``."""
        fits = isinstance(args[0], Lean) and isinstance(args[1], types.Integer)
        return signature(args[0].dtype, *args) if fits else None


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, _: Any) -> Any:
        """The type of ``a[i] = value``."""
        fits = isinstance(args[0], Lean) and isinstance(args[1], types.Integer)
        return signature(types.none, *args[:2], args[0].dtype) if fits else None


def place(context: Any, builder: Any, kinds: Any, arguments: Any) -> Any:
    """Where a number of an array is."""
    index = context.cast(builder, arguments[1], kinds[1], types.intp)
    return builder.gep(arguments[0], [index], inbounds=True)


def _get(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    return builder.load(place(context, builder, sig.args, arguments))


def _set(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    builder.store(arguments[2], place(context, builder, sig.args, arguments))
    return context.get_dummy_value()


lower_builtin(operator.getitem, Lean, types.Integer)(_get)
lower_builtin(operator.setitem, Lean, types.Integer, types.Any)(_set)


def _type_of_lean(kind: Any) -> Any:
    """The type of what `lean` makes of a type."""
    if isinstance(kind, NAMED):
        return types.BaseTuple.from_types([_type_of_lean(each) for each in kind],
                                          kind.instance_class)
    if not isinstance(kind, types.Array):
        return kind
    if kind.ndim != 1 or kind.layout != "C":
        raise TypingError(f"{kind} is not an array of one dimension without gaps")
    return Lean(kind.dtype)


def _make_lean(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, NAMED):
        parts = [_make_lean(context, builder, each, builder.extract_value(value, i))
                 for i, each in enumerate(kind)]
        return context.make_tuple(builder, _type_of_lean(kind), parts)
    if not isinstance(kind, types.Array):
        return value
    return cgutils.create_struct_proxy(kind)(context, builder, value=value).data


@intrinsic
def _lean(_: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        return _make_lean(context, builder, sig.args[0], arguments[0])

    return signature(_type_of_lean(value), value), generate


@intrinsic
def _part(_: Any, numbers: Any, n: Any) -> Any:
    kind = types.Array(numbers.dtype, 1, "C")

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        count = context.cast(builder, arguments[1], n, types.intp)
        width = context.get_constant(types.intp, context.get_abi_sizeof(
            context.get_data_type(numbers.dtype)))
        array = context.make_array(kind)(context, builder)
        context.populate_array(
            array, data=arguments[0], shape=cgutils.pack_array(builder, [count]),
            strides=cgutils.pack_array(builder, [width]), itemsize=width, meminfo=None)
        return array._getvalue()

    return signature(kind, numbers, n), generate


def _as_it_is(value: Any) -> Any:
    return value


def _slice(numbers: np.ndarray, n: int) -> np.ndarray:
    return numbers[:n]


# What a kernel has been given, an array or a tuple with arrays in it, as its helpers take it; and
# the first n numbers of a lean array as one of Numba's, for drives.
lean: Any = _as_it_is if config.DISABLE_JIT else _lean
whole: Any = _slice if config.DISABLE_JIT else _part


@inline
def copy(source: np.ndarray, target: np.ndarray, n: int) -> None:
    """Copy n numbers."""
    for i in range(U(n)):
        target[i] = source[i]


@inline
def set_all(target: np.ndarray, n: int, value: float) -> None:
    """Set the first n numbers of an array."""
    for i in range(U(n)):
        target[i] = value


def columns(length: int, kinds: list[type]) -> list[np.ndarray]:
    """Zeroed arrays of one length, one a kind (float, int or that of NumPy), laid out against cache
    conflicts.

    Arrays that each begin on a page of their own fall into the same few sets of the first-level
    cache when they are walked together; here each begins three cache lines further on.
    """
    stride = -(-length // 512) * 512 + 24
    block = np.zeros(stride * len(kinds))
    parts = [block[i * stride : i * stride + length] for i in range(len(kinds))]
    return [part.view(np.dtype(kind))[:length] for part, kind in zip(parts, kinds, strict=True)]
