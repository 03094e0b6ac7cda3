"""Processor time of `truearc.discover(system, runs)`: 32 runs of 1,000 samples of a mass on a spring with dry friction.

    python -m benchmarks.system_speed

JAX traces the rate function. Compilation counts. The recordings come from NumPy code that shares nothing with it.
"""

import sys
import time
from typing import Any

import numpy as np

import truearc as ta
from benchmarks.options import read_options

STEP_S, HELD, SUBSTEPS = 0.02, 25, 5
NOISE = {"x_m": 0.002, "v_m_s": 0.01}


def rate(state: Any, inputs: Any, p: Any) -> Any:
    place, speed = state
    return speed, (inputs["force_n"] - p.k * place - p.c * speed) / inputs["mass_kg"]


def truth(force_n: Any, mass_kg: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """Places and speeds [runs, samples] with dry friction, by Runge and Kutta in SUBSTEPS."""
    runs, samples = force_n.shape
    state, told = np.zeros((2, runs)), np.zeros((2, runs, samples))

    def slope(state: Any, force: Any) -> Any:
        place, speed = state
        return np.stack([speed, (force - 10.0 * place - 0.4 * speed) / mass_kg - 0.15 * np.tanh(speed / 0.02)])

    h = STEP_S / SUBSTEPS
    for n in range(samples):
        told[:, :, n] = state
        for _ in range(SUBSTEPS):
            one = slope(state, force_n[:, n])
            two = slope(state + 0.5 * h * one, force_n[:, n])
            three = slope(state + 0.5 * h * two, force_n[:, n])
            state = state + h / 6.0 * (one + 2.0 * two + 2.0 * three + slope(state + h * three, force_n[:, n]))
    return tuple(told + rng.normal(size=told.shape) * np.array([[[sd]] for sd in NOISE.values()]))


def main() -> int:
    args = read_options(__doc__, runs=32, samples=1000, seed=6700)
    rng, run = np.random.default_rng(args.seed), np.repeat(np.arange(args.runs), args.samples)
    force_n = np.repeat(rng.uniform(-4.0, 4.0, (args.runs, -(-args.samples // HELD))), HELD, axis=1)[:, :args.samples]
    mass_kg = rng.uniform(0.5, 2.0, args.runs)
    place_m, speed_m_s = truth(force_n, mass_kg, rng)
    table = {"run": run, "t_s": STEP_S * np.tile(np.arange(args.samples), args.runs), "force_n": force_n.ravel(),
             "mass_kg": mass_kg[run], "x_m": place_m.ravel(), "v_m_s": speed_m_s.ravel()}
    given: dict[str, Any] = {"inputs": ["force_n"], "conditions": ["mass_kg"]}
    system = ta.System(rate=rate, state=list(NOISE), believed={
        "k": ta.positive(8.0, factor=2), "c": ta.positive(0.3, factor=3)})
    begin = time.process_time()
    found = ta.discover(system, ta.Runs(table, **given), seed=0)
    seconds = time.process_time() - begin
    terms = [one for one in found.investigation.model.layout.columns if one.kind == "term"]
    print(f"{found}\n{len(terms)} candidates, {args.runs} runs of {args.samples} samples: {seconds:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
