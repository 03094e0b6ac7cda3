"""Every built-in family of motor controllers declares everything about itself, and does what it declares."""

import pytest

from tests.hw.family_checks import CHECKS, check_frames, codec_of
from truearc.hw.devices.registry import BY_DRIVER, FAMILIES, drivers, find_family

names = pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.driver)


@names
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_family_passes(check, family) -> None:
    check(family)


@pytest.mark.parametrize("family", [one for one in FAMILIES if one.dbc], ids=lambda family: family.driver)
def test_its_frames_come_back_as_they_went_out(family) -> None:
    check_frames(codec_of(family))


def test_a_driver_that_does_not_exist_is_an_error() -> None:
    assert set(BY_DRIVER) <= set(drivers())
    with pytest.raises(LookupError):
        find_family("sprak")
