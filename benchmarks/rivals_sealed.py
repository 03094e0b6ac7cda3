"""Intervals and forecasts of all methods in a packed sealed round that rivals were put to.

    python -m benchmarks.rivals_sealed docs/measured/sealed/L2d.tar.xz

Interval: of the first name, 90 %, where that name is the one that was hidden. Error: RMS height at the end of hold-out
tracks, forecast from their first 40 %, by what is believed and by what the method puts in; the median over the worlds
in which truearc finds something that is there. What each names and claims: `python -m benchmarks.proof FILE`.
"""

import argparse
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from benchmarks.archives import stored_file
from truearc_proof.rounds.archive import unpack
from truearc_proof.rounds.documents import load_seal
from truearc_proof.rounds.grader import graded_of
from truearc_proof.rounds.ledger import Room
from truearc_proof.scoring.score_world import NULLS
from truearc_proof.table import make_markdown

OURS = "truearc"


class Said(NamedTuple):
    """One method's answer to one world: errors in m, and whether its interval holds the truth; None: no such name."""

    before_m: float | None
    after_m: float | None
    holds: bool | None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packed", type=stored_file)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        room = Room(Path(folder) / "round")
        unpack(args.packed, room)
        answers: dict[str, list[Said]] = {}
        for mark in (one.first for one in graded_of(room)):
            if mark.kind not in NULLS:
                truth = load_seal(room.seal(mark.world)).world.get("effects") or {}
                claims = msgspec.json.decode(room.claims(mark.world).read_bytes())
                for name, said in _answers(claims, truth):
                    answers.setdefault(name, []).append(said)
    rows = [(name, _counted([one.holds for one in said]), f"{_median(said, 0):.2f} -> {_median(said, 1):.2f} cm")
            for name, said in answers.items()]
    print(make_markdown(("method", "interval holds, of first names right", "error of track ends, median"), rows))


def _answers(claims: Mapping[str, Any], truth: Mapping[str, float]) -> Iterator[tuple[str, Said]]:
    finding = claims["finding"]
    first = finding["what"][0] if finding["what"] else None
    fit = finding.get("fit") or {}
    forecast = fit.get("height_rmse_after_m") is not None
    if finding["mismatch"]["found"]:
        sizes = next(iter(first["parameters"].values())) if first and first["parameters"] else None
        yield OURS, Said(fit.get("height_rmse_before_m"), fit.get("height_rmse_after_m"),
                         _holds(first["term"], sizes, truth) if first and sizes else None)
    for name, said in claims.get("rivals", {}).items():
        named = said["names"][0] if said["names"] and said["says_something"] else None
        errors = (said["before_m"], said["after_m"]) if forecast else (None, None)
        yield name, Said(*errors, _holds(named, said["figures"], truth))


def _holds(term: str | None, interval: Mapping[str, float], truth: Mapping[str, float]) -> bool | None:
    if term not in truth or "low90" not in interval:
        return None
    return bool(interval["low90"] <= truth[term] <= interval["high90"])


def _counted(holds: list[bool | None]) -> str:
    known = [one for one in holds if one is not None]
    return f"{sum(known)} of {len(known)}" if known else "-"


def _median(said: list[Said], place: int) -> float:
    known = [one[place] for one in said if one[place] is not None]
    return 100.0 * float(np.median(known)) if known else np.nan


if __name__ == "__main__":
    main()
