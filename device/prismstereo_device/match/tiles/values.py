"""Values of a program of vectors: what `lanes` reads, computes and writes, with operators as numpy has them."""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, config

__all__ = ["BYTES", "FLOATS", "LANES", "NUMBER", "SHORTS", "TILE", "WORDS", "Value"]

_ir: Any = cgutils  # untyped
TILE = 32


def _lanes() -> int:
    """Return the bytes of a vector register, at most a tile's row; NUMBA_CPU_NAME decides as it does for numba."""
    named: str | None = getattr(config, "CPU_NAME", None)  # from NUMBA_CPU_NAME
    if named is None or named == "host":
        wide = llvm.get_host_cpu_features().get("avx2", False)
    else:
        wide = named not in _NARROW and not named.startswith(("cortex", "apple", "generic", "neoverse", "atom"))
    return TILE if wide else TILE // 2


_NARROW = frozenset(
    ("x86-64", "x86-64-v2", "core2", "penryn", "nehalem", "westmere", "sandybridge", "ivybridge", "btver2")
)
LANES = _lanes()
BYTES = ir.VectorType(ir.IntType(8), LANES)
SHORTS = ir.VectorType(ir.IntType(16), LANES)
WORDS = ir.VectorType(ir.IntType(32), LANES)
FLOATS = ir.VectorType(ir.FloatType(), LANES)
NUMBER = ir.IntType(64)


def _element(kind: Any) -> Any:
    return kind.element if isinstance(kind, ir.VectorType) else kind


