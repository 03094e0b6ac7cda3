"""The page of formats and the JSON schemas are what the code says; documents of every kind pass, broken ones do not."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest

from tests.golden.make import REFERENCE
from tools.formats import DOCUMENTS, launcher_keys, make_page, make_schema
from tools.pages import SCHEMAS
from truearc.hw.devices.canandmag import CanandmagConfig
from truearc.hw.devices.family import HoodEncoder
from truearc.robot.config.schema import Config

GOLDEN = sorted([*REFERENCE.glob("finding-*/finding.json"), *REFERENCE.glob("identifiability/*.json"),
                 *REFERENCE.glob("design/*.json"), *REFERENCE.glob("gated-*/session.json"),
                 Path(__file__).parents[1] / "robot" / "aim.json",
                 REFERENCE.parent / "inputs" / "proposal.json"])
# docs/how-to/motors.md, docs/reference/dataset.md, `--plan`, docs/how-to/advise.md
ELSEWHERE = ("axes.", "rig.", "collect.prescribed.", "readings.")


def validator(name: str) -> Any:
    return jsonschema.Draft202012Validator(json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8")))


def leaves(kind: type[msgspec.Struct], prefix: str = "") -> Iterator[str]:
    for field in msgspec.structs.fields(kind):
        inner = [CanandmagConfig] if field.type is HoodEncoder else structs_in(field.type)     # the shipped one
        if field.type is HoodEncoder:
            yield f"{prefix}{field.encode_name}.driver"
        if inner:
            yield from leaves(inner[0], f"{prefix}{field.encode_name}.")
        else:
            yield prefix + field.encode_name


def structs_in(annotation: Any) -> list[type[msgspec.Struct]]:
    parts = (annotation, *getattr(annotation, "__args__", ()))
    return [part for part in parts if isinstance(part, type) and issubclass(part, msgspec.Struct)]


def test_there_is_a_schema_for_each_document() -> None:
    assert {path.stem for path in SCHEMAS.iterdir()} == set(DOCUMENTS)


def test_every_key_of_the_configuration_is_on_the_page() -> None:
    described = [key for key, _, _ in launcher_keys()]
    wanted = {key for key in leaves(Config) if not f"{key}.".startswith(ELSEWHERE)}
    assert len(described) == len(set(described)) and set(described) == wanted


def test_every_key_has_a_meaning() -> None:
    assert not [key for key, _, meaning in launcher_keys() if not meaning]
    rows = [line.split(" | ") for line in make_page().splitlines() if line.startswith("| `")]
    assert not [row[0] for row in rows if not row[-1].strip(" |")]


def test_documents_pass_their_schema_and_have_no_key_beside_it() -> None:
    assert GOLDEN
    for path in GOLDEN:
        document = json.loads(path.read_text(encoding="utf-8"))
        validator(path.stem).validate(document)
        kind = DOCUMENTS[path.stem][0]
        assert set(document) <= {field.encode_name for field in msgspec.structs.fields(kind)}, path


@pytest.mark.parametrize("name", DOCUMENTS)
def test_a_document_that_lacks_or_spoils_a_needed_key_fails(name: str) -> None:
    document = json.loads(next(path for path in GOLDEN if path.stem == name).read_text(encoding="utf-8"))
    needed = make_schema(name)["$defs"][DOCUMENTS[name][0].__name__]["required"]
    assert needed
    for key in needed:
        assert not validator(name).is_valid({other: value for other, value in document.items() if other != key}), key
        assert not validator(name).is_valid({**document, key: [1j]}), key


def test_belief_has_the_tables_that_the_page_names() -> None:
    belief = msgspec.toml.decode((REFERENCE / "belief" / "belief.toml").read_bytes())
    page = make_page().split("## Belief")[1].split("\n## ")[0]
    for key, value in belief.items():
        if key in ("schema", "scatter", "covariance", "curve", "provenance"):
            assert f"`{key}" in page
            for inner in value if key in ("scatter", "covariance") else ():
                assert f"`{key}.{inner}`" in page, inner
