"""Claims of both schemas: instruments by their ids, and the ledger's hash of a request as it was written."""

from pathlib import Path

import msgspec
import pytest

from truearc.errors import InputError
from truearc_proof.rounds.claims_schema import INSTRUMENTS_1, SCHEMA, SCHEMA_1, load_claims
from truearc_proof.rounds.commitment import canonical
from truearc_proof.rounds.committer import Reading, asked_of
from truearc_proof.rounds.ledger import digest
from truearc_proof.rounds.round_layout import Room
from truearc_proof.scoring.score_finding import names_ranked, said_set, said_stage
from truearc_proof.worlds.instruments import TOOLS

# World w0018 of the published round 4 at L0, its lists shortened; ASKED is in that round's ledger.
PUBLISHED = Path(__file__).with_name("claims1.json")
ASKED = "3f66705ec50e11c100c32563769081bd87463a21f8854c2f1beba462bc154379"


@pytest.fixture
def room(tmp_path: Path) -> Room:
    room = Room(tmp_path)
    room.claims("w0018").parent.mkdir()
    room.claims("w0018").write_bytes(PUBLISHED.read_bytes())
    return room


def test_claims_of_schema_1_load_with_instruments_by_id(room: Room) -> None:
    claims = load_claims(room.claims("w0018"))
    assert claims.schema == SCHEMA_1 and claims.asked == [{"measure": "inclinometer"}]
    assert asked_of(room, "w0018") == Reading("inclinometer", "hood angle with an inclinometer")
    assert digest(canonical(claims.written)) == ASKED


def test_what_is_scored_of_claims_of_schema_1_are_ids() -> None:
    finding = load_claims(PUBLISHED).finding
    assert names_ranked(finding)[:2] == said_set(finding) == ["rim_catch", "hood_offset"]
    assert said_stage(finding["where"]) == "arrival"


def test_every_instrument_of_schema_1_has_an_id_that_is_still_there() -> None:
    assert set(INSTRUMENTS_1.values()) == set(TOOLS) and len(INSTRUMENTS_1) == len(TOOLS)


def test_claims_of_schema_2_take_ids_alone(room: Room) -> None:
    path = room.claims("w0018")
    claims = {**msgspec.json.decode(PUBLISHED.read_bytes()), "schema": SCHEMA}
    path.write_bytes(canonical(claims))
    with pytest.raises(InputError, match="asked: measure: there is no 'hood angle with an inclinometer'"):
        asked_of(room, "w0018")
    path.write_bytes(canonical({**claims, "asked": [{"measure": "inclinometer"}]}))
    assert asked_of(room, "w0018") == Reading("inclinometer", "inclinometer")


def test_claims_of_an_unknown_schema_are_refused(room: Room) -> None:
    path = room.claims("w0018")
    path.write_bytes(PUBLISHED.read_bytes().replace(b"truearc.claims/1", b"truearc.claims/3"))
    with pytest.raises(InputError, match=r"w0018\.json: Invalid enum value 'truearc\.claims/3'"):
        load_claims(path)
