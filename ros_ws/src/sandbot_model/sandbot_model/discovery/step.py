"""One effect more: where the search for its fit begins, and how far it looks."""

from dataclasses import dataclass

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.verdict import passes
from sandbot_model.fitting.fit import Fit, fit, fitted_at
from sandbot_model.fitting.global_minimum import WarmStart, solve_near
from sandbot_model.physics.model import Model


@dataclass(frozen=True)
class Begin:
    """Where a fit begins; it stays ``nearby`` if what is there already leaves nothing to explain."""

    at: WarmStart | None
    nearby: bool = False

    @classmethod
    def after(cls, before: Fit | None) -> "Begin":
        """Of the step after a fit, which has one effect more."""
        return cls(None) if before is None else cls(before.warm_start, passes(before))

    def fit(self, model: Model, cells: Cells) -> Fit:
        """The fit of a model."""
        if self.at is None or not self.nearby:
            return fit(model, cells, self.at)
        return fitted_at(model, cells, solve_near((model, cells, (self.at,), None)))

    def same_as(self, other: "Begin | None") -> bool:
        """Whether two searches begin at the same place, and look as far."""
        if other is None or self.nearby != other.nearby:
            return False
        if self.at is None or other.at is None:
            return self.at is other.at
        return self.at.deviance == other.at.deviance and dict(self.at.parameters) == dict(other.at.parameters)
