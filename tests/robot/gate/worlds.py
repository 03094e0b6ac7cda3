"""Worlds in which up to four things are not as they should be, and whether one may fire in them.

A world is a table of plain facts. `build` turns them into what the tick is handed; `may_fire` restates, from the facts
alone and with numbers of its own, what firing needs. It knows nothing of the verdict.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_memory
from tests.robot.sparks import ALL_SPARK, only_advice
from truearc.hw import fault_codes as hw
from truearc.hw.protocols import AngleReading, ButtonEvent, MotorReading
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config
from truearc.robot.gate import Gate
from truearc.robot.motors import screw_length_m
from truearc.robot.types import Aim, Inputs, Memory, Sighting

MS = 1_000_000
FREE_RAD_S = 594.0
FAMILIES = {"odrive": CONFIG, "spark": ALL_SPARK, "another's odrive": only_advice("odrive"),
            "another's spark": only_advice("spark")}
FAMILIES = {name: replace(config, gate=replace(config.gate, policy="model")) for name, config in FAMILIES.items()}
WHEELS, MOTORS = ("left", "right"), ("left", "right", "screw", "feeder")
HELD = good_memory().aim
assert HELD is not None
WANTED = HELD.motor_ratio * FREE_RAD_S
BOX = (2.0, 8.0, 0.3, 0.9, 20.0, 60.0)            # distance, ratio, hood: low and high of each
NEVER, ABSENT = "never", "absent"

Facts = dict[str, Any]
Draw = Callable[[int], Any]                       # a number below 4096 -> a value


class Fact(NamedTuple):
    good: Any
    draw: Draw


def among(*values: Any) -> Draw:
    return lambda n: values[n % len(values)]


def ages(limit_ns: int, good_ns: int = 4 * MS, exact: bool = True) -> Draw:
    """An age in ns: at the edges of what is allowed, absurd, or anywhere from 1 s in the future to 3 s ago.

    Not `exact`: the limit in seconds is not the float that its nanoseconds come to, so that no age can be just there.
    """
    edges = (limit_ns if exact else limit_ns - 1, limit_ns + 1, limit_ns - 1, 0, 1, -1, -MS, -3_600_000 * MS,
             86_400_000 * MS, NEVER, 2 * limit_ns, limit_ns // 3)
    return lambda n: edges[n // 2 % len(edges)] if n % 2 else (n - 1024) * MS + 137_031


def numbers(good: float, span: float) -> Draw:
    """No number at all, absurdly large, or anywhere within `span` of what it should be, but on no limit."""
    wild = (math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, -good)
    return lambda n: wild[n // 2 % len(wild)] if n % 2 else good + (n - 2048) / 2048 * span + span * 1.7e-5


def limits(good: float) -> Draw:
    return among(math.nan, -1e-9, -1.0, good / 2.0, -math.inf)


def _motor_facts(name: str) -> dict[str, Fact]:
    wheel = name in WHEELS
    return {
        f"{name}: age": Fact(4 * MS, ages(100 * MS)),
        f"{name}: heartbeat age": Fact(4 * MS, ages(250 * MS)),
        f"{name}: errors age": Fact(ABSENT, ages(1000 * MS)),
        f"{name}: state": Fact(8, among(0, 1, 2, 3, 7, 9, 11, 255)),
        f"{name}: errors": Fact(0, lambda n: 1 << n % 10),
        f"{name}: speed": Fact(WANTED if wheel else 0.0, numbers(WANTED if wheel else 0.0, 12.0)),
        # None: as far as the hood is up
        f"{name}: turned": Fact(None if name == "screw" else 1.0, numbers(1.0, 1e5)),
        f"{name}: current": Fact(5.0, numbers(5.0, 100.0)),
        f"{name}: supply": Fact(12.2, numbers(12.2, 12.0)),
    }


FACTS: dict[str, Fact] = {
    **{key: fact for name in MOTORS for key, fact in _motor_facts(name).items()},
    "encoder: there": Fact(True, among(False)),
    "encoder: age": Fact(4 * MS, ages(100 * MS)),
    "encoder: faults age": Fact(4 * MS, ages(250 * MS)),
    "encoder: magnet": Fact(True, among(False)),
    "encoder: hood": Fact(HELD.hood_deg, numbers(HELD.hood_deg, 4.0)),
    "screw: hood": Fact(HELD.hood_deg, lambda n: HELD.hood_deg + (n - 2048) / 512 + 7e-5),
    "wires": Fact((), among((because.CAN_LOST(cause=hw.CAN_BUS_OFF(bus="CAN")),), (because.BOX_PRESS_UNCERTAIN(),),
                            (hw.ENCODER_MISMATCH(motor="feeder motor", controller="odrive node 4", speed_rad_s=178.0,
                                                 turned_rad_s=9.0),))),
    "presses": Fact(None, among(hw.BOX_PRESSES_LOST(presses=2), hw.BOX_RESTARTED())),
    "armed": Fact(True, among(False)),
    "homed": Fact(True, among(False)),
    "unmarked shot": Fact(False, among(True)),
    "ball on its way": Fact(NEVER, ages(600 * MS)),
    "asked": Fact(True, among(False)),
    "steady": Fact(500 * MS, ages(100 * MS)),
    "aim: ratio": Fact(HELD.motor_ratio, numbers(HELD.motor_ratio, 0.02)),
    "aim: hood": Fact(HELD.hood_deg, numbers(HELD.hood_deg, 1.0)),
    "aim: says": Fact("plan", among("idle", 4.0)),       # a number: stand there
    # how far away it is for, None: from anywhere
    "aim: place": Fact(None, lambda n: math.nan if n % 64 == 1 else 5.0 + (n - 2048) / 2048 * 0.6 + 7e-5),
    "target: seen": Fact(True, among(False)),
    "target: age": Fact(50 * MS, ages(300 * MS, exact=False)),
    "target: distance": Fact(5.0, lambda n: None if n % 16 == 1 else numbers(5.0, 18.0)(n)),
    "target: sigma": Fact(0.03, among(None, math.nan, math.inf, -math.inf, -0.01, 0.0, 10.0)),
    "policy": Fact("model", among("collect", "models", "")),
    "model: there": Fact(True, among(False)),
    "model: raises": Fact(None, among(RuntimeError("out of memory"), ValueError(), KeyError("p"), ZeroDivisionError())),
    "model: two": Fact(0.9, among(math.nan, math.inf, -0.01, 1.01, 0.0, 1.0)),
    "model: three": Fact(0.8, lambda n: n / 4095.0 + 7e-5 if n % 4 else among(math.nan, math.inf, -0.01, 1.01)(n // 4)),
    "model: novelty": Fact(0.5, lambda n: n / 2048.0 + 7e-5 if n % 4 else among(math.nan, math.inf, -0.01)(n // 4)),
    "model: box": Fact(BOX, lambda n: tuple(low if k != n % 6 else (edge, low)[n // 6 % 2] for k, (low, edge) in
                                            enumerate(zip(BOX, (5.1, 4.9, 0.62, 0.59, 49.0, 48.0), strict=True)))),
    "limit: reading age": Fact(0.1, limits(0.1)),
    "limit: sighting age": Fact(0.3, limits(0.3)),
    "limit: threshold": Fact(0.3, among(math.nan, math.inf, 0.5, 0.9, 0.0)),
    "limit: wheels": Fact(3.0, limits(3.0)),
    "limit: spread": Fact(5.0, limits(5.0)),
    "limit: hood": Fact(0.3, limits(0.3)),
    "limit: hood twice": Fact(1.5, limits(1.5)),
    "limit: steady": Fact(0.1, among(math.nan, math.inf, 0.2, 0.7)),
    "family": Fact("odrive", among(*FAMILIES)),
    "pressed": Fact((), among(("arm",), ("fire",), ("arm", "fire"), ("fire", "arm"), ("two",), ("reject",)))}
NAMES = tuple(FACTS)
IN_CONFIG = tuple(name for name in NAMES if name.startswith(("policy", "limit: ")))
GOOD: Facts = {name: fact.good for name, fact in FACTS.items()}


def spoil(number: int) -> Facts:
    """The facts that differ from good ones, none to three and perhaps the family of the motors: `number` says which."""
    number, many = divmod(number, 4)
    spoilt: Facts = {}
    for _ in range(many):
        number, which = divmod(number, len(NAMES))
        number, value = divmod(number, 4096)
        spoilt[NAMES[which]] = FACTS[NAMES[which]].draw(value)
    if number % 2:
        spoilt.setdefault("family", tuple(FAMILIES)[number // 2 % len(FAMILIES)])
    return spoilt


# --- what firing needs


def may_fire(facts: Facts) -> bool:
    """Everything that can be checked is known and good, the driver has asked, and the model agrees."""
    return (_crew(facts) and not facts["wires"] and all(motor_is_good(facts, name) for name in MOTORS) and _hood(facts)
            and _wheels(facts) and _target(facts) and _model(facts))


def _crew(facts: Facts) -> bool:
    marked = not facts["unmarked shot"] and facts["ball on its way"] == NEVER
    return facts["armed"] and facts["homed"] and facts["asked"] and marked and not facts["presses"]


def _known(age_ns: Any, most_s: float) -> bool:
    return age_ns not in (NEVER, ABSENT) and age_ns < NOW_NS and 0 <= age_ns <= most_s * 1e9


def motor_is_good(facts: Facts, name: str, beat_s: float = 0.25) -> bool:
    family = facts["family"]
    asked_of = 0x3FF
    if family == "another's spark":               # that it obeys another, and was switched on, is as it should be
        asked_of = 0xFF
    obeys = facts[f"{name}: state"] == 8 or family == "another's spark"
    says_errors = facts[f"{name}: errors age"] == ABSENT or _known(facts[f"{name}: errors age"], 1.0)
    turned = facts[f"{name}: turned"]
    finite = all(map(math.isfinite, (facts[f"{name}: speed"], turned if turned is not None else 0.0,
                                     facts[f"{name}: current"], facts[f"{name}: supply"])))
    return (_known(facts[f"{name}: age"], facts["limit: reading age"])
            and _known(facts[f"{name}: heartbeat age"], beat_s)
            and says_errors and finite and obeys and not facts[f"{name}: errors"] & asked_of)


def encoder_is_good(facts: Facts, beat_s: float = 0.25) -> bool:
    """The hood's encoder."""
    there = facts["encoder: there"] and facts["encoder: magnet"] and _known(facts["encoder: faults age"], beat_s)
    return (there and _known(facts["encoder: age"], facts["limit: reading age"])
            and math.isfinite(facts["encoder: hood"]))


