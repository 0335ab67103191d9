"""What a campaign asks of the nodes: their services and parameters. An order that is refused fails the trial."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from sandbot_bringup.endings import TrialFailed
from sandbot_common import topics
from sandbot_common.node import ask
from sandbot_common.standstill import AWAKE_S, OLD

CALL_S = 10.0
_TRIGGERS = ("/clock/home", "/clock/start", "/clock/stop", "/bed/prepare", "/bed/abort", "/lab/reset")
_PAUSE_IMAGES = "/recorder/pause_images"

Wait = Callable[[Callable[[], bool], float], bool]
"""Spin until a condition holds, at most so many seconds; whether it does."""


class Orders:
    """Clients of a node's; ``wait`` spins it."""

    def __init__(self, node: Node, wait: Wait) -> None:
        self._wait = wait
        self._triggers = {name: node.create_client(Trigger, topics.relative(name)) for name in _TRIGGERS}
        self._pause_images = node.create_client(SetBool, topics.relative(_PAUSE_IMAGES))
        self._setters = {
            name: node.create_client(SetParametersAtomically, f"{name}/set_parameters_atomically")
            for name in ("clock", "bed", "lab")
        }
        self._getters = {name: node.create_client(GetParameters, f"{name}/get_parameters") for name in ("clock", "bed")}

    def is_offered(self, name: str) -> bool:
        """Whether anybody offers the service."""
        return bool(self._triggers[name].service_is_ready())

    def call(self, name: str, begun: Callable[[], bool] = lambda: False) -> None:
        """Give an order and have it obeyed; TrialFailed otherwise. ``begun``: whether what it starts is seen."""
        answer = self._ask(self._triggers[name], Trigger.Request(), name, begun)
        if answer and answer.message == OLD:
            self._wait(lambda: False, AWAKE_S)
            answer = self._ask(self._triggers[name], Trigger.Request(), name, begun)
        if answer and not answer.success:
            raise TrialFailed(f"{name} refused: {answer.message}")

    def send(self, name: str) -> None:
        """Give an order and wait for nothing."""
        self._triggers[name].call_async(Trigger.Request())

    def set(self, node: str, values: Mapping[str, Any]) -> None:
        """Set a node's parameters together, for some fit only each other; TrialFailed where it refuses: none is set."""
        result = self._ask(self._setters[node], _set(values), f"parameters of {node}").result
        if not result.successful:
            raise TrialFailed(f"{node} refused its parameters: {result.reason}")

    def send_values(self, node: str, values: Mapping[str, Any]) -> Future:
        """The same without waiting for the answer."""
        return self._setters[node].call_async(_set(values))

    def get(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """The values of a node's parameters; TrialFailed where it does not tell them."""
        answer = self._ask(self._getters[node], GetParameters.Request(names=list(names)), f"parameters of {node}")
        return dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))

    def film(self) -> None:
        """Have the recorder keep frames from here on."""
        if not self._wait(self._pause_images.service_is_ready, CALL_S):
            raise TrialFailed(f"the recorder does not offer {_PAUSE_IMAGES}")
        self._ask(self._pause_images, SetBool.Request(data=False), _PAUSE_IMAGES)

    def _ask(self, client: Client, request: Any, what: str, begun: Callable[[], bool] = lambda: False) -> Any:
        """The answer; None where it is lost and what was asked for has begun."""
        answer = ask(client, request, self._wait, CALL_S, begun)
        if answer is None and not begun():
            raise TrialFailed(f"no answer from {what} within {CALL_S:g} s")
        return answer


def _set(values: Mapping[str, Any]) -> SetParametersAtomically.Request:
    asked = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return SetParametersAtomically.Request(parameters=asked)
