"""Marks of one opened world: what was claimed against what was true.

The name of a decoy, which changes much and does nothing, is false, whatever it resembles. Marks keep what the data
cannot tell apart, the decoy's name with it; here it is put right, for older rounds too.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec import Struct, structs

from truearc_proof.scoring import score_finding
from truearc_proof.scoring.oracle import Measured
from truearc_proof.worlds.sampling_plan import ALIKE, DECOY, MUJOCO, OWN, Drawn, changes_of

Finding = Mapping[str, Any]
NULLS = ("clean", "dirty")
SHOTS, MEASUREMENT = "shots", "measurement"
MEASUREMENT_1 = "one measurement"     # in marks of rounds up to tag proof-1


class Mark(Struct, frozen=True):
    """One world's; None where the question does not arise. `hidden`: what was true of it.

    first: the first name is right. alias: or of a class with the right one, be it a decoy's
    (`up_to_alias` takes those out). covered: the set has a right name. both: of two effects both are
    named. error: amplitude of the right name, less the truth, over the best standard error that anybody could have
    (Cramer and Rao). gain: held out, nats a shot, by the solver's own word (its folds); oracle_gain: the same of the
    true term, by the grader. allowed: chances that the data allow to find, name, name up to alias, place. goes_with:
    covariate and direction of what is in no catalogue. right: names of the catalogue that would be right. off_m: RMS
    errors of heights in the sealed test, by what was believed, by what was adopted, and, where the grader knows it,
    by what is believed with the true term. asked: SHOTS, a MEASUREMENT or "". random: as many shots
    drawn like the first would have parted the names as well as those asked for. rivals: of others put to the same
    data, whether each says something, and of its first name what `first` and `alias` are of ours, decoys taken out.
    said, unexplained: probabilities that were claimed of the first name, and of a change that no term explains.
    """

    world: str
    engine: str
    kind: str
    level: str
    shots: int
    hidden: tuple[str, ...]
    strength: float | None
    found: bool
    p_value: float | None
    verdict: str
    names: tuple[str, ...]
    set_size: int | None = None
    stage: bool | None = None
    first: bool | None = None
    alias: bool | None = None
    covered: bool | None = None
    both: bool | None = None
    holds: bool | None = None
    error: float | None = None
    gain: float | None = None
    oracle_gain: float | None = None
    allowed: tuple[float, ...] | None = None
    goes_with: bool | None = None
    right: tuple[str, ...] = ()
    rivals: dict[str, tuple[bool, bool | None, bool | None]] = {}
    off_m: tuple[float, ...] | None = None
    asked: str = ""
    random: int | None = None
    said: float | None = None
    unexplained: float | None = None

    def __post_init__(self) -> None:
        if self.asked == MEASUREMENT_1:
            structs.force_setattr(self, "asked", MEASUREMENT)


def mark(drawn: Drawn, finding: Finding, measured: Measured, rivals: Mapping[str, Any] | None = None) -> Mark:
    """Against the sealed truth; `measured`: what the data themselves allow, as far as it was worked out; rivals:
    {name: its claim (truearc_proof.rivals.claim)}."""
    names, found = score_finding.names_ranked(finding)[:1], bool(finding["mismatch"]["found"])
    further = [one["what"][0]["term"] for one in finding.get("also") or () if one.get("set") and one["what"]]
    said = score_finding.said_set(finding) if found else []
    plain = Mark(drawn.name, drawn.engine, drawn.kind, drawn.level, drawn.shots, hidden_of(drawn),
                 _strength(drawn, measured), found, finding["mismatch"].get("p_value"),
                 str(finding["verdict"]), tuple(said) if finding["verdict"] in ("named", "set") else (),
                 len(said) if said else None)
    right, stages = right_names(drawn), right_stages(drawn)
    plain = structs.replace(plain, allowed=measured.allowed, right=right, rivals={
        name: mark_rival(drawn, claim, right, measured) for name, claim in (rivals or {}).items()})
    if not found or drawn.kind in NULLS:
        return plain
    likeliest = max((one.get("probability") or 0.0 for one in finding.get("what") or ()), default=None)
    more = {"said": likeliest, "unexplained": finding.get("unexplained"),
            "stage": score_finding.said_stage(finding.get("where") or {}) in stages if stages else None,
            "gain": (finding.get("fit") or {}).get("gain_per_shot"), "oracle_gain": measured.oracle_gain}
    if not right:                     # in no catalogue: only the stage can be right, and no name
        hidden = hidden_of(drawn)
        known = drawn.kind == "off" and len(hidden) == 1 and set(hidden) <= set(score_finding.GOES_WITH)
        goes_with = score_finding.goes_with_right(hidden[0], finding) if known else None
        return structs.replace(plain, **more, goes_with=goes_with)
    more |= {"first": bool(names) and names[0] in right, "covered": bool(set(said) & set(right)),
             "alias": _alike(drawn, names, right, measured)}
    if drawn.kind == "two":
        more["both"] = all({*names, *further} & set(each) for each in _right_of_each(drawn))
    return structs.replace(plain, **more, **_size(drawn, finding, measured))


def _strength(drawn: Drawn, measured: Measured) -> float | None:
    """Lambda in these very data where it was worked out, else by the ladder's table."""
    return min(drawn.strength.values(), default=None) if measured.strength is None else measured.strength


