"""A small vector layer: numba intrinsics written as if they were numpy, compiled to LLVM vectors of 16 or 32 bytes.

The loop vectoriser of LLVM may or may not understand a loop over bytes; here the width is part of the program, so that
speed and bits are the same wherever the same instructions exist. A kernel works on rows of TILE = 32 pixels in pieces of
LANES: 32 where the CPU has registers for it (AVX2 and later), else 16 (NEON, SSE). All arithmetic is on whole bytes or
16-bit numbers and wraps, except where it says saturating; the lanes never mix, so the width does not change the result.

    @kernel(arrays=2, numbers=1)
    def brighten(code: Code, source: Memory, target: Memory, at: Value) -> None:
        for piece in PIECES:
            target.store(at + piece, source.load(at + piece, BYTES).add_saturating(10))

`brighten(source, target, at)` can then be called from compiled code. Memory is addressed in bytes and not checked: who
calls sizes the arrays. numba caches machine code by the file of the caller: after a change here, clear the caches.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from prismstereo_device.match.tiles.values import BYTES, FLOATS, LANES, NUMBER, SHORTS, TILE, WORDS, Value

__all__ = ["BYTES", "FLOATS", "LANES", "PIECES", "SHORTS", "TILE", "WORDS", "Code", "Memory", "Value", "kernel"]

_ir: Any = cgutils  # untyped
PIECES = range(0, TILE, LANES)


class Memory:
    """An array of the program, addressed in bytes."""

    __slots__ = ("builder", "dtype_bits", "start")

    def __init__(self, builder: Any, start: Any, dtype_bits: int) -> None:
        self.builder, self.start, self.dtype_bits = builder, start, dtype_bits

    def _at(self, at: Value, kind: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(self.start, [at.ir]), kind.as_pointer())

    def behind(self, at: Value) -> Memory:
        """Return the memory that starts `at` bytes further on."""
        return Memory(self.builder, self.builder.gep(self.start, [at.ir]), self.dtype_bits)

    def load(self, at: Value, kind: Any = BYTES) -> Value:
        """Read a vector of this kind."""
        value = self.builder.load(self._at(at, kind))
        value.align = 1
        return Value(self.builder, value)

    def store(self, at: Value, value: Value) -> None:
        """Write a vector."""
        self.builder.store(value.ir, self._at(at, value.ir.type)).align = 1

    def prefetch(self, at: Value) -> None:
        """Ask for the cache line of this byte; it need not be inside of the array."""
        word = ir.IntType(32)
        function = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), word, word, word])
        called = _ir.get_or_insert_function(self.builder.module, function, "llvm.prefetch.p0i8")
        reading, keep, data = (ir.Constant(word, value) for value in (0, 3, 1))
        self.builder.call(called, [self.builder.gep(self.start, [at.ir]), reading, keep, data])

    def spread(self, at: Value) -> Value:
        """Read one byte into all lanes."""
        value = self.builder.zext(self.builder.load(self.builder.gep(self.start, [at.ir])), NUMBER)
        return Value(self.builder, value).everywhere(BYTES)

    def number(self, index: Value) -> Value:
        """Read the `index`-th 32-bit signed number."""
        value = self.builder.load(self._at(index * 4, ir.IntType(32)))
        return Value(self.builder, self.builder.sext(value, NUMBER))

    @property
    def kind(self) -> Any:
        """The vector kind of the array's own elements, bytes or shorts."""
        return BYTES if self.dtype_bits == 8 else SHORTS

    @property
    def bytes_each(self) -> int:
        """The bytes of one element."""
        return self.dtype_bits // 8


class Variable:
    """A vector that a loop changes; it lives in a register."""

    __slots__ = ("_builder", "_place")

    def __init__(self, builder: Any, kind: Any, first: int) -> None:
        self._builder = builder
        self._place = _ir.alloca_once(builder, kind)
        builder.store(ir.Constant(kind, [first] * kind.count), self._place)

    @property
    def value(self) -> Value:
        """What it holds now."""
        return Value(self._builder, self._builder.load(self._place))

    @value.setter
    def value(self, new: Value) -> None:
        self._builder.store(new.ir, self._place)


class Code:
    """The program that is being written."""

    __slots__ = ("builder",)

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def number(self, value: int) -> Value:
        """Return a 64-bit constant."""
        return Value(self.builder, ir.Constant(NUMBER, value))

    def constant(self, kind: Any, value: int) -> Value:
        """Return a vector with the same number in all lanes."""
        return Value(self.builder, ir.Constant(kind, [value] * kind.count))

    def counted(self, kind: Any) -> Value:
        """Return the vector 0, 1, 2, ..."""
        return Value(self.builder, ir.Constant(kind, list(range(kind.count))))

    def variable(self, kind: Any, first: int) -> Variable:
        """Make a variable that starts with `first` in all lanes."""
        return Variable(self.builder, kind, first)

    @contextmanager
    def each(self, count: Value) -> Iterator[Value]:
        """Repeat what is written in this block for 0 .. count - 1."""
        with _ir.for_range(self.builder, count.ir) as loop:
            yield Value(self.builder, loop.index)


def total(values: list[Value]) -> Value:
    """Return the sum."""
    return reduce(Value.__add__, values)


def kernel(*, arrays: int, numbers: int, returns: bool = False) -> Callable[[Callable[..., Value | None]], Any]:
    """Make an intrinsic of `body(code, *arrays, *numbers)`: so many arrays, then so many 64-bit numbers.

    With `returns` it gives back the number that the body returns, else nothing.
    """

    def decorate(body: Callable[..., Value | None]) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            values: list[Memory | Value] = []
            for kind, value in zip(signature.args, given, strict=True):
                if isinstance(kind, types.Array):
                    start = context.make_array(kind)(context, builder, value).data
                    start = builder.bitcast(start, ir.IntType(8).as_pointer())
                    values.append(Memory(builder, start, kind.dtype.bitwidth))
                else:
                    values.append(Value(builder, value))
            result = body(Code(builder), *values)
            return context.get_dummy_value() if result is None else result.ir

        def definition(_context: Any, *given: Any) -> Any:
            wanted = given[:arrays] + (types.int64,) * numbers
            return (types.int64 if returns else types.void)(*wanted), generate

        names = [
            "context",
            *(f"array{index}" for index in range(arrays)),
            *(f"number{index}" for index in range(numbers)),
        ]
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
        definition.__signature__ = inspect.Signature([inspect.Parameter(name, kind) for name in names])  # type: ignore[attr-defined]
        definition.__name__ = definition.__qualname__ = body.__name__
        definition.__module__, definition.__doc__ = body.__module__, body.__doc__
        return intrinsic(definition)

    return decorate
