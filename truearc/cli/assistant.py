"""The command `mcp`, which offers an assistant truearc's questions as tools (Model Context Protocol, standard input).

Each tool takes JSON and returns a sentence for people and JSON for programs. Only files below the stated folders are
read; nothing is written unless a folder for results is stated. A mistake of the caller is an error with a message.
"""

import argparse
import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import truearc as ta
from truearc.errors import InputError

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

MOST_ROWS = 500                       # of a table in an answer; a longer one says how many there are
INSTRUCTIONS = (
    "Questions about recorded shots of a ball launcher. A dataset is a folder with rig.toml and shots.csv. Begin with "
    "`check`; `discover` says whether the simulation lacks something, what, how large and how sure. When it finds "
    "nothing, or cannot tell names apart, say so and do not guess; its field `next` has what to measure or shoot next.")
Answer = tuple[str, Any]              # a sentence, and plain values


class Tools:
    """The tools. folders: what may be read; write: where results may be saved, None: nowhere."""

    def __init__(self, folders: list[Path], write: Path | None = None) -> None:
        self.folders = [one.resolve() for one in (*folders, *([] if write is None else [write]))]
        self.write = write

    def check(self, dataset: str) -> Answer:
        """Check the data of a dataset for plausibility: units, axes, angles, and rows that cannot be read."""
        data = self._dataset(dataset)
        try:
            accepted = ta.paper.check_plausible(data).accepted
        except InputError as error:
            return f"Not plausible: {error}", {"plausible": False, "objection": str(error)}
        warnings = [*data.left_out, *accepted]
        return "\n".join(data.lines()), {"plausible": True, "shots": len(data.shots), "warnings": warnings}

    def fit(self, dataset: str, terms: list[str] | None = None, save_as: str | None = None) -> Answer:
        """Fit coefficients with 90 % intervals. save_as: name of a file for the belief, if results may be saved."""
        target = self._new(save_as, ".toml")
        found = ta.fit(self._dataset(dataset), terms)
        if target is not None:
            found.belief.save(target)
        return str(found), {"converged": found.converged, "rows": _rows(found.table()), "saved": _name(target)}

    def discover(self, dataset: str, believe: list[str] | None = None, belief: str | None = None, seed: int = 0,
                 save_as: str | None = None) -> Answer:
        """Find what the simulation lacks, with size, probability and 90 % interval, or what changed since `belief`.

        believe: terms of the simulation (default: those of rig.toml). belief: file of an earlier session. save_as: name
        of the report and, if anything is adopted, of the corrected belief, if results may be saved.
        """
        page, target = self._new(save_as, ".html"), self._new(save_as, ".toml")
        found = self._discover(dataset, believe, belief, seed)
        if page is not None and target is not None:
            found.to_html(page, command="truearc mcp")
            found.adopt().save(target)
        return str(found), {**json.loads(found.to_json()), "saved": [_name(page), _name(target)] if page else []}

    def identifiability(self, dataset_or_rig: str, shots: int | None = None, level: str | None = None,
                        believe: list[str] | None = None) -> Answer:
        """List the effects that shots could reveal. A rig.toml takes `shots` and `level` (L0 outcomes, L1, L2)."""
        path = self._path(dataset_or_rig)
        source = ta.load_rig(path) if path.is_file() else self._dataset(dataset_or_rig)
        found = ta.identifiability(source, level=level, shots=shots, believe=believe)
        return str(found), {"rows": _rows(found.table())}

    def design(self, dataset: str, believe: list[str] | None = None, belief: str | None = None, seed: int = 0,
               shots: int = 100, configurations: int = 5) -> Answer:
        """Plan the next shots, or the measurement, that would tell the names of `discover` apart."""
        found = self._discover(dataset, believe, belief, seed)
        plan = ta.design_shots(found.investigation.dataset or self._dataset(dataset), found, shots=shots,
                               configurations=configurations, seed=seed)
        return str(plan), json.loads(plan.to_json())

    def aim(self, belief: str, rig: str, distances_m: list[float] | None = None) -> Answer:
        """Find the hood angle and motor speed that score most at each distance. rig: rig.toml, or a dataset."""
        place = self._path(rig)
        facts = ta.load_rig(place) if place.is_file() else self._dataset(rig).rig
        table = ta.aim(ta.load_belief(self._path(belief)), facts, distances_m=distances_m)
        return str(table), json.loads(table.to_json())

    def predict(self, dataset: str, belief: str) -> Answer:
        """Forecast the height and outcome of each shot of a dataset by a belief."""
        table = ta.predict(self._dataset(dataset), ta.load_belief(self._path(belief)))
        return f"{len(table)} shots forecast.", {"rows": _rows(table), "of": len(table)}

    def follow(self, dataset: str, belief: str, false_alarm: float = 0.05) -> Answer:
        """Test the shots since a belief for a change; the answer is valid after every shot."""
        found = ta.follow(self._dataset(dataset), ta.load_belief(self._path(belief)), false_alarm=false_alarm)
        return str(found), {"alarm": found.alarm, "since": found.since, "e_values": list(found.e_values)}

    def _discover(self, dataset: str, believe: list[str] | None, belief: str | None, seed: int) -> "ta.Finding":
        known = None if belief is None else ta.load_belief(self._path(belief))
        return ta.discover(self._dataset(dataset), belief=known, believe=believe, seed=seed)

    def _dataset(self, text: str) -> "ta.Dataset":
        path = self._path(text)
        for one in path.iterdir() if path.is_dir() else ():
            self._path(str(one))      # a link in the folder may lead out of it
        return ta.load_dataset(path)

    def _path(self, text: str) -> Path:
        """The file or folder; InputError if it lies outside the folders, or is not there."""
        if "\0" in text:
            raise InputError(f"{text!r}: not a path")
        path = next((one for one in ((folder / text).resolve() for folder in self.folders)
                     if any(one.is_relative_to(folder) for folder in self.folders) and one.exists()), None)
        if path is None:
            raise InputError(f"{text}: no such file or folder below {', '.join(map(str, self.folders))}; nothing else "
                             "is read")
        return path

    def _new(self, name: str | None, ending: str) -> Path | None:
        """The file to save, which must not exist; None if nothing is to be saved."""
        if name is None:
            return None
        if self.write is None:
            raise InputError("save_as: nothing is written; start truearc mcp with --write DIR")
        if not name or Path(name).name != name or name.startswith(".") or "\0" in name:
            raise InputError(f"save_as: got {name!r}; expected a name without folders")
        path = self.write / f"{name.removesuffix(ending)}{ending}"
        if path.exists():
            raise InputError(f"save_as: {path} exists already; name another")
        return path


