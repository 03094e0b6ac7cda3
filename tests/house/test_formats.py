"""The page of formats and the JSON schemas are what the code says; golden documents pass."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec

from tests.golden.make import REFERENCE
from tools.formats import DOCUMENTS, launcher_keys
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


def test_every_key_of_the_configuration_is_on_the_page() -> None:
    described = [key for key, _, _ in launcher_keys()]
    wanted = {key for key in leaves(Config) if not f"{key}.".startswith(ELSEWHERE)}
    assert len(described) == len(set(described)) and set(described) == wanted


def test_documents_pass_their_schema_and_have_no_key_beside_it() -> None:
    assert GOLDEN
    for path in GOLDEN:
        document = json.loads(path.read_text(encoding="utf-8"))
        validator(path.stem).validate(document)
        kind = DOCUMENTS[path.stem][0]
        assert set(document) <= {field.encode_name for field in msgspec.structs.fields(kind)}, path
