"""What each rule beside the posterior earns: worlds right with it and without it, where it changes the answer.

    python -m benchmarks.naming_rules --level L1 --worlds 120 --seed 731 --out FILE
    python -m benchmarks.naming_rules --table FILE

Worlds as in benchmarks.naming, of development: none is sealed. Each is answered by all rules. Where a rule has acted,
the world is answered again without it. Right: of what a term has, a set that holds it; of two things, both; of what
no term has, unknown or a set.
"""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.filling import fill_and_tell, parser_of
from benchmarks.naming import Line, answer_of, are_both, is_held
from truearc.cli.common import make_progress
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover import decide
from truearc.sim.discover.investigate import discover
from truearc.sim.discover.select.effects import Search
from truearc.sim.discover.select.posterior import Hypotheses
from truearc.sim.discover.select.terms import Naming
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.tables import make_text
from truearc_proof.rounds.jsonl_store import fill
from truearc_proof.scoring.score_world import right_names
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.sampling_plan import NUMPY, Drawn, draw_round

NATURE, NATURE_TWO = "a name that moves a known number by 4 sd is unknown", "the same of a second name"
NOTHING, ODDS = "a name that gains nothing is unknown", "more than one: the data raise its odds tenfold"
LEFT, SAME = "more than one: a test finds something beside the first", "an unknown rest in the name's own direction"
TWINS, ALONE = "sets hold what hardly differs from a name", "one name alone has 90 %, not only 90 % of the explained"
WHAT = (NATURE, NATURE_TWO, NOTHING, ODDS, LEFT, SAME, TWINS, ALONE)


class Switch:
    """Rules of decide, one of which may be off; `acted`: which had something to say."""

    def __init__(self, off: str | None) -> None:
        self.off, self.acted = off, set[str]()

    def act(self, rule: str, fires: bool) -> bool:
        """Whether a rule fires, and is on."""
        if fires:
            self.acted.add(rule)
        return fires and rule != self.off

    @contextlib.contextmanager
    def turned(self) -> Iterator[None]:
        """Discovery by these rules."""
        with contextlib.ExitStack() as stack:
            for place, name, rule in ((decide, "out_of_nature", self._nature), (decide, "says_nothing", self._nothing),
                                      (Search, "left", self._left), (decide, "_direction", self._direction),
                                      (decide, "credible_set", self._named), (decide, "holds_more", self._more)):
                stack.enter_context(patch.object(place, name, rule(getattr(place, name))))
            yield

    def _nature(self, rule: Callable[..., bool]) -> Callable[..., bool]:
        return lambda found, before: self.act(NATURE if isinstance(before, BaselineFit) else NATURE_TWO,
                                              rule(found, before))

    def _nothing(self, rule: Callable[..., bool]) -> Callable[..., bool]:
        return lambda naming: self.act(NOTHING, rule(naming))

    def _left(self, rule: Callable[..., Any]) -> Callable[..., Any]:
        def left(search: Search, fitted: BaselineFit) -> Any:
            found = rule(search, fitted)
            if found is None and self.act(LEFT, True):
                return None
            return found or rule(replace(search, false_alarm=1.0), fitted)
        return left

    def _direction(self, rule: Callable[..., str]) -> Callable[..., str]:
        """The rule compares it with the name's."""
        return lambda fitted, change: rule(fitted, change) if self.act(SAME, True) else "none"

    def _more(self, rule: Callable[..., bool]) -> Callable[..., bool]:
        def holds_more(found: Hypotheses) -> bool:
            likely = found.share("two") + found.share("both") >= decide.MORE
            return likely and not self.act(ODDS, not rule(found))
        return holds_more

    def _named(self, rule: Callable[..., tuple[str, ...]]) -> Callable[..., tuple[str, ...]]:
        def named(naming: Naming, found: Hypotheses | None, beside: bool = False) -> tuple[str, ...]:
            whole = rule(naming, found, beside)
            if found is None:
                return whole
            bare = rule(replace(naming, kin={}), found, beside)
            if whole != bare and not self.act(TWINS, True):
                whole = bare
            with patch.object(decide, "SURE", 0.0):
                first = rule(replace(naming, kin={}), found, beside)[:1]
            explained = 1.0 - (found.share("unexplained") if beside else found.unexplained())
            lone = (found.held_by(first, beside) >= decide.SURE * explained
                    and naming.probability[first[0]] < decide.SURE)
            return whole if self.act(ALONE, lone) or not lone else first
        return named


def run(drawn: Drawn) -> Line:
    """Answers of one world: by all rules, and without each that has acted."""
    keep_compiled()
    shots = shoot(make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt))
    answers: dict[str, Line] = {}

    def answer(off: str | None) -> set[str]:
        switch = Switch(off)
        with switch.turned():
            answers[off or "all"] = answer_of(discover(shots, seed=0).finding)
        return switch.acted

    for rule in sorted(answer(None)):
        answer(rule)
    return {"kind": drawn.kind, "dirt": drawn.dirt, "effects": drawn.effects, "right": right_names(drawn),
            "answers": answers}


def make_table(lines: Sequence[Line]) -> str:
    """A row a rule: how often it acted and changed the answer, and what was right with it and without."""
    found = [line for line in lines if line["answers"]["all"]["found"] and line["kind"] not in ("clean", "dirty")]
    rows = []
    for rule in WHAT:
        acted = [line for line in found if rule in line["answers"]]
        pairs = [(_scored(line, "all"), _scored(line, rule)) for line in acted
                 if _told(line, "all") != _told(line, rule)]
        rows.append((rule, str(len(acted)), str(len(pairs)), *(
            f"{sum(bool(on[key]) for on, _ in pairs)}, {sum(bool(off[key]) for _, off in pairs)}"
            for key in ("right", "wrong")), f"{_mean(on['size'] for on, _ in pairs)}, "
            f"{_mean(off['size'] for _, off in pairs)}"))
    return "\n".join([f"{len(lines)} worlds, {len(found)} of them changed and found; with the rule, without it",
                      *make_text(("rule", "acted", "changed", "right", "single names wrong", "size"), rows,
                                 right=(1, 2, 3, 4, 5))])


def _told(line: Line, rule: str) -> tuple[Any, ...]:
    answer = line["answers"][rule]
    return answer["verdict"], sorted(answer["set"]), sorted(map(sorted, answer["also"]))


def _scored(line: Line, rule: str) -> dict[str, Any]:
    answer = {**line["answers"][rule], "right": line["right"]}
    names = set(answer["set"])
    right = (answer["verdict"] != "named" if not line["right"] else are_both(answer) if line["kind"] == "two"
             else is_held(answer))
    return {"right": right, "wrong": answer["verdict"] == "named" and not names & set(line["right"]),
            "size": len(names) or None}


def _mean(sizes: Iterator[int | None]) -> str:
    known = [size for size in sizes if size]
    return f"{sum(known) / len(known):.1f}" if known else "-"


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--level", choices=("L0", "L1", "L2"), default="L1")
    parser.add_argument("--worlds", type=int, default=120)
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--seed", type=int, default=731)
    args = parser.parse_args()
    return fill_and_tell(args, partial(_run_all, args), make_table)


def _run_all(args: argparse.Namespace, path: Path) -> dict[str, Line]:
    worlds = draw_round(args.seed, args.worlds, args.level, args.shots, (NUMPY,))
    jobs = {f"{args.seed}/{args.level}/{one.name}": one for one in worlds}
    return fill(path, jobs, run, make_progress("worlds"), args.processes)


if __name__ == "__main__":
    sys.exit(main())
