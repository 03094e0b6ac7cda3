"""The worlds of a round: their draw from a single number, and their released data.

The proportions of the kinds are those of the design. The size of an effect follows from lambda, its detectability in
such data (proof/truearc_proof/truth/ladder.toml), and not from a judgement of its usual size. Nothing here comes from
truearc.sim.physics.

Foreign worlds use the NumPy engine with several small errors of the believed physics. The errors are the same in a
practice session, which is released in the folder `home`, and in the event, before which one thing or nothing has
changed. They follow from the seed (truearc_proof.truth.world); `effects` contains only the change.

In the MuJoCo world, a concealed change has one or more correct names in the catalogue. The physics of this world
differs from that of the catalogue: a softer ball leaves slower, lower and with different spin. Several names may
therefore be right for one change, and for some changes only the stage is.

The data of a MuJoCo world may be worse than those of its session at home or than rig.toml states. This is not a change.
The kinds shared with the NumPy engine are noise_understated (rig.toml states half of the noise), outliers (2 % of
outcomes are recorded as another, and tracks have Student's t noise with 3 degrees of freedom), missing_frames (a
quarter of a track) and battery_with_wear (a voltage without effect that falls as balls wear). In addition, scatter
makes balls, and shots of a ball, vary 1.25 times as much, and lopsided restricts practice to long distances. No kind
overstates the noise, because rig.toml already does.

Only scatter and battery affect the mean flight, as measured in 300 shots. More scatter lowers the mean height by 7 mm,
less than its standard error of 11 mm (1.4 times as much scatter: 12 mm). The battery moves heights by 3 mm RMS, and by
7 mm along its fall, compared with a scatter of shots of 150 mm.
"""

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from msgspec import Struct, ValidationError, convert, structs

from truearc import robot
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Believe, Noise
from truearc.robot.config.schema import load_config
from truearc.sim.data.files import save_dataset
from truearc.sim.world.options import Options
from truearc.sim.world.world import Season, ShotSetting
from truearc_proof.truth import world as truth
from truearc_proof.truth.generate import foreign_robot, write
from truearc_proof.truth.world import FEWEST, LEVELS, TRACK_DIRT, World, find_effect, make_world
from truearc_proof.world.season import ORDINARY, Sensors, plan_season, play_season

# --- hidden effects, and the catalogue's numbers for them

DIRTS: dict[str, tuple[str, ...]] = {
    "clean": (), "balls": ("balls",), "outliers": ("outliers",), "noise_understated": ("noise_understated",),
    "noise_overstated": ("noise_overstated",), "track_memory": ("track_memory",), "missing_frames": ("missing_frames",),
    "clipped": ("clipped",),
    "all": ("balls", "outliers", "noise_understated", "track_memory", "missing_frames", "clipped")}
SEED_SPIN = 2.0                       # the paper's Eq. 12 has twice the spin of rolling, and with it twice r w / v
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


def names_at(kind: str, level: str, hopeless: bool = False) -> Iterator[str]:
    """Return names of "nulls", "effects" of the catalogue, or effects "off" it at a level.

    Effects that its data cannot show are omitted unless `hopeless`.
    """
    if kind == "nulls":
        yield from (name for name, dirt in DIRTS.items()
                    if level == "L2" or name == "all" or not any(one in truth.TRACK_DIRT for one in dirt))
    else:
        effects = truth.CATALOGUED if kind == "effects" else truth.UNCATALOGUED
        yield from (effect.name for effect in effects if hopeless or effect.name not in unseen(level))


def unseen(level: str) -> tuple[str, ...]:
    """Return effects of which the data of a level have no trace, by kind."""
    tracks = truth.TRACK_EFFECTS
    return truth.ABSORBED + {"L0": truth.COVARIATE_EFFECTS + tracks, "L1": tracks, "L2": ()}[level]


# --- what is drawn

