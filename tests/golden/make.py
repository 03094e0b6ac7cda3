"""`make golden`: recompute every artefact through the command line and compare it with tests/golden/reference.

One line an artefact, with the largest difference of numbers; exit 1 if anything is beyond its limit. `--write` makes
the references again, for a change that is meant: say in the commit what has changed. Most are of tag proof-1; written
again since, each by a commit that says why: finding-*, design, identifiability, predict, belief, grid*, train-physics,
export-physics, gate-physics, gated-*. tests/golden/proof_1 keeps the belief from
which some begin.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))      # run as a file, too

from tests.golden.artefacts import ARTEFACTS, REFERENCE, Artefact, unpack
from tests.golden.commands import CommandFailed
from tests.golden.compare import compare

SHOWN = 5                                               # differences printed of each artefact


def main(argv: list[str] | None = None) -> int:
    """Exit 0 if everything is as it was, 1 if not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["*"], help="artefacts to make, with * and ? (all)")
    parser.add_argument("--write", action="store_true", help="replace the references")
    args = parser.parse_args(argv)
    chosen = [one for one in ARTEFACTS if any(fnmatch(one.name, pattern) for pattern in args.names)]
    if not chosen:
        parser.error(f"no artefact is called {' or '.join(args.names)}; there are "
                     f"{', '.join(one.name for one in ARTEFACTS)}")
    with tempfile.TemporaryDirectory(prefix="truearc-golden-") as folder:
        scratch = Path(folder)
        unpack(scratch)
        start = time.monotonic()
        if args.write:                                  # in order: later ones read earlier references
            same = [write(one, scratch) for one in chosen]
        else:
            with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
                same = list(pool.map(lambda one: check(one, scratch), chosen))
    print(f"{sum(same)} of {len(same)} artefacts {'written' if args.write else 'as they were'}, "
          f"{time.monotonic() - start:.0f} s")
    return 0 if all(same) else 1


def check(artefact: Artefact, scratch: Path) -> bool:
    """Make it, compare it, print the line; whether it is as it was."""
    start, out = time.monotonic(), make(artefact, scratch)
    if out is None:
        return False
    found = compare(REFERENCE / artefact.name, out, artefact.limit)
    print(f"{'DIFFERS' if found.wrong else 'ok':8s}{artefact.name:21s}{found.leaves:5d} leaves, largest difference "
          f"{found.largest:.1e} (limit {artefact.limit:g})  {time.monotonic() - start:.0f} s"
          f"{f'  {found.where}' if found.largest else ''}", flush=True)
    for line in found.wrong[:SHOWN]:
        print(f"          {line}", flush=True)
    if len(found.wrong) > SHOWN:
        print(f"          and {len(found.wrong) - SHOWN} more", flush=True)
    return not found.wrong


def write(artefact: Artefact, scratch: Path) -> bool:
    """Make it and put it in the reference's place."""
    out = make(artefact, scratch)
    if out is None:
        return False
    shutil.rmtree(REFERENCE / artefact.name, ignore_errors=True)
    shutil.copytree(out, REFERENCE / artefact.name)
    print(f"written {artefact.name}", flush=True)
    return True


def make(artefact: Artefact, scratch: Path) -> Path | None:
    """The artefact's folder of results under `scratch`; None, and the reason printed, where a command failed."""
    out = scratch / "results" / artefact.name
    out.mkdir(parents=True)
    try:
        artefact.make(scratch, out)
    except CommandFailed as error:
        print(f"FAILED  {artefact.name}: {error}", flush=True)
        return None
    return out


if __name__ == "__main__":
    sys.exit(main())
