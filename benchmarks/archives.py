"""Archives of published runs: fetches them from the history of this repository, and paths of stored results as options.

    python -m benchmarks.archives          # in the root of a clone: puts all of them into benchmarks/results/

benchmarks/results/MANIFEST.md lists them, with the SHA-256 of each.
"""

import argparse
import io
import subprocess
import sys
import tarfile
from pathlib import Path

COMMIT = "df827fa626938dca9a3cac7b9b9870457f6af75a"           # the tag proof-1
RESULTS = "benchmarks/results"
ADVICE = ("archives of runs up to the tag proof-1 are not on main: python -m benchmarks.archives puts them into "
          "benchmarks/results/")


def stored_file(text: str) -> Path:
    """Return the path of a file of results; ArgumentTypeError, with how to get the archives, if there is none."""
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"{text}: no such file; {ADVICE}")
    return path


def main() -> int:
    """Return 0 when all archives are below the working directory; 2 where the clone lacks their commit."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    done = subprocess.run(["git", "archive", COMMIT, RESULTS], capture_output=True, check=False)
    if done.returncode != 0:
        print(f"{done.stderr.decode(errors='replace').strip()}\nneeds a clone with the whole history, of which this "
              f"commit is part: git fetch --unshallow", file=sys.stderr)
        return 2
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as tar:
        names = [one.name for one in tar if one.isfile()]
        tar.extractall(".", filter="data")
    print(f"{RESULTS}: {len(names)} files")
    return 0


if __name__ == "__main__":
    sys.exit(main())
