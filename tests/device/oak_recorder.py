"""A depthai pipeline that needs no camera: it takes what the installed package's own stubs say, and nothing else.

depthai builds no graph without a device. So the stubs that come with it are read here, and stand-ins are made of them: a method
that is not in there, too many or too few arguments, an unknown keyword, an argument of another type, a port that there is not,
or one linked the wrong way round raise `NotInStubs`. Calls and links are kept for a test to look at. Enumerations and
configuration objects are the real ones, so they check themselves.
"""

from __future__ import annotations

import ast
import datetime as dt
import os
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

REAL_CONFIGS = {"ImageManipConfig", "StereoDepthConfig", "CameraControl", "GateControl"}
REFUSED = {("RVC4", "StereoDepth", "setOutputSize"), ("RVC4", "StereoDepth", "setOutputKeepAspectRatio")}
PLAIN = {"int": int, "str": str, "bool": bool, "datetime.timedelta": dt.timedelta, "os.PathLike": os.PathLike}


class NotInStubs(Exception):
    """Something was asked for that the installed package does not have."""


@dataclass
class StubClass:
    """One class of the stubs: its bases, methods with their overloads, properties and attributes with their types."""

    name: str
    bases: list[str]
    methods: dict[str, list[ast.FunctionDef]] = field(default_factory=dict)
    values: dict[str, ast.expr | None] = field(default_factory=dict)
    read_only: set[str] = field(default_factory=set)


class Stubs:
    """All classes of depthai and depthai.node, by dotted name without `depthai.`."""

    def __init__(self, folder: Path) -> None:
        self.classes: dict[str, StubClass] = {}
        for file, prefix in (("__init__.pyi", ""), ("node/__init__.pyi", "node.")):
            for node in ast.parse((folder / file).read_text()).body:
                if isinstance(node, ast.ClassDef) and node.name not in self.classes:  # the second repeats the first
                    self._add(node, prefix)

    def _add(self, node: ast.ClassDef, prefix: str) -> None:
        name = prefix + node.name
        made = StubClass(name, [ast.unparse(base).removeprefix("depthai.") for base in node.bases])
        self.classes[name] = made
        for part in node.body:
            if isinstance(part, ast.ClassDef):
                self._add(part, f"{name}.")
            elif isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                made.values[part.target.id] = part.annotation
            elif isinstance(part, ast.FunctionDef) and _is_property(part):
                made.values[part.name] = part.returns
                made.read_only.add(part.name)
            elif isinstance(part, ast.FunctionDef):
                made.methods.setdefault(part.name, []).append(part)

    def line(self, name: str) -> list[StubClass]:
        """The class and everything it is derived from."""
        found = [self.classes[self.resolved(name, "")]]
        for base in found[0].bases:
            full = self.resolved(base, found[0].name)
            found += self.line(full) if full in self.classes else []
        return found

    def resolved(self, name: str, scope: str) -> str:
        """The full name of a class as it is called within another one."""
        name = name.removeprefix("depthai.")
        parts = scope.split(".")
        for depth in range(len(parts), -1, -1):
            full = ".".join([*parts[:depth], name])
            if full in self.classes:
                return full
        return name

    def is_a(self, name: str, wanted: str) -> bool:
        return any(each.name == wanted for each in self.line(name))


@cache
def stubs_of(file: str) -> Stubs:
    """The stubs beside an installed depthai."""
    return Stubs(Path(file).parent / "depthai")


def _is_property(function: ast.FunctionDef) -> bool:
    return any(isinstance(mark, ast.Name) and mark.id == "property" for mark in function.decorator_list)


@dataclass
class Call:
    """One call, in its order: on what, which method, with what."""

    on: str
    method: str
    arguments: tuple[Any, ...]
    keywords: dict[str, Any]


