"""Identifiability: which effects a kind of data can reveal, by the expected Fisher information of every term.

The efficient information of a term is I_ee - I_en I_nn^-1 I_ne, the part that the fitted coefficients, scatters and
random effects cannot absorb. The term's score is normal with that variance, and an effect shifts the score by its size
times the information. An effect is detected if its score exceeds a simulated threshold. Without any effect, the
probability that the largest score over all terms exceeds it is the part of the false-alarm rate that discovery allots
to terms. Information grows with the number of shots.

A planned season consists of configurations that reach the target under the belief, together with the kinds of data to
be recorded. Its outcomes do not matter, because only the expected information is computed from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from msgspec import Struct
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from scipy.special import ndtr, ndtri

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.data.dataset import ORDINARY, Dataset, Shots, Traces, Tracks
from truearc.sim.discover.detect.battery import ALLOWANCE, LEAST_SHARE, TERMS
from truearc.sim.discover.finding import FALSE_ALARM, LEVELS, SEASON_SHOTS
from truearc.sim.discover.select.terms import ALIAS, BUSY
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import FEWEST, Launcher
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, say_few, see_outcomes
from truearc.sim.infer.likelihood.layout import weak_prior
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.physics.catalogue import Catalogue, effective, find_terms, flight_terms
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import by_robot, forecast, launch_of, leave, sense
from truearc.sim.printed import Progress

SCHEMA = "truearc.identifiability/1"
POWER = 0.8                           # from which an effect counts as seen (Cohen 1988)
BEYOND = float(ndtri(POWER))          # standard deviations beyond the threshold, for this power
DRAWS, SEED = 4000, 0                 # of scores by chance; a probability is known to 0.8 %
NOTHING = 1e-9                        # information on a term at its usual size that no number of shots makes up for
# Chosen: a printed list
ABSORBS = 0.1                         # of the largest coefficient's part, from which one is named, too
UNTOUCHED, TAKEN = "untouched", "taken up"      # values of truearc.identifiability/1


class TermIdentifiability(Struct, frozen=True):
    """One term. `usual`, `smallest` in `unit`; `power` to detect it at its usual size with these shots.

    share_left: share of its information that the fitted numbers leave. shots_needed: to detect it at its usual size,
    None if no number suffices; `why` is then UNTOUCHED (nothing in the data depends on it) or TAKEN (the numbers in
    `taken_by` absorb it). like: the most similar other term with its correlation. also: known otherwise.
    """

    term: str                         # name in docs/reference/terms.md
    stage: str                        # sensing | launch | flight | arrival
    unit: str                         # of `usual` and `smallest`
    usual: float                      # usual size of the effect
    information: float                # 1 / variance of its amplitude, all else fitted
    share_left: float                 # of its information, after the fitted numbers
    shots_needed: int | None          # to see it at its usual size; null: no number will do
    smallest: float | None            # size seen four times in five with these shots
    power: float                      # probability of seeing it at its usual size
    why: str | None                   # null, or why no number of shots will do
    taken_by: tuple[str, ...]         # fitted numbers that absorb it
    like: str | None                  # most similar other term
    correlation: float                # with that one


class Fittable(Struct, frozen=True):
    """A number that is fitted in any case: its standard deviation before and after these shots."""

    name: str                         # term.parameter
    unit: str                         # of `before` and `after`
    before: float                     # standard deviation before these shots
    after: float                      # standard deviation after them


class Sight(Struct, frozen=True):
    """What `shots` of this kind could show. classes: terms that these data cannot distinguish (more than one each)."""

    shots: int                        # number of shots
    level: str                        # L0 outcomes | L1 with telemetry | L2 with tracks
    believed: tuple[str, ...]         # terms whose coefficients are fitted anyway
    terms: tuple[TermIdentifiability, ...] # most easily seen first
    classes: tuple[tuple[str, ...], ...] # terms that these data cannot tell apart, two or more each
    fitted: tuple[Fittable, ...]      # the numbers of `believed`
    schema: str = SCHEMA              # truearc.identifiability/1


def sight_of(evidence: ScoreTable, level: str, believed: tuple[str, ...], threshold: float | None = None) -> Sight:
    """Evaluate every candidate term, easiest to detect first; believed ones are among the fitted numbers.

    threshold: the |score| that a term needs, in standard deviations; None: simulated, as in discovery.
    """
    columns = np.array([k for k, column in enumerate(evidence.columns) if column.kind == "term"], dtype=int)
    own, left, free, parts = _efficient(evidence, columns)
    usual = np.array([evidence.columns[k].usual for k in columns])
    own = np.where(own * usual**2 > NOTHING, own, 0.0)
    visible = (own > BUSY) & (np.diag(free) > LEAST_SHARE * own)
    size = np.sqrt(np.maximum(np.diag(left), BUSY))
    alike = np.where(np.outer(visible, visible), left / np.outer(size, size), 0.0)
    names = [evidence.columns[k].term for k in columns]
    shots = len(evidence.rows)
    threshold = chance_threshold(alike[np.ix_(visible, visible)]) if threshold is None else threshold
    terms = [_seen(evidence.columns[k], float(own[i]), float(left[i, i]), threshold if visible[i] else np.inf, shots,
                   _takers(evidence, parts[i]), _most_alike(names, alike, i)) for i, k in enumerate(columns)]
    ordered = sorted(terms, key=lambda seen: (seen.shots_needed is None, seen.shots_needed or 0, seen.term))
    return Sight(shots, level, believed, tuple(ordered), _classes(names, alike, visible), _fittable(evidence))


def _efficient(evidence: ScoreTable, columns: Int[Array, " K"]) -> tuple[
        Float[Array, " K"], Float[Array, "K K"], Float[Array, "K K"], Float[Array, "K p"]]:
    """(own information [K], left [K, K], left where priors of coefficients do not help [K, K], parts [K, p]).

    parts: of each term's score, in its own standard deviations, what each shared column absorbs by itself.
    """
    shared = evidence.shared
    info = evidence.information
    inner, cross = info[shared, shared], info[columns][:, shared]
    square = info[np.ix_(columns, columns)]
    grouped = np.array([column.kind == "group" for column in evidence.columns[shared]], dtype=bool)
    lift = np.linalg.solve(inner + evidence.precision, cross.T)
    bare = np.linalg.pinv(inner + np.where(grouped[:, None] & grouped, evidence.precision, 0.0), 1e-12, hermitian=True)
    parts = np.abs(lift.T) * np.sqrt(np.maximum(np.diag(inner), 0.0))
    return np.diag(square).copy(), square - cross @ lift, square - cross @ bare @ cross.T, parts


def chance_threshold(correlation: Float[Array, "K K"]) -> float:
    """Return the limit, in standard deviations, that the largest of K correlated scores exceeds at the terms' share of
    the false-alarm rate."""
    size, turn = np.linalg.eigh(correlation)
    root = (turn * np.sqrt(np.maximum(size, 0.0))) @ turn.T
    drawn = np.random.default_rng(SEED).normal(size=(DRAWS, len(size))) @ root
    return float(np.quantile(np.abs(drawn).max(axis=1, initial=0.0), 1.0 - FALSE_ALARM * ALLOWANCE[TERMS]))


def _seen(column: Column, own: float, left: float, threshold: float, shots: int, takers: tuple[str, ...],
          like: tuple[str | None, float]) -> TermIdentifiability:
    visible = np.isfinite(threshold)
    information = left if visible else 0.0
    signal = np.sqrt(information) * column.usual
    power = float(ndtr(signal - threshold) + ndtr(-signal - threshold)) if visible else 0.0
    why = None if visible else UNTOUCHED if own <= BUSY else TAKEN
    needed = max(int(np.ceil(shots * ((threshold + BEYOND) / signal)**2)), 1) if visible else None
    smallest = float((threshold + BEYOND) / np.sqrt(information)) if visible else None
    return TermIdentifiability(column.term, column.stage, column.unit, column.usual, information,
                               left / own if own > BUSY else 0.0, needed, smallest, power, why,
                               takers if why == TAKEN else (), *like)


def _takers(evidence: ScoreTable, parts: Float[Array, " p"]) -> tuple[str, ...]:
    """Fitted numbers that absorb a term's information, largest part first."""
    order = [k for k in np.argsort(-parts) if parts[k] > max(ABSORBS * parts.max(initial=0.0), BUSY)]
    found = [evidence.columns[evidence.first_shared + k] for k in order]
    return tuple(dict.fromkeys(f"each {column.name.partition(' ')[0]}'s random effect" if column.kind == "group" else
                               column.name for column in found))


