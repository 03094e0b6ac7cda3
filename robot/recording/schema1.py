"""Sessions of format truearc.session/1, whose reasons are English sentences; for reading them, and for nothing else.

`schema1_sentences.toml` has every sentence that was ever recorded, as a template over the parameters of its code; it is
frozen, since what was recorded does not change. The same template reads a sentence and writes it, and what it reads is
kept only if it writes the same sentence again; any other sentence is LEGACY_TEXT, whole. So nothing is lost, although
numbers have only the digits that the sentence had. A replay of such a session compares bit by bit, too: what is
recomputed is written as format 1 (`Rows1.encode_tick`), sentences and all, and must be the recorded bytes.
"""

import ast
import re
import tomllib
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from importlib.resources import files
from string import Formatter
from typing import Any

import msgspec

from truearc.hw import fault_codes as hw
from truearc.hw.reason import OPTIONAL, Code, Reason
from truearc.robot import reasons as bot
from truearc.robot.recording.rows import Trial, as_object
from truearc.robot.types import Progress, Tick

MOTOR = r"(?:flywheel motor \d+|hood motor|feeder motor)"
NUMBER = r"(?:-?\d+(?:\.\d+)?(?:e[-+]?\d+)?|-?inf|nan)"
SHAPES = {"motor": MOTOR, "device": f"(?:{MOTOR}|hood encoder)", "count": r"-?\d+", "px": r"-?[\d.]+", "text": ".+?",
          "texts": ".+", "counts": ".+", "reason": ".+", "reasons": ".+"}
FLOAT_FORMS = ("f", "g", "%", "ms")
IDENTIFY = "identify: "               # before what Progress.over says
STAND = re.compile(r"stand at (-?[\d.]+) m")
# Faults of the button box in Inputs.missed and what follows from it
MISSED = {hw.BOX_RESTARTED.name: "has restarted", hw.BOX_PRESSES_LOST.name: "lost presses"}
BITS = re.compile("error 0x([0-9a-f]{8})")


@dataclass(frozen=True)
class Form:
    """One sentence. `fixed`: parameters that it has without showing them; `within`: only as the cause of this code."""

    code: Code
    template: str
    fixed: dict[str, Any]
    within: str

    @cached_property
    def fields(self) -> dict[str, str]:
        """Formats by the names of the parameters that it shows."""
        return {name: spec or "" for _, name, spec, _ in Formatter().parse(self.template) if name is not None}

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        shapes = {name: f"(?P<{name}>{_shape(self.code.params[name].rstrip(OPTIONAL), spec)})"
                  for name, spec in self.fields.items()}
        return re.compile("".join(re.escape(literal) + shapes.get(name or "", "")
                                  for literal, name, _, _ in Formatter().parse(self.template)), re.DOTALL)


@cache
def load_forms() -> tuple[Form, ...]:
    """Return the sentences in the order in which they are tried."""
    return tuple(Form(bot.BY_NAME[row["code"]], row["template"], row.get("fixed", {}), row.get("within", ""))
                 for row in tomllib.loads(_frozen())["sentence"])


@cache
def load_errors() -> dict[str, str]:
    """Return the words of motors' errors, by their codes."""
    return dict(tomllib.loads(_frozen())["errors"])


def _frozen() -> str:
    return (files("truearc.robot.recording") / "schema1_sentences.toml").read_text(encoding="utf-8")


