"""truearc paper synth: balanced simulated shots."""

import argparse
import json
import shutil
from pathlib import Path

from truearc.cli.terms_from import add_terms_from, catalogue_of

DESCRIPTION = """Simulated shots for the classifier: every configuration of the paper's grid is flown with fitted
coefficients, and an even sample of the three outcomes is drawn. With --draws each shot has coefficients of its own,
drawn from the covariance that `truearc fit` writes, and the scatter and sensor noise of a real shot."""
EXAMPLE = "truearc paper synth --rig rig.toml --coefficients coefficients.toml -n 900 --exclude shots/ -o simulated/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rig", required=True, help="rig.toml")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` and `truearc paper fit` write it")
    add_terms_from(parser)
    parser.add_argument("-n", type=int, default=900, help="shots in all (900)")
    parser.add_argument("--draws", type=int, metavar="N",
                        help="draw N sets of coefficients from the fit's covariance, and scatter every shot; without "
                             "it one exact set, as in the paper")
    parser.add_argument("--exclude", metavar="DIR", help="dataset of recorded shots whose configurations are not drawn")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("-o", "--out", required=True, metavar="DIR", help="dataset directory to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the dataset is written."""
    from importlib.metadata import version

    from truearc.cli.progress import make_progress
    from truearc.sim.data.columns import OUTCOMES
    from truearc.sim.data.dataset import Dataset, check_free, dataset_hash, load_dataset, load_rig, save_dataset
    from truearc.sim.infer.belief import load_belief
    from truearc.sim.paper.synthetic_data import PROVENANCE_FILE, SHAPE, synthesise
    from truearc.sim.paper.synthetic_draws import check_belief, synthesise_draws
    check_free(args.out)
    facts = load_rig(args.rig)
    belief = load_belief(args.coefficients, catalogue_of(args))
    recorded = load_dataset(args.exclude).shots if args.exclude else None
    progress = make_progress("synth", args.quiet)
    if args.draws is None:
        shots = synthesise(facts, belief, args.n, recorded, args.seed, progress)
    else:
        check_belief(belief, args.coefficients)
        shots = synthesise_draws(facts, belief, args.draws, args.n, recorded, args.seed, progress)
    out = Path(args.out)
    save_dataset(out, Dataset(out.name, facts, shots))
    shutil.copyfile(args.coefficients, out / "coefficients.toml")
    provenance = {"version": version("truearc"), "seed": args.seed, "coefficients": belief.coefficients,
                  "draws": args.draws, "scatter": belief.scatter if args.draws else None,
                  "excluded_sha256": dataset_hash(args.exclude) if args.exclude else None}
    (out / PROVENANCE_FILE).write_text(json.dumps(provenance, indent=1) + "\n", encoding="utf-8")
    counts = {outcome: shots.text("outcome").count(outcome) for outcome in OUTCOMES}
    print(f"{out}: {len(shots)} simulated shots of {SHAPE[0] * SHAPE[1] * SHAPE[2]} configurations: "
          + ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
          + (f"; each with one of {args.draws} sets of coefficients, launch scatter and sensor noise"
             if args.draws else ""))
    return 0