ROBOT_DIRT = ("scatter", "noise_understated", "outliers", "lopsided")
ROBOT_TRACK_DIRT = ("missing_frames",)
DECOY_DIRT = "battery_with_wear"
SCATTER_SCALE = 1.25
UNDERSTATED = 2.0                     # true standard deviations / stated
WRONG_MARKS, TRACK_TAILS, LOST_FRAMES = 0.02, 3, 0.25
FAR_M = 5.0                           # lopsided practice is from there on
# A decoy's battery: from a little above the usual 12.6 V, so that the motors always have what they ask for.
FULL_V, FALL_V = 12.9, 0.8
FOREIGN, NUMPY, MUJOCO = "foreign", "numpy", "mujoco"
ENGINES = (FOREIGN, NUMPY, MUJOCO)
OWN = "own"                           # an external world, by an engine of its maker's
# Shares of kinds; MuJoCo's worlds are of every kind, too, but have no ladder.
SHARES = {"clean": 0.175, "dirty": 0.175, "one": 0.30, "two": 0.10, "off": 0.15, "alias": 0.05, "decoy": 0.05}
IN_FOREIGN = 0.3                      # of all, unchanged in place of nulls
IN_MUJOCO = 0.2                       # of each kind of the others
FOREIGN_CHANGES = (("wind_x", 1.5), ("hood_offset", 1.5), ("distance_scale", 0.04))    # of either sign
EVENT = 80 / 300                      # shots of a foreign world's event, by those of its practice
LADDER = (0.5, 2.0, 5.0, 10.0, 20.0, 50.0, 200.0)
PLAIN = 10.0                          # least lambda of each of two effects, of an alias and of a decoy's companion
LARGEST = 4.0                         # times the usual size: beyond that nothing is credible; of some, less is
LESS = {"air_density": 1.0, "drag_crisis": 2.0, "drag_reynolds": 2.5, "vision_latency": 3.0}
FACTORS = (0.5, 1.0, 2.0)             # of a change in MuJoCo; where it must be plain, of these
PLAIN_FACTORS = tuple(one for one in FACTORS if one >= 1.0)
OFF_FACTORS = (1.0, 2.0)              # of what is in no catalogue where its lambda is not known (tracks)
DIRTY = 0.4                           # of the worlds with an effect
LADDER_SHOTS = 300                    # that the table of lambdas is about
FIRST_SEED = 1 << 50                  # a round's worlds have none of the small seeds that benchmarks' worlds have
# Effects that are easily mistaken for each other; the whole set is the right answer.
ALIKE = {"L0": ("target_height", "release_height", "distance_bias", "distance_scale"),
         "L1": ("target_height", "release_height"), "L2": ("distance_bias", "distance_scale")}
LIMITS = {"ball_stiffness_scale": (0.35, 3.0), "flywheel_inertia_scale": (0.25, 5.0)}      # that a world stands
WEAR = ("ball_wear", "drag_wear")     # what a battery that falls with wear is a decoy for
DECOY = "battery_sag"                 # and the name of the catalogue that it resembles


class Change(NamedTuple):
    """`options` of truearc.sim.world.options, how the changed world differs from one as drawn; names and stages that
    are right of it; whether only tracks can show it; options that go with it and are not larger where it is; whether
    nature may turn it either way, where another change is not already the other."""

    name: str
    options: Mapping[str, float]
    names: tuple[str, ...]
    stages: tuple[str, ...]
    tracks_only: bool = False
    beside: tuple[tuple[str, float], ...] = ()
    signed: bool = False


