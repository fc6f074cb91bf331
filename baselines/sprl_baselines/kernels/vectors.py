"""Eight single-precision numbers at once, for Numba: what its loops do not reliably become by themselves.

A vector is a local variable of a kernel: a register of the processor, or two where registers hold four numbers. The
arrays that vectors are read from and written to are flat and float32, and places in them are not checked.
"""

# ruff: noqa: ARG001, ARG005 - an intrinsic gets the types of what it is called with, whether it looks at them or not

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, cast

from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.extending import models, register_model

LANES: Final = 8
VECTOR: Final = ir.VectorType(ir.FloatType(), LANES)
ZERO: Final = ir.Constant(VECTOR, [0.0] * LANES)
MINUS_ZERO: Final = ir.Constant(VECTOR, [-0.0] * LANES)
UNDEFINED: Final = ir.Constant(VECTOR, ir.Undefined)

Signature = tuple[Any, Callable[..., Any]]  # of an intrinsic, and what builds its instructions


class VectorType(types.Type):
    """The type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"float32x{LANES}")


@register_model(VectorType)
class VectorModel(models.PrimitiveModel):
    """How LLVM holds one."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)  # type: ignore[no-untyped-call] # Numba has no types


vector: Final = VectorType()
place_type: Final = types.int64


def intrinsic(function: Callable[..., Signature]) -> Callable[..., Any]:
    """Make an operation that kernels call without the first argument, by Numba, which has no types."""
    return cast(Callable[..., Any], extending.intrinsic(function))


def _pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    """Return the pointer to a number of an array."""
    return builder.gep(context.make_array(kind)(context, builder, array).data, [place])


def _load(builder: Any, pointer: Any) -> Any:
    loaded = builder.load(builder.bitcast(pointer, VECTOR.as_pointer()))
    loaded.align = 4
    return loaded


def _store(builder: Any, value: Any, pointer: Any) -> None:
    builder.store(value, builder.bitcast(pointer, VECTOR.as_pointer()), align=4)


def _shuffled(builder: Any, first: Any, second: Any, lanes: list[int]) -> Any:
    """Return the given lanes of two vectors; those of the second count from 8 on."""
    return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(ir.IntType(32), LANES), lanes))


@intrinsic
def load(typing: Any, array: Any, place: Any) -> Signature:
    """Return the eight numbers from a place on."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _load(builder, _pointer(context, builder, signature.args[0], *values))

    return vector(array, place_type), build


@intrinsic
def store(typing: Any, array: Any, place: Any, value: Any) -> Signature:
    """Write a vector from a place on."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        _store(builder, values[2], _pointer(context, builder, signature.args[0], *values[:2]))
        return context.get_dummy_value()

    return types.void(array, place_type, vector), build


@intrinsic
def spread(typing: Any, array: Any, place: Any) -> Signature:
    """Return the number at a place, eight times."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        number = builder.load(_pointer(context, builder, signature.args[0], *values))
        first = builder.insert_element(UNDEFINED, number, ir.Constant(ir.IntType(32), 0))
        return _shuffled(builder, first, UNDEFINED, [0] * LANES)

    return vector(array, place_type), build


@intrinsic
def zeros(typing: Any) -> Signature:
    """Return eight zeros."""
    return vector(), lambda context, builder, signature, values: ZERO


@intrinsic
def multiply_add(typing: Any, first: Any, second: Any, summand: Any) -> Signature:
    """Return the product of the first two plus the third, in one instruction where there is one."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind, name = ir.FunctionType(VECTOR, [VECTOR] * 3), f"llvm.fmuladd.v{LANES}f32"
        function = cgutils.get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call] # as above
        return builder.call(function, values)

    return vector(vector, vector, vector), build


@intrinsic
def add(typing: Any, first: Any, second: Any) -> Signature:
    """Return the sum."""
    return vector(vector, vector), lambda context, builder, signature, values: builder.fadd(*values)


@intrinsic
def subtract(typing: Any, first: Any, second: Any) -> Signature:
    """Return the difference."""
    return vector(vector, vector), lambda context, builder, signature, values: builder.fsub(*values)


@intrinsic
def rectified(typing: Any, value: Any) -> Signature:
    """Return 0 where the vector is negative; what is not a number stays so."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", values[0], ZERO), ZERO, values[0])

    return vector(vector), build


@intrinsic
def negated(typing: Any, value: Any) -> Signature:
    """Return the vector with the other sign."""
    return vector(vector), lambda context, builder, signature, values: builder.fsub(MINUS_ZERO, values[0])


@intrinsic
def where_positive(typing: Any, condition: Any, value: Any) -> Signature:
    """Return the second vector where the first is positive, and 0 elsewhere."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", values[0], ZERO), values[1], ZERO)

    return vector(vector, vector), build


@intrinsic
def transpose(typing: Any, source: Any, at: Any, step: Any, target: Any, to: Any, stride: Any) -> Signature:
    """Copy 8x8 numbers: rows that begin `step` apart become columns of rows that begin `stride` apart."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds = signature.args
        rows = [_load(builder, one) for one in _pointers(context, builder, kinds[0], *values[:3])]
        for width in (4, 2, 1):
            rows = _exchanged(builder, rows, width)
        for row, one in zip(rows, _pointers(context, builder, kinds[3], *values[3:]), strict=True):
            _store(builder, row, one)
        return context.get_dummy_value()

    return types.void(source, place_type, place_type, target, place_type, place_type), build


def _pointers(context: Any, builder: Any, kind: Any, array: Any, place: Any, step: Any) -> list[Any]:
    """Return pointers to eight numbers `step` apart."""
    pointers = [_pointer(context, builder, kind, array, place)]
    while len(pointers) < LANES:
        pointers.append(builder.gep(pointers[-1], [step]))
    return pointers


def _exchanged(builder: Any, rows: list[Any], width: int) -> list[Any]:
    """Return the rows with blocks of `width` x `width` numbers exchanged across the diagonal, in each pair of rows."""
    keep_low = [lane if not lane & width else LANES + (lane ^ width) for lane in range(LANES)]
    keep_high = [lane | width if not lane & width else LANES + lane for lane in range(LANES)]
    return [
        _shuffled(builder, rows[row & ~width], rows[row | width], keep_high if row & width else keep_low)
        for row in range(LANES)
    ]
