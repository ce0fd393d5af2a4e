"""onnxruntime, opened and run with complaints of ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prismstereo_device.match.learned.model_shape import Port
from prismstereo_hw.errors import DataError, UsageError

__all__ = ["Session"]

_PROVIDER = "ExecutionProvider"
_QUIET = 4  # onnxruntime says its errors on stderr as well; ours come as exceptions


class Session:
    """A model file that is ready to run on the providers that were asked for."""

    def __init__(self, path: Path, providers: Sequence[str] = (), threads: int = 2) -> None:
        """Open a model; `DataError` for a file that is none, `UsageError` for a provider that is not here."""
        runtime = _runtime()
        if not path.is_file():
            raise DataError(f"there is no model file {path}: give the path of an .onnx file")
        available = runtime.get_available_providers()
        wanted = list(dict.fromkeys(_provider(name, available) for name in providers or ("cpu",)))
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.log_severity_level = _QUIET
        self._path = path
        self._failures = _failures()
        try:
            self._session = runtime.InferenceSession(str(path), options, providers=wanted)
        except self._failures as error:
            raise DataError(f"{path} is no model that onnxruntime can run: {_first_line(error)}") from error
        running = self._session.get_providers()
        if running[: len(wanted)] != wanted:
            raise UsageError(
                f"provider {wanted[0]} could not start and {running[0]} would run instead: install what it needs, or ask for "
                f"{running[0]}"
            )
        self.inputs = tuple(_port(node) for node in self._session.get_inputs())
        self.outputs = tuple(_port(node) for node in self._session.get_outputs())

    def run(self, inputs: dict[str, NDArray[np.generic]], output: str) -> NDArray[np.generic]:
        """Run the model on tensors by name; `DataError` where it fails on them."""
        try:
            return np.asarray(self._session.run([output], inputs)[0])
        except self._failures as error:
            given = ", ".join(f"{name} {'x'.join(map(str, value.shape))}" for name, value in inputs.items())
            raise DataError(
                f"{self._path} failed on {given}: {_first_line(error)}; if it wants other sizes, add multiple=N"
            ) from error


def _runtime() -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise UsageError(
            "learned matchers need onnxruntime, which is not installed: pip install onnxruntime"
        ) from error
    return onnxruntime


def _failures() -> tuple[type[Exception], ...]:
    """Return every exception of onnxruntime's: they have no root of their own."""
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    own = [kind for kind in vars(state).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    return (*own, RuntimeError, MemoryError)


def _provider(name: str, available: Sequence[str]) -> str:
    """Return the full name of a provider, `cuda` as well as `CUDAExecutionProvider`."""
    for known in available:
        if name.lower() in (known.lower(), known.removesuffix(_PROVIDER).lower()):
            return known
    short = ", ".join(known.removesuffix(_PROVIDER).lower() for known in available)
    raise UsageError(f"this onnxruntime has no provider {name!r}: choose one of {short}, or install a build with it")


def _port(node: Any) -> Port:
    sizes = tuple(size if isinstance(size, int) else None for size in node.shape or ())
    return Port(node.name, sizes, node.type)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
