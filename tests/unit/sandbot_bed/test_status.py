from sandbot_bed.protocol import Command, Stage
from sandbot_bed.status import status_message


def test_status_carries_the_command():
    status = status_message(1, Command(stage=Stage.PULSE, pulses=3, phi=0.6, blower=1.0)).status[0]
    values = {pair.key: pair.value for pair in status.values}
    assert (values["stage"], values["pulses"], values["phi"], values["phi_sd"]) == ("pulse", "3", "0.6", "nan")
    assert status.level == b"\x00"


def test_a_failure_is_an_error_with_its_reason():
    status = status_message(1, Command(stage=Stage.FAILED, reason="no height")).status[0]
    assert (status.level, status.message) == (b"\x02", "no height")
