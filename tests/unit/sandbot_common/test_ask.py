"""Services over DDS whose answers get lost, as rmw_fastrtps loses those to a client it has only just met."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from sandbot_common.node import ask

pytestmark = pytest.mark.ros


@pytest.fixture
def service(domain):
    """A client of a service that obeys every order and loses its first ``lost`` answers; orders; how to wait."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    here = rclpy.create_node("here", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(here)
    orders = []

    def wait(condition, seconds):
        end = time.monotonic() + seconds
        while not condition() and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        return condition()

    def make(lost):
        def obey(_, response):
            orders.append(time.monotonic())
            response.success = True
            return response

        server = here.create_service(Trigger, "/order", obey)
        send = server.send_response
        server.send_response = lambda *given: send(*given) if len(orders) > lost else None
        client = here.create_client(Trigger, "/order")
        assert wait(client.service_is_ready, 20.0)
        return client, orders, wait

    yield make
    here.destroy_node()
    executor.shutdown()
    rclpy.shutdown(context=context)


def test_a_lost_answer_is_asked_for_again(service):
    client, orders, wait = service(lost=1)
    assert ask(client, Trigger.Request(), wait, 10.0).success
    assert len(orders) == 2
    assert ask(client, Trigger.Request(), wait, 10.0).success
    assert len(orders) == 3  # nothing is asked twice without need


def test_no_answer_is_told_and_nothing_stays_pending(service):
    client, orders, wait = service(lost=99)
    assert ask(client, Trigger.Request(), wait, 3.0) is None
    assert len(orders) == 2
    assert client._pending_requests == {}
