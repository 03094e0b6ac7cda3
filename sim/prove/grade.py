"""A finding against the truth: what was right, world by world. Reads findings as formats.md section 2 has them."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from msgspec import Struct

from sim.prove.suite import CUT, Job, amount_of
from sim.prove.truth.effects import EFFECTS
from sim.prove.truth.world import World

Finding = Mapping[str, Any]
SEED_SPIN = 2.0                       # the seed's Eq. 12 has twice the spin of rolling, and with it twice r w / v
SET_SHARE = 0.9

# The parameter of the catalogue's term that a hidden amplitude is, and its value then.
PARAMETER: dict[str, tuple[str, Callable[[float], float]]] = {
    "hood_offset": ("angle_deg", float), "hood_backlash": ("angle_deg", lambda a: -a),
    "encoder_scale": ("share", float), "distance_scale": ("share", float), "distance_bias": ("bias_m", float),
    "vision_latency": ("delay_s", float), "track_scale": ("share", float), "track_tilt": ("angle_deg", float),
    "track_clock": ("share", lambda a: 1.0 / (1.0 + a) - 1.0),
    "wheel_slip": ("loss_per_m_s", float), "wheel_droop": ("loss", float), "ball_compression": ("share", float),
    "ball_wear": ("loss", float), "ball_spread": ("spread", float), "battery_sag": ("sensitivity", float),
    "rapid_fire": ("loss", float), "release_height": ("above_m", float), "buoyancy": ("share", float),
    "added_mass": ("share", float), "spin_decay": ("rate_per_s", float),
    "spin_drag": ("share", lambda a: a / SEED_SPIN**2), "drag_reynolds": ("slope", float),
    "lift_saturation": ("rate", lambda a: a / SEED_SPIN), "wind_x": ("speed_m_s", float),
    "wind_y": ("speed_m_s", float), "wind_z": ("speed_m_s", float), "air_density": ("share", float),
    "drag_wear": ("share", float), "target_height": ("rise_m", float), "rim_catch": ("reach_m", float),
}
# Names that data of a level can hardly or not at all tell apart, whatever the solver says (design, section 4.2).
ALIASES: dict[str, tuple[frozenset[str], ...]] = {
    "L0": (frozenset({"distance_bias", "distance_scale", "target_height", "release_height"}),
           frozenset({"hood_offset", "wheel_slip", "drag_reynolds"}), frozenset({"ball_wear", "drag_wear"}),
           frozenset({"buoyancy", "added_mass"}), frozenset({"spin_drag", "spin_decay"})),
    "L1": (frozenset({"target_height", "release_height"}), frozenset({"buoyancy", "added_mass"})),
    "L2": (frozenset({"distance_bias", "distance_scale"}), frozenset({"buoyancy", "added_mass"})),
}
# Of what is in no catalogue: covariates of which any would be right, and the direction. Balls of one supplier are told
# by the ball's or the supplier's name; what goes on inside a flight by time or speed in it.
SPEEDS = ("motor_ratio", "exit_speed_m_s", "exit_spin_rev_s", "wheel_lower_rad_s", "wheel_upper_rad_s",
          "fed_wheel_lower_rad_s", "fed_wheel_upper_rad_s")
GOES_WITH: dict[str, tuple[tuple[str, ...], str]] = {
    "late_gust": (("time_in_flight_s",), "along"),
    "far_kick": (("distance_m",), "along"), "supplier_drag": (("supplier", "ball_id"), "along"),
    "seam_force": (("temperature_c",), "lateral"), "cold_rubber": (("temperature_c",), "along"),
    "hood_flex": (SPEEDS, "vertical"), "worn_wheel": (SPEEDS, "along"),
    "drag_crisis": (("speed_in_flight_m_s",), "along")}
BY_BALL = ("ball_wear", "drag_wear")  # amplitudes are those of the most used ball
STAGE_OF = {effect.name: effect.stage for effect in EFFECTS} | {
    "drag": "flight", "magnus": "flight", "exit_efficiency": "launch"}


class Grade(Struct, frozen=True):
    """One world's marks; None where the question does not arise."""

    kind: str
    name: str
    level: str
    shots: int
    scale: float
    found: bool
    verdict: str
    p_value: float | None
    stage_right: bool | None          # of what was found
    top_right: bool | None
    alias_right: bool | None
    covered: bool | None              # the truth is in the set that is said
    set_size: int | None
    interval_holds: bool | None       # of what was named right
    covariate: str | None
    direction: str | None
    gain: float | None                # per held-out shot
    oracle_gain: float | None         # the same, had the true term been given
    ceiling: tuple[float, ...] | None  # sim.prove.ceiling.Ceiling's chances in these data
    seconds: float
    strength: float | None = None     # lambda of what is in no catalogue, where only heights speak of it
    goes_with_right: bool | None = None        # covariate and direction of what is in no catalogue


