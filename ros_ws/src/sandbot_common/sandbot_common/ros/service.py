"""Asking a service until it answers."""

import math
from collections.abc import Callable
from typing import Any

from rclpy.client import Client

ASK_AGAIN_S = 2.0


def ask(
    client: Client,
    request: Any,
    wait: Callable[[Callable[[], bool], float], bool],
    patience_s: float,
    begun: Callable[[], bool] = lambda: False,
) -> Any:
    """The response of a service, requested again every two seconds; None if there is none within ``patience_s``.

    A server may receive a new client's request before it knows where to respond; rmw_fastrtps then drops the response
    after 0.1 s ("client will not receive response"). The request was executed all the same, so it must be idempotent,
    or ``begun`` must tell that it was executed: then it is not repeated, as somebody may since have ended what it
    began. ``wait(condition, timeout_s)`` spins until the condition holds, and returns whether it does.
    """
    asked: list[Any] = []

    def answered() -> bool:
        return any(future.done() for future in asked)

    for _ in range(math.ceil(patience_s / ASK_AGAIN_S)):
        asked.append(client.call_async(request))
        if wait(answered, ASK_AGAIN_S) or begun():
            break
    for future in asked:
        client.remove_pending_request(future)
    return next((future.result() for future in asked if future.done()), None)
