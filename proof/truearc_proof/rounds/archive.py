"""The archive of a finished round in one file, without its data, which the opened seals reproduce byte for byte.

First claims are recomputed from the released data alone and must earn the same marks, which shows that they do not use
the truth. Only the same solver, identified by its hash, makes the same claims. The claims of rivals are not recomputed,
and further shots in older rounds are ignored.

In two gradings of one world, the claims, the truth and the correctness must be identical, and numbers computed from the
data must agree within the precision of different machines. The grader's own numbers (the ceiling that the data allow)
come from the solver's fits. With a different version of the solver they may differ; this is reported but not counted as
a difference.
"""

import io
import lzma
import shutil
import tarfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from truearc.errors import MAX_BYTES, InputError
from truearc.sim.printed import Progress
from truearc_proof.rounds import Room, Step, append, digest, grader, load_seal
from truearc_proof.rounds.committer import entropy
from truearc_proof.rounds.marks import Mark
from truearc_proof.rounds.solver import solver_id
from truearc_proof.rounds.worlds import HOME, OWN, Drawn, drawn_of, make_data

KEPT = ("ledger.jsonl", "grades.jsonl", "keeper", "claims")
NEARLY = 1e-3                         # what other machines' rounding makes of a fit
ROUNDING = 1e-6                       # of sums in another order; forty worlds marked again were off by 2e-12 at most
# Of a chance drawn 2000 times, threshold and all, twice: drawn by six seeds in sixteen worlds it had a standard
# deviation of .023 at most, and two were .06 apart at most; of 24 published ones the worst was off by .04.
DRAWN = 0.08
TOLERANCE: Mapping[str, float] = {"error": ROUNDING, "off_m": ROUNDING, "allowed": DRAWN}
SOLVED_AGAIN = dict.fromkeys((*TOLERANCE, "p_value", "said", "unexplained"), NEARLY)
FITTED = ("alias", "rivals")          # hang on which terms the fits cannot tell apart


class Checked(NamedTuple):
    """Result of checking a packed round.

    wrong: a sentence for each difference from the commitments. off: largest differences of recomputed numbers of the
    marks (truearc_proof.rounds.archive). seed: of the sample of recreated worlds. others: hashes of other states of the
    solver that claimed worlds.
    """

    sealed: int
    graded: int
    remade: tuple[str, ...]
    wrong: tuple[str, ...]
    off: Mapping[str, float]
    seed: int
    others: tuple[str, ...] = ()


def pack(room: Room, path: Path) -> None:
    """Write a .tar.xz of everything but the data; InputError for a round with unmarked or external worlds.

    The data of an external world cannot be recreated here.
    """
    open_yet = [name for name, done in room.steps().items() if name != HOME and Step.GRADED not in done]
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
    """Unpack a round; InputError if the directory already exists, or the file is not a packed round."""
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
    """Recreate a world's data; return what differs from the commitment."""
    drawn = _drawn(room, name)
    shutil.rmtree(room.data(name), ignore_errors=True)
    room.data(name).parent.mkdir(parents=True, exist_ok=True)
    make_data(drawn, room.data(name))
    return grader.check_world(room, name, done)


def check_round(room: Room, worlds: int, progress: Progress, seed: int | None = None,
                remake: Callable[[Room, str, dict[str, str]], list[str]] = remake,
                mark: Callable[[Path, Drawn], grader.Graded] = grader.mark_world) -> Checked:
    """Recreate the data of `worlds` worlds, compare all hashes, and mark them again.

    The sample is drawn from the seed; without one, from entropy, so that no player can predict it. For all worlds,
    seals, claims and marks must be exactly those in the ledger, and drawn from the seed of the round.
    """
    steps = room.steps()
    wrong = [line for name, done in steps.items() for line in _check_papers(room, name, done)]
    unlike = [*grader.wrong_marks(room.grades, steps), *grader.missing_marks(room.grades, steps)]
    wrong += [*grader.left_out(room, steps), *grader.check_draw(room, steps), *unlike]
    seed = entropy() if seed is None else seed
    names = [name for name in steps if name != HOME]
    places = np.random.default_rng(seed).choice(len(names), min(worlds, len(names)), replace=False)
    chosen = tuple(names[place] for place in sorted(places))
    marked = {} if unlike else {one.world: one for one in grader.graded_of(room)}
    off = dict.fromkeys(TOLERANCE, 0.0)
    for number, name in enumerate([*([HOME] if HOME in steps else []), *chosen]):
        progress(number / (len(chosen) + 1), f"{name} is made again")
        changed = remake(room, name, steps[name])
        wrong += changed
        if name in marked and not changed:
            compared = compare_gradings(marked[name], mark(room.root, _drawn(room, name)),
                                        solver_of(room, name) == solver_id())
            wrong += [f"{room.claims(name)}: is marked otherwise now: {one}" for one in compared.other]
            off = {number: max(far, compared.off[number]) for number, far in off.items()}
    progress(1.0, f"{len(chosen)} worlds made again")
    others = {solver_of(room, name) for name in marked} - {solver_id()}
    return Checked(len(steps), sum(Step.GRADED in done for done in steps.values()), chosen, tuple(dict.fromkeys(wrong)),
                   off, seed, tuple(sorted(others)))


