"""The desk of a campaign without a graph."""

import json
from types import SimpleNamespace

from sandbot_bringup.desk_node import Desk
from sandbot_common import messages


def test_half_a_character_in_an_order_is_answered_and_does_not_end_the_campaign():
    one, said = object.__new__(Desk), []
    one._answers, one.queue = {}, SimpleNamespace(plan=None)
    one._content = lambda: {"answers": one._answers}
    one._status = SimpleNamespace(publish=lambda message: said.append(message.data.encode()))
    one._on_command(messages.string('{"id": "\\ud800", "do": "dance"}'))
    assert "no order" in json.loads(said[-1])["answers"]["\ud800"]["message"]


def test_a_disk_that_cannot_be_asked_does_not_end_the_campaign(tmp_path):
    one = object.__new__(Desk)
    one._folder = tmp_path
    assert one._free_bytes() > 0
    one._folder = tmp_path / "pulled out"
    assert one._free_bytes() is None
