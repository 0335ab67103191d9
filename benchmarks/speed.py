"""v_x(t): ours and its peers on the same signals (20 + 5 sin cm/s at 5 Hz; B adds 10 and 15 Hz), 100 frames/s."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.signal import savgol_filter

from sandbot_common.arrays import Floats
from sandbot_tracking.smooth import smooth
from sandbot_tracking.speed import HarmonicSpeed

CASES = (("A", 2e-5), ("A", 6e-5), ("A", 5e-4), ("B", 6e-5))
TRIALS, WARM = 3, 200
T = np.arange(0, 6, 0.01)


def truth(kind: str) -> tuple[Floats, Floats]:
    """Position [m] and velocity [m/s]."""
    parts = [(5, 0.05)] + ([(10, 0.025), (15, 0.0125)] if kind == "B" else [])
    x, v = 0.2 * T, np.full(T.size, 0.2)
    for hertz, amplitude in parts:
        w = 2 * np.pi * hertz
        x, v = x - amplitude * np.cos(w * T) / w, v + amplitude * np.sin(w * T)
    return x, v


def _savgol_tuned(y: Floats, v: Floats) -> Floats:
    tries = [savgol_filter(y, n, k, deriv=1, delta=0.01) for n in range(5, 31, 2) for k in (2, 3, 4) if n > k]
    return min(tries, key=lambda guess: float(_rms(guess, v)))


def _spline(y: Floats, _: Floats) -> Floats:
    frames = np.arange(y.size, dtype=float)
    return np.asarray(make_smoothing_spline(frames, y).derivative()(frames) * 100)


def _online(y: Floats, noise: float) -> Floats:
    estimate = HarmonicSpeed()
    return np.array([estimate.update(t, x, noise**2, 5 * np.pi)[0] for t, x in zip(T, y, strict=True)])


def _rms(guess: Floats, v: Floats) -> float:
    return float(np.sqrt(np.mean((guess - v)[WARM:-20] ** 2)) * 100)


def main() -> str:
    """The markdown section."""
    rng = np.random.default_rng(1)
    methods: dict[str, Callable[[Floats, Floats, float], Floats]] = {
        "np.gradient": lambda y, _v, _n: np.gradient(y, T),
        "Savitzky–Golay tuned to the truth": lambda y, v, _n: _savgol_tuned(y, v),
        "smoothing spline, GCV": lambda y, v, _n: _spline(y, v),
        "ours offline, smooth()": lambda y, _v, _n: smooth(T, y).v,
        "ours online, HarmonicSpeed": lambda y, _v, n: _online(y, n),
    }
    table: dict[str, list[float]] = {name: [] for name in methods}
    for kind, noise in CASES:
        x, v = truth(kind)
        records = [x + noise * rng.standard_normal(T.size) for _ in range(TRIALS)]
        for name, method in methods.items():
            table[name].append(float(np.median([_rms(method(y, v, noise), v) for y in records])))
    heads = " | ".join(f"{kind} {noise * 1e3:.2f} mm" for kind, noise in CASES)
    lines = ["## Speed: RMS error of v_x(t) [cm/s]", "", f"| method | {heads} |", "|---" * (len(CASES) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(f"{value:.3f}" for value in row) + " |" for name, row in table.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    print(main())