def grade(job: Job, finding: Finding, seconds: float, world: World | None = None) -> Grade:
    """Marks of one finding. world: its true coefficients, for what was cut from the belief."""
    found = bool(finding["mismatch"]["found"])
    where = finding.get("where") or {}
    gain, oracle_gain = gain_said(finding) if found else (None, None)
    hidden = job.kind != "nulls"
    named = job.kind in ("effects", "cut")
    names = said_set(finding)
    top = names_ranked(finding)[:1]
    right = bool(top) and top[0] == job.name
    return Grade(
        job.kind, job.name, job.level, job.shots, job.scale, found, str(finding.get("verdict")),
        finding["mismatch"].get("p_value"),
        said_stage(where) == STAGE_OF[job.name] if found and hidden else None,
        right if found and named else None,
        (right or is_alias(job.level, job.name, top, finding)) if found and named else None,
        job.name in names if found and named and names else None,
        len(names) if found and names else None,
        interval_holds(job, finding, world) if found and named and right else None,
        where.get("covariate"), where.get("direction"), gain, oracle_gain, _ceiling(finding), seconds,
        finding.get("strength"), goes_with_right(job.name, finding) if found and job.kind == "off" else None)


def goes_with_right(name: str, finding: Finding) -> bool:
    """Whether it is said to have no name, and to go with what it does go with, in its direction."""
    where, unknown = finding.get("where") or {}, finding.get("unknown") or {}
    said = unknown if unknown.get("covariate") else where
    covariates, direction = GOES_WITH[name]
    names = {said.get("covariate"), *(where.get("inseparable") or ())}
    return (finding.get("verdict") == "unknown" and bool(names & set(covariates))
            and said.get("direction") == direction)


def _ceiling(finding: Finding) -> tuple[float, ...] | None:
    ceiling = finding.get("ceiling")
    return None if ceiling is None else tuple(ceiling[:4])


def gain_said(finding: Finding) -> tuple[float | None, float | None]:
    """Held-out gain a shot, and what the true term alone would have gained if somebody worked that out."""
    fit = finding.get("fit") or {}
    return fit.get("gain_per_shot"), fit.get("oracle_gain_per_shot")


def said_stage(where: Mapping[str, Any]) -> str | None:
    """The stage that is said, or else thought likeliest."""
    stage, shares = where.get("stage"), where.get("stage_probability") or {}
    return stage if stage or not shares else max(shares, key=lambda name: shares[name] or 0.0)


def names_ranked(finding: Finding) -> list[str]:
    """Terms by probability, likeliest first."""
    return [entry["term"] for entry in sorted(finding.get("what") or (), key=lambda e: -(e.get("probability") or 0.0))]


def said_set(finding: Finding) -> list[str]:
    """The set that is said; else, of a ranking, as many as make 90 % of what is not unknown."""
    if finding.get("set"):
        return list(finding["set"])
    shares = {entry["term"]: entry.get("probability") or 0.0 for entry in finding.get("what") or ()}
    names: list[str] = []
    for name in sorted(shares, key=lambda name: -shares[name]):
        if names and sum(shares[one] for one in names) >= SET_SHARE * sum(shares.values()):
            break
        names.append(name)
    return names


def is_alias(level: str, name: str, top: Sequence[str], finding: Finding | None = None) -> bool:
    """Whether the first name said is of the true one's class: the level's, or these very data's (Ceiling.alike)."""
    alike = ((finding or {}).get("ceiling") or [()])[-1]
    return bool(top) and (top[0] in alike or any(name in names and top[0] in names for names in ALIASES[level]))


def interval_holds(job: Job, finding: Finding, world: World | None = None) -> bool | None:
    """Whether the 90 % interval of the right name holds the true amplitude; None when none is given, or where balls are
    not told apart and wear can only mean what it comes to by the end, not that of the most used ball."""
    if job.level == "L0" and job.name in BY_BALL:
        return None
    wanted = true_parameter(job, world)
    entry = next(entry for entry in finding["what"] if entry["term"] == job.name)
    given = (entry.get("parameters") or {}).get(wanted[0]) if wanted else None
    if wanted is None or not given or given.get("low90") is None or given.get("high90") is None:
        return None
    return bool(given["low90"] <= wanted[1] <= given["high90"])


def true_parameter(job: Job, world: World | None = None) -> tuple[str, float] | None:
    """(parameter, value) of the true term in the catalogue's words; None where there is no such thing."""
    if job.name in CUT and job.kind == "cut" and world is not None:
        return {"drag": ("cd", world.cd), "magnus": ("cl", world.lift_slope * 3.0 / 32.0),
                "exit_efficiency": ("loss", 1.0 - world.efficiency)}[job.name]
    if job.name not in PARAMETER or math.isclose(amount_of(job), 0.0):
        return None
    parameter, value = PARAMETER[job.name]
    return parameter, value(amount_of(job))
