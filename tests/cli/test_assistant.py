"""`truearc mcp` as an assistant meets it, through the SDK's own client: answers, refusals, and malformed calls."""

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

import truearc as ta
from truearc.cli.assistant import NAMES, Tools, make_server

mcp = pytest.importorskip("mcp")
EXAMPLES = Path(__file__).parents[2] / "examples"


def ask(work: Callable[[Any], Awaitable[Any]], write: Path | None = None,
        folders: tuple[Path, ...] = (EXAMPLES,)) -> Any:
    async def whole() -> Any:
        async with mcp.Client(make_server(Tools(list(folders), write))) as client:
            return await work(client)

    return asyncio.run(whole())


def call(name: str, arguments: dict[str, Any], **options: Any) -> Any:
    return ask(lambda client: client.call_tool(name, arguments), **options)


def test_tools_are_listed_with_their_arguments_and_read_only() -> None:
    listed = ask(lambda client: client.list_tools()).tools
    assert tuple(one.name for one in listed) == NAMES
    assert all(one.annotations.read_only_hint and one.description for one in listed)
    assert set(listed[0].input_schema["properties"]) == {"dataset"}


def test_check_answers_with_a_sentence_and_json() -> None:
    answer = call("check", {"dataset": "spreadsheet"})
    assert not answer.is_error and "48" in answer.content[0].text
    assert answer.structured_content == json.loads(answer.content[1].text)
    assert answer.structured_content["plausible"] and answer.structured_content["shots"] == 48


@pytest.mark.slow
def test_a_fit_is_saved_only_where_results_may_be(tmp_path: Path) -> None:
    asked = {"dataset": "spreadsheet", "terms": ["gravity", "drag"], "save_as": "belief"}
    refused = call("fit", asked)
    assert refused.is_error and "start truearc mcp with --write" in refused.content[0].text
    answer = call("fit", asked, write=tmp_path)
    assert not answer.is_error and ta.load_belief(tmp_path / "belief.toml").coefficients.keys() == {"drag"}
    (row,) = (one for one in answer.structured_content["rows"] if "cd" in str(one))
    assert row and "already" in call("fit", asked, write=tmp_path).content[0].text
    away = call("fit", {**asked, "save_as": "../belief"}, write=tmp_path)
    assert away.is_error and [one.name for one in tmp_path.iterdir()] == ["belief.toml"]


def test_nothing_outside_the_folders_is_read(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "rig.toml").write_bytes((EXAMPLES / "spreadsheet" / "rig.toml").read_bytes())
    (inside / "shots.csv").symlink_to(EXAMPLES / "spreadsheet" / "shots.csv")
    (tmp_path / "away").symlink_to(EXAMPLES)
    for path in ("..", "/etc", "../../etc/passwd", str(EXAMPLES / "spreadsheet"), "../away/spreadsheet", ".", "\0"):
        answer = call("check", {"dataset": path}, folders=(inside,))
        assert answer.is_error and "Traceback" not in answer.content[0].text, path
    assert call("check", {"dataset": str(EXAMPLES / "spreadsheet")}, folders=(EXAMPLES, inside)).is_error is False


MALFORMED = [(name, arguments) for name in NAMES for arguments in (
    {}, {"dataset": None}, {"dataset": 3}, {"dataset": "nowhere", "belief": "nowhere", "rig": "nowhere"},
    {"dataset": "../..", "belief": "/etc/passwd", "rig": "/etc", "dataset_or_rig": "/etc/shadow"},
    {"dataset": "spreadsheet", "belief": "spreadsheet/shots.csv", "rig": "spreadsheet", "dataset_or_rig": "\0",
     "terms": ["nonsense"], "seed": -1, "save_as": "a/b", "shots": -1}, {"dataset": ["spreadsheet"]})]
MALFORMED = [one for one in MALFORMED if one != ("check", MALFORMED[5][1])] + [
    ("discover", {"dataset": "spreadsheet", "believe": ["no_such_term"]}), ("no_such_tool", {})]


def test_malformed_calls_get_errors_and_no_traceback(caplog: pytest.LogCaptureFixture) -> None:
    assert len(MALFORMED) >= 50

    async def each(client: Any) -> list[str]:
        said = []
        for name, arguments in MALFORMED:
            try:
                answer = await client.call_tool(name, arguments)
            except mcp.MCPError as error:         # the protocol's own: no such tool
                said.append(str(error))
                continue
            assert answer.is_error, (name, arguments)
            said.append(answer.content[0].text)
        return said

    said = ask(each)
    assert len(said) == len(MALFORMED) and all(said)
    assert not any("Traceback" in one or "internal error" in one for one in (*said, caplog.text))


@pytest.mark.slow
def test_an_assistant_checks_discovers_and_aims_over_standard_input(tmp_path: Path) -> None:
    server = mcp.StdioServerParameters(command=sys.executable, args=[
        "-m", "truearc", "mcp", str(EXAMPLES), "--write", str(tmp_path)])

    async def whole() -> tuple[Any, ...]:
        async with mcp.Client(server) as client:
            checked = await client.call_tool("check", {"dataset": "spreadsheet"})
            found = await client.call_tool("discover", {"dataset": "spreadsheet", "save_as": "found"})
            aimed = await client.call_tool("aim", {"belief": "found.toml", "rig": "spreadsheet/rig.toml",
                                                   "distances_m": [3.0, 4.0]})
            return checked, found, aimed

    checked, found, aimed = asyncio.run(whole())
    assert not (checked.is_error or found.is_error or aimed.is_error), (found.content, aimed.content)
    alone = ta.discover(ta.load_dataset(EXAMPLES / "spreadsheet"), seed=0)
    assert found.structured_content["story"]["change"] == alone.change
    assert found.content[0].text.startswith(alone.change) and (tmp_path / "found.html").is_file()
    assert [row["distance_m"] for row in aimed.structured_content["rows"]] == [3.0, 4.0]
