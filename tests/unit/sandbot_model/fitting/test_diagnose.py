"""At which stage of the chain a model fails."""

from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.diagnose import stage_tests
from sandbot_model.fitting.fit import fit
from sandbot_model.physics.model import model_of


def test_says_at_which_stage_it_fails(drawn):
    def failing(effects, values=None):
        base = fit(model_of("simple", (), {}), cells_of(drawn(effects, seed=9, values=values)))
        return {one.stage for one in stage_tests(base) if one.p < 1e-4}

    assert failing(()) == set()
    assert "speed" in failing(("stance_overlap",), {"stance_overlap": {"eta": 0.2}})
    assert "memory" in failing(("crater_refill",), {"crater_refill": {"z_0_m": 0.006, "tau_s": 0.3}})
    assert "clock" in failing(("slow_phase_speed",), {"slow_phase_speed": {"rho": 0.8}})
