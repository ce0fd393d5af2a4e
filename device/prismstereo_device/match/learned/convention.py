"""How a network wants its pictures and gives its disparity: what its file does not say of itself."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

__all__ = ["Convention"]

_Multiple = Annotated[int, msgspec.Meta(ge=1, le=512)]
_Channel = Annotated[int, msgspec.Meta(ge=0, le=63)]
_Reach = Annotated[int, msgspec.Meta(ge=0, le=4096)]


class Convention(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Grey levels in, disparity out.

    `scale`: grey levels as they are (`none`), divided by 255 (`unit`), from -1 to 1 (`symmetric`), or by mean and
    deviation of ImageNet's colours (`imagenet`, in the `order` of the channels). `multiple`: an open height or width must be
    a multiple of it. `fit`: whether a picture is padded or resized to the network's size; `auto` pads where the picture is
    not larger. `output`: name of the output with the disparity, `channel` its channel, `sign` -1 where disparity is given
    as a movement to the left. `max_disparity`: what the network can find, in its own pixels; 0 where unknown.
    """

    scale: Literal["none", "unit", "symmetric", "imagenet"]
    order: Literal["rgb", "bgr"] = "rgb"
    layout: Literal["auto", "nchw", "nhwc"] = "auto"
    channels: Annotated[int, msgspec.Meta(ge=0, le=6)] = 0  # 0: as the file says
    multiple: _Multiple = 32
    fit: Literal["auto", "pad", "resize"] = "auto"
    output: str = ""  # empty: found by its shape and name
    channel: _Channel = 0
    sign: Literal[1, -1] = 1
    max_disparity: _Reach = 0
