"""A campaign's calls to the nodes' services and parameters. A refused call fails the trial."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from sandbot_bringup.endings import StoppedByHand, TrialFailed
from sandbot_common import topics
from sandbot_common.ros.service import ASK_AGAIN_S, ask
from sandbot_common.standstill import AWAKE_S, REFUSED_S, STOPPED, STOPPED_S

CALL_S = 10.0
_TRIGGERS = ("/clock/home", "/clock/start", "/clock/stop", "/bed/prepare", "/bed/abort", "/lab/reset")
_PAUSE_IMAGES = "/recorder/pause_images"

Wait = Callable[[Callable[[], bool], float], bool]
"""Spin until a condition holds, up to a number of seconds; returns whether it does."""


class ServiceClients:
    """Service clients of a node; ``wait`` spins it."""

    def __init__(self, node: Node, wait: Wait) -> None:
        self._wait = wait
        self._triggers = {name: node.create_client(Trigger, topics.relative(name)) for name in _TRIGGERS}
        self._pause_images = node.create_client(SetBool, topics.relative(_PAUSE_IMAGES))
        self._setters = {
            name: node.create_client(SetParametersAtomically, f"{name}/set_parameters_atomically")
            for name in ("clock", "bed", "lab")
        }
        self._unanswered: list[Future] = []
        self._getters = {name: node.create_client(GetParameters, f"{name}/get_parameters") for name in ("clock", "bed")}

    def is_offered(self, name: str) -> bool:
        """Whether anybody offers the service."""
        return bool(self._triggers[name].service_is_ready())

    def call(self, name: str, begun: Callable[[], bool] = lambda: False, since_s: float = math.inf) -> None:
        """Call a service that must succeed, or raise TrialFailed. ``begun``: whether its effect has been observed.

        ``since_s``: when the trial began [s, monotonic]. A stop before it does not count, and is waited for until it is
        over; raises StoppedByHand after a later one.
        """
        refused = set(REFUSED_S)
        # A node that was held up and then stopped says so one after the other.
        while (answer := self._ask(self._triggers[name], Trigger.Request(), name, begun)) and answer.message in refused:
            refused.remove(answer.message)
            again_s = since_s + STOPPED_S if answer.message == STOPPED else math.inf
            self._wait(lambda: False, min(REFUSED_S[answer.message], max(again_s - time.monotonic(), 0.0)))
        if answer and answer.message == STOPPED:
            raise StoppedByHand(f"stopped by hand before {name}")
        if answer and not answer.success:
            raise TrialFailed(f"{name} refused: {answer.message}")

    def words(self, name: str) -> str:
        """Call a service once; the words of its answer, empty if there is none."""
        answer = ask(self._triggers[name], Trigger.Request(), self._wait, ASK_AGAIN_S)
        return answer.message if answer else ""

    def send(self, name: str) -> None:
        """Call a service without waiting for the response."""
        self._unanswered.append(self._triggers[name].call_async(Trigger.Request()))

    def await_answers(self) -> None:
        """Wait for the responses to ``send``: a node that was frozen meanwhile obeys seconds after it resumes.

        What it is asked next must not be taken for older than that stop. One that has ended never answers.
        """
        self._wait(lambda: all(answer.done() for answer in self._unanswered), AWAKE_S)
        self._unanswered.clear()

    def set(self, node: str, values: Mapping[str, Any]) -> None:
        """Set a node's parameters atomically, as some are only valid together. Raises TrialFailed if it refuses."""
        result = self._ask(self._setters[node], _set(values), f"parameters of {node}").result
        if not result.successful:
            raise TrialFailed(f"{node} refused its parameters: {result.reason}")

    def send_values(self, node: str, values: Mapping[str, Any]) -> Future:
        """The same without waiting for the response."""
        return self._setters[node].call_async(_set(values))

    def get(self, node: str, names: Sequence[str]) -> dict[str, Any]:
        """The values of a node's parameters. Raises TrialFailed if there is no response."""
        answer = self._ask(self._getters[node], GetParameters.Request(names=list(names)), f"parameters of {node}")
        return dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))

    def film(self) -> None:
        """Have the recorder keep frames from now on."""
        if not self._wait(self._pause_images.service_is_ready, CALL_S):
            raise TrialFailed(f"the recorder does not offer {_PAUSE_IMAGES}")
        self._ask(self._pause_images, SetBool.Request(data=False), _PAUSE_IMAGES)

    def _ask(self, client: Client, request: Any, what: str, begun: Callable[[], bool] = lambda: False) -> Any:
        """The response; None if it is lost but the request is known to have been executed."""
        answer = ask(client, request, self._wait, CALL_S, begun)
        if answer is None and not begun():
            raise TrialFailed(f"no answer from {what} within {CALL_S:g} s")
        return answer


def _set(values: Mapping[str, Any]) -> SetParametersAtomically.Request:
    asked = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return SetParametersAtomically.Request(parameters=asked)