LAUNCH = ("exit_efficiency", "wheel_slip", "wheel_droop", "ball_compression")
CHANGES: tuple[Change, ...] = (
    Change("nothing", {}, (), ()),
    Change("tail_wind", {"wind_x_m_s": 1.5}, ("wind_x",), ("flight",)),
    Change("head_wind", {"wind_x_m_s": -1.5}, ("wind_x",), ("flight",)),
    Change("cross_wind", {"wind_y_m_s": 1.5}, ("wind_y",), ("flight",), tracks_only=True),
    Change("dense_air", {"air_density_kg_m3": 1.44}, ("air_change", "drag", "magnus"), ("flight",)),
    Change("soft_ball", {"ball_stiffness_scale": 0.6}, LAUNCH, ("launch",)),
    Change("worn_ball", {"wear_stiffness_per_shot": 0.005, "wear_friction_per_shot": 0.002},
           ("ball_wear", *LAUNCH), ("launch",)),
    Change("heavy_ball", {"ball_mass_scale": 1.2}, ("drag", "magnus", "added_mass", "buoyancy", *LAUNCH),
           ("flight", "launch")),
    Change("hood_offset", {"hood_offset_deg": 1.5}, ("hood_offset",), ("sensing",)),
    Change("camera_scale", {"camera_focal_scale": 1.05}, ("distance_scale", "distance_bias"), ("sensing",)),
    Change("encoder_scale", {"encoder_scale": 1.05}, ("encoder_scale", *LAUNCH), ("sensing", "launch")),
    Change("release_height", {"release_height_error_m": 0.1}, ("release_height", "target_height"),
           ("launch", "arrival")),
    Change("sagging_battery", {"battery_drop_v_per_shot": 0.012, "battery_resistance_ohm": 0.08},
           ("battery_sag", "wheel_droop", "rapid_fire"), ("launch",)),
    Change("light_wheels", {"flywheel_inertia_scale": 0.4}, ("wheel_droop", "rapid_fire", *LAUNCH), ("launch",)),
)
# Effects in no catalogue. They move heights at the plane by (RMS of 100 shots without scatter): release_arc .06 m;
# hood_flex .13 m (by -0.2) to .28 (by 0.4); drag_crisis .12 (by -0.1) to .26 (by -0.2); wind_aloft .11 (by 0.25) to .28
# (by -0.5). Effects that the NumPy engine has too follow the same covariates as there (whose drag steps more gently).
UNCATALOGUED: tuple[Change, ...] = (
    Change("release_arc", {}, (), ("launch",), beside=(("release_arc", 1.0),)),
    Change("hood_flex", {"hood_flex_deg": 0.2}, (), ("launch",), signed=True),
    Change("drag_crisis", {"drag_step": -0.1}, (), ("flight",)),
    Change("wind_aloft", {"wind_x_m_s": 0.25}, (), ("flight",), beside=(("wind_above_m", 2.5),), signed=True),
)
# Of which a class of names that such data never tell apart is the only right answer
# (ALIKE).
ALIKE_CHANGES = {"L0": ("release_height", "camera_scale"), "L1": ("release_height",), "L2": ("camera_scale",)}
WORN_CHANGE = "worn_ball"             # what a battery that falls with it is a decoy for
AND = "+"                             # between the names of two


def seen_at(level: str) -> tuple[Change, ...]:
    """Return those of which data of the level have a trace."""
    return tuple(change for change in CHANGES if level == "L2" or not change.tracks_only)


def changes_of(name: str) -> tuple[Change, ...]:
    """Return the changes: none, one or two. ValueError if there is no such change."""
    known = {change.name: change for change in (*CHANGES, *UNCATALOGUED)}
    missing = set(name.split(AND)) - set(known)
    if missing:
        raise ValueError(f"there is no change {', '.join(sorted(missing))}; there are {', '.join(known)}")
    return tuple(known[one] for one in name.split(AND) if known[one] is not CHANGES[0])


def pairs_at(level: str) -> tuple[tuple[Change, Change], ...]:
    """Return pairs that share neither an option nor a right name: no single name is right for both."""
    return tuple((one, other) for one, other in combinations(seen_at(level)[1:], 2)
                 if not set(one.options) & set(other.options) and not set(one.names) & set(other.names))


def dirt_at(level: str) -> tuple[str, ...]:
    """Return the data defects that are possible at a level."""
    return ROBOT_DIRT + (ROBOT_TRACK_DIRT if level == "L2" else ())


