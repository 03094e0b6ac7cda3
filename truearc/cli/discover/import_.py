"""Turn recordings that others made into a dataset directory (docs/importing.md)."""

import argparse

import truearc as ta
from truearc.cli.outputs import DATASET, OutFolder
from truearc.sim.data.importers.registry import load_importers

EXAMPLE = "truearc import mpi mn5008_backspin.hdf5 mn5008_no_spin.hdf5 -o mpi"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    importers = load_importers()
    known = "; ".join(f"{importer.name}: {', or '.join(importer.ways)}" for importer in importers)
    parser.add_argument("source", choices=[importer.name for importer in importers], help="whose recordings")
    parser.add_argument("files", nargs="+", metavar="FILE", help=f"the public originals, or tables of them: {known}")
    parser.add_argument("-o", "--out", type=OutFolder(DATASET), required=True, metavar="DIR",
                        help="dataset directory to write")
    parser.add_argument("--only", metavar="COLUMN=TEXT,...", help="of the dataset's shots those with one of these "
                        "texts in the column (ball_quality=new), to compare parts with each other")


def main(args: argparse.Namespace) -> int:
    """Read, say what came of it, write."""
    from truearc.sim.data.importers.imported import doubts_of, only
    importer = next(importer for importer in load_importers() if importer.name == args.source)
    if not importer.takes(args.files):
        raise ta.InputError(f"{args.source} takes {', or '.join(importer.ways)}; not {' '.join(args.files)}")
    dataset = importer.load(*args.files)
    if args.only is not None:
        dataset = only(dataset, args.only)
    ta.save_dataset(args.out, dataset)
    kind, table = ("times", dataset.times) if dataset.times is not None else ("track samples", dataset.tracks)
    print(f"{args.out}: {len(dataset.shots)} shots, {0 if table is None else len(table.t_s)} {kind}")
    for line in dataset.left_out:
        print(f"left out: {line}")
    for line in doubts_of(dataset):
        print(f"warning: {line}")
    return 0