def _most_alike(names: list[str], alike: Float[Array, "K K"], index: int) -> tuple[str | None, float]:
    others = np.abs(alike[index]) * (np.arange(len(names)) != index)
    best = int(others.argmax()) if len(names) > 1 else 0
    return (names[best], float(alike[index, best])) if len(names) > 1 and others[best] > 0.0 else (None, 0.0)


def _classes(names: list[str], alike: Float[Array, "K K"],
             visible: Bool[Array, " K"]) -> tuple[tuple[str, ...], ...]:
    """Groups in which every two are more alike than ALIAS (complete linkage)."""
    kept = np.flatnonzero(visible)
    if len(kept) < 2:
        return ()
    distance = 1.0 - np.clip(np.abs(alike[np.ix_(kept, kept)]), 0.0, 1.0)
    np.fill_diagonal(distance, 0.0)
    number = fcluster(linkage(squareform(distance, checks=False), "complete"), 1.0 - ALIAS, "distance")
    groups = [tuple(names[k] for k in kept[number == one]) for one in dict.fromkeys(number.tolist())]
    return tuple(group for group in groups if len(group) > 1)


def _fittable(evidence: ScoreTable) -> tuple[Fittable, ...]:
    shared = evidence.shared
    before, after = (np.diag(np.linalg.inv(precision)) for precision in (
        evidence.precision, evidence.information[shared, shared] + evidence.precision))
    rows = zip(evidence.columns[shared], before, after, strict=True)
    return tuple(Fittable(column.name, column.unit, float(np.sqrt(known)), float(np.sqrt(variance)))
                 for column, known, variance in rows if column.kind == "shared")


