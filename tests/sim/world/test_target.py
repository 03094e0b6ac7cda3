import math

from hypothesis import given
from hypothesis import strategies as st

from truearc.sim.world.field import classify


def _inside_hexagon(y: float, up: float) -> bool:
    """By walking round the six corners of a regular hexagon that stands on a flat side, apothem 0.35."""
    circum = 0.35 / math.cos(math.radians(30.0))
    corners = [(circum * math.cos(math.radians(60.0 * k)), circum * math.sin(math.radians(60.0 * k))) for k in range(6)]
    return all((x2 - x1) * (up - z1) - (z2 - z1) * (y - x1) >= 0.0
               for (x1, z1), (x2, z2) in zip(corners, corners[1:] + corners[:1], strict=True))


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6).filter(lambda up: abs(up) > 1e-6))
def test_each_crossing_has_the_name_that_geometry_gives(y: float, up: float) -> None:
    outcome = classify(y, 2.44 + up)
    if math.hypot(y, up) < 0.0699:
        assert outcome == "three"
    elif math.hypot(y, up) > 0.0701 and _inside_hexagon(y * 1.0001, up * 1.0001):
        assert outcome == ("two" if abs(up) <= 0.07 else "two-high" if up > 0.0 else "two-low")
    elif not _inside_hexagon(y * 0.9999, up * 0.9999):
        assert outcome == ("miss-high" if up > 0.0 else "miss-low")


def test_what_never_crosses_is_low() -> None:
    assert classify(None, None) == "miss-low"
