"""Exceptions that end a trial or a campaign early."""

from sandbot_common.errors import InputError


class TrialFailed(RuntimeError):
    """A trial could not be completed; the campaign goes on with the next one."""


class Held(RuntimeError):
    """The trial under way was stopped by a person; it is neither ok nor failed, and will be run again."""


class StoppedByHand(RuntimeError):
    """Somebody stopped legs or air of the trial under way before they had begun."""


class CampaignEnds(InputError):
    """Nothing more can be run, or somebody stopped it by hand; what was finished is kept."""