def _hood(facts: Facts) -> bool:
    if not encoder_is_good(facts):
        return False
    hood, turned = facts["encoder: hood"], facts["screw: turned"]
    screw = facts["screw: hood"] if turned is None else math.nan     # no such turn brings it anywhere near
    return (abs(hood - screw) <= facts["limit: hood twice"]
            and abs(hood - facts["aim: hood"]) <= facts["limit: hood"] and facts["aim: says"] == "plan")


def _wheels(facts: Facts) -> bool:
    left, right = (facts[f"{name}: speed"] for name in WHEELS)
    wanted, steady = facts["aim: ratio"] * FREE_RAD_S, facts["steady"]
    return (wanted > 0.0 and abs((left + right) / 2.0 - wanted) <= facts["limit: wheels"]
            and abs(left - right) <= facts["limit: spread"]
            and steady not in (NEVER, NOW_NS) and steady >= facts["limit: steady"] * 1e9)


def _target(facts: Facts) -> bool:
    distance, sigma = facts["target: distance"], facts["target: sigma"]
    place = facts["aim: place"]
    return (facts["target: seen"] and distance is not None and sigma is not None and 0.0 <= distance <= 20.0
            and (place is None or abs(distance - place) <= 0.3) and 0.0 <= sigma < math.inf
            and facts["target: age"] != NEVER and 0 <= facts["target: age"] <= facts["limit: sighting age"] * 1e9)


