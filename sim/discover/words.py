"""The verdict in sentences."""

import math
from collections.abc import Sequence

import numpy as np

from sim.discover.evidence import Evidence, shared_columns
from sim.discover.finding import Finding, Fit, Interval, Named, Unknown, Where
from sim.discover.locate import Place

STAGE_WORDS = {"sensing": "in what the sensors say", "launch": "at the launch", "flight": "in flight",
               "arrival": "at the target"}
DIRECTION_WORDS = {"along": "along the flight", "vertical": "vertically", "lateral": "sideways"}
EIGHTY = 7.85                         # what a 5 % test needs of amplitude^2 x information for 80 % power
SHOWN = 6


def say_named(believed: tuple[str, ...], p_value: float, where: Where, unknown: Unknown | None,
              what: Sequence[Named], chosen: tuple[str, ...] | None, also: Sequence[Named], fit: Fit,
              place: Place | None) -> str:
    """One name, or those that cannot be told apart, with the size and what it gains."""
    del unknown, place
    leader = what[0]
    names = chosen or (leader.term,)
    said = f"The simulation ({', '.join(believed)}) leaves something out (p = {p_value:.2g}). "
    if len(names) == 1:
        said += f"{leader.sentence} {_amplitude(leader)}"
    else:
        rest = [f"{one.term} ({one.probability:.0%})" for one in what if one.term in names]
        stages = sorted({STAGE_WORDS[one.stage] for one in what if one.term in names})
        said += (f"It lies {' or '.join(stages)}: {' or '.join(rest)}; these data cannot tell them apart. Likeliest: "
                 f"{leader.sentence} {_amplitude(leader)}")
    for one in also:
        said += f" Besides: {one.sentence} {_amplitude(one)}"
    return said + _gained(fit)


def say_unknown(believed: tuple[str, ...], p_value: float, where: Where, unknown: Unknown | None,
                what: Sequence[Named], chosen: tuple[str, ...] | None, also: Sequence[Named], fit: Fit,
                place: Place | None) -> str:
    """Nothing in the catalogue explains it; what it looks like all the same."""
    del chosen, also
    said = (f"The simulation ({', '.join(believed)}) leaves something out (p = {p_value:.2g}), and no term of the "
            f"catalogue explains it as well as a free curve does.")
    if unknown is None or place is None:
        return said
    words = place.column.words[unknown.amplitude < 0.0]
    follows = f", depending on {unknown.covariate} (by {_size(abs(unknown.amplitude), unknown.unit)} over its range)" \
        if unknown.covariate else f" by {_size(abs(unknown.amplitude), unknown.unit)} in every shot alike"
    nearest = f" Nearest in the catalogue: {what[0].term}." if what else ""
    return (f"{said} {words[0].upper() + words[1:]} than simulated{follows}, {DIRECTION_WORDS[unknown.direction]}; "
            f"most likely {STAGE_WORDS[where.stage or 'flight']}.{nearest}{_gained(fit)}")


def say_none(believed: tuple[str, ...], p_value: float | None, shots: int, false_alarm: float) -> str:
    """No mismatch, or nothing to see one by."""
    if p_value is None:
        return (f"These {shots} shots cannot say anything about the simulation: too few of them have a track, or an "
                "outcome or height, with distance and launch, that would tell.")
    return (f"No mismatch: {shots} shots look as the simulation ({', '.join(believed)}) has them "
            f"(p = {p_value:.2g}, false alarms {false_alarm:g}).")


def say_smallest(evidence: Evidence) -> str:
    """The smallest effects that would have been seen, of the terms that these data see best for their usual size."""
    smallest = smallest_seen(evidence)[:SHOWN]
    if not smallest:
        return " Of no term could these data have shown anything."
    parts = [f"{name.partition('.')[0]} of {_size(size, unit)}" for name, size, unit, _ in smallest]
    return f" It would have shown (80 % power): {', '.join(parts)}."


def smallest_seen(evidence: Evidence) -> list[tuple[str, float, str, float]]:
    """(term's column, amplitude seen with 80 % power at 5 %, unit, that in usual ones), best seen first."""
    shared = shared_columns(evidence)
    info = evidence.info.sum(0)
    inner = info[shared, shared] + np.diag(evidence.precision)
    found = []
    for k, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind != "term" or info[k, k] <= 0.0:
            continue
        left = info[k, k] - info[k, shared] @ np.linalg.solve(inner, info[shared, k]) if len(inner) else info[k, k]
        if left > 1e-4 * info[k, k]:
            size = math.sqrt(EIGHTY / left)
            found.append((column.name, size, column.unit, size / column.usual))
    return sorted(found, key=lambda row: row[3])


def console_lines(finding: Finding) -> list[str]:
    """The verdict and a few lines below it."""
    data, where, fit = finding.data, finding.where, finding.fit
    lines = [finding.sentence,
             f"{data.shots} shots, level {data.level}, {finding.mismatch.tests_made} tests over "
             f"{data.clusters['count']} clusters ({data.clusters['by']})"]
    lines += [f"fitted: {', '.join(f'{name} {value:.3g}' for name, value in values.items())}"
              for values in data.fitted.values() if values]
    if finding.what:
        lines.append("names: " + ", ".join(f"{one.term} {one.probability:.2f}" for one in finding.what[:SHOWN]))
    if finding.mismatch.found and where.stage_probability:
        lines.append("stages: " + ", ".join(f"{stage} {p:.2f}" for stage, p in where.stage_probability.items()))
    if where.inseparable:
        lines.append(f"{where.covariate} goes with {', '.join(where.inseparable)}: these data cannot tell them apart")
    if finding.mismatch.found and where.times_s:
        lines.append(f"along the flight: {where.times_s[0]:.2f} to {where.times_s[1]:.2f} s")
    if fit and fit.height_rmse_before_m is not None:
        after = "" if fit.height_rmse_after_m is None else f" before, {fit.height_rmse_after_m:.3g} m after"
        lines.append(f"height foretold within {fit.height_rmse_before_m:.3g} m{after}")
    for step in finding.next:
        lines.append("next: measure " + step["what"] if step["do"] == "measure" else
                     f"next: {step['shots']} shots at {step['distance_m']:g} m, hood {step['hood_deg']:g} deg, motor "
                     f"{step['motor_ratio']:g}, to part {' from '.join(step['separates'])}")
    lines += [f"left out: {line}" for line in data.left_out]
    return lines


def _gained(fit: Fit) -> str:
    if fit.gain_per_shot is None or fit.gain_se is None:
        return ""
    return (f" On shots it has not seen the corrected simulation gains {fit.gain_per_shot:.3g} +- {fit.gain_se:.2g} "
            "nats a shot.")


def _amplitude(named: Named) -> str:
    parts = [f"{name.replace('_', ' ')} {_range(interval)}" for name, interval in named.parameters.items()]
    return f"({'; '.join(parts)})."


def _range(interval: Interval) -> str:
    unit = "" if interval.unit == "1" else f" {interval.unit}"
    return f"{interval.value:.2g}{unit}, 90 %: {interval.low90:.2g} to {interval.high90:.2g}"


def _size(amplitude: float, unit: str) -> str:
    """An amplitude as people say it: shares in per cent, angles in degrees."""
    if unit == "1":
        return f"{100.0 * amplitude:.2g} %"
    return f"{math.degrees(amplitude):.2g} degrees" if unit == "rad" else f"{amplitude:.2g} {unit}"
