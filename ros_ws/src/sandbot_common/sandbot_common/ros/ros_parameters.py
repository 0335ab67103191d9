"""A node's ROS parameters, declared from a parameter dataclass."""

import math
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.parameters import Spec, check, from_mapping, specs
from sandbot_common.suggest import did_you_mean

T = TypeVar("T")


class Parameters(Generic[T]):
    """ROS parameters declared from a parameter dataclass; ``current`` is always a valid instance.

    An invalid change is refused with the reason; a valid one calls ``on_change`` with the new instance.
    """

    def __init__(self, node: Node, cls: type[T], on_change: Callable[[T], None] | None = None) -> None:
        self._cls = cls
        self._names = [spec.name for spec in specs(cls)]
        self._where = f"{node.get_name()} parameters"
        self._on_change = on_change
        default = cls()
        _convert_given(node, cls, self._where)
        try:
            given = {
                spec.name: node.declare_parameter(spec.name, _ros(getattr(default, spec.name)), _descriptor(spec)).value
                for spec in specs(cls)
            }
        except ParameterException as error:
            raise InputError(f"{self._where}: {error}") from None
        _refuse_unknown(node, self._where)
        self.current: T = from_mapping(cls, given, self._where)
        node.add_pre_set_parameters_callback(self._to_floats)
        node.add_on_set_parameters_callback(self._set)

    def _to_floats(self, asked: list[Parameter]) -> list[Parameter]:
        """ROS itself refuses 12 where 12.0 is meant."""
        floats = {spec.name for spec in specs(self._cls) if spec.type is float}
        whole = Parameter.Type.INTEGER
        return [
            Parameter(each.name, value=float(each.value)) if each.name in floats and each.type_ == whole else each
            for each in asked
        ]

    def _set(self, changed: list[Parameter]) -> SetParametersResult:
        ours = {parameter.name: parameter.value for parameter in changed if parameter.name in self._names}
        if not ours:
            return SetParametersResult(successful=True)
        values = {name: getattr(self.current, name) for name in self._names}
        try:
            new = from_mapping(self._cls, {**values, **ours}, self._where)
            if self._on_change is not None:
                self._on_change(new)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.current = new
        return SetParametersResult(successful=True)


def fixed(why: str) -> Callable[[object], None]:
    """For ``Parameters``: a callback that refuses every change, saying ``why``."""

    def refuse(_: object) -> None:
        raise InputError(why)

    return refuse


def refuse_parameters(node: Node) -> None:
    """Raise InputError if a node configured by options was given a parameter; call before it declares any."""
    for name in _undeclared(node):
        raise cli.no_parameter(name, node.get_name())


def _convert_given(node: Node, cls: type, where: str) -> None:
    """Check the numbers given at start, and convert them as in YAML (12 to 12.0), before ROS refuses them in its words.

    Raises InputError.
    """
    for spec in specs(cls):
        override = node._parameter_overrides.get(spec.name)
        if override is not None and spec.type in (float, int):
            node._parameter_overrides[spec.name] = Parameter(spec.name, value=check(spec, override.value, where))


def _refuse_unknown(node: Node, where: str) -> None:
    known = list(node._parameters)
    for name in _undeclared(node):
        raise InputError(f"{where}: unknown parameter {name!r}{did_you_mean(name, known)}")


def _undeclared(node: Node) -> list[str]:
    # ROS silently ignores a misspelt -p.
    given = node._parameter_overrides
    return [name for name in given if not node.has_parameter(name) and not name.startswith(cli.OF_EVERY_NODE)]


def _descriptor(spec: Spec) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=spec.described)
    bounded = math.isfinite(spec.low) and math.isfinite(spec.high)
    if bounded and spec.type is float:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(spec.low), to_value=float(spec.high))]
    if bounded and spec.type is int:
        descriptor.integer_range = [IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)]
    return descriptor


def _ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
