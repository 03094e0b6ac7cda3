"""How often 90 % intervals of `truearc fit` contain the truth, on shots that other code simulated.

    python -m benchmarks.coverage [--replicates 200] [--shots 150] [--side] [--seed 0]

Every replicate draws its own truth (scatters from their priors, coefficients from wide ranges), configurations and
shots (tests.sim.fit.independent: DOP853, no code of truearc.sim.physics), fits, and asks of every parameter whether
the truth lies in its profile-likelihood interval.
"""

import argparse
import time

import numpy as np

from tests.sim.infer.independent import Truth, make_dataset
from truearc.sim.infer.fit import fit_map
from truearc.sim.infer.intervals import deviance_at
from truearc.sim.infer.likelihood.noise import SCATTER_PRIOR
from truearc.sim.intervals import Z90, wilson

TERMS = ("drag", "magnus", "exit_efficiency")
LOW, HIGH = 0.86, 0.94                # coverage that every parameter must have


def draw_truth(rng: np.random.Generator) -> Truth:
    """Coefficients over what launchers and balls have; scatters from the priors that the fit states."""
    speed, elevation_rad = (median * np.exp(np.log(factor) * rng.normal()) for median, factor in (
        SCATTER_PRIOR["scatter.speed"], SCATTER_PRIOR["scatter.elevation_rad"]))
    return Truth(rng.uniform(0.3, 0.7), rng.uniform(0.02, 0.1), rng.uniform(0.1, 0.35), float(speed),
                 float(np.degrees(elevation_rad)))


def true_values(truth: Truth) -> dict[str, float]:
    return {"drag.cd": truth.cd, "magnus.cl": truth.cl, "exit_efficiency.loss": truth.loss,
            "scatter.speed": truth.speed_sd, "scatter.elevation_deg": truth.elevation_sd_deg}


def replicate(seed: int, shots: int, side: bool) -> dict[str, bool] | None:
    """Whether each parameter's interval holds the truth; None when the fit did not settle."""
    truth = draw_truth(np.random.default_rng([seed, 1]))
    fit = fit_map(make_dataset(seed, shots, truth, side=side), TERMS)
    if not fit.converged:
        return None
    return {name: deviance_at(fit, name, value) <= Z90**2 for name, value in true_values(truth).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=200)
    parser.add_argument("--shots", type=int, default=150)
    parser.add_argument("--side", action="store_true", help="high or low is known of all but threes")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    begin, found = time.perf_counter(), []
    for number in range(args.replicates):
        found.append(replicate(args.seed + number, args.shots, args.side))
        if (number + 1) % 20 == 0 or number + 1 == args.replicates:
            print(f"\n{time.perf_counter() - begin:.0f} s")
            report(found, args.shots)


def report(found: list[dict[str, bool] | None], shots: int) -> None:
    settled = [one for one in found if one is not None]
    print(f"{len(found)} replicates of {shots} shots, {len(found) - len(settled)} fits did not settle", flush=True)
    for name in settled[0] if settled else ():
        inside = sum(one[name] for one in settled)
        low, high = wilson(inside, len(settled))
        share = inside / len(settled)
        print(f"{name:24s} {share:.3f} inside ({low:.3f} to {high:.3f})  "
              f"{'within' if LOW <= share <= HIGH else 'OUTSIDE'} {LOW}-{HIGH}", flush=True)


if __name__ == "__main__":
    main()
