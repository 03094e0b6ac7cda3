"""A finished round in one file, without its data: the opened seals say how to make them again, to the last byte."""

import io
import lzma
import shutil
import tarfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.errors import MAX_BYTES, InputError
from truearc.sim.printed import Progress
from truearc_proof.rounds.commitment import load_seal
from truearc_proof.rounds.committer import answer, asked_of, entropy
from truearc_proof.rounds.grader import Graded, check_draw, check_world, graded_of, left_out, mark_world
from truearc_proof.rounds.ledger import digest
from truearc_proof.rounds.reproduce_claims import solver_of
from truearc_proof.rounds.reproducibility import TOLERANCE, compare
from truearc_proof.rounds.round_layout import ANSWERED, CLAIMED, CLAIMED_AGAIN, GRADED, SEALED, Room
from truearc_proof.rounds.score_store import missing_marks, wrong_marks
from truearc_proof.rounds.solver import solver_id
from truearc_proof.worlds.generate_data import HOME, make_data
from truearc_proof.worlds.sampling_plan import OWN, Drawn, drawn_of

KEPT = ("ledger.jsonl", "grades.jsonl", "keeper", "claims", "again")


class Checked(NamedTuple):
    """Result of checking a packed round.

    wrong: a sentence for each difference from the commitments. off: largest differences of numbers of the marks that
    were worked out again (truearc_proof.rounds.reproducibility). seed: of the sample of worlds that were made again.
    others: hashes of other states of the solver, by which worlds were claimed.
    """

    sealed: int
    graded: int
    remade: tuple[str, ...]
    wrong: tuple[str, ...]
    off: Mapping[str, float]
    seed: int
    others: tuple[str, ...] = ()


def pack(room: Room, path: Path) -> None:
    """Write a .tar.xz of all but the data; InputError for a round with unmarked or external worlds.

    The data of an external world cannot be made again here.
    """
    open_yet = [name for name, done in room.steps().items() if name != HOME and GRADED not in done]
    if open_yet:
        raise InputError(f"{room.ledger}: {', '.join(open_yet[:5])}: not marked yet; `truearc prove grade` first")
    if any(_drawn(room, name).engine == OWN for name in room.steps()):
        raise InputError(f"{room.ledger}: has an external world, whose data cannot be made again: keep the "
                         f"directory")
    files = [file for name in KEPT for file in sorted([room.root / name, *(room.root / name).rglob("*")])
             if file.is_file()]
    with tarfile.open(path, "w:xz", preset=9) as tar:
        for file in files:
            entry = tarfile.TarInfo(file.relative_to(room.root).as_posix())     # no owner, no time of day
            data = file.read_bytes()
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))


def unpack(path: Path, room: Room) -> None:
    """Unpack a round; InputError where the directory exists already, or the file is not a packed round."""
    if room.root.exists():
        raise InputError(f"{room.root}: is there already")
    try:
        with tarfile.open(path, "r:xz") as tar:
            size = 0
            for entry in tar:         # in order: none is unpacked before its size is known
                size += entry.size
                if size > MAX_BYTES:
                    raise InputError(f"{path}: unpacks to more than {MAX_BYTES} bytes: no round is as large")
            tar.extractall(room.root, filter="data")
    except (OSError, tarfile.TarError, EOFError, lzma.LZMAError) as error:
        raise InputError(f"{path}: {error}") from error
    if not room.ledger.is_file():
        raise InputError(f"{path}: has no ledger.jsonl: no round was packed there")


def remake(room: Room, name: str, done: dict[str, str]) -> list[str]:
    """Make a world's data again; what of them is not as it was committed to."""
    drawn = _drawn(room, name)
    for directory in (room.data(name), room.more(name)):
        shutil.rmtree(directory, ignore_errors=True)
        directory.parent.mkdir(parents=True, exist_ok=True)
    make_data(drawn, room.data(name))
    if ANSWERED in done:
        answer(drawn, asked_of(room, name), room.more(name))
    return check_world(room, name, done)


def check_round(room: Room, worlds: int, progress: Progress, seed: int | None = None,
                remake: Callable[[Room, str, dict[str, str]], list[str]] = remake,
                mark: Callable[[Path, tuple[Drawn, bool]], Graded] = mark_world) -> Checked:
    """Make the data of `worlds` worlds again, compare all hashes, and mark them again.

    The sample is drawn from the seed; without one, from entropy, so that no player can predict it. For all worlds:
    their seals, claims and marks must be, to the letter, those in the ledger, and drawn from the seed of the round.
    """
    steps = room.steps()
    wrong = [line for name, done in steps.items() for line in _check_papers(room, name, done)]
    unlike = [*wrong_marks(room.grades, steps), *missing_marks(room.grades, steps)]
    wrong += [*left_out(room, steps), *check_draw(room, steps), *unlike]
    seed = entropy() if seed is None else seed
    chosen = _sample([name for name in steps if name != HOME], worlds, seed)
    marked = {} if unlike else {one.world: one for one in graded_of(room)}
    off = dict.fromkeys(TOLERANCE, 0.0)
    for number, name in enumerate([*([HOME] if HOME in steps else []), *chosen]):
        progress(number / (len(chosen) + 1), f"{name} is made again")
        changed = remake(room, name, steps[name])
        wrong += changed
        if name in marked and not changed:
            again = CLAIMED_AGAIN in steps[name]
            compared = compare(marked[name], mark(room.root, (_drawn(room, name), again)),
                               solver_of(room, name) == solver_id())
            wrong += [f"{room.claims(name)}: is marked otherwise now: {one}" for one in compared.other]
            off = {number: max(far, compared.off[number]) for number, far in off.items()}
    progress(1.0, f"{len(chosen)} worlds made again")
    others = {solver_of(room, name) for name in marked} - {solver_id()}
    return Checked(len(steps), sum(GRADED in done for done in steps.values()), chosen, tuple(dict.fromkeys(wrong)), off,
                   seed, tuple(sorted(others)))


def _check_papers(room: Room, name: str, done: dict[str, str]) -> list[str]:
    wrong = [] if load_seal(room.seal(name)).commitment == done.get(SEALED) else [
        f"{room.seal(name)}: is not what was sealed"]
    for step, path in ((CLAIMED, room.claims(name)), (CLAIMED_AGAIN, room.again(name))):
        if step in done and (not path.is_file() or digest(path.read_bytes()) != done[step]):
            wrong.append(f"{path}: is not what was claimed")
    return wrong


def _drawn(room: Room, name: str) -> Drawn:
    return drawn_of(load_seal(room.seal(name)).world, room.seal(name))


def _sample(names: Sequence[str], count: int, seed: int) -> tuple[str, ...]:
    """Draw `count` of them, in their order."""
    places = np.random.default_rng(seed).choice(len(names), min(count, len(names)), replace=False)
    return tuple(names[place] for place in sorted(places))