def _alike(drawn: Drawn, names: Sequence[str], right: Sequence[str], measured: Measured) -> bool:
    """Whether the first of these names is right, or of a class with a right one."""
    return bool(names) and (names[0] in right or names[0] in measured.alike
                            or any(score_finding.is_alias(drawn.level, name, names) for name in right))


def mark_rival(drawn: Drawn, claim: Mapping[str, Any], right: Sequence[str],
               measured: Measured) -> tuple[bool, bool | None, bool | None]:
    """Whether it says something, and of its first name whether it is right, or of a class with a right one; None where
    no name of the catalogue would be right."""
    says, names = bool(claim["says_something"]), list(claim["names"])[:1]
    if not right:
        return says, None, None
    # ours: up_to_alias
    decoy = drawn.engine != OWN and drawn.kind == "decoy" and names == [DECOY]
    return (says, says and bool(names) and names[0] in right,
            says and not decoy and _alike(drawn, names, right, measured))


def hidden_of(drawn: Drawn) -> tuple[str, ...]:
    """Return the names of the hidden effects, or of the changes of MuJoCo's robot."""
    if drawn.engine == MUJOCO:
        return tuple(change.name for change in changes_of(drawn.change))
    return tuple(drawn.effects)


def right_names(drawn: Drawn) -> tuple[str, ...]:
    """Names of the catalogue that would be right; none of what no catalogue has."""
    return tuple(dict.fromkeys(name for names in _right_of_each(drawn) for name in names))


def _right_of_each(drawn: Drawn) -> list[tuple[str, ...]]:
    """Names that would be right of each thing that is hidden; of MuJoCo's aliases those of the whole class are."""
    if drawn.engine == MUJOCO and drawn.kind == "alias":
        return [ALIKE[drawn.level]]
    if drawn.engine == MUJOCO:
        return [change.names for change in changes_of(drawn.change)]
    return [(name,) for name, amount in drawn.effects.items() if score_finding.in_catalogue(name, amount)]


def right_stages(drawn: Drawn) -> tuple[str, ...]:
    if drawn.engine == MUJOCO:
        alike = [(score_finding.STAGE_OF[name],) for name in ALIKE[drawn.level]] if drawn.kind == "alias" else None
        each: Sequence[tuple[str, ...]] = alike or [change.stages for change in changes_of(drawn.change)]
        return tuple(dict.fromkeys(stage for stages in each for stage in stages))
    return tuple(score_finding.STAGE_OF[name] for name in drawn.effects if name in score_finding.STAGE_OF)


def _size(drawn: Drawn, finding: Finding, measured: Measured) -> dict[str, Any]:
    """Whether the interval of the first name, where that is the one hidden effect, holds the truth, and its error."""
    first = score_finding.names_ranked(finding)[:1]
    if drawn.engine == MUJOCO or len(drawn.effects) != 1 or first != list(drawn.effects):
        return {}
    (name, amount), = drawn.effects.items()
    told = score_finding.in_catalogue(name, amount)
    if told is None:
        return {}
    parameter = told[0]
    truth = amount if drawn.engine == OWN else told[1]       # strangers state the catalogue's own number
    given = (next(one for one in finding["what"] if one["term"] == name).get("parameters") or {}).get(parameter)
    if given is None or given["low90"] is None or (drawn.level == "L0" and name in score_finding.BY_BALL):
        return {}                     # balls not told apart: wear is what it comes to by the end, not a ball's own
    error = None if measured.best_sd is None else (given["value"] - truth) / measured.best_sd
    return {"holds": given["low90"] <= truth <= given["high90"], "error": error}


def named_decoy(mark: Mark) -> bool | None:
    """Return whether the decoy's name comes first, alone or in a set.

    None in other worlds, and where the level's data have nothing of the decoy.
    """
    return None if _absent(mark) else mark.names[:1] == (DECOY,)


def has_decoy(mark: Mark) -> bool | None:
    """Whether its name is among those that are said."""
    return None if _absent(mark) else DECOY in mark.names


def up_to_alias(mark: Mark) -> bool | None:
    """Whether the first name is right or of a class with the right one, and no decoy's."""
    return mark.alias and not named_decoy(mark)


def _absent(mark: Mark) -> bool:
    return mark.engine == OWN or mark.kind != "decoy" or DECOY in score_finding.unseen(mark.level)
