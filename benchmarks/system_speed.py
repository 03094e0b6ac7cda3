"""Processor time of `truearc.discover(system, runs)`: 32 runs of 1,000 samples of a mass on a spring with dry friction.

    python -m benchmarks.system_speed

The rate function is written with jax.numpy. Compilation counts.
"""

import sys
import time
from typing import Any

import jax.numpy as jnp
import numpy as np

import truearc as ta
from benchmarks.options import read_options

STEP_S, HELD = 0.02, 25
NOISE = {"x_m": 0.002, "v_m_s": 0.01}


def rate(state: Any, inputs: Any, p: Any) -> Any:
    place, speed = state
    return speed, (inputs["force_n"] - p.k * place - p.c * speed) / inputs["mass_kg"]


def truth(state: Any, inputs: Any, p: Any) -> Any:
    speed, push = rate(state, inputs, p)
    return speed, push - 0.15 * jnp.tanh(speed / 0.02)


def main() -> int:
    args = read_options(__doc__, runs=32, samples=1000, seed=6700)
    rng, run = np.random.default_rng(args.seed), np.repeat(np.arange(args.runs), args.samples)
    table = {"run": run, "t_s": STEP_S * np.tile(np.arange(args.samples), args.runs),
             "force_n": np.repeat(rng.uniform(-4.0, 4.0, len(run) // HELD), HELD),
             "mass_kg": rng.uniform(0.5, 2.0, args.runs)[run], "x_m": np.zeros(len(run)), "v_m_s": np.zeros(len(run))}
    given: dict[str, Any] = {"inputs": ["force_n"], "conditions": ["mass_kg"]}
    true = ta.System(rate=truth, state=list(NOISE), observe=NOISE, believed={
        "k": ta.positive(10.0), "c": ta.positive(0.4)})
    seen = true.simulate(ta.Runs(table, **given))
    table |= {name: seen[name] + sd * rng.normal(size=len(run)) for name, sd in NOISE.items()}
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
