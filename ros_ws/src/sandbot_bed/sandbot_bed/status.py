"""A command of the protocol as a /bed/status message, the same live and in batch."""

from diagnostic_msgs.msg import DiagnosticArray

from sandbot_bed.protocol import Command, Stage
from sandbot_common import messages

_ERROR = 2


def status_message(t_ns: int, command: Command) -> DiagnosticArray:
    """/bed/status: number of preparation, stage, target, pulses, refluidised, φ, σ_φ, height and blower; error level
    if the bed failed."""
    failed = command.stage is Stage.FAILED
    figures = {
        "preparation": command.preparation,
        "stage": command.stage.value,
        "target_phi": command.target_phi,
        "pulses": command.pulses,
        "refluidised": command.refluidised,
        "phi": command.phi,
        "phi_sd": command.phi_sd,
        "height_m": command.height_m,
        "blower": command.blower,
    }
    text = command.reason or command.stage.value
    return messages.diagnostics(t_ns, "bed", figures, level=_ERROR if failed else 0, text=text)
