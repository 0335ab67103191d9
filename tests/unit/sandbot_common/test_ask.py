"""Services over DDS whose answers get lost, as rmw_fastrtps loses those to a client it has only just met."""

import pytest
from std_srvs.srv import Trigger

from sandbot_common.ros.service import ASK_AGAIN_S, ask

pytestmark = pytest.mark.ros


class Service:
    """A service that obeys every order and loses its first ``lost`` answers, and the patience of who asks it.

    Patience ends when the order is known to be obeyed and its answer to be lost, not by the clock.
    """

    def __init__(self, beside):
        self._beside, self.lost, self.orders, self.waited_s = beside, 0, 0, []
        server = beside.node.create_service(Trigger, "/order", self._obey)
        self._send, server.send_response = server.send_response, self._answer
        self.client = beside.node.create_client(Trigger, "/order")
        beside.until(self.client.service_is_ready)
        assert ask(self.client, Trigger.Request(), beside.wait, 60.0)  # now they have met
        self.orders = 0

    def ask(self, patience_s, begun=lambda: False):
        return ask(self.client, Trigger.Request(), self._wait, patience_s, begun)

    def _wait(self, answered, seconds):
        self.waited_s.append(seconds)
        self._beside.until(lambda: self.orders == len(self.waited_s))
        return self.orders > self.lost and self._beside.wait(answered, 60.0)

    def _obey(self, _, response):
        self.orders += 1
        response.success = True
        return response

    def _answer(self, *given):
        if self.orders > self.lost:
            self._send(*given)


@pytest.fixture
def service(beside):
    return Service(beside)


def test_a_lost_answer_is_asked_for_again(service):
    service.lost = 1
    assert service.ask(10.0).success
    assert service.waited_s == [ASK_AGAIN_S] * 2
    assert service.ask(10.0).success
    assert service.orders == 3  # nothing is asked twice without need


def test_no_answer_is_told_and_nothing_stays_pending(service):
    service.lost = 99
    assert service.ask(3.0) is None
    assert service.orders == 2
    assert service.client._pending_requests == {}


def test_what_is_seen_to_have_begun_is_not_asked_for_again(service):
    service.lost = 99
    assert service.ask(10.0, begun=lambda: service.orders == 1) is None
    assert service.orders == 1