def _model(facts: Facts) -> bool:
    if not facts["model: there"]:
        return facts["policy"] == "collect"
    if facts["model: raises"] is not None:        # whatever the policy, something is broken
        return False
    if facts["policy"] == "collect":
        return True
    low_m, high_m, low_r, high_r, low_deg, high_deg = facts["model: box"]
    ratio = (facts["left: speed"] + facts["right: speed"]) / 2.0 / FREE_RAD_S
    inside = (low_m <= facts["target: distance"] <= high_m and low_r <= ratio <= high_r
              and low_deg <= facts["encoder: hood"] <= high_deg)
    return (inside and 0.0 <= facts["model: two"] <= 1.0 and 0.0 <= facts["model: three"] <= 1.0
            and 0.0 <= facts["model: novelty"] <= 1.0 and facts["model: three"] >= facts["limit: threshold"])


# --- the same facts as the tick meets them


class Model:
    """In place of an onnxruntime session: one answer, whatever it is asked."""

    def __init__(self, facts: Facts) -> None:
        self._raises = facts["model: raises"]
        self._answer = [np.array([[facts["model: two"], facts["model: three"]]], np.float64),
                        np.array([[facts["model: novelty"]]], np.float64)]

    def run(self, outputs: Any, inputs: Any) -> list[Any]:
        if self._raises is not None:
            raise self._raises
        return self._answer


