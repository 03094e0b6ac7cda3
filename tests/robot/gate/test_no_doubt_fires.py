"""FIRE exactly when everything is known and good: the whole tick against rules written down apart from it.

One example is one world, put through the tick. Hypothesis draws a thousand at a time, seven bytes each: a draw a world
would cost more than the tick. `--hypothesis-profile=million` draws ten times as many.
"""

from collections import Counter

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.robot.gate import worlds as drawn
from truearc.robot.tick import step

AT_ONCE, BYTES = 1000, 7
BEAT_S = 0.35                         # age of a heartbeat with which an axis may still be driven, but nothing fired


class Worlds(bytes):
    """A thousand numbers of worlds; a report of a failure needs the one that failed, which it has, and not all."""

    def __repr__(self) -> str:
        return f"<{AT_ONCE} worlds>"

    def numbers(self) -> list[int]:
        return [int.from_bytes(self[at:at + BYTES], "little") for at in range(0, len(self), BYTES)]


def fires(facts: drawn.Facts) -> bool:
    inputs, memory, config, gate = drawn.build(facts)
    tick = step(inputs, memory, config, gate)
    fed = tick.command.feeder_torque_nm != 0.0
    spoilt = {name: value for name, value in facts.items() if value != drawn.GOOD[name]}
    assert tick.verdict.fire == drawn.may_fire(_after_the_presses(facts)), (spoilt, tick.verdict.reasons)
    assert tick.verdict.fire == (not tick.verdict.reasons) == (tick.shot is not None)
    # a ball that is on its way is fed to its end, unless the driver disarms or an axis is in doubt
    may_feed = tick.verdict.fire or (tick.memory.armed and _still_feeding(facts))
    all_good = (drawn.motor_is_good(facts, "feeder") and not facts["wires"] and tick.command.enable_flywheel
                and tick.command.enable_hood and drawn.encoder_is_good(facts, BEAT_S)
                and all(drawn.motor_is_good(facts, name, BEAT_S) for name in (*drawn.WHEELS, "screw")))
    assert fed == may_feed if all_good else not fed or facts["wires"]
    assert tick.memory.armed or not (tick.command.enable_flywheel or tick.command.enable_hood or fed)
    wheels_are_good = all(drawn.motor_is_good(facts, name, BEAT_S) for name in drawn.WHEELS)
    assert tick.command.flywheel_torque_nm == 0.0 or wheels_are_good, spoilt
    assert tick.command.hood_torque_nm == 0.0 or drawn.motor_is_good(facts, "screw", BEAT_S), spoilt
    assert not tick.verdict.fire or (tick.memory.feed_t_ns == inputs.t_ns and tick.memory.awaiting
                                     and not tick.memory.request_t_ns)
    return tick.verdict.fire


def _still_feeding(facts: drawn.Facts) -> bool:
    since_ns = facts["ball on its way"]
    return since_ns != drawn.NEVER and since_ns < 250_000_000 and since_ns != 10_000_000_000


def _after_the_presses(facts: drawn.Facts) -> drawn.Facts:
    """Effect of the buttons: arming forgets what was asked, and only who is armed and has no ball out may ask."""
    armed, asked = facts["armed"], facts["asked"]
    for button in facts["pressed"]:
        if button == "arm":
            armed, asked = not armed, False
        elif button == "fire":
            asked = asked or (armed and not facts["unmarked shot"] and facts["ball on its way"] == drawn.NEVER)
    if facts["presses"]:                          # one of those that got lost may have disarmed
        armed = asked = False
    # arming also drops the aim and the time since which all was steady: nothing is fired in the tick that armed
    return {**facts, "armed": armed, "asked": asked and "arm" not in facts["pressed"]}


def test_no_doubt_fires_and_no_certainty_holds() -> None:
    fired, alone, different = Counter[bool](), Counter[str](), set[int]()

    # one world is as small as it gets: a thousand need no shrinking
    @settings(suppress_health_check=[HealthCheck.large_base_example], phases=[Phase.generate], database=None)
    @given(st.binary(min_size=AT_ONCE * BYTES, max_size=AT_ONCE * BYTES).map(Worlds))
    def try_them(worlds: Worlds) -> None:
        for number in worlds.numbers():
            spoilt = drawn.spoil(number)
            different.add(number)
            fired[fire := fires({**drawn.GOOD, **spoilt})] += 1
            wrong = spoilt.keys() - {"family"}
            if len(wrong) == 1 and not fire:
                alone.update(wrong)

    try_them()
    assert fired.total() >= settings().max_examples * AT_ONCE and len(different) > 0.9 * fired.total()
    assert fired[True] > fired.total() / 10
    # each thing that can be wrong has been all that was
    assert set(alone) == set(drawn.NAMES) - {"family", "policy"}


def test_a_good_world_fires_whoever_made_its_motors() -> None:
    for name in drawn.FAMILIES:
        world = {**drawn.GOOD, "family": name}
        assert drawn.may_fire(world) and fires(world)