def _check_papers(room: Room, name: str, done: dict[str, str]) -> list[str]:
    wrong = [] if load_seal(room.seal(name)).commitment == done.get(Step.SEALED) else [
        f"{room.seal(name)}: is not what was sealed"]
    path = room.claims(name)
    if Step.CLAIMED in done and (not path.is_file() or digest(path.read_bytes()) != done[Step.CLAIMED]):
        wrong.append(f"{path}: is not what was claimed")
    return wrong


def _drawn(room: Room, name: str) -> Drawn:
    return drawn_of(load_seal(room.seal(name)).world, room.seal(name))


def give_away(room: Room, names: Sequence[str], away: Path) -> Room:
    """Copy the data of these worlds and their seals' hashes and nothing else, as an external solver receives a
    round."""
    other, steps = Room(away), room.steps()
    for name in (*([HOME] if HOME in steps else []), *names):
        shutil.copytree(room.data(name), other.data(name))
        append(other.ledger, Step.SEALED, name, steps[name][Step.SEALED])
    return other


def solver_of(room: Room, name: str) -> str:
    """Return the hash that a world's claims carry; whatever else is in them is not checked here."""
    return str(msgspec.json.decode(room.claims(name).read_bytes()).get("solver"))


def compare_claims(room: Room, other: Room, name: str) -> tuple[str, ...]:
    """Return a sentence for each mark that claims about a world in the other round would get otherwise; numbers may be
    off by NEARLY, as fits are between machines."""
    was, now = (grader.mark_world(one.root, _drawn(room, name)) for one in (room, other))
    return tuple(f"{room.claims(name)}: solved again, its {line}"
                 for line in compare_gradings(was, now, tolerance=SOLVED_AGAIN).other)


class Compared(NamedTuple):
    """other: a sentence for each difference; off: {number: how far it is off at most}, of TOLERANCE; a number
    larger than 1 in parts of itself."""

    other: tuple[str, ...]
    off: Mapping[str, float]


def compare_gradings(was: grader.Graded, now: grader.Graded, fits_alike: bool = True,
                     tolerance: Mapping[str, float] = TOLERANCE) -> Compared:
    """Compare two gradings of one world, field by field.

    The largest difference of each number with a tolerance is reported even within it; all others must be equal.

    Args:
        was: As published.
        now: As marked again.
        fits_alike: Both by one state of the solver, so that its fits are the same.
        tolerance: By field.
    """
    other, off = [], dict.fromkeys(tolerance, 0.0)
    for name in Mark.__struct_fields__:
        old, new = getattr(was.first, name), getattr(now.first, name)
        far = _far(old, new) if name in tolerance else None
        if far is not None:
            off[name] = max(off[name], far)
        if not fits_alike and (name in tolerance or name in FITTED):
            continue
        if (far is None and old != new) or (far is not None and not far <= tolerance[name]):
            other.append(f"{name} is {new!r}, was {old!r}")
    return Compared(tuple(other), off)


def _far(old: Any, new: Any) -> float | None:
    """None where they are not as many numbers."""
    before, after = (one if isinstance(one, tuple) else (one,) for one in (old, new))
    if len(before) != len(after) or None in (*before, *after):
        return None
    farthest: float | None = max(abs(one - two) / max(1.0, abs(one)) for one, two in zip(before, after, strict=True))
    return farthest
