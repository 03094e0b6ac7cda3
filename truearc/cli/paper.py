"""The commands for the paper's own method: `paper fit`, `synth`, `train` and `sweep`."""

import argparse
import sys
from typing import TYPE_CHECKING, Any

import truearc as ta
from truearc.cli import common
from truearc.errors import save_whole
from truearc.sim.paper import DEFAULT_RECIPE as DEFAULT
from truearc.sim.paper import PATIENCE, STEP

if TYPE_CHECKING:
    from truearc.api.fitting import GridSearch
    from truearc.api.paper import Recipe

SYNTHESIS = (*common.DATASET, "coefficients.toml", "synth.json")    # what a folder of simulated shots has
SWEEP = ("networks.csv", "settings.csv", "sweep.png", "best")    # and one of a sweep
LAMBDA = 0.01                         # the paper's weight of the simulated loss


def fit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset of shots")
    parser.add_argument("-o", "--out", type=common.out_file, metavar="FILE", help="coefficients.toml to write")
    parser.add_argument("--step", type=float, default=STEP, help="step of the grid; divides 5")
    parser.add_argument("--map", type=common.out_file, metavar="FILE", help="npz to write the whole map to: axis, "
                        "share_three, share_two, mean_deviation_m (nan where no three is reproduced), tied; rows cd, "
                        "columns cl")
    parser.add_argument("--picture", type=common.out_file, metavar="FILE", help="png to draw the map to")
    parser.add_argument("--tied", type=common.out_file, metavar="FILE",
                        help="csv to write all tied pairs to, the chosen one first")
    common.add_accept(parser)


def fit(args: argparse.Namespace) -> int:
    """Find the drag and lift coefficients that reproduce the most recorded outcomes, by the paper's grid search.

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


def synth_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rig", required=True, help="rig.toml")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` and `truearc paper fit` write it")
    common.add_terms_from(parser)
    parser.add_argument("-n", type=int, default=900, help="shots in all")
    parser.add_argument("--exclude", metavar="DIR", help="dataset of recorded shots whose configurations are not drawn")
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="of the draw")
    parser.add_argument("-o", "--out", type=common.OutFolder(SYNTHESIS), required=True, metavar="DIR",
                        help="dataset directory to write")


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


def train_options(parser: argparse.ArgumentParser) -> None:
    add_recipe(parser, "dataset of simulated shots; without it, recorded ones only",
               "of the shots trained on that decides when to stop; 0 trains to the end")
    parser.add_argument("--lambda", dest="simulated_weight", type=float, metavar="L",
                        help="weight of the simulated loss (default 0.01)")
    parser.add_argument("--seed", type=common.number(int, 0), default=0,
                        help="seed of split, first weights and batches")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, default=DEFAULT.steps, help="minibatches at most")
    length.add_argument("--epochs", type=common.number(int, 1),
                        help="times through the simulated shots at most, instead of --steps")
    parser.add_argument("-o", "--out", type=common.OutFolder(common.WEIGHTS), required=True, metavar="DIR",
                        help="weights directory to write")


def add_recipe(parser: argparse.ArgumentParser, simulated: str, validated: str) -> None:
    """Add options for training, also to `truearc paper sweep`; the texts describe --sim and --validation."""
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--sim", metavar="DIR", help=simulated)
    common.add_accept(parser)
    parser.add_argument("--holdout", type=float, default=0.2, metavar="SHARE",
                        help="share of recorded shots kept out of training, to report on")
    parser.add_argument("--validation", type=float, default=0.25, metavar="SHARE", help=f"share {validated}")
    parser.add_argument("--learning-rate", type=float, default=DEFAULT.learning_rate, help="Adam's step")
    parser.add_argument("--patience", type=common.number(int, 1), metavar="STEPS",
                        help=f"stop after this number of steps without improvement (default {DEFAULT.patience})")


def train(args: argparse.Namespace) -> int:
    """Train the paper's network (3-8-2, sigmoids) on recorded shots.

    Each batch is paired with a batch of simulated shots whose loss is weighted by lambda.
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
    """Return the training recipe from the options of `add_recipe` and --steps; InputError if it is invalid."""
    return ta.paper.Recipe(args.learning_rate, args.steps, args.patience or PATIENCE)


def data_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the datasets of --real and --sim, and the coefficients of the simulated shots."""
    real = ta.paper.check_plausible(ta.load_dataset(args.real), args.accept)
    return {"real": real, "simulated": ta.load_dataset(args.sim) if args.sim else None,
            "coefficients": ta.paper.load_provenance(args.sim).get("coefficients") if args.sim else None}


def sweep_options(parser: argparse.ArgumentParser) -> None:
    add_recipe(parser, "dataset of simulated shots to draw from",
               "of the rest that decides when to stop and which setting is best")
    parser.add_argument("--sizes", type=common.listed(common.number(int, 0)), default="0,500,600,750,900,1000,1250",
                        metavar="N,N...", help="numbers of simulated shots (default: the paper's %(default)s)")
    parser.add_argument("--lambdas", type=common.listed(common.number(float)), metavar="L,L...",
                        help="weights of the simulated loss (default 0.01)")
    parser.add_argument("--seeds", type=common.number(int, 1), default=20,
                        help="networks of each setting, each with its own splits")
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="the first of them")
    parser.add_argument("--steps", type=int, default=DEFAULT.steps, help="minibatches at most")
    parser.add_argument("-o", "--out", type=common.OutFolder(SWEEP), required=True, metavar="DIR",
                        help="directory to write")


def sweep(args: argparse.Namespace) -> int:
    """Train the paper's network with each amount and weight of simulated shots, with several seeds of each.

    All are trained in one batch. Report which setting is best on hold-out shots, and by how much.
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
