"""The quick part of `make golden`, and that its comparison sees a difference."""

import contextlib
import io
import json
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from tests.golden import artefacts
from tests.golden.artefacts import ARTEFACTS, REFERENCE, unpack
from tests.golden.commands import COMMANDS, CommandFailed
from tests.golden.compare import FITTED, compare
from tests.golden.make import check
from truearc.cli.main import main

ELSEWHERE = sys.platform != "linux" or platform.machine() != "x86_64"
# `make test` has real discoveries by outcomes (none found) and by tracks (named)
QUICK = ("replay", "shots", "launcher", "predict", "finding-l0-null", "finding-l2-distance")
LONGER = ("finding-l1-target", "finding-l2-seam", "export-network", "export-physics",
          "gate-network", "gate-physics", "gated-network", "gated-physics")
APART = ("replay", "shots", "launcher")        # in processes of their own, as `make golden` makes all of them


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden")
    unpack(folder)
    return folder


def run_here(scratch: Path, name: str, *args: str | Path) -> str:
    """As tests.golden.commands.run, in this process: it has imported and compiled most of what the commands need."""
    said = io.StringIO()
    with contextlib.chdir(scratch), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main([*COMMANDS.get(name, name).split(), *map(str, args)])
    if code:
        raise CommandFailed(f"{name}: exit {code}\n{said.getvalue()[-2500:]}")
    return said.getvalue()


@pytest.mark.skipif(ELSEWHERE, reason="another C library rounds otherwise; references made on Linux, x86-64")
@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONGER)])
def test_golden_artefact_is_unchanged(name, scratch, capsys, monkeypatch):
    if name not in APART:
        monkeypatch.setattr(artefacts, "run", run_here)
    artefact = next(one for one in ARTEFACTS if one.name == name)
    same = check(artefact, scratch)
    assert same, capsys.readouterr().out


Finding = dict[str, Any]


def changed(tmp_path: Path, finding: Finding) -> tuple[str, ...]:
    """What `compare` objects to in a finding that was edited."""
    (tmp_path / "finding.json").write_text(json.dumps(finding))
    return compare(REFERENCE / "finding-l2-distance", tmp_path, FITTED).wrong


@pytest.fixture
def finding() -> Finding:
    loaded: Finding = json.loads((REFERENCE / "finding-l2-distance" / "finding.json").read_text())
    return loaded


def test_comparison_accepts_other_words_order_and_numbers_within_the_limit(tmp_path: Path, finding: Finding) -> None:
    finding["sentence"] = finding["what"][0]["sentence"] = "Other words."
    finding["next"][0]["what"] = {"code": "measure"}
    finding["next"][0]["instrument"] = "distance_tape"
    finding["what"][0]["parameters"]["share"]["value"] *= 1 + FITTED / 2
    finding["what"].reverse()
    assert changed(tmp_path, finding) == ()


@pytest.mark.parametrize(("path", "value"), [
    (("what", 0, "parameters", "share", "value"), 0.0715), (("verdict",), "set"), (("mismatch", "p_value"), 0.0026),
    (("data", "shots"), 61), (("what", 0, "term"), "distance_bias"), (("fit", "accuracy_before"), None),
    (("mismatch", "found"), 1), (("set",), []), (("new key",), 1.0),
], ids=lambda part: ".".join(map(str, part)) if isinstance(part, tuple) else str(part))
def test_comparison_reports_a_changed_value(tmp_path, finding, path, value):
    inner = finding
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    assert changed(tmp_path, finding)


def test_comparison_reports_a_missing_sentence(tmp_path: Path, finding: Finding) -> None:
    del finding["sentence"]
    assert changed(tmp_path, finding) == ("finding.json:sentence: only in the reference",)


@pytest.mark.parametrize("name", ["rows.csv", "map.npz", "gate.onnx"])
def test_comparison_reads_tables_arrays_and_graphs(tmp_path: Path, name: str) -> None:
    source = next(path for path in sorted(REFERENCE.rglob(name)))
    old, new = tmp_path / "old" / name, tmp_path / "new" / name
    old.parent.mkdir()
    new.parent.mkdir()
    old.write_bytes(source.read_bytes())
    match new.suffix:
        case ".csv":
            head, first, *rest = source.read_text().splitlines()
            new.write_text("\n".join([head, ",".join([*first.split(",")[:-1], "0.5"]), *rest]))
        case ".npz":
            arrays = dict(np.load(source))
            np.savez(new, **arrays | {"share_two": arrays["share_two"] + 0.01})
        case ".onnx":
            model = onnx.load(source)
            model.metadata_props[1].value = "0" * 64
            onnx.save(model, new)
    wrong = compare(old.parent, new.parent, FITTED).wrong
    assert len(wrong) == 1 and wrong[0].startswith(f"{name}:")