TRIED = 2                             # configurations drawn for every one wanted
DRIVES = 28                           # motor speeds tried for each
SLOWEST, FASTEST = 0.15, 0.97         # motor ratio; chosen: slower is hardly held, faster has no reserve
# Chosen: slower go nowhere, faster has no launcher
SPEEDS_M_S = (2.0, 25.0)              # of surfaces or balls, where no free speed is known
# Chosen: for a target 1.9 m up these are inside the paper's zones of 3 to 30 feet
NEAR, FAR, LEAST_RISE_M = 1.0, 4.0, 1.0           # distances, in heights of the target above the exit
ELEVATION_DEG = (30.0, 65.0)          # chosen: hoods of launchers
STEEPER_DEG = 10.0                    # than the straight line to the target; chosen: flatter ones arrive from below
# Chosen: 1.5 % of speed and 0.4 degrees, as SCATTER_PRIOR; a camera's 3 cm
SPEED_SD, DISTANCE_SD_M = 0.018, 0.03     # of one shot: log speed with elevation, and distance
# Derived: a class then has 0.74 to 0.78 of a measured height's information, at the centre none (Fisher information, for
# half heights of 1 and 2.5 deviations)
ASIDE = (1.5, 2.5)                    # off the centre, in standard deviations: there outcomes tell most
SESSION_SHOTS, BALLS = 30, 16         # chosen: ten sessions a season, two rounds of a rack
FRAMES_HZ, FRAMES = 60.0, 46          # chosen: a phone's film of 0.75 s
# Measured: wheels of MuJoCo's launcher dip by 6 to 7 % (git show archive-1:archive/emulated-world.md); chosen: the
# spread
DIP, DIP_SPREAD = 0.06, 0.3
TRACE_S = (-0.01, 0.0, 0.1, 0.2)      # chosen: before, at, after the dip
FREE_M_S = (5.0, 11.0)                # thrown, where there is no launcher; chosen: a person's throw


def foresee(rig: Rig, believed: tuple[str, ...], level: str, shots: int, sides: bool = False, seed: int = 0,
            progress: Progress = lambda done, note: None, among: Catalogue | None = None) -> Sight:
    """Return the effects that a season of `shots` with this rig could show; InputError as in rehearse. among: the
    catalogue."""
    progress(0.0, "aim")
    dataset = rehearse(rig, believed, level, shots, sides, seed, among)
    progress(0.2, "slopes")
    evidence, _ = _expected(dataset, believed, among)
    progress(1.0, "done")
    return sight_of(evidence, level, believed)


def is_planned(dataset: Dataset) -> bool:
    """Return whether its shots have no results yet, so that they are treated as aimed beside the centre."""
    has_results = dataset.tracks is not None or sum(map(bool, dataset.shots.text("outcome"))) >= FEWEST or (
        np.isfinite(dataset.shots.number("miss_height_m")).sum() >= FEWEST)
    return not has_results and dataset.facts.target is not None


