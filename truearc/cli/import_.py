"""Turn the logs, tables and recordings of others into a dataset directory (docs/how-to/importing.md)."""

import argparse
import shlex
from pathlib import Path

import truearc as ta
from truearc.cli.common import make_progress
from truearc.cli.outputs import DATASET, OutFolder
from truearc.errors import OTHER_FORMATS, needs
from truearc.sim.data.log import load_importers

MAP = "shots.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    importers = load_importers()
    known = "; ".join(f"{importer.name}: {', or '.join(importer.ways)}" for importer in importers)
    parser.add_argument("source", choices=sorted({*OTHER_FORMATS, *(importer.name for importer in importers)}),
                        help=f"{', '.join(OTHER_FORMATS)} or csv: any team's; others: whose recordings (more come "
                        "with pip install ./proof in a checkout)")
    parser.add_argument("files", nargs="+", metavar="FILE", help=f"the public originals, or tables of them: {known}")
    parser.add_argument("-o", "--out", type=OutFolder(DATASET), required=True, metavar="DIR",
                        help="dataset directory to write")
    parser.add_argument("--only", metavar="COLUMN=TEXT,...", help="of the dataset's shots those with one of these "
                        "texts in the column (ball_quality=new), to compare parts with each other")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--map", metavar="MAP", help="of any team's files: which keys say what: a shots.toml, or an "
                     "installed map, such as ftc-csv, tracker, kinovea")
    how.add_argument("--guess", action="store_true", help="propose that map from the names, units and numbers in the "
                     f"first file, write it to DIR/{MAP}, and import by it; a CSV without a column Timestamp has a row "
                     "per shot")
    parser.add_argument("--rig", type=Path, metavar="RIG.toml", help="of any team's files: ball, wheels and target "
                        "(truearc init DIR makes one to fill in)")


def main(args: argparse.Namespace) -> int:
    """Read, say what came of it, write."""
    from truearc.sim.data.import_shots import doubts_of, only
    from truearc.sim.printed import left_out_lines
    importer = next((importer for importer in load_importers() if importer.name == args.source), None)
    if importer is None:
        raise ta.InputError(f"{args.source}: {needs(args.source)}")
    if not importer.takes(args.files):
        raise ta.InputError(f"{args.source} takes {', or '.join(importer.ways)}; not {' '.join(args.files)}")
    shot_map = ""
    if importer.load is None:
        dataset, shot_map = _by_map(args)
    elif args.map or args.guess or args.rig:
        any_team = " and ".join(one.name for one in load_importers() if one.load is None)
        raise ta.InputError(f"--map, --guess and --rig are for {any_team}; {args.source} knows its files' form")
    else:
        dataset = importer.load(*args.files)
    if args.only is not None:
        dataset = only(dataset, args.only)
    ta.save_dataset(args.out, dataset)
    if shot_map:
        (args.out / MAP).write_text(shot_map, encoding="utf-8")
    kind, table = ("times", dataset.times) if dataset.times is not None else ("track samples", dataset.tracks)
    print(f"{args.out}: {len(dataset.shots)} shots, {0 if table is None else len(table.t_s)} {kind}")
    for line in left_out_lines(dataset.left_out):
        print(line)
    for line in doubts_of(dataset):
        print(f"warning: {line}")
    return 0


def _by_map(args: argparse.Namespace) -> "tuple[ta.Dataset, str]":
    """(the dataset, the map's text where it was guessed)."""
    from truearc.sim.data.import_shots import guess
    if not args.rig:
        raise ta.InputError(f"{args.source}: --rig RIG.toml is needed: a log does not say what ball, wheels and target "
                            "there are; `truearc init DIR` makes one to fill in")
    if args.map:
        return ta.import_shots(args.files, rig=args.rig, shot_map=args.map, name=args.out.name,
                               progress=make_progress("import", args.quiet)), ""
    if not args.guess:
        raise ta.InputError(f"{args.source}: --map MAP is needed, or --guess, which proposes one")
    guessed = guess(args.files, ta.load_rig(args.rig), make_progress("guess", args.quiet))
    print(f"guessed from the names, units and numbers of {args.files[0]}; make sure of it:")
    for line in guessed.lines:
        print(f"  {line}")
    try:
        return ta.import_shots(args.files, rig=args.rig, shot_map=guessed.map, name=args.out.name,
                               progress=make_progress("import", args.quiet)), guessed.to_toml()
    except ta.InputError as error:
        print(f"\nthe map, to save as {MAP} and correct:\n\n{guessed.to_toml()}")
        again = shlex.join(["truearc", "import", args.source, *args.files, "--map", MAP, "--rig", str(args.rig),
                            "-o", str(args.out)])
        raise ta.InputError(f"{error}\nCorrect what is named; or save the map above as {MAP}, correct it (words of "
                            f"outcomes: outcome.values), and run: {again}") from error
