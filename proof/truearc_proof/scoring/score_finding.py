"""Score of one finding (`truearc.finding/1`) against the truth of its world."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from truearc_proof.truth import world as truth

NULLS: dict[str, tuple[str, ...]] = {
    "clean": (), "balls": ("balls",), "outliers": ("outliers",), "noise_understated": ("noise_understated",),
    "noise_overstated": ("noise_overstated",), "track_memory": ("track_memory",), "missing_frames": ("missing_frames",),
    "clipped": ("clipped",),
    "all": ("balls", "outliers", "noise_understated", "track_memory", "missing_frames", "clipped")}
Finding = Mapping[str, Any]
SEED_SPIN = 2.0                       # the paper's Eq. 12 has twice the spin of rolling, and with it twice r w / v
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
# Terms that a belief may lack though they are true; their amplitude is the coefficient itself.
CUT: dict[str, tuple[str, Callable[[float], float]]] = {
    "drag": ("cd", float), "magnus": ("cl", float), "exit_efficiency": ("loss", float)}
# Names that data of a level can hardly or not at all tell apart, whatever the solver says (design, section 4.2).
ALIASES: dict[str, tuple[frozenset[str], ...]] = {
    "L0": (frozenset({"distance_bias", "distance_scale", "target_height", "release_height"}),
           frozenset({"hood_offset", "wheel_slip", "drag_reynolds"}), frozenset({"ball_wear", "drag_wear"}),
           frozenset({"buoyancy", "added_mass"}), frozenset({"spin_drag", "spin_decay"})),
    "L1": (frozenset({"target_height", "release_height"}), frozenset({"buoyancy", "added_mass"})),
    "L2": (frozenset({"distance_bias", "distance_scale"}), frozenset({"buoyancy", "added_mass"})),
}
# Of effects in no catalogue: covariates of which any is right, and the direction. Balls of one supplier are identified
# by the ball's or the supplier's name; effects within a flight by time or speed in it.
SPEEDS = ("motor_ratio", "exit_speed_m_s", "exit_spin_rev_s", "wheel_lower_rad_s", "wheel_upper_rad_s",
          "fed_wheel_lower_rad_s", "fed_wheel_upper_rad_s")
GOES_WITH: dict[str, tuple[tuple[str, ...], str]] = {
    "late_gust": (("time_in_flight_s",), "along"),
    "far_kick": (("distance_m",), "along"), "supplier_drag": (("supplier", "ball_id"), "along"),
    "seam_force": (("temperature_c",), "lateral"), "cold_rubber": (("temperature_c",), "along"),
    "hood_flex": (SPEEDS, "vertical"), "worn_wheel": (SPEEDS, "along"),
    "drag_crisis": (("speed_in_flight_m_s",), "along")}
BY_BALL = ("ball_wear", "drag_wear")  # amplitudes are those of the most used ball
STAGE_OF = {effect.name: effect.stage for effect in truth.EFFECTS} | {
    "drag": "flight", "magnus": "flight", "exit_efficiency": "launch"}


def names_at(kind: str, level: str, hopeless: bool = False) -> Iterator[str]:
    """Names of "nulls", "effects" of the catalogue, or effects "off" it at a level; effects that its data cannot show
    are left out unless `hopeless`."""
    if kind == "nulls":
        yield from (name for name, dirt in NULLS.items()
                    if level == "L2" or name == "all" or not any(one in truth.TRACK_DIRT for one in dirt))
    else:
        effects = truth.CATALOGUED if kind == "effects" else truth.UNCATALOGUED
        yield from (effect.name for effect in effects if hopeless or effect.name not in unseen(level))


def unseen(level: str) -> tuple[str, ...]:
    """Effects of which the data of a level have no trace, by what they are."""
    tracks = truth.TRACK_EFFECTS
    return truth.ABSORBED + {"L0": truth.COVARIATE_EFFECTS + tracks, "L1": tracks, "L2": ()}[level]


def goes_with_right(name: str, finding: Finding) -> bool:
    """Return whether the verdict is unknown, with a right covariate and the right direction."""
    where, unknown = finding.get("where") or {}, finding.get("unknown") or {}
    said = unknown if unknown.get("covariate") else where
    covariates, direction = GOES_WITH[name]
    names = {said.get("covariate"), *(where.get("inseparable") or ())}
    return (finding.get("verdict") == "unknown" and bool(names & set(covariates))
            and said.get("direction") == direction)


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


def is_alias(level: str, name: str, top: Sequence[str]) -> bool:
    """Whether the first name said is of the true one's class at this level."""
    return bool(top) and any(name in names and top[0] in names for names in ALIASES[level])


def in_catalogue(name: str, amount: float) -> tuple[str, float] | None:
    """Parameter of the catalogue's term that an effect's amplitude is, and its value; None for what has no term."""
    if name not in PARAMETER and name not in CUT:
        return None
    parameter, value = (PARAMETER | CUT)[name]
    return parameter, value(amount)