def dirty_options(dirt: Sequence[str], shots: int) -> dict[str, float]:
    """Return options of the world; `shots`: over which the battery voltage falls."""
    options = {"scatter_scale": SCATTER_SCALE} if "scatter" in dirt else {}
    return options | ({"battery_start_v": FULL_V, "battery_drop_v_per_shot": FALL_V / shots}
                      if DECOY_DIRT in dirt else {})


def dirty_sensors(dirt: Sequence[str], stated: Noise) -> Sensors:
    """Return the sensors' true noise; stated: rig.toml's."""
    sensors = ORDINARY
    if "noise_understated" in dirt:
        distance_m, hood_deg, wheel_rad_s, track_m = (
            UNDERSTATED * one for one in (stated.distance_m, stated.hood_deg, stated.wheel_rad_s, stated.track_m))
        sensors = Sensors(distance_m, hood_deg, wheel_rad_s, track_m)
    if "outliers" in dirt:
        sensors = sensors._replace(wrong_marks=WRONG_MARKS, track_tails=TRACK_TAILS)
    return sensors._replace(lost_frames=LOST_FRAMES) if "missing_frames" in dirt else sensors


def dirty_plan(dirt: Sequence[str], seed: int, shots: int) -> list[ShotSetting]:
    """Return which shots are taken."""
    return plan_season(seed, shots, FAR_M) if "lopsided" in dirt else plan_season(seed, shots)


class Drawn(Struct, frozen=True, forbid_unknown_fields=True):
    """One world. `effects`: {name: amplitude}, or for MuJoCo {option: value}; `change`: MuJoCo's, by name.

    strength: {effect: its lambda by the ladder's table}, of those that the table has.
    """

    name: str
    engine: str
    kind: str
    level: str
    shots: int
    seed: int
    effects: dict[str, float] = {}
    dirt: tuple[str, ...] = ()
    change: str = ""
    strength: dict[str, float] = {}