NAMES = ("check", "fit", "discover", "identifiability", "design", "aim", "predict", "follow")


def _name(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _rows(table: "ta.Table") -> list[dict[str, Any]]:
    """The first rows as objects; numbers that are not finite become null."""
    return [{name: None if isinstance(value, float) and value - value != 0.0 else value
             for name, value in zip(table.columns, row, strict=True)} for row in table.rows[:MOST_ROWS]]


def make_server(tools: Tools) -> "MCPServer[Any]":
    """Return the server of the tools; one question is answered at a time."""
    from mcp.server.mcpserver import MCPServer
    from mcp.server.mcpserver.exceptions import ToolError
    from mcp.types import CallToolResult, TextContent, ToolAnnotations
    server: MCPServer[Any] = MCPServer("truearc", instructions=INSTRUCTIONS, version=ta.__version__,
                                       log_level="WARNING")
    turn = Lock()

    def answered(question: Callable[..., Answer]) -> Callable[..., Any]:
        @wraps(question)
        def answer(*args: Any, **arguments: Any) -> CallToolResult:
            try:
                with turn:
                    text, values = question(*args, **arguments)
            except (InputError, OSError, ValueError) as error:
                raise ToolError(str(error)) from None
            except Exception as error:            # a defect, which the caller is told of without the server's insides
                raise ToolError(f"{question.__name__}: internal error ({type(error).__name__}); please report it"
                                ) from None
            return CallToolResult(content=[TextContent(type="text", text=text),
                                           TextContent(type="text", text=json.dumps(values))],
                                  structured_content=values)

        answer.__annotations__ = {**question.__annotations__, "return": CallToolResult}
        return answer

    for name in NAMES:
        writes = name in ("fit", "discover") and tools.write is not None
        server.add_tool(answered(getattr(tools, name)), name=name, structured_output=False,
                        annotations=ToolAnnotations(read_only_hint=not writes, destructive_hint=False,
                                                    open_world_hint=False))
    return server


def mcp_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folders", metavar="DIR", nargs="+", type=Path, help="folder that may be read, with datasets "
                        "and beliefs; several")
    parser.add_argument("--write", metavar="DIR", type=Path, help="existing folder in which `fit` and `discover` may "
                        "save results (default: nothing is written)")


def mcp(args: argparse.Namespace) -> int:
    """Offer check, fit, discover, identifiability, design, aim, predict and follow to an assistant as tools.

    It speaks the Model Context Protocol on standard input and output until the assistant ends it; enter the example
    as the command of a server in the assistant's settings. Only files below the folders are read.
    """
    for folder in (*args.folders, *([args.write] if args.write else [])):
        if not folder.is_dir():
            raise InputError(f"{folder}: there is no such folder")
    try:
        server = make_server(Tools(args.folders, args.write))
    except ModuleNotFoundError as error:
        raise InputError("truearc mcp needs the extra: pip install 'truearc[sim,mcp]'") from error
    from truearc.sim.compute import keep_compiled
    keep_compiled()
    server.run("stdio")
    return 0
