"""Signs that a verdict of a run must hold: reasons by their codes, and by parameters of theirs."""

from collections.abc import Iterable
from typing import Any

from msgspec import Struct

from truearc.hw.reason import Code, Reason


class Sign(Struct, frozen=True):
    """A reason of this code with these parameters; of a list, these among others; of a cause, one of these signs."""

    code: Code
    params: dict[str, Any] = {}

    def fits(self, reason: Reason) -> bool:
        return reason.code == self.code.name and all(
            _fits(wanted, reason.params.get(name)) for name, wanted in self.params.items())


Signs = tuple[Sign, ...]


def says(*codes: Code, **params: Any) -> Signs:
    """Any of these codes, with these parameters."""
    return tuple(Sign(code, params) for code in codes)


def of(device: str, signs: Signs) -> Signs:
    """The same, of one motor or encoder."""
    return tuple(Sign(sign.code, {**sign.params, next(name for name in ("motor", "device")
                                                      if name in sign.code.params): device}) for sign in signs)


def find(signs: Signs, reasons: Iterable[Reason]) -> Reason | None:
    """The first reason that fits one of the signs."""
    return next((reason for reason in reasons if any(sign.fits(reason) for sign in signs)), None)


def _fits(wanted: Any, value: Any) -> bool:
    if isinstance(wanted, tuple) and any(isinstance(one, Sign) for one in wanted):
        return isinstance(value, Reason) and find(wanted, (value,)) is not None
    if isinstance(wanted, tuple):
        return isinstance(value, tuple | list) and all(one in value for one in wanted)
    return bool(value == wanted)
