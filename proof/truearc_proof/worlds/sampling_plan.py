"""Which worlds a round of proof is made of: drawn from one number, in shares and sizes that the solver does not know.

Shares follow the design, sizes a ladder in lambda: how plain the effect is in such data
(proof/truearc_proof/truth/ladder.toml), not its usual size by judgement. Nothing here comes from truearc.sim.physics.
"""

import math
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, ValidationError, convert, structs

from truearc.errors import InputError
from truearc.sim.world.options import Options
from truearc_proof.scoring.suite import NULLS, names_at
from truearc_proof.truth.effects import find_effect
from truearc_proof.truth.world import LEVELS, TRACK_DIRT
from truearc_proof.worlds.data_quality import DECOY_DIRT, dirt_at
from truearc_proof.worlds.perturbations import (
    ALIKE_CHANGES,
    AND,
    CHANGES,
    UNCATALOGUED,
    WORN_CHANGE,
    Change,
    changes_of,
    pairs_at,
    seen_at,
)

NUMPY, MUJOCO = "numpy", "mujoco"
OWN = "own"                           # an external world, by an engine of its maker's
# Shares of kinds; MuJoCo's worlds are of every kind, too, but have no ladder.
SHARES = {"clean": 0.175, "dirty": 0.175, "one": 0.30, "two": 0.10, "off": 0.15, "alias": 0.05, "decoy": 0.05}
IN_MUJOCO = 0.2                       # of each kind
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


def draw_round(seed: int, worlds: int, level: str, shots: int, engines: tuple[str, ...] = (NUMPY, MUJOCO)
               ) -> tuple[Drawn, ...]:
    """The worlds of a round, in the order in which they are released; the same arguments draw the same.

    InputError for an unknown level or engine.
    """
    if level not in LEVELS:
        raise InputError(f"there is no level {level!r}; there are {', '.join(LEVELS)}")
    if not engines or set(engines) - {NUMPY, MUJOCO}:
        raise InputError(f"engines are {NUMPY} and {MUJOCO}, not {', '.join(engines)}")
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
    if MUJOCO in engines and (NUMPY not in engines or rng.random() < IN_MUJOCO):
        return change_robot(rng, Drawn(name, MUJOCO, kind, level, shots, seed))
    sizes = _sizes(rng, kind, level)
    effects = {effect: _amount(rng, effect, level, shots, size) for effect, size in sizes.items()}
    strength = {effect: strength_of(effect, amount, level, shots) for effect, amount in effects.items()}
    return Drawn(name, NUMPY, kind, level, shots, seed, effects, _dirt(rng, kind, level), "",
                 {effect: size for effect, size in strength.items() if size is not None})


def strength_of(effect: str, amount: float, level: str, shots: int) -> float | None:
    """Lambda of an amplitude: it grows with its square and with the shots. None for what the table does not have."""
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
    possible = [dirt for dirt in NULLS.values() if dirt and (level == "L2" or not set(dirt) <= set(TRACK_DIRT))]
    if kind == "dirty" or (kind != "clean" and rng.random() < DIRTY):
        chosen = possible[int(rng.integers(len(possible)))]
        return tuple(one for one in chosen if level == "L2" or one not in TRACK_DIRT)
    return ()


def change_robot(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """A MuJoCo world of its kind."""
    kind, level = drawn.kind, drawn.level
    if kind == "one":
        return change_one(rng, drawn)
    if kind in ("clean", "dirty"):
        dirt = (str(rng.choice(dirt_at(level))),) if kind == "dirty" else ()
        return structs.replace(drawn, change=CHANGES[0].name, dirt=dirt)
    among = {"two": pairs_at(level), "off": tuple((one,) for one in UNCATALOGUED),
             "alias": tuple(changes_of(name) for name in ALIKE_CHANGES[level]), "decoy": (changes_of(WORN_CHANGE),)}
    changes = among[kind][int(rng.integers(len(among[kind])))]
    either = [one.signed or kind == "alias" for one in changes]
    options = [_sized(rng, one, PLAIN_FACTORS, signed) for one, signed in zip(changes, either, strict=True)]
    return structs.replace(drawn, effects={name: value for each in options for name, value in each.items()},
                           change=AND.join(one.name for one in changes),
                           dirt=(DECOY_DIRT,) if kind == "decoy" else ())


def change_one(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """A MuJoCo world with nothing changed, or one thing, by so much."""
    if drawn.kind == "clean":
        return structs.replace(drawn, change=CHANGES[0].name)
    change = seen_at(drawn.level)[1:][int(rng.integers(len(seen_at(drawn.level)) - 1))]
    return structs.replace(drawn, effects=_sized(rng, change, FACTORS), change=change.name)


def _sized(rng: np.random.Generator, change: Change, factors: tuple[float, ...], signed: bool = False
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
    """{effect: lambda of LADDER_SHOTS shots at its usual size}; what the data hardly show is not in it."""
    table = tomllib.loads((Path(__file__).parents[1] / "truth" / "ladder.toml").read_text(encoding="utf-8"))
    return {name: value for name, value in table[level].items() if value > 0.1}


def drawn_of(world: Mapping[str, Any], path: Path) -> Drawn:
    """The world of a seal, whatever else is noted of it; InputError, with the path, for what cannot be marked."""
    try:
        drawn = convert({name: world[name] for name in Drawn.__struct_fields__ if name in world}, Drawn)
    except ValidationError as error:
        raise InputError(f"{path}: {error}") from error
    if drawn.kind not in SHARES:
        raise InputError(f"{path}: kind: there is no {drawn.kind!r}; there are {', '.join(SHARES)}")
    return drawn
