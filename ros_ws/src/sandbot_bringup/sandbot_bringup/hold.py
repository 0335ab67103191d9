"""Whether a campaign may go on: pure. Once held it stays held until somebody says go; nothing resumes by itself."""

from dataclasses import dataclass


@dataclass
class Hold:
    """``now``: the trial under way must end at once. ``pausing``: the campaign is to be held once it has ended."""

    why: str = ""
    """Why it is held; empty while it is not."""
    now: bool = False
    pausing: bool = False

    @property
    def state(self) -> str:
        """running, pausing (held after this trial), stopping (held as soon as all is at rest) or held."""
        return "stopping" if self.now else "held" if self.why else "pausing" if self.pausing else "running"

    def stop(self, why: str) -> str:
        """End the trial under way and hold; returns what is going to happen."""
        if self.state != "held":  # otherwise no trial is under way
            self.why, self.now, self.pausing = why, True, False
        return "the campaign is held until Go"

    def pause(self) -> str:
        """Hold after the trial under way; returns what is going to happen."""
        if self.why:
            return f"held already: {self.why}"
        self.pausing = True
        return "the campaign is held after this trial, until Go"

    def between_trials(self) -> None:
        """No trial is under way: pending requests take effect."""
        self.now = False
        if self.pausing:
            self.why, self.pausing = "paused by the operator", False

    def go(self) -> tuple[bool, str]:
        """Go on; returns whether that was possible, and what happens."""
        if self.now:
            return False, "the trial under way is still being stopped"
        if not (self.why or self.pausing):
            return True, "the campaign was running"
        self.why, self.pausing = "", False
        return True, "the campaign goes on"