def build(facts: Facts) -> tuple[Inputs, Memory, Config, Gate | None]:
    """What `tick.step` is handed."""
    angle = AngleReading(_stamp(facts["encoder: age"]), _encoder_rad(facts["encoder: hood"]), facts["encoder: magnet"],
                         0, _stamp(facts["encoder: faults age"]))
    left, right, screw, feeder = (_reading(facts, name) for name in MOTORS)
    presses = tuple(ButtonEvent(NOW_NS, seq, button) for seq, button in enumerate(facts["pressed"]))
    inputs = Inputs(NOW_NS, 2000, (left, right), screw, feeder, angle if facts["encoder: there"] else None, None,
                    presses, facts["wires"], missed=facts["presses"])
    box = facts["model: box"]
    gate = Gate(Model(facts), ((box[0], box[1]), (box[2], box[3]), (box[4], box[5])), "", {})
    return inputs, _memory(facts), _config(facts), gate if facts["model: there"] else None


def _stamp(age_ns: Any) -> Any:
    return {NEVER: 0, ABSENT: UNSET}[age_ns] if isinstance(age_ns, str) else NOW_NS - age_ns


def _reading(facts: Facts, name: str) -> MotorReading:
    stamp, turned = _stamp(facts[f"{name}: age"]), facts[f"{name}: turned"]
    return MotorReading(
        stamp, _screw_rad(facts["screw: hood"]) if turned is None else turned, facts[f"{name}: speed"],
        _stamp(facts[f"{name}: heartbeat age"]), facts[f"{name}: state"], facts[f"{name}: errors"], stamp,
        facts[f"{name}: current"], stamp, facts[f"{name}: supply"], errors_t_ns=_stamp(facts[f"{name}: errors age"]))


def _screw_rad(hood_deg: float) -> float:
    travel_m = screw_length_m(hood_deg, CONFIG.hood) - screw_length_m(CONFIG.hood.low_deg, CONFIG.hood)
    return travel_m / CONFIG.hood.screw_lead_m * math.tau


def _encoder_rad(hood_deg: float) -> float:
    return math.radians((hood_deg + 40.0) % 360.0) if abs(hood_deg) < 1e9 else hood_deg


def _memory(facts: Facts) -> Memory:
    sighting = Sighting(_stamp(facts["target: age"]), True, None, None if facts["target: distance"] is None else
                        facts["target: distance"] + CONFIG.camera.behind_exit_m, facts["target: sigma"], 0.0)
    return Memory(
        armed=facts["armed"], homed=facts["homed"], trial=3, request_t_ns=NOW_NS - 500 * MS if facts["asked"] else 0,
        aim=_aim(facts), aim_place_m=facts["aim: place"], steady_t_ns=_stamp(facts["steady"]),
        feed_t_ns=_stamp(facts["ball on its way"]), awaiting=facts["unmarked shot"],
        last_sighting=sighting if facts["target: seen"] else None)


def _aim(facts: Facts) -> Aim:
    says = facts["aim: says"]
    away = () if isinstance(says, str) else (says,)
    return Aim(facts["aim: ratio"], facts["aim: hood"], "plan" if away else says, *away)


def _config(facts: Facts) -> Config:
    config = FAMILIES[facts["family"]]
    if all(facts[name] == GOOD[name] for name in IN_CONFIG):
        return config
    gate = replace(config.gate, policy=facts["policy"], threshold=facts["limit: threshold"],
                   reading_age_s=facts["limit: reading age"], sighting_age_s=facts["limit: sighting age"])
    flywheel = replace(config.flywheel, tolerance_rad_s=facts["limit: wheels"], spread_rad_s=facts["limit: spread"],
                       steady_s=facts["limit: steady"])
    hood = replace(config.hood, tolerance_deg=facts["limit: hood"], crosscheck_deg=facts["limit: hood twice"])
    return replace(config, gate=gate, flywheel=flywheel, hood=hood)
