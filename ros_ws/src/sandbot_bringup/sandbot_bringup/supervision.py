"""Who must be heard from while a trial runs: pure; ``campaign_node`` feeds it, the clock is passed in."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Sign:
    """A sign of life: who gives it, on which topic, and how long it may stay away [s]."""

    who: str
    topic: str
    limit_s: float

    @property
    def missing(self) -> str:
        """One phrase of what is wrong where it stays away."""
        return f"{self.who} is silent: nothing from it on {self.topic} for {self.limit_s:g} s"


@dataclass
class Supervisor:
    """Tells who has fallen silent. Silence counts from the moment a sign is asked for, at the earliest."""

    _heard_s: dict[tuple[str, str], float] = field(default_factory=dict)
    _watched: dict[Sign, float] = field(default_factory=dict)

    def heard(self, who: str, topic: str, now_s: float) -> None:
        """A sign of life."""
        self._heard_s[who, topic] = now_s

    def age_s(self, who: str, topic: str, now_s: float) -> float:
        """Time since the last sign; infinite before the first."""
        return now_s - self._heard_s.get((who, topic), -math.inf)

    def watch(self, *signs: Sign, now_s: float) -> None:
        """Ask for these signs, and no others, from now on."""
        self._watched = {sign: self._watched.get(sign, now_s) for sign in signs}

    def pardon(self, now_s: float) -> None:
        """Count all silence anew: nobody was listened to until now."""
        self._watched = dict.fromkeys(self._watched, now_s)

    def silent(self, now_s: float) -> str:
        """Who is silent, in one phrase; an empty string if nobody is."""
        for sign, since_s in self._watched.items():
            if min(self.age_s(sign.who, sign.topic, now_s), now_s - since_s) > sign.limit_s:
                return sign.missing
        return ""


def status_values(status: object) -> Mapping[str, str]:
    """The key-value pairs of a DiagnosticStatus."""
    return {pair.key: pair.value for pair in status.values}  # type: ignore[attr-defined]
