"""Codec 2 read by the book: device/CODEC.md in plain Python integers; of the product it uses the frozen shapes only."""

from __future__ import annotations

from prismstereo_device.codec.frozen import SHAPES

Levels = list[int]


class Refused(Exception):
    pass


def frequencies(levels: Levels) -> list[int]:
    weights = [(4 + level % 4) * 2 ** (level // 4) if level else 0 for level in levels]
    shares = [1 + weight * 4032 // max(sum(weights), 1) for weight in weights]
    shares[weights.index(max(weights))] += 4096 - sum(shares)
    return shares


def frozen_levels(bound: int, context: int) -> Levels:
    unmatched, none, first, halves, escape = SHAPES[bound][context]
    levels = [max(0, first - (symbol // 2 - 1) * halves // 2) for symbol in range(64)]
    levels[0], levels[1], levels[63] = unmatched, none, escape
    return levels


def own_levels(bits: list[int]) -> Levels:
    def take(count: int) -> int:
        return int("".join(str(bits.pop(0)) for _ in range(count)), 2)

    levels = [0] * 64
    levels[0], levels[63], last = take(6), take(6), take(6)
    before = [47, 47]
    for symbol in range(1, last + 1):
        ones = 0
        while take(1):
            ones += 1
        folded = 4 * ones + take(2)
        levels[symbol] = sum(before) // 2 + (folded // 2 if folded % 2 == 0 else -(folded + 1) // 2)
        before = [before[1], levels[symbol]]
    return levels


def tables(data: bytes, bound: int) -> list[list[int]]:
    if not data:
        return [frequencies(frozen_levels(bound, context)) for context in range(28)]
    bits = [byte >> place & 1 for byte in data for place in range(7, -1, -1)]
    return [frequencies(own_levels(bits) if bits.pop(0) else frozen_levels(bound, context)) for context in range(28)]


def check(pixels: list[int]) -> int:
    total = 0
    for pixel in pixels:
        total = (total ^ pixel) * 0x9E3779B1 % 2**32
    return total >> 16


class Coder:
    def __init__(self, data: bytes) -> None:
        self.words = [data[at] + 256 * data[at + 1] for at in range(0, len(data), 2)]
        self.state = self.words.pop(0) + 65536 * self.words.pop(0)

    def take(self, shares: list[int]) -> int:
        slot, start, symbol = self.state % 4096, 0, 0
        while symbol < len(shares) and slot >= start + shares[symbol]:
            start += shares[symbol]
            symbol += 1
        if symbol == len(shares):
            raise Refused
        self.state = shares[symbol] * (self.state // 4096) + slot - start
        if self.state < 65536:
            if not self.words:
                raise Refused
            self.state = 65536 * self.state + self.words.pop(0)
        return symbol


HIGH_BYTE = [384] * 8 + [64] * 8 + [2] * 240
LOW_BYTE = [16] * 256


def neighbours(rows: list[list[tuple[int, bool]]], width: int) -> list[tuple[int, bool]]:
    """Left, above, above left and above right of the next pixel, each as value and whether it is matched."""
    here, x = rows[-1], len(rows[-1])
    above = rows[-2] if len(rows) > 1 else [(0, False)] * width
    left = here[x - 1] if x else above[0]
    return [left, above[x], above[max(x - 1, 0)], above[min(x + 1, width - 1)]]


def context_and_guess(four: list[tuple[int, bool]], bound: int) -> tuple[int, int]:
    (a, left), (b, above), (c, above_left), (d, above_right) = four
    rough = abs(a - c) + abs(b - c) + abs(b - d)
    if left and above and above_left and above_right:
        context = min(rough.bit_length(), 11)
        if bound and rough <= 2 * (2 * bound + 1):
            return context, (5 * a + 3 * b + 2 * d - 2 * c + 4) // 8
    else:
        context = 12 + left + 2 * above + 4 * above_left + 8 * above_right
    if left and above:
        return context, sorted((a, b, a + b - c))[1]
    if left or above:
        return context, a if left else b
    return context, d if above_right else c if above_left else a


def decode(data: bytes, rows: int, width: int, bound: int, table_data: bytes) -> list[int]:
    if int.from_bytes(data[:4], "little") < 65536:
        pixels = [data[at] + 256 * data[at + 1] for at in range(4, len(data), 2)]
        if len(pixels) != rows * width or check(pixels) != data[0] + 256 * data[1]:
            raise Refused
        return pixels
    shares, coder, values = tables(table_data, bound), Coder(data), []
    for _ in range(rows):
        values.append([])
        for _ in range(width):
            four = neighbours(values, width)
            context, guess = context_and_guess(four, bound)
            symbol = coder.take(shares[context])
            if symbol == 0:
                values[-1].append((four[0][0], False))
                continue
            if symbol == 63:
                pixel = 256 * coder.take(HIGH_BYTE)
                pixel += coder.take(LOW_BYTE)
                if pixel == 0:
                    raise Refused
            else:
                error = symbol // 2 if symbol % 2 else -(symbol // 2)
                pixel = min(max(guess + error * (2 * bound + 1), 1), 65535)
            values[-1].append((pixel, True))
    pixels = [value if matched else 0 for row in values for value, matched in row]
    if coder.words or coder.state != 65536 + check(pixels):
        raise Refused
    return pixels
