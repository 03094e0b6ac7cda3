"""Reasons for a HOLD, a fault or a refusal, each of which is a code with parameters.

Only the outermost layers turn reasons into text. A Code declares the parameters and the log text of one kind of reason;
calling it makes a Reason. The codes for wires and devices are in `truearc.hw.fault_codes`, and those for the robot are
in `truearc.robot.reasons`. A Message holds the text that the driver sees.
"""

import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from string import Formatter
from typing import Any

from msgspec import Struct
from msgspec.structs import force_setattr, replace

OPTIONAL = "?"                        # at the end of a parameter's unit: it may be absent
LARGEST = sys.float_info.max          # what is beyond is not finite
UNITS = (("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_deg_s", "deg/s"), ("_rad", "rad"), ("_deg", "deg"), ("_nm", "Nm"),
         ("_ns", "ns"), ("_px", "px"), ("_m", "m"), ("_s", "s"), ("_v", "V"), ("_a", "A"))     # by how a name ends
KINDS = {"cause": "reason", "causes": "reasons", "errors": "reasons", "motor": "motor", "bytes": "count",
         "frames": "count", "presses": "count", "spark": "count"}  # by the name itself
NUMERIC = "efg"                       # how the format of a number ends
WITHOUT_NUMBERS = {"text", "count", "flag", "motor", "device", "texts", "counts", "reason", "reasons"}
NESTED = "~"                          # in a template's format: stands for the parameter's text, where there is one
LISTED = ","                          # the format of several that commas separate
FAULT = "fault"                       # something is not as it should be
YOU = "you"                           # it is the driver's turn


class Reason(Struct, frozen=True, omit_defaults=True):
    """One reason as it is recorded.

    params: by name; numbers at full precision, their unit last in the name; one that is not finite is its text ("nan"),
        for JSON has none. `cause`, `causes`: what is behind it, reasons themselves.
    """

    code: str
    params: "dict[str, bool | int | float | str | Reason | tuple[int | float | str | Reason, ...]]" = {}

    def about(self, **params: Any) -> "Reason":
        """Return the same reason with these parameters in front."""
        return replace(self, params={**params, **self.params})


class Code(Struct, frozen=True):
    """One kind of reason.

    text: log text; fields are the parameters. `{cause: (~)}` is " (...)" with the text of `cause`, "" without it.
    params: name -> unit, or "text", "count", "flag", "motor", "device", "texts", "counts", "reason", "reasons"; of the
        text's fields only where the name does not tell (KINDS, UNITS, else "text"; with "~" it may be absent).
    """

    name: str
    text: str
    params: dict[str, str] = {}
    has_numbers: bool = False         # worked out
    bare: Reason | None = None        # worked out: without parameters it is always the same

    def __post_init__(self) -> None:
        inferred = {}
        for _, name, form, _ in Formatter().parse(self.text):
            if name and name not in self.params:
                kind = KINDS.get(name) or unit_of(name)
                if not kind and form and form[-1] in NUMERIC:
                    raise ValueError(f"code {self.name}: declare the unit of {name}; its name does not end with one")
                inferred[name] = (kind or "text") + (OPTIONAL if NESTED in (form or "") else "")
        if inferred:
            fields = {name: None for _, name, *_ in Formatter().parse(self.text) if name}
            force_setattr(self, "params", {**fields, **inferred, **self.params})
        kinds = {unit.rstrip(OPTIONAL) for unit in self.params.values()}
        force_setattr(self, "has_numbers", bool(kinds - WITHOUT_NUMBERS))
        force_setattr(self, "bare", Reason(self.name))

    def __call__(self, /, **params: Any) -> Reason:
        if not params and self.bare is not None:
            return self.bare
        if self.has_numbers:
            for name, value in params.items():
                if value.__class__ is float and not -LARGEST <= value <= LARGEST:
                    params[name] = str(value)
        return Reason(self.name, params)


class Message(Struct, frozen=True):
    """One kind of reason on the operator's page.

    kind: FAULT, YOU, or "wait" where it comes by itself.
    means, do: templates over the reason's parameters; `do` is "" where there is nothing to do.
    case: only where this is the code of the reason's cause, or of a motor's single error; "": otherwise.
    """

    code: Code
    kind: str
    means: str
    do: str = ""
    case: str = ""


def unit_of(name: str) -> str:
    """Return the unit at the end of a name, as in `speed_rad_s` or `outer_m.0`; "" without one."""
    name = name.rstrip("0123456789.")
    return next((unit for end, unit in UNITS if name.endswith(end)), "")


def index(codes: Iterable[Code]) -> dict[str, Code]:
    """Return codes by name; ValueError for one declared twice."""
    found: dict[str, Code] = {}
    for code in codes:
        if found.setdefault(code.name, code) is not code:
            raise ValueError(f"{code.name} is declared twice")
    return found


def render(reason: Reason, codes: Mapping[str, Code]) -> str:
    """Return the log text; for a code that is not among `codes`, its name and parameters."""
    try:
        code = codes[reason.code]
    except KeyError:
        shown = ", ".join(f"{name} {_text(value, codes)}" for name, value in reason.params.items())
        return f"{reason.code} ({shown})" if shown else reason.code
    return fill(code.text, reason.params, codes)


def fill(template: str, params: Mapping[str, Any], codes: Mapping[str, Code]) -> str:
    """Return `template` filled with a reason's parameters, each in the format that its field states."""
    shown = {name: _Shown(value, codes) for name, value in params.items()}
    return template.format_map(defaultdict(lambda: _Shown(None, codes), shown))


def listed(values: Iterable[Any], codes: Mapping[str, Code]) -> str:
    """Join several texts with commas."""
    return ", ".join(_text(one, codes) for one in values)


class _Shown:
    """A parameter's value under a template's format."""

    def __init__(self, value: Any, codes: Mapping[str, Code]) -> None:
        self._value, self._codes = value, codes

    def __format__(self, form: str) -> str:
        if self._value is None:
            return ""
        if isinstance(self._value, int | float) and NESTED not in form:
            return format(self._value, form)
        if form == LISTED:
            return listed(self._value, self._codes)
        text = _text(self._value, self._codes)
        return form.replace(NESTED, text) if NESTED in form else text


def _text(value: Any, codes: Mapping[str, Code]) -> str:
    if isinstance(value, Reason):
        return render(value, codes)
    if isinstance(value, tuple | list):
        between = "; " if any(isinstance(one, Reason) for one in value) else ", "
        return between.join(_text(one, codes) for one in value)
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
