"""Excitation program: quasistatic ramps and dynamic steps, each followed by coasting to rest."""

from msgspec import Struct

from truearc.errors import InputError
from truearc.robot.config.schema import Config, Excite
from truearc.robot.motion import OVERSPEED

READY, HOME, COAST, RAMP, STEP = "ready", "home", "coast", "ramp", "step"
# The doctor's: a short push that may move nothing; no torque for a while; slow travel of the hood, to or off its switch
NUDGE, PAUSE, CREEP = "nudge", "pause", "creep"
CREEP_UP_DEG = 3.0                    # above the switch: it closes within a fraction of a degree
FLYWHEEL, HOOD = "flywheel", "hood"
STILL = 0.02                          # times top_rad_s: it has come to rest
READY_S = 5.0                         # from arming until every axis is under control


class Phase(Struct, frozen=True):
    """One joint, one thing done to it; speeds and torques at the motor."""

    joint: str
    kind: str
    sign: int                         # +1 launches a ball or raises the hood, -1 the other way
    torque_nm: float                  # at most
    rate_nm_s: float                  # how fast the torque grows; 0 = at once
    top_rad_s: float
    longest_s: float
    ends_rad_s: float = 0.0           # a drive ends at this speed, creeping keeps to it; 0: top_rad_s
    must_turn: bool = False           # a nudge, after which nothing more is tried

    def asked_nm(self, since_s: float) -> float:
        """The torque this long after the phase began."""
        size_nm = min(self.torque_nm, self.rate_nm_s * since_s) if self.rate_nm_s else self.torque_nm
        return self.sign * size_nm


def phases(config: Config) -> tuple[Phase, ...]:
    """The whole program; InputError when [identify] is missing or asks for what the launcher's own limits forbid."""
    if config.identify is None:
        raise InputError("[identify] is missing from the configuration: it says what may be driven, and how hard")
    wheel, hood = config.identify.flywheel, config.identify.hood
    _check(config)
    program = [Phase(FLYWHEEL, READY, 1, 0.0, 0.0, wheel.top_rad_s, READY_S)]
    if wheel.repeats:
        program += _joint(FLYWHEEL, wheel, (1, -1) if wheel.reverse else (1,))
    if hood.repeats:
        homing_nm = config.hood.homing_torque_nm
        program += [Phase(HOOD, HOME, 1 if homing_nm > 0.0 else -1, abs(homing_nm), 0.0, hood.top_rad_s,
                          hood.longest_s)]
        program += _joint(HOOD, hood, (1, -1))
    if len(program) == 1:
        raise InputError("identify: both repeats are 0, so nothing would be driven")
    return tuple(program)


def _joint(joint: str, excite: Excite, signs: tuple[int, ...]) -> list[Phase]:
    """Coast, then for each repeat ramps each way and steps each way, so that up and down end where they began."""
    coast = Phase(joint, COAST, 1, 0.0, 0.0, excite.top_rad_s, excite.longest_s)
    made = [coast]
    for _ in range(excite.repeats):
        for kind, rate_nm_s in ((RAMP, excite.ramp_nm_s), (STEP, 0.0)):
            for sign in signs:
                made += [Phase(joint, kind, sign, excite.step_nm, rate_nm_s, excite.top_rad_s, excite.longest_s), coast]
    return made


def _check(config: Config) -> None:
    assert config.identify is not None
    wheel, hood = config.identify.flywheel, config.identify.hood
    free_rad_s = config.rig.launcher.free_speed_rad_s
    if free_rad_s and OVERSPEED * wheel.top_rad_s > free_rad_s:
        raise InputError(f"identify.flywheel.top_rad_s is {wheel.top_rad_s:g}; with {OVERSPEED - 1.0:.0%} to spare "
                         f"that is above rig.launcher.free_speed_rad_s, {free_rad_s:g}")
    if not 0.0 < 2.0 * hood.margin_deg < config.hood.high_deg - config.hood.low_deg:
        raise InputError(f"identify.hood.margin_deg is {hood.margin_deg:g}: nothing is left of the hood's travel from "
                       f"{config.hood.low_deg:g} to {config.hood.high_deg:g} degrees")
