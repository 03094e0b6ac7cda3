"""What `truearc discover` says of the recordings that others published, one row a set.

    python -m benchmarks.real_sets DIR [--only mpi,drops]

DIR has the tables that proof/IMPORTERS.md describes. Each set is imported and asked by the commands that
docs/measured/real-data.md prints; a row has the number of shots, the first sentence of the answer, and how much better
shots are forecast that were held out.
"""

import argparse
import contextlib
import io
import re
import sys
import tempfile
from pathlib import Path

import truearc as ta
from truearc.cli.main import main as truearc
from truearc.errors import InputError
from truearc_proof.table import make_markdown

LINEAR_DRAG = Path(__file__).parents[1] / "examples" / "linear_drag.py"


# name: title, and what `import` and `discover` are given
SETS = {
    "mpi": ("table-tennis launcher", "mpi", ("mpi_launches.csv", "mpi_tracks.csv"), "--believe", "gravity,drag"),
    "drops": ("ball drops from 47 m", "ball-drops", ("ball_drops.csv",), "--believe", "gravity"),
    "falls": ("a toolbox's ball drops", "sepia-drops",
              tuple(f"sepia_ball_drop/1_field.{what}" for what in ("dat", "height", "radii")),
              "--terms-from", str(LINEAR_DRAG), "--believe", "gravity"),
    "bb": ("a throwing robot", "ball-butler", ("ball_butler_tracks.csv",), "--believe", "gravity"),
    "speeds": ("team 971's exit speeds", "frc-971", ("frc971_wheel_to_ball_speed.csv",)),
    "new-and-old": ("team 254's set points", "frc-254", ("frc_shot_tables.csv",)),
    "two-weeks": ("team 3476's set points", "frc-3476", ("frc3476_tuning_history.csv",)),
}


def ask(name: str, data: Path, folder: Path) -> tuple[str, ...]:
    """Import a set and ask about it; its row."""
    (title, importer, files, *options), where = SETS[name], folder / name
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        for words in (["import", importer, *(str(data / one) for one in files), "-o", str(where)],
                      ["discover", str(where), *options]):
            said.seek(said.truncate(0))
            if truearc([*words, "--quiet"]):
                raise InputError(f"truearc {' '.join(words)}: no answer")
    answer = said.getvalue().splitlines()[0]
    held_out = re.search(r"forecasts (.*? instead of [^(]*)", answer)
    return (title, str(len(ta.load_dataset(where).shots)), answer.partition(". ")[0] + ".",
            held_out[1].strip() if held_out else "-")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", metavar="DIR", type=Path, help="folder of the recordings")
    parser.add_argument("--only", default=",".join(SETS), help=f"comma-separated, of {', '.join(SETS)} (default: all)")
    args = parser.parse_args()
    if unknown := set(args.only.split(",")) - set(SETS):
        parser.error(f"--only: there is no {', '.join(sorted(unknown))}; there are {', '.join(SETS)}")
    with tempfile.TemporaryDirectory() as folder:
        rows = [ask(name, args.data, Path(folder)) for name in args.only.split(",")]
    print(make_markdown(("set", "shots", "answer", "forecast of shots held out"), rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
