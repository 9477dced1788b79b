# SPDX-License-Identifier: Apache-2.0
"""SIMD vectors in kernels: scalar code processes several lanes at once.

A kernel loads a `Vector` from an array and uses it like a float; `select` replaces branches. LLVM
maps the vectors to the registers of the processor. ``+ - * /``, unary minus, ``abs``, ``min``,
``max``, ``math.floor``, ``math.copysign``, the comparisons and (slowly) ``math.cos`` and
``math.sin`` act lane by lane; a number has the same value in all lanes. Comparisons return a
`Mask`, which supports ``& | ~``. Lanes are independent of each other.

numba documents neither the conversion of a number to another type (``Conversion``) nor the contexts
that generate code. Only this module uses them; tests/core/test_simd.py fails if a version of numba
changes them.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from numba import TypingError, types
from numba.core.typeconv.castgraph import Conversion
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    register_model,
    type_callable,
)

# Untyped: type checkers would require the typing context, which calls do not pass.
_kernel_function: Final[Any] = intrinsic
_TUPLE: Final[Any] = types.BaseTuple

LANES: Final = 16 if get_host_cpu_features().get("avx512f") else 8
"""Number of lanes per vector. Because the operations of a step depend on each other, 16 lanes take
only 1.3 times as long as 8 lanes in 512-bit registers, and 1.7 times as long in 256-bit registers.
"""

_DOUBLES: Final = ir.VectorType(ir.DoubleType(), LANES)
_BITS: Final = ir.VectorType(ir.IntType(1), LANES)
_INDEX: Final = ir.IntType(32)
# Permit fused multiply-add, and division by multiplication with the reciprocal.
_FLAGS: Final = ("arcp", "contract")
_FLOAT64_BYTES: Final = 8


class Vector(types.Type):
    """Type of a vector with a float64 in each lane."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector({LANES})")

    def can_convert_from(self, typingctx, other):
        """Allow conversion of any number to a vector."""
        return Conversion.safe if isinstance(other, types.Number) else None


