"""Whether a requested preparation of the bed has ended; what the bed reports may be the end of an earlier one."""

from sandbot_bed.protocol import Stage

AT_REST = ("", *(stage.value for stage in Stage if not stage.busy))
"""Stages in which no preparation is under way; "" means that no stage has been received."""


class Preparation:
    """A requested preparation. ``before`` is the number of the bed's last one, empty if it does not report it.

    A campaign that was frozen receives everything its bed has done meanwhile at once, or only the end of it: it may
    never see the bed busy, but the number of the preparation has changed.
    """

    def __init__(self, before: str) -> None:
        self._before, self._begun = before, False

    def begun(self, number: str, stage: str) -> bool:
        """Whether it is or was under way, according to the bed's last status."""
        is_new = bool(self._before and number) and number != self._before
        self._begun = self._begun or is_new or stage not in AT_REST
        return self._begun

    def over(self, number: str, stage: str) -> bool:
        """Whether it has ended, with success if the stage is ``ready``."""
        return self.begun(number, stage) and stage in (Stage.READY, Stage.FAILED, Stage.IDLE)
