"""Both tripods standing at once hold each other back."""

from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect, Parameter, Values


class StanceOverlap(Effect):
    """A fraction η of every step is lost to the other tripod."""

    identifier = "stance_overlap"
    stage = "speed"
    formula = "v -> v*(1 - eta): the first step likewise"
    source = "Li09, double stance"
    seen_in = "off the geometry lock: v lower at the same L"
    control = "walk in a gait of smaller duty factor d_c: it shrinks"
    mistaken_for = "a cable that slows the body but not its peak speed, unlike cable_drag,"
    parameters = (
        Parameter(
            "eta",
            "1",
            0.0,
            0.25,
            0.1,
            "fraction of the speed lost while both tripods stand",
            neutral=0.0,
            hard_low=0.0,
            hard_high=0.9,
        ),
    )

    def apply(self, chain: Chain, p: Values) -> None:
        chain.kept = chain.kept * (1 - p["eta"])