class Recorder:
    """Makes stand-ins and keeps what is done with them; `answers` is what a camera would say, by the method that asks."""

    def __init__(self, dai: ModuleType, platform: str = "RVC2", answers: dict[str, Any] | None = None) -> None:
        self.dai, self.platform, self.answers = dai, platform, answers or {}
        self.stubs = stubs_of(str(dai.__file__))
        self.calls: list[Call] = []
        self.links: list[tuple[str, str]] = []
        self.nodes: dict[str, Any] = {}
        self.pipeline = StandIn(self, "Pipeline", "pipeline")
        self.device = StandIn(self, "Device", "device")

    def module(self) -> Any:
        """depthai with this device in place of any other."""

        real = self.dai

        class Offline(ModuleType):
            def __getattr__(self, name: str) -> Any:
                return getattr(real, name)

        offline = Offline("depthai")
        offline.Device = lambda *_: self.device
        offline.Device.getAnyAvailableDevice = lambda: (True, real.DeviceInfo())
        offline.Pipeline = lambda device: self.pipeline if device is self.device else None
        offline.Pipeline.AutoCalibrationMode = real.Pipeline.AutoCalibrationMode
        return offline

    def called(self, on: str, method: str) -> list[tuple[Any, ...]]:
        """The positional arguments of all calls of a method on a stand-in."""
        return [call.arguments for call in self.calls if (call.on, call.method) == (on, method)]

    def create(self, kind: type) -> Any:
        """Make a node of one of depthai's own classes."""
        name = f"node.{kind.__name__}"
        if getattr(self.dai.node, kind.__name__, None) is not kind or not self.stubs.is_a(name, "Node"):
            raise NotInStubs(f"{kind!r} is no node")
        label = f"{kind.__name__}{sum(each.startswith(kind.__name__) for each in self.nodes)}"
        self.nodes[label] = StandIn(self, name, label)
        return self.nodes[label]

    def fits(self, value: Any, annotation: ast.expr | None, scope: str) -> bool:
        """Tell whether an argument is of an annotated type."""
        if annotation is None:
            return True
        if isinstance(annotation, ast.BinOp):  # A | B
            return self.fits(value, annotation.left, scope) or self.fits(value, annotation.right, scope)
        if isinstance(annotation, ast.Constant) and annotation.value is None:
            return value is None
        if isinstance(annotation, ast.Subscript):
            return self._fits_inside(value, annotation, scope)
        name = ast.unparse(annotation)
        if name == "float":
            return type(value) in (int, float)
        if name in PLAIN:
            return type(value) is PLAIN[name] or (name == "os.PathLike" and isinstance(value, os.PathLike))
        if name.startswith("numpy.ndarray"):
            return isinstance(value, np.ndarray)
        full = self.stubs.resolved(name, scope)
        if full not in self.stubs.classes:
            raise NotInStubs(f"the stubs name a type that they do not have: {name}")
        if isinstance(value, StandIn):
            return self.stubs.is_a(value._kind, full)
        return isinstance(value, _real(self.dai, full))

    def _fits_inside(self, value: Any, annotation: ast.Subscript, scope: str) -> bool:
        outer = ast.unparse(annotation.value)
        if outer == "Callable":
            return callable(value)
        inner = annotation.slice.elts if isinstance(annotation.slice, ast.Tuple) else [annotation.slice]
        if outer == "tuple":
            return (
                isinstance(value, tuple)
                and len(value) == len(inner)
                and all(self.fits(each, kind, scope) for each, kind in zip(value, inner, strict=True))
            )
        if outer == "list":
            return isinstance(value, list) and all(self.fits(each, inner[0], scope) for each in value)
        if outer == "numpy.ndarray":
            return isinstance(value, np.ndarray)
        raise NotInStubs(f"a type that is not checked here: {ast.unparse(annotation)}")


def _real(dai: ModuleType, full: str) -> Any:
    found: Any = dai
    for part in full.split("."):
        found = getattr(found, part)
    return found


