"""A reason of each code, with every parameter that it declares; and whether a reason has what its code declares."""

from typing import Any

from truearc.hw.reason import OPTIONAL, Code, Reason
from truearc.robot.reasons import BY_NAME, TAPE_NARROW

VALUES: dict[str, Any] = {"text": "x", "count": 7, "flag": True, "motor": "hood motor", "device": "hood encoder",
                          "texts": ("x", "y"), "counts": (7, 8), "reason": TAPE_NARROW(), "reasons": (TAPE_NARROW(),)}
TYPES: dict[str, Any] = {"text": str, "count": int, "flag": bool, "motor": str, "device": str, "texts": tuple,
                         "counts": tuple, "reason": Reason, "reasons": tuple}


def sample(code: Code, case: str = "") -> Reason:
    """With the parameters of `code`; `case`: the code of its cause, or its only error."""
    params = {name: VALUES.get(unit.rstrip(OPTIONAL), 7.25) for name, unit in code.params.items()}
    if case and "errors" in params:
        params["errors"] = (sample(BY_NAME[case]),)
    elif case:
        params["cause"] = sample(BY_NAME[case])
    return code(**params)


def check(reason: Reason) -> None:
    """Each parameter is declared and of the declared kind, and none that must be there is missing."""
    code = BY_NAME[reason.code]
    assert reason.params.keys() <= code.params.keys(), reason
    assert {name for name, unit in code.params.items() if not unit.endswith(OPTIONAL)} <= reason.params.keys(), reason
    for name, value in reason.params.items():
        kind = TYPES.get(code.params[name].rstrip(OPTIONAL), (int, float))
        assert isinstance(value, kind) or value in ("nan", "inf", "-inf"), (reason, name)
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, Reason):
                check(one)