class Mask(types.Type):
    """Type of a vector with a boolean in each lane, the result of a comparison."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask({LANES})")


VECTOR: Final = Vector()
MASK: Final = Mask()


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _DOUBLES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _BITS)


@lower_cast(types.Number, Vector)
def _broadcast(context, builder, fromty, toty, val):
    number = context.cast(builder, val, fromty, types.float64)
    nothing = ir.Constant(_DOUBLES, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(
        first, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)
    )


def _register(
    function: Callable[..., Any], operands: int, operand: types.Type, result: types.Type, emit: Any
) -> None:
    """Define an operator or function for lanes; ``emit(builder, *values)`` generates the code."""

    @type_callable(function)
    def type_function(context):
        def unary(a):
            return result(operand) if a == operand else None

        def binary(a, b):
            return result(operand, operand) if operand in (a, b) else None

        return unary if operands == 1 else binary

    @lower_builtin(function, *[type(operand)] * operands)
    def lower(context, builder, sig, args):
        return emit(builder, *args)


def _call(name: str) -> Callable[..., Any]:
    def emit(builder, *values):
        function = builder.module.declare_intrinsic(
            f"llvm.{name}.v{LANES}f64", fnty=ir.FunctionType(_DOUBLES, [_DOUBLES] * len(values))
        )
        return builder.call(function, values)

    return emit


def _arithmetic(name: str) -> Callable[..., Any]:
    return lambda builder, *values: getattr(builder, name)(*values, flags=_FLAGS)


def _compare(symbol: str) -> Callable[..., Any]:
    # As for floats, only "not equal" is true for NaN.
    unordered = symbol == "!="
    return lambda builder, a, b: (
        builder.fcmp_unordered(symbol, a, b) if unordered else builder.fcmp_ordered(symbol, a, b)
    )


def _extreme(symbol: str) -> Callable[..., Any]:
    # As for floats, the result is the first operand if either operand is NaN.
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(symbol, b, a), b, a)


for _operator, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"),
    (operator.isub, "fsub"),
    (operator.imul, "fmul"),
    (operator.itruediv, "fdiv"),
):
    _register(_operator, 2, VECTOR, VECTOR, _arithmetic(_name))
for _operator, _symbol in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _register(_operator, 2, VECTOR, MASK, _compare(_symbol))
_register(operator.neg, 1, VECTOR, VECTOR, lambda builder, a: builder.fneg(a))
_register(abs, 1, VECTOR, VECTOR, _call("fabs"))
_register(math.floor, 1, VECTOR, VECTOR, _call("floor"))
_register(math.cos, 1, VECTOR, VECTOR, _call("cos"))
_register(math.sin, 1, VECTOR, VECTOR, _call("sin"))
_register(math.copysign, 2, VECTOR, VECTOR, _call("copysign"))
_register(operator.and_, 2, MASK, MASK, lambda builder, a, b: builder.and_(a, b))
_register(operator.or_, 2, MASK, MASK, lambda builder, a, b: builder.or_(a, b))
_register(operator.invert, 1, MASK, MASK, lambda builder, a: builder.not_(a))
_register(min, 2, VECTOR, VECTOR, _extreme("<"))
_register(max, 2, VECTOR, VECTOR, _extreme(">"))


@_kernel_function
def select(typingctx, condition, a, b):
    """Return ``a`` in the lanes where ``condition`` is true, else ``b``.

    A scalar condition selects between two floats.
    """
    kind = VECTOR if condition == MASK else types.float64

    def lower(context, builder, sig, args):
        return builder.select(*args)

    return kind(condition, kind, kind), lower


@_kernel_function
def any_lane(typingctx, condition):
    """Return whether a mask is true in any lane, for a branch that all lanes take together."""

    def lower(context, builder, sig, args):
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(MASK), lower


@_kernel_function
def broadcast(typingctx, number):
    """Return a vector with a number in all lanes."""

    def lower(context, builder, sig, args):
        return args[0]

    return VECTOR(VECTOR), lower


@_kernel_function
def load(typingctx, values, start):
    """Return `LANES` values of an array as a vector, beginning at index ``start``.

    ``values`` may be a tuple, named or nested: its arrays become vectors and its numbers remain
    numbers. Arrays must be contiguous, ``(n,)``, with at least ``start + LANES`` values; this is
    not checked.
    """

    def lower(context, builder, sig, args):
        return _load(context, builder, values, *args)

    return _loaded(values)(values, types.intp), lower


def _loaded(kind: Any) -> Any:
    if isinstance(kind, _TUPLE):
        return types.BaseTuple.from_types(
            [_loaded(member) for member in kind.types], getattr(kind, "instance_class", None)
        )
    if isinstance(kind, types.Number):
        return kind
    if isinstance(kind, types.Array) and (kind.ndim, kind.layout) == (1, "C"):
        return VECTOR
    raise TypingError(f"{kind} is neither a number nor a contiguous array of one dimension")


def _load(context: Any, builder: Any, kind: Any, value: Any, start: Any) -> Any:
    if isinstance(kind, _TUPLE):
        members = [builder.extract_value(value, i) for i in range(len(kind.types))]
        return context.make_tuple(
            builder,
            _loaded(kind),
            [
                _load(context, builder, member_kind, member, start)
                for member_kind, member in zip(kind.types, members, strict=True)
            ],
        )
    if isinstance(kind, types.Number):
        return value
    address = builder.gep(context.make_array(kind)(context, builder, value).data, [start])
    return builder.load(
        builder.bitcast(address, _DOUBLES.as_pointer()), align=_FLOAT64_BYTES, typ=_DOUBLES
    )


@_kernel_function
def store(typingctx, array, row, column, vector):
    """Write the lanes of a vector to ``array[row, column]``, ``array[row + 1, column]`` and so on.

    Bounds are not checked.
    """

    def lower(context, builder, sig, args):
        array_value, row, column, lanes = args
        into = context.make_array(array)(context, builder, array_value)
        row_stride, column_stride = (builder.extract_value(into.strides, i) for i in range(2))
        bytes_of = builder.bitcast(into.data, ir.IntType(8).as_pointer())
        offset = builder.add(builder.mul(row, row_stride), builder.mul(column, column_stride))
        for lane in range(LANES):
            builder.store(
                builder.extract_element(lanes, ir.Constant(_INDEX, lane)),
                builder.bitcast(builder.gep(bytes_of, [offset]), into.data.type),
                align=_FLOAT64_BYTES,
            )
            offset = builder.add(offset, row_stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, VECTOR), lower
