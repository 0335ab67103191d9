"""Services over DDS whose answers get lost, as rmw_fastrtps loses those to a client it has only just met."""

import time

import pytest
from std_srvs.srv import Trigger

from sandbot_common.node import ask

pytestmark = pytest.mark.ros


@pytest.fixture
def service(beside):
    """A client of a service that obeys every order and loses its first ``lost`` answers, and the orders."""
    orders = []

    def make(lost):
        def obey(_, response):
            orders.append(time.monotonic())
            response.success = True
            return response

        server = beside.node.create_service(Trigger, "/order", obey)
        send = server.send_response
        server.send_response = lambda *given: send(*given) if len(orders) > lost else None
        client = beside.node.create_client(Trigger, "/order")
        beside.until(client.service_is_ready)
        return client, orders

    return make


def test_a_lost_answer_is_asked_for_again(service, beside):
    client, orders = service(lost=1)
    assert ask(client, Trigger.Request(), beside.wait, 10.0).success
    assert len(orders) == 2
    assert ask(client, Trigger.Request(), beside.wait, 10.0).success
    assert len(orders) == 3  # nothing is asked twice without need


def test_no_answer_is_told_and_nothing_stays_pending(service, beside):
    client, orders = service(lost=99)
    assert ask(client, Trigger.Request(), beside.wait, 3.0) is None
    assert len(orders) == 2
    assert client._pending_requests == {}
