"""Reasons compared by code and parameters, numbers to a thousandth."""

from collections.abc import Iterable

import pytest

from truearc.hw.reason import Reason


def assert_alike(found: Iterable[Reason], wanted: Iterable[Reason]) -> None:
    """The same codes in the same order, with the same parameters."""
    found, wanted = list(found), list(wanted)
    assert [one.code for one in found] == [one.code for one in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert one.params.keys() == other.params.keys()
        for name, value in other.params.items():
            expected = pytest.approx(value, rel=1e-3, abs=1e-3) if isinstance(value, float) else value
            assert one.params[name] == expected, (one.code, name)


def codes(reasons: Iterable[Reason]) -> list[str]:
    return [reason.code for reason in reasons]
