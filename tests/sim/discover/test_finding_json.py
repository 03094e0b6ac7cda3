"""Findings on disk: golden ones load, and are written again to the byte (proof-1's own: tests/golden)."""

from pathlib import Path

import pytest

from truearc.errors import InputError
from truearc.sim.discover.finding import load_record, make_json

GOLDEN = sorted((Path(__file__).parents[2] / "golden" / "reference").glob("finding-*/finding.json"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.parent.name)
def test_golden_finding_is_written_again_to_the_byte(path: Path) -> None:
    finding = load_record(path)
    assert make_json(finding) == path.read_bytes()
    assert finding.mismatch.found == (finding.verdict != "none") and finding.data.shots > 0


@pytest.mark.parametrize(("old", "new", "error"), [
    (b'"truearc.finding/1"', b'"truearc.finding/2"', "schema: got 'truearc.finding/2'"),
    (b'"verdict"', b'"said"', r"finding\.json: verdict: missing key"),
    (b'"shots"', b'"shots', "finding.json: "),
])
def test_load_record_refuses_what_is_no_finding(tmp_path: Path, old: bytes, new: bytes, error: str) -> None:
    path = tmp_path / "finding.json"
    path.write_bytes(GOLDEN[0].read_bytes().replace(old, new, 1))
    with pytest.raises(InputError, match=error):
        load_record(path)