def foresee_dataset(dataset: Dataset, believed: tuple[str, ...], sides: bool = False, seed: int = 0,
                    progress: Progress = lambda done, note: None, among: Catalogue | None = None) -> Sight:
    """Return the effects that the shots of a dataset can show.

    Shots with results are evaluated at the coefficients fitted to them, others as aimed beside the centre with the
    usual coefficients.
    """
    dataset = dataset.in_order()
    if not is_planned(dataset):
        model = _model_of(dataset, believed, among)
        return sight_of(fit_believed(model, progress).scores, model.data.level, believed)
    progress(0.1, "slopes")
    texts = {**dataset.shots.texts, **mark(len(dataset.shots), sides, dataset.facts.target)}
    marked = Shots(dataset.shots.shot_id, dataset.shots.numbers, texts, dataset.shots.source)
    evidence, level = _expected(replace(dataset, shots=marked), believed, among)
    progress(1.0, "done")
    return sight_of(_as_aimed(evidence, seed), level, believed)


def _model_of(dataset: Dataset, believed: tuple[str, ...], among: Catalogue | None) -> Launcher:
    model = Launcher.of(dataset, believed, among)
    if not len(model.data.rows):
        raise InputError("no shot can say anything: distance_m, and hood_deg with motor_ratio (and "
                         "launcher.free_speed_rad_s in rig.toml) or every wheel's speed, or exit_deg with "
                         "exit_speed_m_s, are needed beside its outcome, or a track")
    return model


def _expected(dataset: Dataset, believed: tuple[str, ...], among: Catalogue | None) -> tuple[ScoreTable, str]:
    """Evidence at the middle of the priors; its scores mean nothing."""
    model = _model_of(dataset, believed, among)
    return model.linearise(model.middle())[0], model.data.level


def _as_aimed(evidence: ScoreTable, seed: int) -> ScoreTable:
    """Heights beside the centre, wherever the middle of the priors would have sent them."""
    plane = evidence.plane
    if plane is None:
        return evidence
    rng = np.random.default_rng(seed)
    aside = rng.choice((-1.0, 1.0), len(plane.mean_m)) * rng.uniform(*ASIDE, len(plane.mean_m))
    mean_m = plane.seen.beside(plane.spread_m, aside)
    return replace(evidence, plane=replace(plane, mean_m=mean_m)).moved(np.zeros_like(evidence.score))


@dataclass(frozen=True)
class Plan:
    """n configurations. drive: motor ratio, or speed in m/s of surfaces or balls if the rig states no motors."""

    distance_m: Float[Array, " n"]
    hood_deg: Float[Array, " n"]
    drive: Float[Array, " n"]


def rehearse(rig: Rig, believed: tuple[str, ...], level: str, shots: int = SEASON_SHOTS, sides: bool = False,
             seed: int = 0, among: Catalogue | None = None) -> Dataset:
    """Make a dataset of `shots` aimed beside the centre, high and low, as one aims to learn.

    L1 adds telemetry, circumstances, balls and sessions, L2 tracks. sides: high or low is noted of every miss. among:
    the catalogue of the terms.
    InputError for an unknown level or term, too few shots, or a target that is missing or out of reach.
    """
    if level not in LEVELS:
        raise InputError(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
    if shots < FEWEST_SHOTS:
        raise InputError(say_few(shots))
    coefficients = {term.name: {p.name: weak_prior(p)[0] if p.prior else p.default for p in term.parameters}
                    for term in find_terms(believed, among)}         # the middle of each prior
    rng = np.random.default_rng(seed)
    if rig.target is None and level != "L2":
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         "; level L2, by tracks, does without")
    plan = _throw(rig, shots, rng) if rig.target is None else _aim(rig, coefficients, shots, rng, among)
    numbers, texts = settings(rig, plan), {}
    if rig.target is not None:
        numbers["distance_m"] = plan.distance_m
        texts = mark(shots, sides, rig.target)
    ids = tuple(f"s{number}" for number in range(1, shots + 1))
    flown = Shots(ids, dict(numbers), dict(texts))
    tracks = _watch(rig, coefficients, flown, plan.distance_m, rng, among) if level == "L2" else None
    if not rig.launcher.wheel and level == "L2":
        numbers = {name: column for name, column in numbers.items() if not name.startswith("exit_")}
    traces = None
    if level != "L0":
        more, labels = _circumstances(shots, rng)
        wheels = _wheel_speeds(rig, plan)
        numbers, texts = numbers | more | wheels, texts | labels
        traces = _dips(wheels, shots, rng) if wheels else None
    return Dataset("rehearsal", rig, Shots(ids, numbers, texts), tracks, traces)


