"""First claims made again from the released data alone, which shows that they do not come from the truth.

Only the very solver, by its hash, makes the same claims. Claims of rivals, follow-up requests and second claims are not
made again.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from truearc_proof.rounds.ledger import append
from truearc_proof.rounds.round_layout import SEALED, Room
from truearc_proof.scoring.score_finding import said_set, said_stage
from truearc_proof.worlds.generate_data import HOME

NEARLY, ZERO = 1e-3, 1e-6             # of a number, and of one near 0: what other machines' rounding makes of a fit


def give_away(room: Room, names: Sequence[str], away: Path) -> Room:
    """A round with the data of these worlds and their seals' hashes and nothing else, as a solver elsewhere gets it."""
    other, steps = Room(away), room.steps()
    for name in (*([HOME] if HOME in steps else []), *names):
        shutil.copytree(room.data(name), other.data(name))
        append(other.ledger, SEALED, name, steps[name][SEALED])
    return other


def solver_of(room: Room, name: str) -> str:
    """Return the hash that a world's claims carry; whatever else is in them is not checked here."""
    return str(msgspec.json.decode(room.claims(name).read_bytes()).get("solver"))


def compare_claims(room: Room, other: Room, name: str) -> tuple[str, ...]:
    """Return a sentence for each difference between the claims; numbers may be off by NEARLY."""
    was, now = (_told(msgspec.json.decode(one.claims(name).read_bytes())) for one in (room, other))
    return tuple(f"{room.claims(name)}: {line}" for line in _unlike("", was, now))


def _told(claims: Mapping[str, Any]) -> dict[str, Any]:
    """What marks are made of. Names by name: two as likely as each other come in either order."""
    finding = claims["finding"]
    where, unknown = finding.get("where") or {}, finding.get("unknown") or {}
    what = {one["term"]: [one.get("probability"), one.get("parameters")] for one in finding.get("what") or ()}
    also = [sorted(one.get("set") or ()) for one in finding.get("also") or ()]
    return {"verdict": finding["verdict"], "found": finding["mismatch"]["found"],
            "p_value": finding["mismatch"].get("p_value"), "set": sorted(said_set(finding)), "what": what, "also": also,
            "stage": said_stage(where), "goes with": [where.get("covariate"), where.get("direction"),
                                                      sorted(where.get("inseparable") or ()),
                                                      unknown.get("covariate"), unknown.get("direction")],
            "fit": finding.get("fit"), "believed": claims.get("believed")}


def _unlike(key: str, was: Any, now: Any) -> Iterator[str]:
    """Yield a line for each place where two plain JSON values differ.

    For claims, whose keys are open: any tree of values, one tolerance (NEARLY, ZERO) for every number, by which a fit
    differs between machines. Marks have a tolerance for each field; truearc_proof.rounds.reproducibility compares them.
    """
    if isinstance(was, Mapping) and isinstance(now, Mapping) and set(was) == set(now):
        for name in was:
            yield from _unlike(f"{key}.{name}" if key else name, was[name], now[name])
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for place, (one, other) in enumerate(zip(was, now, strict=True)):
            yield from _unlike(f"{key}[{place}]", one, other)
    elif not _same(was, now):
        yield f"claims {key} {_short(was)}; solved again, it is {_short(now)}"


def _same(was: Any, now: Any) -> bool:
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (was, now))
    if not numbers:
        return type(was) is type(now) and bool(was == now)
    return bool(abs(was - now) <= NEARLY * abs(was) + ZERO)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."
