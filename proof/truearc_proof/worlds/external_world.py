"""External worlds: the truth that their makers state is sealed with their data, if it can be marked."""

import shutil
from pathlib import Path
from typing import Any

import msgspec

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, load_dataset
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS
from truearc.sim.physics.catalogue import TERMS
from truearc_proof.rounds.commitment import check_data, load_seal, make_seal, save_seal
from truearc_proof.rounds.file_lock import alone
from truearc_proof.rounds.ledger import append
from truearc_proof.rounds.round_layout import SEALED, Room
from truearc_proof.scoring.score_finding import PARAMETER
from truearc_proof.worlds.generate_data import HOME
from truearc_proof.worlds.sampling_plan import OWN, Drawn, drawn_of

TAKEN = (HOME, "round")               # home: MuJoCo's unmodified robot; keeper/round.json: how a round was drawn
EFFECTS = {"clean": (0, 0), "dirty": (0, 0), "one": (1, 1), "alias": (1, 1), "decoy": (1, 1), "two": (2, 2),
           "off": (1, None)}          # of a kind, at least and at most


def seal_own(room: Room, world: Path, data: Path) -> str:
    """Seal an external world with its data; return its commitment, which its maker publishes before the data.

    world: JSON, {"kind": "one", "effects": {"wind_x": 2.0}} and whatever else is true of it; kinds are those of
    truearc_proof.worlds.sampling_plan, effects the catalogue's parameters' values, or names of their own for what no
    catalogue has. InputError for what could never be marked, naming file and key, and for one of that name sealed
    already.
    """
    try:
        truth = msgspec.json.decode(world.read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError) as error:
        raise InputError(f"{world}: {error}") from error
    name, dataset = data.resolve().name, load_dataset(data)
    level = "L2" if dataset.tracks is not None else "L1" if dataset.traces is not None else "L0"
    whole = {**truth, "name": name, "engine": OWN, "level": level, "shots": len(dataset.shots), "seed": 0}
    _check_data(room, data, dataset)
    _check_truth(world, drawn_of(whole, world))
    with alone(room.root):
        return _seal(room, name, whole, data)


def _seal(room: Room, name: str, whole: dict[str, Any], data: Path) -> str:
    sealed = room.steps().get(name)
    if sealed and room.data(name).is_dir():
        raise InputError(f"{room.ledger}: {name} is sealed already")
    if sealed:                        # a kill came before the data were given away
        seal = load_seal(room.seal(name))
        wrong = check_data(seal, data)
        if wrong:
            raise InputError("\n".join(wrong))
    else:
        room.keeper.mkdir(parents=True, exist_ok=True)
        seal = make_seal(whole, "external", data)
        save_seal(room.seal(name), seal)
        append(room.ledger, SEALED, name, seal.commitment)
    _give_away(data, room.data(name))
    return seal.commitment


def _give_away(data: Path, directory: Path) -> None:
    """Whole or not at all; what was sealed where it lies is there already."""
    if data.resolve() != directory.resolve():
        half = directory.with_name(f"{directory.name}.half")
        for left in (half, directory):          # by a kill
            shutil.rmtree(left, ignore_errors=True)
        shutil.copytree(data, half)
        half.rename(directory)


def _check_data(room: Room, data: Path, dataset: Dataset) -> None:
    """InputError for data that discovery would refuse, or whose name something else has."""
    if data.resolve().name in TAKEN:
        raise InputError(f"{data}: a world cannot be called {data.resolve().name!r}, which means something else in a "
                       "round; give the directory another name")
    if len(dataset.shots) < FEWEST_SHOTS:
        raise InputError(f"{dataset.shots.source}: {len(dataset.shots)} shots; discovery takes {FEWEST_SHOTS} at least")
    if not dataset.facts.believe.terms and not room.data(HOME).is_dir():
        raise InputError(f"{data / 'rig.toml'}: believe: terms: say what is to be believed; there is nothing else to "
                       "compare the shots with")


def _check_truth(path: Path, drawn: Drawn) -> None:
    """InputError for effects that are not such as the kind has."""
    least, most = EFFECTS[drawn.kind]
    count, names = len(drawn.effects), [term.name for term in TERMS]
    if count < least or (most is not None and count > most):
        wanted = "none" if most == 0 else f"{least}" if most == least else f"{least} or more"
        raise InputError(f"{path}: effects: there are {count}; kind {drawn.kind!r} has {wanted}")
    for name, amount in drawn.effects.items():
        if name in names and name not in PARAMETER:
            raise InputError(f"{path}: effects: {name}: claims about this term cannot be marked")
        if drawn.kind == "off" and name in PARAMETER:
            raise InputError(f"{path}: effects: {name}: is in the catalogue; kind 'off' is for what is not")
        if drawn.kind != "off" and name not in PARAMETER:
            raise InputError(f"{path}: effects: {name}: the catalogue has no such term (kind 'off' is for what it does "
                           f"not have); there are {', '.join(PARAMETER)}")
        if amount == 0.0:
            raise InputError(f"{path}: effects: {name}: 0 is nothing to be found; kind 'clean' is for that")