class Rows1:
    """truearc.robot.recording.rows.RowFormat of truearc.session/1."""

    def __init__(self) -> None:
        self._encode = msgspec.json.Encoder().encode

    def decode_tick(self, data: bytes) -> Tick:
        row = msgspec.json.decode(data)
        if not isinstance(row, dict):
            raise msgspec.ValidationError("a tick is an object")
        try:
            _read_tick(row)
        except (KeyError, TypeError, AttributeError) as error:
            raise msgspec.ValidationError(f"not a tick: {type(error).__name__} {error}") from error
        return msgspec.convert(row, Tick)

    def encode_tick(self, tick: Tick) -> bytes:
        row = msgspec.to_builtins(tick)
        _write_tick(row, tick)
        return self._encode(row)

    def decode_trial(self, data: bytes) -> Trial:
        row = msgspec.json.decode(data)
        if not isinstance(row, dict) or not isinstance(row.get("outcome"), dict):
            raise msgspec.ValidationError("a trial is an object with an outcome")
        row["outcome"]["reasons"] = [_plain(one) for one in row["outcome"].get("reasons", ())]
        return msgspec.convert(row, Trial)

    def encode_trial(self, trial: Trial) -> bytes:
        row = msgspec.to_builtins(trial)
        row["outcome"]["reasons"] = [write(one) for one in trial.outcome.reasons]
        return self._encode(row)

    def schema(self, kind: type[Tick] | type[Trial]) -> bytes:
        made = msgspec.json.schema(kind)
        made["$defs"]["Reason"] = {"title": "Reason", "type": "string"}
        return self._encode(as_object(made))

    def recorded(self, reasons: tuple[Reason, ...]) -> tuple[Reason, ...]:
        return tuple(read(write(one)) for one in reasons)


def write(reason: Reason) -> str:
    """The sentence that a reason was; today's text where no sentence of format 1 said it."""
    if reason.code == bot.LEGACY_TEXT.name:
        return str(reason.params["text"])
    for form in (form for form in load_forms() if form.code.name == reason.code):
        shown = form.fields.keys() | form.fixed.keys()
        if reason.params.keys() == shown and all(reason.params[name] == value for name, value in form.fixed.items()):
            return "".join(literal + ("" if name is None else _write_value(reason.params[name], spec or ""))
                           for literal, name, spec, _ in Formatter().parse(form.template))
    return bot.text(reason)


@lru_cache(4096)
def read(sentence: str, within: str = "") -> Reason:
    """The reason that a sentence stands for; `within`: the code that it is the cause of, if any."""
    for form in load_forms():
        if form.within in ("", within) and (match := form.pattern.fullmatch(sentence)):
            params = {name: _read_value(text, form, name) for name, text in match.groupdict().items()} | form.fixed
            reason = Reason(form.code.name, {name: params[name] for name in form.code.params if name in params})
            if write(reason) == sentence:
                return reason
    return bot.LEGACY_TEXT(text=sentence)


def _shape(kind: str, spec: str) -> str:
    if spec == "bytes":
        return ".+"
    return NUMBER + ("%" if spec.endswith("%") else "") if spec.endswith(FLOAT_FORMS) else SHAPES[kind]


def _read_value(text: str, form: Form, name: str) -> Any:
    kind, spec = form.code.params[name].rstrip(OPTIONAL), form.fields[name]
    if spec.endswith(FLOAT_FORMS):
        value = float(text.rstrip("%")) * {"ms": 1e-3}.get(spec, 1.0) / (100.0 if spec.endswith("%") else 1.0)
        return value if abs(value) < float("inf") else str(value)
    if spec == "bytes":
        return _read_bytes(text)
    match kind:
        case "reason":
            return _read_box(text) if spec == "box" else read(text, form.code.name)
        case "reasons":
            return _read_errors(text) if spec == "errors" else _read_several(text)
        case "texts":
            return tuple(text.split(", "))
        case "counts":
            return tuple(int(word) if word.isdecimal() else word for word in text.split(", "))
        case "count" | "px":
            return int(text)
    return text


def _read_bytes(text: str) -> str:
    try:
        data = ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
    return data.decode("latin-1") if isinstance(data, bytes) else text


def _read_box(text: str) -> Reason:
    return next((Reason(code) for code, said in MISSED.items() if said == text), bot.LEGACY_TEXT(text=text))


def _read_several(text: str) -> tuple[Reason, ...]:
    """Sentences joined by "; ", which some have in themselves: each takes as few parts as it can."""
    parts, found = text.split("; "), []
    while parts:
        tries = (("; ".join(parts[:count]), count) for count in range(1, len(parts) + 1))
        reason, count = next(((one, count) for said, count in tries
                              if (one := read(said)).code != bot.LEGACY_TEXT.name),
                             (bot.LEGACY_TEXT(text=parts[0]), 1))
        found.append(reason)
        parts = parts[count:]
    return tuple(found)


