"""A concealed world: its truth, the effects that may be hidden, and the circumstances of its shots.

Names shared with the solver's catalogue mean the same hypothesis; their laws are implemented here independently, from
the physics alone. An amplitude of 0 means that the effect is completely absent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Target, Wheel, WorldFacts

LEVELS = ("L0", "L1", "L2")
BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")
DIRT = ("track_memory", "balls", "outliers", "noise_understated", "noise_overstated", "missing_frames", "clipped",
        "battery_with_wear")
TRACK_DIRT = ("track_memory", "missing_frames", "clipped")
NOISE = Noise(distance_m=0.03, hood_deg=0.2, wheel_rad_s=0.5, track_m=0.015)
FEWEST = 10
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
SESSION_SHOTS = 30
SUPPLIERS = ("north", "south")
TARGET_ABOVE_EXIT_M = 1.69
STEEPER_DEG = 12.0                    # than the straight line to the target, at least
LOBS = 0.15                           # share of shots from within LOB_M lobbed steeper than 60 degrees
LOB_M = 4.0
FULL_V, RUN_DOWN_V = 12.8, 1.5


class Effect(NamedTuple):
    """`typical` in `unit`; `signed`: nature may give it either sign."""

    name: str
    stage: str
    typical: float
    unit: str
    signed: bool
    meaning: str


CATALOGUED: tuple[Effect, ...] = (
    Effect("hood_offset", "sensing", 0.8, "deg", True, "true elevation minus what the hood's encoder says"),
    Effect("hood_backlash", "sensing", 0.6, "deg", False, "true elevation is this far short of the way the hood came"),
    Effect("encoder_scale", "sensing", 0.01, "1", True, "true surface speeds of all wheels / those by encoder - 1"),
    Effect("distance_scale", "sensing", 0.02, "1", True, "true distance / measured - 1"),
    Effect("distance_bias", "sensing", 0.06, "m", True, "true distance minus measured"),
    Effect("vision_latency", "sensing", 0.05, "s", False, "the distance is this old; the robot was closing in"),
    Effect("track_scale", "sensing", 0.02, "1", True, "tracked lengths / true - 1, about the frame's origin"),
    Effect("track_tilt", "sensing", 1.0, "deg", True, "the tracker sees x axis points this far higher"),
    Effect("track_clock", "sensing", 0.02, "1", True, "the tracker's seconds / true - 1"),
    Effect("wheel_slip", "launch", 0.0075, "s/m", False, "slowness of the ball minus slowness of the surface"),
    Effect("wheel_droop", "launch", 0.05, "1", False, "speed lost at the wheels' mean dip, in proportion to the dip"),
    Effect("ball_compression", "launch", 0.10, "1", False, "share of its radius that the ball is squeezed by"),
    Effect("ball_wear", "launch", 0.03, "1", False, "speed lost by the most used ball"),
    Effect("ball_spread", "launch", 0.03, "1", False, "standard deviation of speed between balls"),
    Effect("battery_sag", "launch", 0.25, "1", False, "relative speed per relative voltage"),
    Effect("rapid_fire", "launch", 0.04, "1", False, "speed lost at no pause, gone with a time constant of 1 s"),
    Effect("release_height", "launch", 0.04, "m", True, "true exit height minus rig.toml's"),
    Effect("buoyancy", "flight", 1.0, "1", False, "share of the displaced air's weight that the ball feels"),
    Effect("added_mass", "flight", 1.0, "1", False, "share of half the displaced air's mass that moves with the ball"),
    Effect("spin_decay", "flight", 0.6, "1/s", False, "rate at which spin dies away"),
    Effect("spin_drag", "flight", 0.15, "1", False, "added to the drag coefficient, times (r w / v)^2"),
    Effect("drag_reynolds", "flight", -0.3, "1", False, "relative drag coefficient per (speed / 10 m/s - 1)"),
    Effect("lift_saturation", "flight", 1.0, "1", False, "e in lift coefficient k S / (1 + e S)"),
    Effect("wind_x", "flight", 0.8, "m/s", True, "air moving toward the target"),
    Effect("wind_y", "flight", 0.8, "m/s", True, "air moving to the left"),
    Effect("wind_z", "flight", 0.8, "m/s", True, "air rising"),
    Effect("air_density", "flight", 1.0, "1", False, "share of the ideal gas's density changes that is real"),
    Effect("drag_wear", "flight", 0.15, "1", True, "relative drag added on the most used ball"),
    Effect("target_height", "arrival", 0.05, "m", True, "true target centre minus rig.toml's"),
    Effect("rim_catch", "arrival", 0.03, "m", False, "both half heights are this much more forgiving"),
)
UNCATALOGUED: tuple[Effect, ...] = (
    Effect("late_gust", "flight", 2.5, "m/s", True, "air along x in the last third of the flight only"),
    Effect("far_kick", "launch", 0.05, "1", True, "relative speed per 2.5 m of distance beyond 4.5 m"),
    Effect("supplier_drag", "flight", 0.15, "1", True, "relative drag of balls of supplier south"),
    Effect("seam_force", "flight", 0.5, "m/s2", True, "sideways push per 10 degrees C above 20"),
    Effect("hood_flex", "launch", 0.6, "deg", True, "elevation per 100 rad/s of the first wheel beyond 250 rad/s"),
    Effect("worn_wheel", "launch", 0.03, "1", True, "true radius of the first wheel / stated - 1"),
    Effect("cold_rubber", "launch", 0.03, "1", True, "relative speed per 10 degrees C above 20"),
    Effect("drag_crisis", "flight", -0.35, "1", False, "relative step of the drag coefficient at 9 m/s, 1 m/s wide"),
)
# Small errors of what is believed, several at once in every session of a foreign world's robot. Their typical sizes: a
# sphere's drag coefficient rises from .4 to .5 over a decade of Reynolds numbers below 1e5, a power of .1, and falls
# where its surface is rough (Achenbach 1972). A golf ball loses 4 to 5 % of its spin in a second (Smits and Smith
# 1994), this ball by as much friction 5 %, more if it is rough. Tennis balls' restitution falls by .01 per m/s (Cross
# 1999), of which wheels see a part. Belts creep by 1 to 2 %, and one tooth of 36 is 3 %. Hoods follow their encoders to
# 1 or 2 %. MuJoCo's balls leave up to 2 deg steeper at slow wheels.
SMALL_ERRORS: tuple[Effect, ...] = (
    Effect("drag_power", "flight", 0.1, "1", True, "drag coefficient goes with this power of the speed"),
    Effect("spin_decay", "flight", 0.1, "1/s", False, "as in the catalogue"),
    Effect("soft_ball", "launch", 0.02, "1", False, "speed lost at 10 m/s, growing with the square of the speed"),
    Effect("wheel_gear", "launch", 0.015, "1", True, "true speed of the second wheel / that by its encoder - 1"),
    Effect("hood_gear", "launch", 0.015, "1", True, "true elevation, from 45 deg on, / that by the hood's encoder - 1"),
    Effect("slow_tilt", "launch", 1.0, "deg", True, "elevation, times (250 rad/s / speed of the first wheel)^2 - 1"),
)
FEWEST_ERRORS, DRAWN = 3, (0.5, 1.5)  # errors of a foreign world at least; their sizes in typical ones
EFFECTS = CATALOGUED + UNCATALOGUED + SMALL_ERRORS
COVARIATE_EFFECTS = ("vision_latency", "wheel_droop", "battery_sag", "rapid_fire", "air_density", "ball_spread",
                     "supplier_drag", "seam_force", "cold_rubber")
# a believed coefficient takes these up whole: all wheels too fast is a better efficiency and more lift, and the spin of
# a squeezed ball is more lift; without a measured spin no data show them
ABSORBED = ("encoder_scale", "ball_compression")
TRACK_EFFECTS = ("track_scale", "track_tilt", "track_clock", "wind_y", "seam_force")


def find_effect(name: str) -> Effect:
    """Return the effect of that name; InputError if there is none."""
    for effect in EFFECTS:
        if effect.name == name:
            return effect
    raise InputError(f"there is no effect {name!r}; there are {', '.join(effect.name for effect in EFFECTS)}")


def check_effects(effects: Mapping[str, float]) -> dict[str, float]:
    """Return effects as floats, by name; InputError for an unknown one."""
    return {find_effect(name).name: float(amount) for name, amount in sorted(effects.items())}


def draw_errors(seed: int) -> dict[str, float]:
    """Return the small errors of the foreign world with that seed, by name."""
    rng = np.random.default_rng([seed, 10])
    chosen = rng.choice(len(SMALL_ERRORS), rng.integers(FEWEST_ERRORS, len(SMALL_ERRORS) + 1), replace=False)
    return {one.name: float(one.typical * rng.uniform(*DRAWN) * (rng.choice((-1.0, 1.0)) if one.signed else 1.0))
            for one in (SMALL_ERRORS[k] for k in sorted(chosen))}


@dataclass(frozen=True)
class Scatter:
    """Standard deviations from shot to shot: speed and spin relative, angles in degrees."""

    speed: float = 0.015
    elevation_deg: float = 0.4
    azimuth_deg: float = 0.4
    spin: float = 0.05
    wheel: float = 0.003              # the speed loop's own error, relative, both wheels alike


@dataclass(frozen=True)
class World:
    """The truth of a world. `facts`: rig.toml as the solver gets it; `noise`: the sensors as they really are."""

    seed: int
    level: str
    shots: int
    facts: Rig
    cd: float
    lift_slope: float                 # k in lift coefficient = k S, S = r w / v
    efficiency: float                 # exit speed / mean surface speed of the wheels
    effects: Mapping[str, float] = field(default_factory=dict)
    dirt: tuple[str, ...] = ()
    scatter: Scatter = Scatter()
    noise: Noise = NOISE
    side: bool = False                # high or low is known of what is not a three

    def amount(self, name: str) -> float:
        """Return the amplitude of an effect; 0 if it is absent."""
        return self.effects.get(name, 0.0)

    def rng(self, what: int) -> np.random.Generator:
        """Return random numbers for one purpose: worlds that differ in effects alone share every draw."""
        return np.random.default_rng([self.seed, what])


def make_world(effects: Mapping[str, float] | None = None, level: str = "L0", shots: int = 300, seed: int = 0,
               dirt: Sequence[str] = (), believe: Sequence[str] = BELIEVED, side: bool = False) -> World:
    """Make a world of the paper's two-wheel rig, with coefficients drawn from `seed`.

    effects: {name: amplitude in the unit of truearc_proof.truth.world}. Terms missing in `believe` are true all the
    same (that is a way of hiding drag, lift, or the loss of speed). InputError for an unknown level, effect or dirt.
    """
    for name in dirt:
        if name not in DIRT:
            raise InputError(f"there is no dirt {name!r}; there are {', '.join(DIRT)}")
    if level not in LEVELS:
        raise InputError(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
    if shots < FEWEST or seed < 0:
        raise InputError(f"a world needs {FEWEST} shots and a seed of 0 or above, not {shots} and {seed}")
    rng = np.random.default_rng([seed, 0])
    cd, slope, efficiency = rng.uniform(0.40, 0.60), rng.uniform(0.35, 0.70), rng.uniform(0.70, 0.85)
    return World(seed, level, shots, _rig(dirt, believe), float(cd), float(slope), float(efficiency),
                 check_effects(effects or {}), tuple(dirt), side=side)


def _rig(dirt: Sequence[str], believe: Sequence[str]) -> Rig:
    """Return the paper's rig."""
    stated = 0.5 if "noise_understated" in dirt else 2.0 if "noise_overstated" in dirt else 1.0
    noise = Noise(NOISE.distance_m * stated, NOISE.hood_deg * stated, NOISE.wheel_rad_s * stated,
                  NOISE.track_m * stated)
    wheels = (Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))
    return Rig(Ball(0.14, 0.0889), LauncherFacts(0.75, 594.0, wheels), Target(2.44, 0.07, 0.35), Air(1.2),
                 WorldFacts(9.81), noise, Believe(tuple(believe)))