class StandIn:
    """An object of a class of the stubs."""

    def __init__(self, recorder: Recorder, kind: str, label: str) -> None:
        self.__dict__.update(_recorder=recorder, _kind=kind, _label=label, _parts={})

    def __getattr__(self, name: str) -> Any:
        for each in self._recorder.stubs.line(self._kind):
            if name in each.values:
                return self._part(name, each)
            if name in each.methods:
                return lambda *arguments, **keywords: self._called(each, name, arguments, keywords)
        raise NotInStubs(f"{self._kind} has no {name}")

    def __setattr__(self, name: str, value: Any) -> None:
        for each in self._recorder.stubs.line(self._kind):
            if name in each.values and name not in each.read_only:
                if not self._recorder.fits(value, each.values[name], each.name):
                    raise NotInStubs(f"{self._kind}.{name} takes {ast.unparse(each.values[name])}, not {value!r}")
                self._parts[name] = value
                return
        raise NotInStubs(f"{self._kind}.{name} cannot be set")

    def __getitem__(self, key: str) -> Any:
        for each in self._recorder.stubs.line(self._kind):
            if "__getitem__" in each.methods:
                self._checked(each, "__getitem__", (key,), {})
                kind = self._recorder.stubs.resolved(ast.unparse(each.methods["__getitem__"][0].returns), each.name)
                return self._parts.setdefault(key, StandIn(self._recorder, kind, f"{self._label}[{key}]"))
        raise NotInStubs(f"{self._kind} holds nothing by name")

    def _part(self, name: str, owner: StubClass) -> Any:
        if name not in self._parts:
            told = owner.values[name]
            kind = "" if told is None else self._recorder.stubs.resolved(ast.unparse(told), owner.name)
            if kind in REAL_CONFIGS:
                self._parts[name] = getattr(self._recorder.dai, kind)()
            elif kind in self._recorder.stubs.classes:
                self._parts[name] = StandIn(self._recorder, kind, f"{self._label}.{name}")
            else:
                raise NotInStubs(f"{self._kind}.{name} is {kind}: nothing that a graph is made of")
        return self._parts[name]

    def _called(self, owner: StubClass, name: str, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        recorder = self._recorder
        if (recorder.platform, owner.name.removeprefix("node."), name) in REFUSED:
            raise NotInStubs(f"{name} is refused on {recorder.platform}")
        found = self._checked(owner, name, arguments, keywords)
        recorder.calls.append(Call(self._label, name, arguments, keywords))
        if name in recorder.answers:
            answer = recorder.answers[name]
            return answer() if callable(answer) else answer
        if name == "create":
            return recorder.create(arguments[0])
        if name == "link":
            recorder.links.append((self._label, arguments[0]._label))
        returned = None if found.returns is None else ast.unparse(found.returns)
        if returned in (None, "None"):
            return None
        kind = recorder.stubs.resolved(returned, owner.name)
        if kind == self._kind:
            return self
        if kind not in recorder.stubs.classes:
            raise NotInStubs(f"{owner.name}.{name} returns {returned}, which only a camera can tell")
        number = sum(call.on == self._label and call.method == name for call in recorder.calls)
        return StandIn(recorder, kind, f"{self._label}.{name}{number - 1}")

    def _checked(
        self, owner: StubClass, name: str, arguments: tuple[Any, ...], keywords: dict[str, Any]
    ) -> ast.FunctionDef:
        for overload in owner.methods[name]:
            if self._takes(overload, owner, arguments, keywords):
                return overload
        forms = " or ".join(f"({ast.unparse(overload.args)})" for overload in owner.methods[name])
        raise NotInStubs(f"{owner.name}.{name} takes {forms}, not {arguments[:4]!r} {keywords!r}")

    def _takes(
        self, overload: ast.FunctionDef, owner: StubClass, arguments: tuple[Any, ...], keywords: dict[str, Any]
    ) -> bool:
        wanted = overload.args.args[1:]
        needed = len(wanted) - len(overload.args.defaults)
        if overload.args.vararg is not None and overload.name == "create":
            return len(arguments) == 1 and not keywords and isinstance(arguments[0], type)
        if overload.args.vararg is not None or len(arguments) > len(wanted):
            return False
        given = {argument.arg: value for argument, value in zip(wanted, arguments, strict=False)}
        if given.keys() & keywords.keys() or keywords.keys() - {argument.arg for argument in wanted}:
            return False
        given |= keywords
        if any(argument.arg not in given for argument in wanted[:needed]):
            return False
        return all(
            self._recorder.fits(given[argument.arg], argument.annotation, owner.name)
            for argument in wanted
            if argument.arg in given
        )