def draw_round(seed: int, worlds: int, level: str, shots: int, engines: tuple[str, ...] = ENGINES
               ) -> tuple[Drawn, ...]:
    """Draw the worlds of a round, in order of release; the same arguments give the same worlds.

    InputError for an unknown level or engine.
    """
    if level not in LEVELS:
        raise InputError(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
    if not engines or set(engines) - set(ENGINES):
        raise InputError(f"engines are {', '.join(ENGINES)}, not {', '.join(engines)}")
    rng = np.random.default_rng([seed, worlds, LEVELS.index(level), shots])
    kinds = rng.permutation(np.repeat(list(SHARES), _shared_out(worlds))).tolist()
    return tuple(_draw(rng, f"w{number:04d}", kind, level, shots, engines) for number, kind in enumerate(kinds, 1))


def _shared_out(worlds: int) -> list[int]:
    """How many of each kind, by largest remainders."""
    wanted = np.array(list(SHARES.values())) * worlds
    counts = np.floor(wanted).astype(int)
    for kind in np.argsort(counts - wanted, kind="stable")[:worlds - counts.sum()]:
        counts[kind] += 1
    return [int(count) for count in counts]


def _draw(rng: np.random.Generator, name: str, kind: str, level: str, shots: int, engines: tuple[str, ...]) -> Drawn:
    seed = FIRST_SEED + int(rng.integers(1 << 62))
    if FOREIGN in engines and (len(engines) == 1 or rng.random() < IN_FOREIGN):
        effect, size = FOREIGN_CHANGES[int(rng.integers(len(FOREIGN_CHANGES)))]
        change = {} if kind in ("clean", "dirty") else {effect: float(size * rng.choice((-1.0, 1.0)))}
        return Drawn(name, FOREIGN, "one" if change else "clean", level, shots, seed, change)
    if MUJOCO in engines and (NUMPY not in engines or rng.random() < IN_MUJOCO):
        return change_robot(rng, Drawn(name, MUJOCO, kind, level, shots, seed))
    sizes = _sizes(rng, kind, level)
    effects = {effect: _amount(rng, effect, level, shots, size) for effect, size in sizes.items()}
    strength = {effect: strength_of(effect, amount, level, shots) for effect, amount in effects.items()}
    return Drawn(name, NUMPY, kind, level, shots, seed, effects, _dirt(rng, kind, level), "",
                 {effect: size for effect, size in strength.items() if size is not None})


def strength_of(effect: str, amount: float, level: str, shots: int) -> float | None:
    """Return lambda of an amplitude: it grows with its square and with the shots. None if the table lacks it."""
    usual = lambdas(level).get(effect)
    return None if usual is None else usual * shots / LADDER_SHOTS * (amount / find_effect(effect).typical)**2


def _sizes(rng: np.random.Generator, kind: str, level: str) -> dict[str, float]:
    """{hidden effect: lambda wanted}."""
    plain = [one for one in LADDER if one >= PLAIN]
    if kind in ("clean", "dirty"):
        return {}
    if kind == "off":
        name = str(rng.choice(list(names_at("off", level))))
        return {name: float(rng.choice(plain))}
    if kind == "two":
        return {str(name): float(rng.choice(plain)) for name in _pair(rng, level)}
    if kind in ("alias", "decoy"):
        return {str(rng.choice(ALIKE[level] if kind == "alias" else WEAR)): float(rng.choice(plain))}
    return {str(rng.choice(_catalogued(level))): float(rng.choice(LADDER))}


def _catalogued(level: str) -> list[str]:
    """Effects of the catalogue that such data show at all."""
    return [name for name in names_at("effects", level) if name in lambdas(level)]


def _pair(rng: np.random.Generator, level: str) -> tuple[str, ...]:
    """Two effects; every second time both of one class that is easily confused."""
    among = list(ALIKE[level]) if rng.random() < 0.5 else _catalogued(level)
    return tuple(map(str, rng.choice(among, 2, replace=False)))


def _amount(rng: np.random.Generator, name: str, level: str, shots: int, size: float) -> float:
    """The amplitude with that lambda, as far as that is credible."""
    effect = find_effect(name)
    usual = strength_of(name, effect.typical, level, shots)
    factor = float(rng.choice(OFF_FACTORS)) if usual is None else math.sqrt(size / usual)
    sign = -1.0 if effect.signed and rng.random() < 0.5 else 1.0
    return sign * effect.typical * min(factor, LESS.get(name, LARGEST))


def _dirt(rng: np.random.Generator, kind: str, level: str) -> tuple[str, ...]:
    if kind == "decoy":
        return ("battery_with_wear",)
    possible = [dirt for dirt in DIRTS.values() if dirt and (level == "L2" or not set(dirt) <= set(TRACK_DIRT))]
    if kind == "dirty" or (kind != "clean" and rng.random() < DIRTY):
        chosen = possible[int(rng.integers(len(possible)))]
        return tuple(one for one in chosen if level == "L2" or one not in TRACK_DIRT)
    return ()


def change_robot(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Return a MuJoCo world of its kind."""
    kind, level = drawn.kind, drawn.level
    if kind in ("clean", "dirty"):
        dirt = (str(rng.choice(dirt_at(level))),) if kind == "dirty" else ()
        return structs.replace(drawn, change=CHANGES[0].name, dirt=dirt)
    among = {"one": tuple((one,) for one in seen_at(level)[1:]), "two": pairs_at(level),
             "off": tuple((one,) for one in UNCATALOGUED),
             "alias": tuple(changes_of(name) for name in ALIKE_CHANGES[level]), "decoy": (changes_of(WORN_CHANGE),)}
    changes = among[kind][int(rng.integers(len(among[kind])))]
    options = [_sized(rng, one, FACTORS if kind == "one" else PLAIN_FACTORS, one.signed or kind == "alias")
               for one in changes]
    return structs.replace(drawn, effects={name: value for each in options for name, value in each.items()},
                           change=AND.join(one.name for one in changes),
                           dirt=(DECOY_DIRT,) if kind == "decoy" else ())


def _sized(rng: np.random.Generator, change: Change, factors: tuple[float, ...], signed: bool
           ) -> dict[str, float]:
    """{option: value} of a change that is one of the factors larger than usual."""
    factor = float(rng.choice(factors)) * (-1.0 if signed and rng.random() < 0.5 else 1.0)
    return {name: _scaled(name, value, factor) for name, value in change.options.items()} | dict(change.beside)


def _scaled(option: str, value: float, factor: float) -> float:
    """A change times a factor: of what is 1 or 1.2 by itself, its departure from that."""
    usual = float(getattr(Options(), option))
    low, high = LIMITS.get(option, (-math.inf, math.inf))
    return min(max(usual + factor * (value - usual), low), high)


@cache
def lambdas(level: str) -> Mapping[str, float]:
    """Return {effect: lambda of LADDER_SHOTS shots at its usual size}; effects that the data hardly show are
    missing."""
    table = tomllib.loads((Path(__file__).parents[1] / "truth" / "ladder.toml").read_text(encoding="utf-8"))
    return {name: value for name, value in table[level].items() if value > 0.1}


def drawn_of(world: Mapping[str, Any], path: Path) -> Drawn:
    """Return the world of a seal, ignoring further notes on it; InputError, with the path, for what cannot be
    marked."""
    try:
        drawn = convert({name: world[name] for name in Drawn.__struct_fields__ if name in world}, Drawn)
    except ValidationError as error:
        raise InputError(f"{path}: {error}") from error
    if drawn.kind not in SHARES:
        raise InputError(f"{path}: kind: there is no {drawn.kind!r}; there are {', '.join(SHARES)}")
    return drawn


# --- what is made

HOME = "home"                         # the session of the unmodified robot that MuJoCo's worlds are compared with


def world_of(drawn: Drawn) -> World:
    """Return the world of the NumPy engine; of a foreign one its event."""
    if drawn.engine != FOREIGN:
        return make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt)
    return foreign_robot(drawn.seed, drawn.level, drawn.shots, max(round(EVENT * drawn.shots), FEWEST),
                         drawn.effects)[1]


def make_data(drawn: Drawn, directory: Path) -> str:
    """Write the dataset; return its maker (engine and version). The directory must be new or empty."""
    if drawn.engine == MUJOCO:
        played = play_robot(drawn, drawn.seed, dirty_plan(drawn.dirt, drawn.seed, drawn.shots))
        save_dataset(directory, replace(played.dataset, name=directory.name))
        return f"mujoco {mujoco.__version__}, truearc {version('truearc')}"
    write(world_of(drawn), directory)
    if drawn.engine == FOREIGN:
        write(foreign_robot(drawn.seed, drawn.level, drawn.shots, FEWEST, {})[0], directory / HOME)
    return f"numpy {version('numpy')}, truearc {version('truearc')}"


def play_robot(drawn: Drawn, seed: int, settings: Sequence[ShotSetting]) -> Season:
    """Play a session of MuJoCo's robot with its hidden changes, and return the truth with it."""
    # what is to be believed of it is not said in rig.toml but shown in the home session
    rig = structs.replace(load_config(Path(robot.__file__).parent / "launcher.toml").rig, believe=Believe(()))
    options = structs.replace(Options(), **drawn.effects, **dirty_options(drawn.dirt, drawn.shots))
    return play_season(rig, options, seed, settings, drawn.level, dirty_sensors(drawn.dirt, rig.noise))


def home_of(worlds: tuple[Drawn, ...], seed: int) -> Drawn | None:
    """Return the unmodified session that a round with MuJoCo's worlds begins with; None for one without."""
    mine = [one for one in worlds if one.engine == MUJOCO]
    return None if not mine else Drawn(HOME, MUJOCO, "clean", mine[0].level, mine[0].shots, seed, change="nothing")