@dataclass(frozen=True)
class Plan:
    """True circumstances of every shot, in shooting order; all [n]."""

    session: Ints
    t_s: Floats                       # in the session
    since_last_s: Floats              # nan at a session's first shot
    ball: Ints
    used: Floats                      # shots the ball has had / most that any ball has had
    fresh_ball: Floats                # how the ball differs from the others, standard normal
    drag_of_ball: Floats              # the same for its drag
    supplier: Ints
    battery_v: Floats
    temperature_c: Floats
    pressure_pa: Floats
    closing_m_s: Floats               # as the last picture was taken; the robot stands when it shoots
    distance_m: Floats
    hood_deg: Floats
    hood_came: Floats                 # +1 the hood came from below, -1 from above, 0 unknown
    squeeze: Floats                   # energy that the ball takes from the wheels / that of an ordinary ball


def plan_shots(world: World) -> Plan:
    """Draw circumstances from the world's seed; effects change none of them."""
    n, rng = world.shots, world.rng(1)
    session, place = _sessions(n)
    since = np.where(rng.random(n) < 0.5, rng.uniform(0.5, 3.0, n), rng.uniform(3.0, 10.0, n))
    since[place == 0] = np.nan
    t_s = _within(session, np.nan_to_num(since))
    ball, used = _balls(rng, n)
    own, drag_own, south = rng.normal(size=ball.max() + 1), rng.normal(size=ball.max() + 1), rng.permutation(
        np.arange(ball.max() + 1) % 2)
    distance, hood = _places(rng, n)
    change = np.sign(np.diff(hood, prepend=hood[0]))
    weather = _weather(rng, session, t_s)
    if "battery_with_wear" in world.dirt:            # one battery for all, weaker and weaker as the balls wear
        weather = (FULL_V - RUN_DOWN_V * used + rng.normal(0.0, 0.1, n), *weather[1:])
    return Plan(session, t_s, since, ball, used, own[ball], drag_own[ball], south[ball], *weather,
                np.where(rng.random(n) < 0.4, 0.0, np.clip(rng.normal(0.0, 1.0, n), -2.0, 2.0)),
                distance, hood, np.where(place == 0, 0.0, change), np.exp(rng.normal(0.0, 0.3, n)))


