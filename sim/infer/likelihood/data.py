"""A dataset as arrays for the forward model and the likelihood: each shot's assumed configuration and its data."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import msgspec
import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Believe, Noise, Rig
from truearc.sim.data import dataset as conditions
from truearc.sim.data.dataset import ORDINARY, Circumstances, Dataset, Shots
from truearc.sim.data.table import SPIN_VECTOR
from truearc.sim.infer.belief import Curves, along
from truearc.sim.infer.likelihood import noise
from truearc.sim.infer.likelihood.forward_model import DEVIATES, ShotBatch
from truearc.sim.infer.likelihood.ground import see_landings
from truearc.sim.infer.likelihood.heights import see_heights
from truearc.sim.infer.likelihood.observations import Samples, Scatter, samples_of
from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics import simulate
from truearc.sim.physics.simulate import has_wheels, is_opposed, launch_of, launch_state, own_balls, require, roll
from truearc.sim.physics.term import Exit

FEWEST_SHOTS = 10                     # by which a simulation is judged; chosen: twice the numbers of a usual belief

Which = Bool[np.ndarray, " n"]


def say_few(count: int) -> str:
    """Report what so few shots cannot show."""
    few = "1 shot is" if count == 1 else f"{count} shots are"
    return f"{few} too few to judge a simulation by; {FEWEST_SHOTS} at least"


def say_left_out(rig: Rig, shots: Shots, use: Which, marked: Which, tracked: Which) -> tuple[str, ...]:
    """Return a line for each reason why a shot, or its outcome, is not used.

    use: the shot is used. marked: it has an outcome, side or height that shows its height. tracked: it has a track.
    """
    sped = has_wheels(rig, shots) | np.isfinite(shots.number("exit_speed_m_s"))
    aimed = np.isfinite(shots.number("hood_deg")) | np.isfinite(shots.number("exit_deg"))
    beside = np.isin(shots.text("side"), ("left", "right")) & ~marked
    placed = np.isfinite(shots.number("distance_m"))
    launched = sped & aimed
    reasons = (
        (~use & launched & beside, "missed left or right, without information about the height"),
        (~use & launched & ~marked & ~beside,
         "nothing was seen of their flight: no outcome, side, miss_height_m, exit_*, track or time"),
        (~use & marked & ~placed, "no distance_m"),
        (use & marked & launched & ~placed, "their outcome only: no distance_m"),
        (~use & ~sped, "no launch speed: motor_ratio (with launcher.free_speed_rad_s in rig.toml), every "
                       "wheel_<name>_rad_s, or exit_speed_m_s"),
        (~use & ~aimed, "no hood_deg or exit_deg"),
        (marked & tracked & ~launched, "their outcome only: no launch, the track alone counts"),
    )
    return tuple(f"{int(which.sum())} of {len(shots)} shots: {why} ({_names(shots, which)})" for which, why in reasons
                 if which.any())


def _names(shots: Shots, which: Which, most: int = 3) -> str:
    names = [shots.shot_id[row] for row in np.flatnonzero(which)]
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


ENERGY = "energy_of_wheels"           # taken by a shot, (rad/s)^2: times their inertia it is in joules
WORN = "shots_of_ball"                # that its ball had before, by the most that any has had
Each = Float[np.ndarray, " n"]        # a number of each shot


def every_column(dataset: Dataset) -> dict[str, Any]:
    """Return everything known of each shot by name: numbers [n], and texts."""
    return {**{name: dataset.shots.text(name) for name in dataset.shots.texts}, **number_columns(dataset)}


def number_columns(dataset: Dataset) -> dict[str, Each]:
    """Return every number of a shot, by name: recorded and derived."""
    columns = {"t_s": dataset.shots.number("t_s"), **dataset.shots.numbers}
    derived = launch_state(dataset.facts, dataset.shots), *(
        derive(dataset) for derive in (_time_columns, _circumstance_columns, _trace_columns))
    for more in derived:
        columns |= {name: values for name, values in more.items() if name not in columns}
    return columns


def _time_columns(dataset: Dataset) -> dict[str, Each]:
    """Place of each shot in its session, and the wait since the shot before; none where a shot has no time."""
    shots = dataset.shots
    if not shots.timed:
        return {}
    sessions = np.array(shots.text("session"))
    order, wait = np.zeros(len(shots)), np.full(len(shots), np.nan)
    for session in np.unique(sessions):
        rows = np.flatnonzero(sessions == session)
        rows = rows[np.argsort(shots.number("t_s")[rows], kind="stable")]
        order[rows] = np.arange(len(rows))
        wait[rows[1:]] = np.diff(shots.number("t_s")[rows])
    return {"order_in_session": order, "since_last_shot_s": wait}


def _circumstance_columns(dataset: Dataset) -> dict[str, Each]:
    """What terms follow and no column says as it is: the way the hood came, the wheels' dip, the ball's earlier shots.
    """
    wanted = {"hood_change": "hood_change", "droop": "wheel_dip"}
    wanted |= {"age": WORN} if conditions.counts_shots(dataset.shots) else {}
    found = conditions.gather_circumstances(dataset)
    return {name: np.where(found[field].said, found[field].value, np.nan) for field, name in wanted.items()}


def _trace_columns(dataset: Dataset) -> dict[str, Each]:
    """Of each telemetry signal its value when the ball is fed, and how far it dips below that; the wheels' energy."""
    if dataset.traces is None:
        return {}
    traces, n = dataset.traces, len(dataset.shots)
    signals = np.array(traces.signal)
    columns: dict[str, Each] = {}
    for signal in np.unique(signals):
        first, lowest = np.full(n, np.nan), np.full(n, np.nan)
        here = np.flatnonzero(signals == signal)
        here = here[np.lexsort((traces.t_s[here], traces.shot[here]))]
        shots, starts = np.unique(traces.shot[here], return_index=True)
        for shot, rows in zip(shots, np.split(here, starts[1:]), strict=True):
            fed = np.abs(traces.t_s[rows]).argmin()
            first[shot] = traces.value[rows[fed]]
            lowest[shot] = first[shot] - traces.value[rows[fed:]].min()
        columns |= {f"fed_{signal}": first, f"dip_{signal}": lowest}
    return columns | _energy_column(columns)


