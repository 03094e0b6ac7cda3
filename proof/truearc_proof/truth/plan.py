"""Plan of a season of shots: places, balls, weather, and pauses."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from truearc_proof.truth.world import World

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
SESSION_SHOTS = 30
SUPPLIERS = ("north", "south")
TARGET_ABOVE_EXIT_M = 1.69
STEEPER_DEG = 12.0                    # than the straight line to the target, at least
LOBS = 0.15                           # share of shots from within LOB_M lobbed steeper than 60 degrees
LOB_M = 4.0
FULL_V, RUN_DOWN_V = 12.8, 1.5


@dataclass(frozen=True)
class Plan:
    """True circumstances of every shot, in the order of shooting; all [n]."""

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
    """Circumstances drawn from the world's seed; effects change none of them."""
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
    """The same shots several times over."""
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
