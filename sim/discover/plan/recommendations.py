"""What to do next: a measurement that no shot can replace, and the shots of these that part the likeliest names."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.sim.data.columns import SPIN_VECTOR
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.detect.covariates import IN_FLIGHT
from truearc.sim.discover.detect.test_battery import name_of
from truearc.sim.discover.plan.detectability import sight_of
from truearc.sim.discover.select.name_effects import Step
from truearc.sim.discover.select.refit import Refit
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.infer.plausibility.flaw import RPM
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.term import Term, WatchTerm

SHOTS = 20
STAND_IN = "wind_z"                   # rising air pushes as lift does
FEW = 3                               # measurements proposed at most


def next_steps(dataset: Dataset, step: Step, chosen: tuple[str, ...] | None) -> tuple[dict[str, Any], ...]:
    """The configuration among the shots at which the two likeliest names differ most, measurements that settle the
    names that compete (or confirm the only one), and what to note of every shot from now on."""
    if chosen is None:
        vertical = step.place is not None and step.place.column.direction == "vertical"
        return (*_spin(dataset, vertical), *_about_unknown(step), *_sides(dataset))
    among = step.fitted.layout.chain.catalogue
    instruments = [term.instrument for name in chosen for term in among.find([name])]
    tracked = dataset.tracks is not None or dataset.times is not None
    wanted = {one.id: one.what for one in instruments if one is not None and not (tracked and one.filmed)}
    steps: list[dict[str, Any]] = [*_spin(dataset, STAND_IN in chosen),
                                   *({"do": "measure", "instrument": name, "what": what}
                                     for name, what in list(wanted.items())[:FEW])]
    if len(step.chosen) < 2:
        return tuple(steps)
    shot = parting_shot(dataset, step, (step.chosen[0], step.chosen[1]))
    return (*([shot] if shot else []), *steps, *_sides(dataset))


def has_spin(dataset: Dataset) -> bool:
    """Return whether lift can be tested: spin was measured, or there are wheels that give it."""
    return bool(dataset.rig.launcher.wheel) or any(
        np.isfinite(dataset.shots.number(name)).any() for name in ("exit_spin_rev_s", *SPIN_VECTOR))


def _spin(dataset: Dataset, like_lift: bool) -> tuple[dict[str, Any], ...]:
    """What looks like lift asks for the spin, where lift could not be tested."""
    return ({"do": "measure", "record": "exit_spin_rev_s", "what": "the spin of a marked ball as it leaves (column "
             "exit_spin_rev_s): missing lift would look like this"},) if like_lift and not has_spin(dataset) else ()


def blind_terms(evidence: ScoreTable, threshold: float, among: Catalogue) -> list[Term]:
    """Terms that these shots would not have shown at their usual size, four times in five, among all that was asked.

    Those that move shots most come first, whether or not fitted numbers can stand in for them. threshold: the |score|
    that a term needs, in standard deviations.
    """
    blind = [one for one in sight_of(evidence, "", (), threshold).terms
             if one.smallest is None or one.smallest > one.usual]
    blind.sort(key=lambda one: -one.usual**2 * one.information / max(one.share_left, 1e-9))
    return [term for one in blind if (term := among.get(one.term)) is not None]


def measure_blind(blind: Sequence[Term], tracked: bool) -> tuple[dict[str, Any], ...]:
    """The measurements for the first of these terms; none of flights that are filmed already."""
    found: dict[str, tuple[str, list[str]]] = {}
    for term in blind:
        if term.instrument is not None and not (tracked and (isinstance(term, WatchTerm) or term.instrument.filmed)):
            found.setdefault(term.instrument.id, (term.instrument.what, []))[1].append(term.name)
    return tuple({"do": "measure", "instrument": name, "what": what, "shows": terms}
                 for name, (what, terms) in list(found.items())[:FEW])


def measure_names(names: Sequence[str], among: Catalogue) -> tuple[dict[str, Any], ...]:
    """The measurements that settle which of these terms it is."""
    wanted = {term.instrument.id: term.instrument.what for term in among.find(names) if term.instrument is not None}
    return tuple({"do": "measure", "instrument": name, "what": what} for name, what in list(wanted.items())[:FEW])


def _about_unknown(step: Step) -> tuple[dict[str, Any], ...]:
    """An unexplained effect is looked for beside the covariate that it goes with."""
    place = step.place
    name = None if place is None else name_of(place.test, place.column)
    if name is None or name in IN_FLIGHT:
        if step.fitted.intake.filmed:
            return _of_filmed(step)
        return ({"do": "measure", "record": "tracks", "what": "the flight with a camera from the side (tracks.csv)"},)
    return ({"do": "measure", "covariate": name, "what": f"what else changes with {name}, which it goes with"},)


def _of_filmed(step: Step) -> tuple[dict[str, Any], ...]:
    """What settles the nearest name, if it is not seen on film anyway; else the wind, where there can be one."""
    (term,) = step.fitted.layout.chain.catalogue.find([step.naming.leader.partition(".")[0]])
    if term.instrument is not None and not term.instrument.filmed:
        return ({"do": "measure", "instrument": term.instrument.id, "what": term.instrument.what},)
    site = step.fitted.intake.rig.site
    if site and site.indoor:
        return ()
    return ({"do": "measure", "instrument": "anemometer", "what": "the wind with an anemometer"},)


def _sides(dataset: Dataset) -> tuple[dict[str, Any], ...]:
    """A shot without a side tells half of what it could."""
    outcome, side = dataset.shots.text("outcome"), dataset.shots.text("side")
    hit = "hit" if dataset.rig.target and dataset.rig.target.hit_or_miss else "two"
    blind = {word: sum(one == said and not where for one, where in zip(outcome, side, strict=True))
             for word, said in (("miss", "miss"), (hit, "two"))}
    if sum(blind.values()) <= 0.5 * sum(map(bool, outcome)):
        return ()
    words = " and each ".join(f"{word} ({count} lack it)" for word, count in blind.items() if count)
    return ({"do": "measure", "record": "side",
             "what": f"on which side of the centre, low or high, each {words} passes (column side)"},)


def parting_shot(dataset: Dataset, step: Step, pair: tuple[str, str]) -> dict[str, Any] | None:
    """The recorded configuration where the two, each fitted, forecast the most different heights; None where SHOTS of
    them would hardly tell the two apart."""
    evidence = step.fitted.evidence
    plane = evidence.plane
    if plane is None or any(name not in step.naming.refits for name in pair):
        return None
    changes = (np.tile(moved_by(evidence, step.naming.refits[name]), (len(evidence.rows), 1)) for name in pair)
    one, other = (evidence.heights(change)[1] for change in changes)
    apart = np.abs(one - other) / plane.spread_m
    if apart.max() * SHOTS**0.5 < 1.0:
        return None
    shot = int(evidence.rows[plane.rows[int(apart.argmax())]])
    numbers = {name: dataset.shots.number(name)[shot] for name in ("distance_m", "hood_deg", "motor_ratio")}
    if not np.isfinite(list(numbers.values())).all():
        return None
    free_rad_s = dataset.rig.launcher.free_speed_rad_s
    rpm = {"motor_rpm": round(float(numbers["motor_ratio"]) * free_rad_s / RPM)} if free_rad_s else {}
    return {"do": "shoot", **{name: round(float(value), 3) for name, value in numbers.items()}, **rpm, "shots": SHOTS,
            "separates": [name.partition(".")[0] for name in pair]}


def moved_by(evidence: ScoreTable, one: Refit) -> Float[Array, " P"]:
    """Change [P] of the evidence's columns that a refit of one name amounts to.

    A name that is a fitted number itself (one that has changed since the belief) stands in that number's place: it is
    then a move from where the number was fitted, not from where it was believed.
    """
    (name,) = one.names
    shared = range(evidence.first_shared, len(evidence.columns))
    rest = [k for k in shared if evidence.columns[k].name != name]
    change = np.zeros(len(evidence.columns))
    change[rest] = one.evidence.point[1:] - evidence.point[rest]
    if len(rest) == len(shared):
        change[evidence.index(name)] = one.amplitude[0]
    for k in set(shared) - set(rest):
        change[k] = one.evidence.point[0] - evidence.point[k]
    return change
