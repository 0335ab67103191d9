"""What a campaign asks of a node's parameters, at a real node in this process: no graph, no executor."""

from types import SimpleNamespace

import pytest
import rclpy
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.task import Future

from sandbot_bed.bed_parameters import BedParameters
from sandbot_bringup.endings import TrialFailed
from sandbot_bringup.nodes import services_node
from sandbot_bringup.nodes.services_node import ServiceClients
from sandbot_common.ros.ros_parameters import Parameters
from sandbot_common.standstill import AWAKE_S

pytestmark = pytest.mark.ros
SHORT = {"settle_s": 0.4, "average_s": 0.2}
"""Neither fits what a bed has by default, in this order."""


class Client:
    """Answers at once, as the node's own service does."""

    def __init__(self, bed, kind):
        self.bed, self.kind = bed, kind

    def call_async(self, request):
        assert self.kind is SetParametersAtomically
        given = [rclpy.parameter.Parameter.from_parameter_msg(one) for one in request.parameters]
        response = SetParametersAtomically.Response(result=self.bed.set_parameters_atomically(given))
        return SimpleNamespace(done=lambda: True, result=lambda: response)

    def remove_pending_request(self, _):
        pass


@pytest.fixture
def bed(domain):
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    yield rclpy.create_node("bed", context=context)
    context.try_shutdown()


def test_parameters_that_fit_only_together_are_set_together_or_not_at_all(bed):
    settings = Parameters(bed, BedParameters)
    services = ServiceClients(
        SimpleNamespace(create_client=lambda kind, _: Client(bed, kind)), lambda condition, _: condition()
    )
    services.set("bed", SHORT)
    assert (settings.current.settle_s, settings.current.average_s) == (0.4, 0.2)
    with pytest.raises(TrialFailed, match=r"bed refused its parameters: .*average_s 0\.5 is longer than the rest"):
        services.set("bed", {"fluidise_s": 0.7, "average_s": 0.5})
    assert settings.current.fluidise_s == 5.0


@pytest.mark.parametrize("began", [True, False])
def test_legs_that_a_person_has_stopped_since_are_not_started_again_for_a_lost_answer(monkeypatch, began):
    one, given = object.__new__(ServiceClients), []
    one._triggers, one._wait = {"/clock/start": None}, None
    monkeypatch.setattr(services_node, "ask", lambda *words: given.append(words[-1]))
    if not began:
        with pytest.raises(TrialFailed, match="no answer from /clock/start within 10 s"):
            one.call("/clock/start", lambda: False)
    else:
        one.call("/clock/start", lambda: True)
        assert [begun() for begun in given] == [True]


def test_a_stop_that_was_sent_is_waited_for_until_it_is_obeyed_or_too_old_to_be():
    answers, waited = [Future(), Future()], []
    sent = iter(answers)

    def wait(condition, seconds):
        waited.append((condition(), seconds))
        for answer in answers:
            answer.set_result(None)
        waited.append((condition(), seconds))

    services = ServiceClients(
        SimpleNamespace(create_client=lambda *_: SimpleNamespace(call_async=lambda _: next(sent))), wait
    )
    services.send("/clock/stop")
    services.send("/bed/abort")
    answers[0].set_result(None)  # the bed is frozen
    services.await_answers()
    assert waited == [(False, AWAKE_S), (True, AWAKE_S)]
    services.await_answers()  # what has been waited for once is not waited for again
    assert waited[2:] == [(True, AWAKE_S)] * 2