def _energy_column(columns: dict[str, Each]) -> dict[str, Each]:
    """Energy that the wheels give the ball or lose beside it: half the drop of their squared speeds, summed, which
    is energy over the inertia that no file states. A ball that leaves slower than what it took would have it has lost
    the rest: squeezed, slipped, rubbed."""
    wheels = [name.removeprefix("fed_") for name in columns if name.startswith("fed_wheel_")]
    if not wheels:
        return {}
    drops = [0.5 * (columns[f"fed_{one}"]**2 - (columns[f"fed_{one}"] - columns[f"dip_{one}"])**2) for one in wheels]
    return {ENERGY: np.sum(drops, axis=0)}


SLOWEST_M_S = 0.1                     # a slower launch goes nowhere, whatever its uncertainty; bounds 1 / speed


class Given(NamedTuple):
    """Launches as the robot's own instruments have them before the shot; numpy arrays.

    rolling: by the wheels without launch terms and the hood; a speed, elevation or spin that was measured on the ball
    has `rolled`, `hooded` or `spun` False, and no scatter of the launch comes on top of it. wheel_log_speed and
    wheel_spin_rev_s: what one standard deviation of each wheel's noise does to the log of that speed and to the
    spin. elevation_sd_rad and distance_sd_m: standard deviations.
    """

    rolling: Exit
    rolled: Bool[Any, " n"]
    hooded: Bool[Any, " n"]
    spun: Bool[Any, " n"]
    distance_m: Float[Any, " n"]
    wheel_log_speed: Float[Any, "n w"]
    wheel_spin_rev_s: Float[Any, "n w"]
    elevation_sd_rad: Float[Any, " n"]
    distance_sd_m: Float[Any, " n"]
    circumstances: Circumstances = ORDINARY

    @property
    def whose(self) -> Exit:
        """Return which parts of the launch come from the robot, as truearc.sim.physics.simulate expects."""
        return Exit(self.rolled, self.hooded, self.spun, True)