def _write_value(value: Any, spec: str) -> str:
    if isinstance(value, Reason):
        return _write_box(value) if spec == "box" else write(value)
    if isinstance(value, tuple | list):
        if spec == "errors":
            return ", ".join(load_errors().get(error.code) or bot.text(error) for error in value)
        between = "; " if any(isinstance(one, Reason) for one in value) else ", "
        return between.join(write(one) if isinstance(one, Reason) else str(one) for one in value)
    if spec == "bytes":
        return repr(str(value).encode("latin-1", "replace"))
    if spec == "ms":
        return format(float(value) * 1e3, ".1f")
    return format(float(value), spec) if spec.endswith(FLOAT_FORMS) else str(value)


def _read_errors(text: str) -> tuple[Reason, ...]:
    """Errors of a motor; empty where one of the words is none, for other sentences begin with a motor's name, too."""
    codes = {word: code for code, word in load_errors().items()}
    words = text.split(", ")
    if not all(word in codes or BITS.fullmatch(word) for word in words):
        return ()
    return tuple(Reason(codes[word]) if word in codes else hw.ERROR_BITS(bits=int(word[-8:], 16)) for word in words)


def _write_box(reason: Reason) -> str:
    return MISSED.get(reason.code) or write(reason)


# --- a row's places for sentences


def _plain(sentence: str) -> Any:
    return msgspec.to_builtins(read(sentence))


def _read_tick(row: dict[str, Any]) -> None:
    inputs, memory = row["inputs"], row["memory"]
    inputs["faults"] = [_plain(fault) for fault in inputs["faults"]]
    if "unseen" in inputs:
        inputs["unseen"] = _plain(inputs["unseen"])
    if "missed" in inputs:
        inputs["missed"] = msgspec.to_builtins(_read_box(inputs["missed"]))
    if "disarmed" in memory:
        memory["disarmed"] = msgspec.to_builtins(_read_box(memory["disarmed"]))
    for sighting in filter(None, (inputs.get("sighting"), memory.get("last_sighting"))):
        sighting["reason"] = _plain(sighting["reason"]) if sighting["reason"] else None
    for aim in filter(None, (row["aim"], memory.get("aim"))):
        if match := STAND.fullmatch(aim["source"]):
            aim["source"], aim["stand_m"] = "plan", float(match[1])
    row["verdict"]["reasons"] = [_plain(reason) for reason in row["verdict"]["reasons"]]
    for outcome in row.get("outcomes", ()):
        outcome["reasons"] = [_plain(reason) for reason in outcome.get("reasons", ())]
    if "identify" in memory:
        over = memory["identify"]["over"]
        memory["identify"]["over"] = _plain(IDENTIFY + over) if over else None


def _write_tick(row: dict[str, Any], tick: Tick) -> None:
    """`row`: what `tick` is as built-in types."""
    inputs, memory = row["inputs"], row["memory"]
    inputs["faults"] = [write(fault) for fault in tick.inputs.faults]
    if tick.inputs.unseen is not None:
        inputs["unseen"] = write(tick.inputs.unseen)
    if tick.inputs.missed is not None:
        inputs["missed"] = _write_box(tick.inputs.missed)
    if isinstance(tick.memory.disarmed, Reason):
        memory["disarmed"] = _write_box(tick.memory.disarmed)
    for place, sighting in ((inputs.get("sighting"), tick.inputs.sighting),
                            (memory["last_sighting"], tick.memory.last_sighting)):
        if sighting is not None and place is not None:
            place["reason"] = write(sighting.reason) if sighting.reason is not None else ""
    for place, aim in ((row["aim"], tick.aim), (memory["aim"], tick.memory.aim)):
        if aim is not None and isinstance(aim.stand_m, float):
            place["source"] = f"stand at {place.pop('stand_m'):.2f} m"
    row["verdict"]["reasons"] = [write(reason) for reason in tick.verdict.reasons]
    for place, outcome in zip(row["outcomes"], tick.outcomes, strict=True):
        place["reasons"] = [write(reason) for reason in outcome.reasons]
    progress = tick.memory.identify
    if isinstance(progress, Progress):
        over = "" if progress.over is None else write(progress.over)
        memory["identify"]["over"] = over.removeprefix(IDENTIFY)