class Value:
    """A vector or a 64-bit whole number of the program that is being written; unsigned unless it says otherwise."""

    __slots__ = ("builder", "ir")

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.ir = builder, value

    def _operand(self, other: Value | int) -> Any:
        if isinstance(other, Value):
            return other.ir
        kind = self.ir.type
        return ir.Constant(kind, [other] * kind.count if isinstance(kind, ir.VectorType) else other)

    def _apply(self, name: str, other: Value | int) -> Value:
        return Value(self.builder, getattr(self.builder, name)(self.ir, self._operand(other)))

    def _compare(self, sign: str, other: Value | int, *, signed: bool = False) -> Value:
        compare = self.builder.icmp_signed if signed else self.builder.icmp_unsigned
        return Value(self.builder, compare(sign, self.ir, self._operand(other)))

    def __add__(self, other: Value | int) -> Value:
        return self._apply("add", other)

    def __sub__(self, other: Value | int) -> Value:
        return self._apply("sub", other)

    def __mul__(self, other: Value | int) -> Value:
        return self._apply("mul", other)

    def __xor__(self, other: Value | int) -> Value:
        return self._apply("xor", other)

    def __or__(self, other: Value | int) -> Value:
        return self._apply("or_", other)

    def __and__(self, other: Value | int) -> Value:
        return self._apply("and_", other)

    def __lshift__(self, bits: int) -> Value:
        return self._apply("shl", bits)

    def __rshift__(self, bits: int) -> Value:
        return self._apply("lshr", bits)

    def __lt__(self, other: Value | int) -> Value:
        return self._compare("<", other)

    def __le__(self, other: Value | int) -> Value:
        return self._compare("<=", other)

    def __gt__(self, other: Value | int) -> Value:
        return self._compare(">", other)

    def same(self, other: Value | int) -> Value:
        """Return where both are equal."""
        return self._compare("==", other)

    def below(self, other: Value | int) -> Value:
        """Return where this is less, both taken as signed."""
        return self._compare("<", other, signed=True)

    def least(self, other: Value | int) -> Value:
        """Return the smaller one."""
        return (self < other).choose(self, other)

    def most(self, other: Value | int) -> Value:
        """Return the larger one."""
        return (self > other).choose(self, other)

    def choose(self, yes: Value | int, no: Value | int) -> Value:
        """Return `yes` where this mask is set, `no` elsewhere; one of them has to be a vector."""
        kind = yes if isinstance(yes, Value) else no
        assert isinstance(kind, Value)
        return Value(self.builder, self.builder.select(self.ir, kind._operand(yes), kind._operand(no)))

    def _call(self, name: str, *others: Value | int) -> Value:
        kind = self.ir.type
        function = ir.FunctionType(kind, [kind] * (1 + len(others)))
        full = f"llvm.{name}.v{kind.count}i{kind.element.width}"
        called = _ir.get_or_insert_function(self.builder.module, function, full)
        return Value(self.builder, self.builder.call(called, [self.ir, *(self._operand(other) for other in others)]))

    def add_saturating(self, other: Value | int) -> Value:
        """Return the sum, or the largest number where it would wrap."""
        return self._call("uadd.sat", other)

    def sub_saturating(self, other: Value | int) -> Value:
        """Return the difference, or 0 where it would wrap."""
        return self._call("usub.sat", other)

    def bits_set(self) -> Value:
        """Return the number of set bits of each lane."""
        return self._call("ctpop")

    def widened(self, kind: Any) -> Value:
        """Return the lanes as wider unsigned numbers of this vector kind."""
        return Value(self.builder, self.ir if kind == self.ir.type else self.builder.zext(self.ir, kind))

    def widened_signed(self, kind: Any) -> Value:
        """Return the lanes as wider signed numbers of this vector kind."""
        return Value(self.builder, self.builder.sext(self.ir, kind))

    def narrowed(self, kind: Any) -> Value:
        """Return the low bits of the lanes."""
        return Value(self.builder, self.builder.trunc(self.ir, kind))

    def floats(self, *, signed: bool = False) -> Value:
        """Return the lanes, 32-bit whole numbers, as floats."""
        convert = self.builder.sitofp if signed else self.builder.uitofp
        return Value(self.builder, convert(self.ir, FLOATS))

    def over(self, other: Value) -> Value:
        """Return the quotient of floats."""
        return Value(self.builder, self.builder.fdiv(self.ir, other.ir))

    def times(self, other: float) -> Value:
        """Return the product of floats and a constant."""
        return Value(self.builder, self.builder.fmul(self.ir, ir.Constant(FLOATS, [other] * LANES)))

    def filled(self, value: float) -> Value:
        """Return floats that are all this value."""
        return Value(self.builder, ir.Constant(FLOATS, [value] * LANES))

    def plus(self, other: float) -> Value:
        """Return the sum of floats and a constant."""
        return Value(self.builder, self.builder.fadd(self.ir, ir.Constant(FLOATS, [other] * LANES)))

    def whole(self) -> Value:
        """Return floats cut to signed 32-bit whole numbers, towards 0."""
        return Value(self.builder, self.builder.fptosi(self.ir, WORDS))

    def everywhere(self, kind: Any) -> Value:
        """Return a vector with this 64-bit number, its low bits, in all lanes."""
        narrow = self.builder.trunc(self.ir, _element(kind))
        nothing = ir.Constant(kind, ir.Undefined)
        one = self.builder.insert_element(nothing, narrow, ir.Constant(ir.IntType(32), 0))
        return Value(self.builder, self.builder.shuffle_vector(one, nothing, ir.Constant(WORDS, [0] * LANES)))

    def interleaved(self, other: Value) -> tuple[Value, Value]:
        """Return a0 b0 a1 b1 ... of the lower halves of both, and of the upper halves."""

        def half(begin: int) -> Value:
            order = [begin + lane // 2 + (lane % 2) * LANES for lane in range(LANES)]
            return Value(self.builder, self.builder.shuffle_vector(self.ir, other.ir, ir.Constant(WORDS, order)))

        return half(0), half(LANES // 2)

    def trailing_zeros(self) -> Value:
        """Return the place of a 64-bit number's lowest set bit, 64 where there is none."""
        return Value(self.builder, self.builder.cttz(self.ir, ir.Constant(ir.IntType(1), 0)))

    def packed_mask(self) -> Value:
        """Return a mask as a number: bit k is lane k."""
        bits = self.builder.bitcast(self.ir, ir.IntType(LANES))
        return Value(self.builder, self.builder.zext(bits, NUMBER))