def given_of(rig: Rig, shots: Shots, circumstances: Circumstances = ORDINARY) -> Given:
    """Return launches of shots with wheel speeds (or motor_ratio) and hood_deg; InputError names shots that lack
    one.

    Measured exit columns take precedence as in truearc.sim.physics.simulate.launch_of, with the uncertainty above.
    circumstances: of these shots.
    """
    speed_m_s = shots.number("exit_speed_m_s")
    by_camera, spin_seen = (~np.isnan(shots.number(name)) for name in ("exit_deg", "exit_spin_rev_s"))
    exit, rolled, distance_m = launch_of(rig, shots), simulate.by_wheels(shots), require(shots, "distance_m")
    log_speed, spin_rev_s = _by_deviation(rig, exit, ~np.isnan(speed_m_s), spin_seen)
    return Given(exit, rolled, ~by_camera, ~spin_seen, distance_m, log_speed, spin_rev_s,
                 np.radians(np.where(by_camera, noise.EXIT_DEG, rig.noise.hood_deg)),
                 np.full(len(shots), rig.noise.distance_m), circumstances)


def _by_deviation(rig: Rig, exit: Exit, speed_seen: Bool[np.ndarray, " n"],
                  spin_seen: Bool[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n w"], Float[np.ndarray, "n w"]]:
    """What one deviation of each wheel, of a measured speed and of a measured spin does: [n, wheels + 2] twice.

    Launches are linear in the wheels' speeds, so that of one wheel alone is the derivative. Wheels are read apart;
    for those on one belt (speeds by motor_ratio) this overstates the uncertainty of the spin a little.
    """
    radius_m = np.array([wheel.radius_m for wheel in rig.launcher.wheel])
    one_speed, one_spin = np.zeros((2, 0))
    if radius_m.size:
        one_speed, one_spin = roll(rig, np.diag(radius_m) * rig.noise.wheel_rad_s)
    per_m_s = 1.0 / np.maximum(exit.speed_m_s, SLOWEST_M_S)
    zero = np.zeros_like(per_m_s)
    speed = np.outer(~speed_seen * per_m_s, one_speed)
    return (np.column_stack([speed, speed_seen * per_m_s * noise.EXIT_SPEED_M_S, zero]),
            np.column_stack([np.outer(~spin_seen, one_spin), zero, spin_seen * noise.EXIT_SPIN_REV_S]))


NONE: Curves = {}
AT_REST_M_S = 1e-3                    # drag has no slope where there is no speed
SETTINGS = ("distance_m", "hood_deg", "motor_ratio", "miss_height_m", "t_s")


@dataclass(frozen=True)
class Intake:
    """n shots (`rows` of the dataset) that carry information; `stripped` rig for the chain.

    noise_var [n, D]: variances of the deviates by other than scatter (sensors, release). scattered [n, S]: variances on
    top where a scatter is 1: of log speed, elevation and azimuth 1 or 0, of the distance as stated. exits [n, 3],
    exit_sd [n, 3]: measured log speed, elevation in rad, backspin, nan where not. seen: of the plane, rows `marked` [m]
    of the n. samples: tracks, with `tracked` [k] their rows among the n.
    """

    rig: Rig
    stripped: Rig
    rows: Int[Array, " n"]
    lanes: ShotBatch
    noise_var: Float[Array, "n D"]
    scattered: Float[Array, "n S"]
    exits: Float[Array, "n 3"]
    exit_sd: Float[Array, "n 3"]
    marked: Int[Array, " m"]
    seen: Outcomes
    tracked: Int[Array, " k"]
    samples: Samples | None
    scatter: Scatter | None
    level: str
    left_out: tuple[str, ...]

    @property
    def filmed(self) -> bool:
        """Whether there are tracks from frames, not only times at a few heights."""
        return self.samples is not None and self.samples.clock_s is None

    @property
    def used(self) -> dict[str, int]:
        """Return {kind of evidence: shots that have it}."""
        measured = int(self.seen.measured.sum())
        kinds = {"outcome": len(self.marked) - measured, "miss_height_m": measured,
                 **{name: int(np.isfinite(column).sum()) for name, column in zip(
                     ("exit_speed_m_s", "exit_deg", "exit_spin_rev_s"), self.exits.T, strict=True)},
                 "tracks" if self.filmed else "times": len(self.tracked)}
        return {kind: count for kind, count in kinds.items() if count}


def see_outcomes(shots: Shots, rig: Rig) -> tuple[Int[Array, " n"], Outcomes]:
    """Return (rows [n] with a usable outcome, side or measured height, the observations).

    InputError when there are outcomes but no [target] in rig.toml.
    """
    if rig.target is not None and rig.target.faces_up:
        return see_landings(shots, rig, rig.target)
    return see_heights(shots, rig.target)


def take_in(dataset: Dataset, curves: Curves = NONE, fewest: int = FEWEST_SHOTS) -> Intake:
    """Return the informative shots; InputError if there are fewer than `fewest`, or outcomes without a target.

    curves: of unexplained effects that are believed.
    """
    rig, shots = dataset.facts, _with_backspin(dataset.shots)
    if len(shots) < fewest:
        raise InputError(f"{shots.source}: {say_few(len(shots))}")
    wheels, hood = has_wheels(rig, shots), np.isfinite(shots.number("hood_deg"))
    sped, aimed = (np.isfinite(shots.number(name)) for name in ("exit_speed_m_s", "exit_deg"))
    launched = (wheels | sped) & (hood | aimed)
    marked, seen = see_outcomes(shots, rig)
    usable = launched[marked] & np.isfinite(shots.number("distance_m")[marked])
    seen = seen.take(usable)
    samples, scatter, notes = samples_of(dataset)
    tracked = np.zeros(len(shots), bool) if samples is None else np.isin(np.arange(len(shots)), samples.rows)
    use = tracked.copy()
    use[marked[usable]] = True
    use |= launched & (wheels & (sped | np.isfinite(shots.number("exit_spin_rev_s"))) | hood & aimed)
    rows = np.flatnonzero(use)
    place = np.full(len(shots), -1)
    place[rows] = np.arange(len(rows))
    part = _Part(rig, shots.take(rows), wheels[rows], hood[rows], launched[rows])
    told = np.isin(np.arange(len(shots)), marked)
    left_out = [*dataset.left_out, *notes, *say_left_out(rig, shots, use, told, tracked)]
    around = conditions.circumstances_of(dataset)
    if curves:
        around = along(curves, around, every_column(dataset), len(shots))
    lanes, noise_var, scattered = _lanes(part, _pick(around, rows), samples, place)
    exits, exit_sd = _exits(part)
    return Intake(rig, without_noise(rig), rows, lanes, noise_var, scattered, exits, exit_sd, place[marked[usable]],
                  seen, np.zeros(0, int) if samples is None else place[samples.rows], samples, scatter,
                  _level(dataset, samples), tuple(left_out))


def _with_backspin(shots: Shots) -> Shots:
    """With the backspin of those of which only the whole spin was measured: from its part about the left."""
    about_left = _whole_spin(shots)[:, 1]
    if not np.isfinite(about_left).any():
        return shots
    backspin = shots.number("exit_spin_rev_s")
    backspin = np.where(np.isnan(backspin), -about_left, backspin)
    return replace(shots, numbers=shots.numbers | {"exit_spin_rev_s": backspin})


def _whole_spin(shots: Shots) -> Float[Array, "n 3"]:
    """Measured spin [n, 3] in rev/s about (x, y, z); nan where any part is unknown."""
    spin = np.stack([shots.number(name) for name in SPIN_VECTOR], axis=1)
    return np.where(np.isfinite(spin).all(1, keepdims=True), spin, np.nan)


def without_noise(rig: Rig) -> Rig:
    """Return the rig without noise, tracker and beliefs, on which no flight depends: compiled code is kept by rig."""
    return msgspec.structs.replace(rig, noise=Noise(), tracker=msgspec.UNSET, site=msgspec.UNSET,
                                   believe=Believe())


@dataclass(frozen=True)
class _Part:
    """The shots used, and what is known of each."""

    rig: Rig
    shots: Shots
    wheels: Bool[Array, " n"]
    hood: Bool[Array, " n"]
    launched: Bool[Array, " n"]


def _lanes(part: _Part, circumstances: Circumstances, samples: Samples | None,
           place: Int[Array, " shots"]) -> tuple[ShotBatch, Float[Array, "n D"], Float[Array, "n S"]]:
    """(lanes, noise variances [n, D], what scatters on top [n, S])."""
    shots, n, free = part.shots, len(part.shots), ~part.launched
    numbers = {**shots.numbers}
    numbers["exit_speed_m_s"] = np.where(free, 1.0, np.where(part.wheels, np.nan, shots.number("exit_speed_m_s")))
    numbers["exit_deg"] = np.where(free, 0.0, np.where(part.hood, np.nan, shots.number("exit_deg")))
    numbers["exit_spin_rev_s"] = np.where(part.wheels & part.launched, np.nan, shots.number("exit_spin_rev_s"))
    numbers["distance_m"] = np.nan_to_num(shots.number("distance_m"), nan=1.0)
    given = given_of(part.rig, Shots(shots.shot_id, numbers, shots.texts))
    side = _side_spin(part)
    start_m, start_m_s, spin, lead_s, time_s = _starts(part, given.rolling, samples, place)
    rolling = Exit(*(np.asarray(each, dtype=float) for each in given.rolling))._replace(above_m=np.zeros(n))
    usual = part.rig.ball
    mass_kg, radius_m = own_balls(part.rig, shots) or (np.full(n, usual.mass_kg), np.full(n, usual.radius_m))
    lanes = ShotBatch(rolling, side, given.rolled & part.launched, given.hooded & part.launched, free, mass_kg,
                      radius_m, given.distance_m, circumstances, start_m, start_m_s, spin, lead_s, time_s)
    variance = np.zeros((n, len(DEVIATES)))
    variance[:, 0] = np.where(free, 0.0, (given.wheel_log_speed**2).sum(1))
    variance[:, 1] = np.where(free, 0.0, given.elevation_sd_rad**2)
    spinning = np.maximum(np.abs(np.asarray(given.rolling.spin_rev_s)), 0.5)
    variance[:, 3] = noise.SPIN_SHARE**2 + np.where(free, 0.0, (given.wheel_spin_rev_s**2).sum(1) / spinning**2)
    timed = samples is not None and samples.clock_s is not None
    variance[:, 5] = np.where(free | timed, 0.0, noise.LEAD_S**2)
    variance[:, 8:11] = np.where(free & ~timed, noise.FREE_PLACE_M, noise.PLACE_M)[:, None]**2
    variance[:, 11:14] = np.where(free & ~timed, noise.FREE_SPEED_M_S, 0.0)[:, None]**2
    filmed = np.full(n, samples is not None and not timed)
    return lanes, variance, np.stack([given.rolled & ~free, given.hooded & ~free, ~free,
                                   np.broadcast_to(given.distance_sd_m**2, n), filmed, filmed], axis=1) * 1.0


def _side_spin(part: _Part) -> Float[Array, "n 2"]:
    """Spin [n, 2] in rev/s about the direction of flight and about up: as measured, else of rigs with other wheels than
    the paper's."""
    side, shots = np.zeros((len(part.shots), 2)), part.shots
    if part.rig.launcher.wheel and not is_opposed(part.rig):
        body = _wheel_spin(part)
        known = np.isfinite(body).all(1)
        side[known] = body[known][:, [0, 2]]
    spin = _whole_spin(shots)
    known = np.isfinite(spin).all(1)
    deg = np.where(np.isfinite(shots.number("exit_deg")), shots.number("exit_deg"), shots.number("hood_deg"))
    level, rise = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    about = np.stack([level * spin[:, 0] + rise * spin[:, 2], level * spin[:, 2] - rise * spin[:, 0]], axis=1)
    side[known] = np.nan_to_num(about[known])
    return side


def _wheel_spin(part: _Part) -> Float[Array, "n 3"]:
    """Spin [n, 3] by all wheels in rev/s about (ahead, left, up); nan where a wheel's speed is unknown."""
    surface = np.stack([part.shots.number(f"wheel_{wheel.name}_rad_s") * wheel.radius_m
                        for wheel in part.rig.launcher.wheel], axis=1)
    return np.asarray(simulate.exit_no_slip(part.rig, surface)[1] / (2.0 * np.pi))


def _starts(part: _Part, rolling: Exit, samples: Samples | None, place: Int[Array, " shots"]
            ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, " n"],
                       Float[Array, "n L"]]:
    """start_m, start_m_s, spin [n, 3], lead_s [n], time_s [n, L] of ShotBatch."""
    n = len(part.shots)
    start_m, start_m_s, spin = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
    if samples is None:
        return start_m, start_m_s, spin, np.zeros(n), np.zeros((n, 1))
    time_s, lead_s = np.zeros((n, samples.time_s.shape[1])), np.zeros(n)
    rows = place[samples.rows]
    time_s[rows] = samples.time_s
    if samples.clock_s is not None:   # dropped, where nothing is known of a launch
        start_m[rows], start_m_s[rows] = [0.0, 0.0, part.rig.launcher.release_height_m], [0.0, 0.0, -AT_REST_M_S]
        return start_m, start_m_s, _free_spin(part, start_m_s), np.zeros(n), time_s
    start_m[rows], start_m_s[rows] = first_guess(samples)
    ahead_m_s = np.maximum(np.asarray(rolling.speed_m_s) * np.cos(np.asarray(rolling.elevation_rad)), 0.5)
    lead_s[rows] = np.clip(start_m[rows, 0] / ahead_m_s[rows], 0.0, 1.0)
    spin[:] = _free_spin(part, start_m_s)
    return start_m, start_m_s, spin, np.where(part.launched, lead_s, 0.0), time_s


def _free_spin(part: _Part, velocity_m_s: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Spin [n, 3] in rev/s of flights with unknown launch: as measured (whole, or backspin), else by the wheels, else
    none."""
    ahead = velocity_m_s / np.maximum(np.linalg.norm(velocity_m_s, axis=1, keepdims=True), 1e-9)
    level = np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-9)
    left = np.stack([-ahead[:, 1] / level, ahead[:, 0] / level, np.zeros(len(ahead))], axis=1)
    measured = part.shots.number("exit_spin_rev_s")
    spin = -left * np.nan_to_num(measured)[:, None]
    if part.rig.launcher.wheel:
        body = _wheel_spin(part)
        turned = body[:, :1] * ahead + body[:, 1:2] * left + body[:, 2:] * np.cross(ahead, left)
        spin = np.where((np.isfinite(turned).all(1) & np.isnan(measured))[:, None], turned, spin)
    whole = _whole_spin(part.shots)
    return np.where(np.isfinite(whole), whole, spin)


def first_guess(samples: Samples) -> tuple[Float[Array, "k 3"], Float[Array, "k 3"]]:
    """Return position and velocity [k, 3] at the first sample, from a parabola through each track."""
    position, velocity = np.zeros((2, len(samples.rows), 3))
    for k, real in enumerate(samples.real):
        curve = np.polynomial.polynomial.polyfit(samples.time_s[k][real], samples.position_m[k][real], 2)
        position[k], velocity[k] = curve[0], curve[1]
    return position, velocity


def _exits(part: _Part) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Measured exits that are evidence about wheels and hood [n, 3], and their standard deviations."""
    speed, deg, spin_rev_s = (_measured(part.shots.number(name), where & part.launched) for name, where in (
        ("exit_speed_m_s", part.wheels), ("exit_deg", part.hood), ("exit_spin_rev_s", part.wheels)))
    exits = np.stack([np.log(np.where(speed > 0.0, speed, np.nan)), np.radians(deg), spin_rev_s], axis=1)
    sd = np.stack([noise.EXIT_SPEED_M_S / np.where(speed > 0.0, speed, 1.0),
                   np.full(len(speed), np.radians(noise.EXIT_DEG)), np.full(len(speed), noise.EXIT_SPIN_REV_S)], axis=1)
    return exits, sd


def _measured(column: Float[Array, " n"], where: Bool[Array, " n"]) -> Float[Array, " n"]:
    """The column there; nan where it is the same for all shots: real measurements scatter."""
    known = column[where & np.isfinite(column)]
    return np.where(where & (len(known) > 1 and np.ptp(known) > 0.0), column, np.nan)


def _pick(circumstances: Circumstances, rows: Int[Array, " n"]) -> Circumstances:
    return Circumstances(*(np.full(len(rows), part, dtype=float) if np.ndim(part) == 0 else np.asarray(part)[rows]
                           for part in circumstances))


def _level(dataset: Dataset, samples: Samples | None) -> str:
    if samples is not None:
        return "L2"
    wheels = tuple(f"wheel_{wheel.name}_rad_s" for wheel in dataset.facts.launcher.wheel)
    telemetry = [name for name in dataset.shots.numbers if name not in SETTINGS + wheels]
    return "L1" if telemetry or dataset.traces is not None else "L0"
