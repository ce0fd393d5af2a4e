"""Small stereo models as ONNX files, built here: a real block matcher, and models that show what they were given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

Sizes = Sequence[int | str | None]
FLOAT = TensorProto.FLOAT


def port(name: str, sizes: Sizes, kind: int = FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, list(sizes))


def constant(name: str, values: object, kind: type = np.float32) -> onnx.TensorProto:
    return numpy_helper.from_array(np.asarray(values, kind), name)


def save(
    path: Path,
    inputs: list[onnx.ValueInfoProto],
    outputs: list[onnx.ValueInfoProto],
    nodes: list[onnx.NodeProto],
    constants: Sequence[onnx.TensorProto] = (),
) -> Path:
    graph = helper.make_graph(nodes, "stereo", inputs, outputs, list(constants))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


def block_matching(left: str, right: str, labels: int) -> tuple[list[onnx.NodeProto], list[onnx.TensorProto]]:
    """Nodes that match `left` to `right` (1, channels, height, width) by the least mean absolute difference of 9x9 pixels.

    The result `best` is (1, height, width) float32: the shift of least cost of 0 .. labels - 1, what is shifted in costs much.
    """
    nodes: list[onnx.NodeProto] = []
    constants = [
        constant("channel_axis", [1], np.int64),
        constant("width_axis", [3], np.int64),
        constant("far_off", 1e4),
    ]
    for d in range(labels):
        constants.append(constant(f"pads{d}", [0, 0, 0, d, 0, 0, 0, 0], np.int64))
        constants += [constant(f"begin{d}", [0], np.int64), constant(f"end{d}", [-d if d else 2**40], np.int64)]
        nodes += [
            helper.make_node("Pad", [right, f"pads{d}", "far_off"], [f"padded{d}"], mode="constant"),
            helper.make_node("Slice", [f"padded{d}", f"begin{d}", f"end{d}", "width_axis"], [f"moved{d}"]),
            helper.make_node("Sub", [left, f"moved{d}"], [f"difference{d}"]),
            helper.make_node("Abs", [f"difference{d}"], [f"absolute{d}"]),
            helper.make_node("ReduceMean", [f"absolute{d}"], [f"grey{d}"], axes=[1]),
            helper.make_node("AveragePool", [f"grey{d}"], [f"cost{d}"], kernel_shape=[9, 9], pads=[4, 4, 4, 4]),
        ]
    nodes += [
        helper.make_node("Concat", [f"cost{d}" for d in range(labels)], ["volume"], axis=1),
        helper.make_node("ArgMin", ["volume"], ["winner"], axis=1, keepdims=0),
        helper.make_node("Cast", ["winner"], ["best"], to=FLOAT),
    ]
    return nodes, constants


def block_matcher(
    path: Path, labels: int, sizes: Sizes = (1, 3, "height", "width"), out: Sizes = (1, "height", "width")
) -> Path:
    """A pair in, (1, height, width) out."""
    nodes, constants = block_matching("left", "right", labels)
    nodes.append(helper.make_node("Identity", ["best"], ["disparity"]))
    return save(path, [port("left", sizes), port("right", sizes)], [port("disparity", out)], nodes, constants)


def shown(
    path: Path, names: Sequence[str], sizes: Sizes, out: Sizes, nodes: list[onnx.NodeProto],
    constants: Sequence[onnx.TensorProto] = (), *, output: str = "disparity", kind: int = FLOAT,
) -> Path:  # fmt: skip
    """A model of given inputs whose one output is whatever the nodes make of them."""
    return save(path, [port(name, sizes, kind) for name in names], [port(output, out)], nodes, constants)