def tile_plan(plan: Plan, times: int) -> Plan:
    """Repeat the same shots several times."""
    return Plan(**{name: np.tile(column, times) for name, column in vars(plan).items()})


def _sessions(n: int) -> tuple[Ints, Ints]:
    """Session of each shot, all of about one length, and the shot's number in it."""
    count = max(1, round(n / SESSION_SHOTS))
    session = np.arange(n) * count // n
    return session, np.arange(n) - np.searchsorted(session, session)


def _within(session: Ints, step: Floats) -> Floats:
    total = np.cumsum(step)
    return total - total[np.searchsorted(session, session)]


def _balls(rng: np.random.Generator, n: int) -> tuple[Ints, Floats]:
    """A hopper of 12 to 20 balls, shaken: each round fires them all, in another order."""
    count = int(rng.integers(12, 21))
    ball = np.concatenate([rng.permutation(count) for _ in range(n // count + 1)])[:n]
    # balls rest now and then, so that use is not time alone
    swap = rng.random(n) < 0.3
    ball = np.where(swap, rng.integers(0, count, n), ball)
    had = np.array([np.count_nonzero(ball[:k] == ball[k]) for k in range(n)], dtype=float)
    return ball, had / max(had.max(), 1.0)


def _places(rng: np.random.Generator, n: int) -> tuple[Floats, Floats]:
    """Distances over the field and elevations that can reach from there: far steep balls balloon and turn back."""
    distance = rng.uniform(2.0, 7.0, n)
    least = np.maximum(30.0, np.degrees(np.arctan(TARGET_ABOVE_EXIT_M / distance)) + STEEPER_DEG)
    most = 60.0 - 4.0 * np.maximum(distance - LOB_M, 0.0)
    lob = (rng.random(n) < LOBS) & (distance < LOB_M)
    return distance, rng.uniform(np.where(lob, 60.0, least), np.where(lob, 66.0, most))


def _weather(rng: np.random.Generator, session: Ints, t_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Battery (falls through a session, rests between), temperature and pressure."""
    count = session.max() + 1
    part = t_s / max(t_s.max(), 1.0)
    full, fall = rng.uniform(12.4, 12.9, count), rng.uniform(0.5, 1.3, count)
    battery = full[session] - fall[session] * part + rng.normal(0.0, 0.1, len(t_s))
    temperature = rng.uniform(6.0, 34.0, count)[session] + 3.0 * part + rng.normal(0.0, 0.3, len(t_s))
    pressure = rng.normal(101_000.0, 900.0, count)[session] + rng.normal(0.0, 20.0, len(t_s))
    return battery, temperature, pressure
