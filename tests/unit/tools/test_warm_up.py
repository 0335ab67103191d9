"""After the set-up nobody waits for a compiler."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
BOOST = """
from scipy.special import expit
from sandbot_model import Chain, Effect, Parameter, Values

class Boost(Effect):
    'Ground that resists a fast leg more, by an S curve: no operation that could be compiled.'
    identifier, stage, formula = "boost", "strength", "k (1 + a S(omega))"
    source, seen_in = "a guess", "v, L"
    parameters = (Parameter("a", "1", -1.0, 1.0, 0.1, "gain", neutral=0.0),)
    def apply(self, chain: Chain, p: Values) -> None:
        chain.k = chain.k * (1 + p["a"] * expit(chain.omega - 12))
"""


@pytest.mark.whole
@pytest.mark.timeout(900)
def test_a_first_search_for_effects_compiles_nothing(tmp_path):
    def run(*command):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        subprocess.run([sys.executable, *command], env=environment, cwd=tmp_path, check=True, capture_output=True)
        return set((tmp_path / "cache").rglob("*.nbc"))

    compiled = run(ROOT / "tools" / "warm_up.py")
    assert compiled
    discover = ("-m", "sandbot_model.tools.discover", ROOT / "examples" / "demo_trials.csv", "--max-effects", "1")
    assert run(*discover) == compiled
    (tmp_path / "boost.py").write_text(BOOST)
    assert run(*discover, "--effects-from", "boost.py") == compiled
    (tmp_path / "readings.csv").write_text("phi,depth_m,force_n\n0.6,0.01,0.4\n0.6,0.02,0.8\n0.62,0.01,0.5\n")
    assert run(*discover, "--penetrometer", "readings.csv") == compiled