def mark(shots: int, sides: bool, target: Target | None) -> dict[str, tuple[str, ...]]:
    """Return outcomes that change no expected information: only the available classes matter, not the class of a
    shot."""
    words = ("high", "low") if target is None else [target.noted("miss", side)[1] for side in ("high", "low")]
    return {"outcome": ("miss",) * shots, **({"side": tuple(words[k % 2] for k in range(shots))} if sides else {})}


def settings(rig: Rig, plan: Plan) -> dict[str, Float[Array, " n"]]:
    """Return the columns that say how a plan's shots are launched."""
    if not rig.launcher.wheel:
        return {"exit_speed_m_s": plan.drive, "exit_deg": plan.hood_deg,
                "exit_spin_rev_s": np.linspace(0.0, 4.0, len(plan.drive))}
    if rig.launcher.free_speed_rad_s is None:
        return {"hood_deg": plan.hood_deg, **_wheel_speeds(rig, plan)}
    return {"hood_deg": plan.hood_deg, "motor_ratio": plan.drive}


def _wheel_speeds(rig: Rig, plan: Plan) -> dict[str, Float[Array, " n"]]:
    free = rig.launcher.free_speed_rad_s
    return {f"wheel_{wheel.name}_rad_s": plan.drive * (wheel.gear * free if free else 1.0 / wheel.radius_m)
            for wheel in rig.launcher.wheel}


def _drives(rig: Rig) -> Float[Array, " drives"]:
    by_ratio = rig.launcher.wheel and rig.launcher.free_speed_rad_s is not None
    return np.geomspace(*((SLOWEST, FASTEST) if by_ratio else SPEEDS_M_S), DRIVES)


def _throw(rig: Rig, shots: int, rng: np.random.Generator) -> Plan:
    """Without a target: every speed and elevation alike."""
    drives = _drives(rig)
    low, high = (np.quantile(drives, 0.3), drives[-1]) if rig.launcher.wheel else FREE_M_S
    return Plan(np.full(shots, np.inf), rng.uniform(*ELEVATION_DEG, shots), rng.uniform(low, high, shots))


def _aim(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: int,
         rng: np.random.Generator, among: Catalogue | None) -> Plan:
    """Distances and elevations drawn at random, drives so that the ball passes beside the centre."""
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    reach_m = max(rise_m, LEAST_RISE_M)
    distance_m = rng.uniform(NEAR * reach_m, FAR * reach_m, TRIED * shots)
    least_deg = np.maximum(ELEVATION_DEG[0], np.degrees(np.arctan2(rise_m, distance_m)) + STEEPER_DEG)
    hood_deg = rng.uniform(np.minimum(least_deg, ELEVATION_DEG[1]), np.maximum(least_deg, ELEVATION_DEG[1]))
    drives = _drives(rig)
    places_m, middle_m = _places(rig, coefficients, distance_m, hood_deg, drives, among)
    _, per_log = _drive_for(places_m, np.full(len(distance_m), middle_m), drives)
    sd_m = np.hypot(SPEED_SD * per_log, DISTANCE_SD_M)
    aside = rng.choice((-1.0, 1.0), len(distance_m)) * rng.uniform(*ASIDE, len(distance_m))
    marked = Shots(("",) * len(aside), {}, mark(len(aside), False, rig.target))
    drive, _ = _drive_for(places_m, middle_m + see_outcomes(marked, rig)[1].beside(sd_m, aside), drives)
    there = np.flatnonzero(np.isfinite(drive))
    if len(there) < FEWEST_SHOTS:
        raise InputError(f"rig.toml: at no distance from {NEAR * reach_m:.3g} to {FAR * reach_m:.3g} m does the "
                         "launcher reach the target, as believed")
    rows = np.resize(there, shots)
    return Plan(distance_m[rows], hood_deg[rows], drive[rows])


def _places(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], distance_m: Float[Array, " n"],
            hood_deg: Float[Array, " n"], drives: Float[Array, " drives"],
            among: Catalogue | None) -> tuple[Float[Array, "n drives"], float]:
    """([n, drives] heights or, where the target faces up, places along from its centre; nan where the ball does not get
    there; where its centre is)."""
    n = len(distance_m)
    every = Plan(np.repeat(distance_m, len(drives)), np.repeat(hood_deg, len(drives)), np.tile(drives, n))
    shots = Shots(("",) * len(every.drive), {**settings(rig, every), "distance_m": every.distance_m}, {})
    flown = forecast(rig, coefficients, shots, among=among)
    if "along_m" in flown:
        return flown["along_m"].reshape(n, -1), 0.0
    assert rig.target is not None
    return flown["height_m"].reshape(n, -1), rig.target.centre_height_m


