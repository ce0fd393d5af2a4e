"""The shape of a model: which inputs take which picture in which form, and which output is the disparity.

All of it is read from what the file says of its inputs and outputs; what it leaves open, the convention decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from prismstereo_device.match.learned.convention import Convention
from prismstereo_hw.errors import DataError, UsageError

__all__ = ["ModelShape", "Port"]

Layout = Literal["nchw", "nhwc"]
_PICTURE_CHANNELS = (1, 3)
_INPUT_TYPES = ("tensor(float)", "tensor(float16)", "tensor(double)", "tensor(uint8)")
_INPUT_COUNTS = (1, 2, 4)


@dataclass(frozen=True, slots=True)
class Port:
    """An input or output: its name, its sizes (None where the file leaves one open), and its type in onnxruntime's words."""

    name: str
    sizes: tuple[int | None, ...]
    kind: str = "tensor(float)"

    def __str__(self) -> str:
        return f"{self.name} {'x'.join('?' if size is None else str(size) for size in self.sizes) or 'scalar'}"


@dataclass(frozen=True, slots=True)
class ModelShape:
    """How a model takes a pair.

    `inputs`: one input for both pictures stacked, left and right, or left and right at half size before left and right.
    `channels`: of each picture. `height` and `width`: of the full-size input, None where open. `output`: the disparity's.
    """

    inputs: tuple[Port, ...]
    layout: Layout
    channels: int
    height: int | None
    width: int | None
    output: Port

    @property
    def stacked(self) -> bool:
        """Whether one input takes both pictures, one behind the other in its channels."""
        return len(self.inputs) == 1

    @property
    def halved(self) -> bool:
        """Whether the pair is wanted at half size too."""
        return len(self.inputs) == 4

    @classmethod
    def of(cls, inputs: Sequence[Port], outputs: Sequence[Port], convention: Convention, origin: str) -> ModelShape:
        """Find out how a model takes a pair; `DataError` tells why one does not fit, `UsageError` what only you can say."""
        if len(inputs) not in _INPUT_COUNTS:
            raise DataError(
                f"{origin} has {len(inputs)} inputs ({_listed(inputs)}), but a stereo model has one (stacked pictures), two "
                "(left, right) or four (both at half size as well): export it so"
            )
        for port in inputs:
            _require_picture(port, origin)
        ordered = _ordered(inputs)
        full = ordered[-2:]
        layout, channels = _channels(full[-1], 2 if len(ordered) == 1 else 1, convention, origin)
        sizes = {_size(port, layout) for port in full}
        if len(sizes) > 1:
            raise DataError(f"{origin} takes pictures of two sizes ({_listed(full)}), but a pair has one: export it so")
        height, width = sizes.pop()
        shape = cls(ordered, layout, channels, height, width, _output(outputs, (height, width), convention, origin))
        _require_halves(shape, origin)
        return shape


def _listed(ports: Sequence[Port]) -> str:
    return ", ".join(map(str, ports))


def _require_picture(port: Port, origin: str) -> None:
    if len(port.sizes) != 4 or port.sizes[0] not in (1, None):
        raise DataError(
            f"input {port} of {origin} is no picture: it must have four axes, the first (the batch) of size 1 or open"
        )
    if port.kind not in _INPUT_TYPES:
        raise DataError(f"input {port} of {origin} takes {port.kind}: export it with one of {', '.join(_INPUT_TYPES)}")


def _ordered(inputs: Sequence[Port]) -> tuple[Port, ...]:
    """Put half-size inputs first and left before right, by sizes and names where they tell, else as the file has them."""
    if len(inputs) == 1:
        return tuple(inputs)
    if len(inputs) == 4:
        areas = [_area(port) for port in inputs]
        if None not in areas and len(set(areas)) == 2:
            inputs = sorted(inputs, key=lambda port: _area(port) or 0)
        return _left_first(inputs[:2]) + _left_first(inputs[2:])
    return _left_first(inputs)


def _area(port: Port) -> int | None:
    area = 1
    for size in port.sizes[1:]:
        if size is None:
            return None
        area *= size
    return area


def _left_first(pair: Sequence[Port]) -> tuple[Port, ...]:
    first, second = pair
    swapped = "right" in first.name.lower() and "left" in second.name.lower()
    return (second, first) if swapped else (first, second)


def _channels(port: Port, pictures: int, convention: Convention, origin: str) -> tuple[Layout, int]:
    """Return the layout of an input and the channels of each picture in it."""
    allowed = tuple(pictures * channels for channels in _PICTURE_CHANNELS)
    layouts: dict[Layout, int | None] = {"nchw": port.sizes[1], "nhwc": port.sizes[3]}
    if convention.layout != "auto":
        layouts = {convention.layout: layouts[convention.layout]}
    fitting = [(layout, size) for layout, size in layouts.items() if size in allowed]
    if fitting:
        layout, size = fitting[0]
        channels = (size or 0) // pictures
        if convention.channels not in (0, channels):
            raise UsageError(
                f"channels={convention.channels}, but input {port} of {origin} takes {channels} a picture: leave channels out"
            )
        return layout, channels
    open_layouts = [layout for layout, size in layouts.items() if size is None]
    if not open_layouts:
        raise DataError(
            f"input {port} of {origin} has no axis of {' or '.join(map(str, allowed))} channels where {pictures} "
            f"picture{'s' if pictures > 1 else ''} would go: export it with grey or RGB pictures"
        )
    if convention.channels not in _PICTURE_CHANNELS:
        raise UsageError(f"input {port} of {origin} leaves its channels open: add channels=1 or channels=3")
    return open_layouts[0], convention.channels


def _size(port: Port, layout: Layout) -> tuple[int | None, int | None]:
    return (port.sizes[2], port.sizes[3]) if layout == "nchw" else (port.sizes[1], port.sizes[2])


def _require_halves(shape: ModelShape, origin: str) -> None:
    if not shape.halved:
        return
    for port in shape.inputs[:2]:
        for half, full in zip(_size(port, shape.layout), (shape.height, shape.width), strict=True):
            if half is not None and full is not None and 2 * half != full:
                raise DataError(
                    f"of the four inputs of {origin} ({_listed(shape.inputs)}) two must be half as high and wide as the others"
                )


def _output(outputs: Sequence[Port], size: tuple[int | None, int | None], convention: Convention, origin: str) -> Port:
    """Return the output that is a map of the pictures' size; of several the first that is called a disparity."""
    if convention.output:
        for port in outputs:
            if port.name == convention.output:
                return port
        raise UsageError(f"{origin} has no output {convention.output!r}: choose one of {_listed(outputs)}")
    unshaped = [port for port in outputs if not port.sizes]  # one number, or of unknown shape: only the run will tell
    maps = [port for port in outputs if _may_be_map(port, size)] or unshaped
    if not maps:
        height, width = ("?" if side is None else side for side in size)
        raise DataError(
            f"no output of {origin} ({_listed(outputs)}) is a map of {width}x{height} like its input: export the disparity at "
            "full size"
        )
    named = [port for port in maps if "disp" in port.name.lower()]
    if len(maps) == 1 or named:
        return (named or maps)[0]
    raise UsageError(f"{origin} has several outputs that may be the disparity: add output=NAME, one of {_listed(maps)}")


def _may_be_map(port: Port, size: tuple[int | None, int | None]) -> bool:
    """Tell whether two neighbouring axes may be height and width."""
    return any(
        all(found is None or wanted is None or found == wanted for found, wanted in zip(axes, size, strict=True))
        for axes in zip(port.sizes[:-1], port.sizes[1:], strict=True)
    )
