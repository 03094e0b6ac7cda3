"""Runner of the notebooks of examples/notebooks, which saves their outputs: `python -m tools.notebooks`.

The environment variable TRUEARC_DATA names the folder of the recordings.
"""

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

HOME = Path(__file__).parents[1] / "examples" / "notebooks"
PATIENCE_S = 1800                     # of a cell, on a machine with much else to do


def execute(book: nbformat.NotebookNode, folder: Path) -> None:
    """Run every cell in a folder, with this Python's commands; CellExecutionError where one fails."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with TemporaryDirectory() as place:               # a short path: sockets' names are limited; ports may be taken
        kernel = AsyncKernelManager(kernel_name="python3", transport="ipc", ip=f"{place}/kernel")
        client = NotebookClient(book, km=kernel, timeout=PATIENCE_S, startup_timeout=PATIENCE_S, record_timing=False,
                                resources={"metadata": {"path": str(folder)}})
        client.owns_km = True                         # so that it ends the kernel, which else lives on
        client.execute(env={**os.environ, "PATH": path})


def main() -> None:
    """Run and save each notebook."""
    for path in sorted(HOME.glob("*.ipynb")):
        book = nbformat.read(path, as_version=4)
        with TemporaryDirectory() as folder:
            execute(book, Path(folder))
        for cell in book.cells:                       # but their progress
            cell.get("outputs", [])[:] = [one for one in cell.get("outputs", []) if one.get("name") != "stderr"]
        nbformat.write(book, path)
        print(path.name)


if __name__ == "__main__":
    main()
