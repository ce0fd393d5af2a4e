"""The camera's settings declared as a node's parameters, and set on the camera when they are set there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from prismstereo import StereoCamera
from prismstereo_hw.errors import PrismStereoError
from prismstereo_ros.parameters import Rule, rules_of, setting_of

__all__ = ["SettingParameters"]


class SettingParameters:
    """Declares what the camera can be set to, with its ranges; a wish that the camera refuses is refused with its words."""

    def __init__(self, node: Any, interfaces: Any, camera: StereoCamera) -> None:
        """Take a node, the module `rcl_interfaces.msg` and the camera."""
        self._interfaces = interfaces
        self._camera = camera
        self._rules = {rule.name: rule for rule in rules_of(camera.identity_details)}
        for rule in self._rules.values():
            node.declare_parameter(rule.name, _value(camera.get(rule.name)), self._descriptor(rule))
        node.add_on_set_parameters_callback(self._set)

    def _descriptor(self, rule: Rule) -> Any:
        found = self._interfaces.ParameterDescriptor(
            name=rule.name,
            description=rule.description,
            additional_constraints=rule.constraints,
            dynamic_typing=rule.dynamic,
        )
        if rule.kind == "double" and rule.least < rule.most:
            found.floating_point_range = [
                self._interfaces.FloatingPointRange(from_value=rule.least, to_value=rule.most, step=0.0)
            ]
        elif rule.kind == "integer" and rule.least < rule.most:
            found.integer_range = [
                self._interfaces.IntegerRange(from_value=int(rule.least), to_value=int(rule.most), step=0)
            ]
        return found

    def _set(self, parameters: Sequence[Any]) -> Any:
        """Set all of them on the camera, or none: what was set before the one that was refused is put back."""
        done: list[tuple[str, Any]] = []
        try:
            for parameter in parameters:
                rule = self._rules.get(parameter.name)
                if rule is not None:
                    before = self._camera.get(rule.name)
                    self._camera.set(rule.name, setting_of(rule, parameter.value))
                    done.append((rule.name, before))
        except PrismStereoError as error:
            return self._interfaces.SetParametersResult(successful=False, reason=self._undone(done, str(error)))
        return self._interfaces.SetParametersResult(successful=True, reason="")

    def _undone(self, done: list[tuple[str, Any]], reason: str) -> str:
        try:
            for name, before in reversed(done):
                self._camera.set(name, before)
        except PrismStereoError as error:
            return f"{reason}; and what was set before it stays so: {error}"
        return reason


def _value(setting: object) -> object:
    """Give a setting in a form that ROS has."""
    return [int(part) for part in setting] if isinstance(setting, list | tuple) else setting
