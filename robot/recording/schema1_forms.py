"""Sentences of sessions of format truearc.session/1, read from schema1_sentences.toml.

For `truearc.robot.recording.schema1` alone. The file is frozen: what was recorded does not change.
"""

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, NamedTuple

from truearc.hw.reason import Code
from truearc.robot.reasons import BY_NAME


class Form(NamedTuple):
    """One sentence. `fixed`: parameters that it has without showing them; `within`: only as the cause of this code."""

    code: Code
    template: str
    fixed: Mapping[str, Any]
    within: str


def _load_forms() -> tuple[Form, ...]:
    """Return the sentences in the order in which they are tried."""
    text = (files("truearc.robot.recording") / "schema1_sentences.toml").read_text(encoding="utf-8")
    return tuple(Form(BY_NAME[row["code"]], row["template"], row.get("fixed", {}), row.get("within", ""))
                 for row in tomllib.loads(text)["sentence"])


FORMS = _load_forms()