def _drive_for(heights_m: Float[Array, "n drives"], wanted_m: Float[Array, " n"],
               drives: Float[Array, " drives"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """(slowest drive [n] that passes at wanted_m, slope of the height by its log); nan where there is none."""
    lane = np.arange(len(wanted_m))
    below, above = heights_m[:, :-1], heights_m[:, 1:]
    crosses = (below <= wanted_m[:, None]) & (above > wanted_m[:, None])
    first = crosses.argmax(axis=1)
    low, high = below[lane, first], above[lane, first]
    step = np.log(drives[1] / drives[0])
    part = np.where(crosses.any(axis=1), (wanted_m - low) / (high - low), np.nan)
    return drives[first] * np.exp(part * step), np.where(np.isfinite(part), (high - low) / step, np.nan)


def _circumstances(shots: int, rng: np.random.Generator) -> tuple[dict[str, Float[Array, " n"]],
                                                                  dict[str, tuple[str, ...]]]:
    """What telemetry and a log book say beside the launch: (numbers, texts).

    Chosen as of a practice: waits of 1 to 12 s, a 12 V battery that loses 0.9 V in a session, days of 20 +- 6 C.
    """
    session, place = np.divmod(np.arange(shots), SESSION_SHOTS)
    count = int(session.max()) + 1
    wait_s = np.where(rng.random(shots) < 0.5, rng.uniform(1.0, 3.0, shots), rng.uniform(3.0, 12.0, shots))
    first = place == 0
    clock_s = np.cumsum(np.where(first, 0.0, wait_s))
    t_s = clock_s - clock_s[np.flatnonzero(first)][session]
    part = t_s / max(float(t_s.max()), 1.0)
    numbers = {"t_s": t_s, "since_last_shot_s": np.where(first, np.nan, wait_s),
               "battery_v": rng.uniform(12.3, 12.9, count)[session] - 0.9 * part + rng.normal(0.0, 0.1, shots),
               "temperature_c": rng.normal(20.0, 6.0, count)[session] + 2.0 * part,
               "pressure_pa": rng.normal(101_000.0, 800.0, count)[session] + rng.normal(0.0, 20.0, shots),
               "robot_speed_m_s": np.where(rng.random(shots) < 0.4, 0.0, rng.normal(0.0, 1.0, shots))}
    balls = np.concatenate([rng.permutation(BALLS) for _ in range(shots // BALLS + 1)])[:shots]
    return numbers, {"session": tuple(f"day{k + 1}" for k in session), "ball_id": tuple(f"ball{k + 1}" for k in balls)}


def _dips(wheels: Mapping[str, Float[Array, " n"]], shots: int, rng: np.random.Generator) -> Traces:
    """Wheel speeds before and while the ball passes; harder balls take more of them."""
    dip = DIP * np.exp(rng.normal(0.0, DIP_SPREAD, shots))
    shape = np.array([1.0, 1.0, 0.0, 0.5])
    values = [speed[:, None] * (1.0 - dip[:, None] * (1.0 - shape)) for speed in wheels.values()]
    signals = np.repeat(list(wheels), shots * len(TRACE_S))
    return Traces(np.tile(np.repeat(np.arange(shots), len(TRACE_S)), len(wheels)),
                  np.tile(TRACE_S, shots * len(wheels)), tuple(signals.tolist()), np.concatenate(values).ravel())


def _watch(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots, distance_m: Float[Array, " n"],
           rng: np.random.Generator, among: Catalogue | None) -> Tracks:
    """Positions by a camera from just after release to the plane or the floor, with the rig's track noise."""
    values, whose = effective(coefficients, ORDINARY, among), by_robot(shots)
    exit, _ = sense(rig, values, launch_of(rig, shots), distance_m, whose, among)
    states = path(rig, flight_terms({"gravity", *coefficients}, among), values,
                  leave(rig, values, exit, whose, among), FRAMES + 1, 1.0 / FRAMES_HZ)
    x, y, z = (np.broadcast_to(np.asarray(part), (FRAMES + 1, len(shots)))[1:].T for part in states.position_m)
    seen = np.logical_and.accumulate((x <= distance_m[:, None]) & (z > 0.0), axis=1)
    shot, frame = np.nonzero(seen)
    noise = rig.noise.track_m * rng.normal(size=(3, len(shot)))
    return Tracks(shot, frame / FRAMES_HZ, *(part[seen] + off for part, off in zip((x, y, z), noise, strict=True)))
