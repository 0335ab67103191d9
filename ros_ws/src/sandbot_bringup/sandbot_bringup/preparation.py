"""Whether the bed has ended what it was asked to prepare; that it failed, or is idle, it may say of what was before."""

from sandbot_bed.protocol import Stage

AT_REST = ("", *(stage.value for stage in Stage if not stage.busy))
"""Stages in which no preparation is under way; the first: none has been heard of."""


class Preparation:
    """A preparation that a bed is asked for. ``before`` is the number of its last one, empty where it tells none.

    A campaign that was frozen hears at once all that its bed has done meanwhile, or only the end of it: that it was
    busy may never be seen, but the number of the preparation is another one.
    """

    def __init__(self, before: str) -> None:
        self._before, self._begun = before, False

    def begun(self, number: str, stage: str) -> bool:
        """Whether it is, or was, under way, by what the bed said last."""
        is_new = bool(self._before and number) and number != self._before
        self._begun = self._begun or is_new or stage not in AT_REST
        return self._begun

    def over(self, number: str, stage: str) -> bool:
        """Whether it has ended without a bed."""
        return self.begun(number, stage) and stage in (Stage.FAILED, Stage.IDLE)
