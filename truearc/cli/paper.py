"""Commands for the paper's own method: `paper fit`, `synth`, `train`, `sweep`."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

import truearc as ta
from truearc.cli import common
from truearc.errors import save_whole
from truearc.sim.paper import PATIENCE

if TYPE_CHECKING:
    from truearc.api.fitting import GridSearch
    from truearc.api.paper import Recipe

SYNTHESIS = (*common.DATASET, "coefficients.toml", "synth.json")    # what a folder of simulated shots has
SWEEP = ("networks.csv", "settings.csv", "sweep.png", "best")    # and one of a sweep
parse_sizes, parse_weights = common.listed(common.number(int, 0)), common.listed(common.number(float))
LAMBDA = 0.01                         # the paper's weight of the simulated loss


def fit(args: argparse.Namespace) -> int:
    """Find the drag and lift coefficient that reproduce most recorded outcomes, by the paper's grid search.

    Every pair from 0 to 5 is ranked by three-point accuracy, then two-point accuracy, then deviation.
    """
    found = ta.fit(ta.load_dataset(args.dataset), method="grid", step=args.step, accept=args.accept,
                   progress=common.make_progress("fit", args.quiet))
    print(found)
    _write(args, found)
    return 0


def _write(args: argparse.Namespace, found: "GridSearch") -> None:
    from truearc.sim.printed import save_csv
    from truearc.sim.report import make_png
    if args.out is not None:
        found.belief.save(args.out)
    if args.tied is not None:
        table = found.table()
        save_csv(args.tied, table.columns, [[f"{cd:.6g}", f"{cl:.6g}", *(common.fixed(value_m, 6) for value_m in off_m)]
                                            for cd, cl, *off_m in table.rows])
    if args.picture is not None:
        save_whole(args.picture, make_png(found.plot()))
    if args.map is not None:
        found.save_map(args.map)


def synth(args: argparse.Namespace) -> int:
    """Simulate shots for the classifier, balanced over the three outcomes.

    Every configuration of the paper's grid is flown with fitted coefficients, and an even sample is drawn.
    """
    recorded = ta.load_dataset(args.exclude) if args.exclude else None
    shots = ta.paper.write_synthetic(args.out, ta.load_rig(args.rig), args.coefficients, args.n, exclude=recorded,
                                     seed=args.seed, among=common.catalogue_of(args),
                                     progress=common.make_progress("synth", args.quiet))
    print(ta.paper.say_synthetic(args.out, shots))
    return 0


def train(args: argparse.Namespace) -> int:
    """Train the paper's network (3-8-2, sigmoids) on recorded shots.

    Each batch of them is paired with a batch of simulated ones whose loss is weighed by lambda.
    """
    if args.sim is None and args.simulated_weight is not None:
        raise ta.InputError("--lambda: applies with --sim only")
    if args.validation == 0.0:
        common.refuse(args, ("--patience",), "--validation 0 trains to the end; leave it out")
    weight = LAMBDA if args.simulated_weight is None else args.simulated_weight
    shares = ta.paper.Shares(args.holdout, args.validation, weight, args.epochs)
    network = ta.paper.train_network(**data_of(args), recipe=recipe_of(args), shares=shares, seed=args.seed,
                                     progress=common.make_progress("train", args.quiet))
    for note in network.notes:
        print(note, file=sys.stderr)
    network.save(args.out)
    print("\n".join(network.report(args.out)))
    return 0


def recipe_of(args: argparse.Namespace) -> "Recipe":
    """Return how to train, as the options of `add_recipe` and --steps say; InputError where that cannot be done."""
    return ta.paper.Recipe(args.learning_rate, args.steps, args.patience or PATIENCE)


def data_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the datasets of --real and --sim, and the coefficients that the simulated shots were flown with."""
    real = ta.paper.check_plausible(ta.load_dataset(args.real), args.accept)
    return {"real": real, "simulated": ta.load_dataset(args.sim) if args.sim else None,
            "coefficients": ta.paper.load_provenance(args.sim).get("coefficients") if args.sim else None}


def sweep(args: argparse.Namespace) -> int:
    """Train the paper's network with each amount and weight of simulated shots, with several seeds of each.

    All are trained in one batch. Report which setting is best on shots that it did not learn from, and by how much.
    """
    recipe = recipe_of(args)
    if not any(args.sizes):
        common.refuse(args, ("--sim", "--lambdas"), "--sizes takes no simulated shots")
    shares = ta.paper.Shares(args.holdout, args.validation)
    sweep = ta.paper.sweep_networks(**data_of(args), sizes=args.sizes, weights=args.lambdas or (LAMBDA,),
                                    seeds=args.seeds, recipe=recipe, shares=shares, seed=args.seed,
                                    progress=common.make_progress("sweep", args.quiet))
    for note in sweep.notes:
        print(note, file=sys.stderr)
    sweep.save(args.out)
    print(sweep)
    print(f"{args.out}: settings.csv, networks.csv, sweep.png; best/ holds the network of seed {args.seed} "
          f"({sweep.best.setting.words()}), for truearc export")
    return 0
