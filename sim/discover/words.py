"""The verdict in a sentence."""

import math

from sim.discover.finding import Finding, Unknown, Where

STAGE_WORDS = {"sensing": "in what the sensors say", "launch": "at the launch", "flight": "in flight",
               "arrival": "at the target"}
LIKELY = 0.05                         # a stage less likely than this is not worth a word
DIRECTION_WORDS = {"along": "along the velocity", "vertical": "vertically", "lateral": "sideways"}


def say_mismatch(believed: tuple[str, ...], p_value: float, where: Where, unknown: Unknown,
                 words: tuple[str, str]) -> str:
    """Where simulation and recordings part, how far, and what it follows."""
    place = STAGE_WORDS[where.stage] if where.stage else _anywhere(where.stage_probability or {})
    said, size = words[unknown.amplitude < 0.0], _size(abs(unknown.amplitude), unknown.unit)
    if unknown.covariate is None:
        how = f"{said} by {size}, in every shot alike"
    elif where.region.get("factor"):
        how = f"{said}, differently in {unknown.covariate} {where.region['level']} (groups differ by {size})"
    elif unknown.covariate in ("time_in_flight_s", "speed_in_flight_m_s"):
        how = f"{said} by {size}, depending on {unknown.covariate}"
    else:
        how = f"{said}, the more so the higher {unknown.covariate} is (by {size} over its range)"
    return (f"The simulation ({', '.join(believed)}) and the recordings disagree {place}, "
            f"{DIRECTION_WORDS[unknown.direction]}. Compared with the simulation, {how}; p = {p_value:.2g}.")


def _anywhere(stage_probability: dict[str, float]) -> str:
    likely = sorted((stage for stage, p in stage_probability.items() if p >= LIKELY),
                    key=lambda stage: -stage_probability[stage])
    if not likely:
        return "somewhere (these data cannot say in which stage)"
    named = " or ".join(f"{STAGE_WORDS[stage]} ({stage_probability[stage]:.0%})" for stage in likely)
    return f"somewhere, perhaps {named} (these data can hardly tell)"


def _size(amplitude: float, unit: str) -> str:
    """An amplitude as people say it: shares in per cent, angles in degrees."""
    if unit == "1":
        return f"{100.0 * amplitude:.2g} %"
    return f"{math.degrees(amplitude):.2g} degrees" if unit == "rad" else f"{amplitude:.2g} {unit}"


def say_none(believed: tuple[str, ...], p_value: float | None, shots: int, false_alarm: float) -> str:
    """No mismatch, or nothing to see one by."""
    if p_value is None:
        return (f"These {shots} shots cannot say anything about the simulation: too few of them have a track, or an "
                "outcome or height, with distance and launch, that would tell.")
    return (f"No mismatch: {shots} shots look as the simulation ({', '.join(believed)}) has them "
            f"(p = {p_value:.2g}, false alarms {false_alarm:g}).")


def console_lines(finding: Finding) -> list[str]:
    """The verdict and a few lines below it."""
    data, where, fit = finding.data, finding.where, finding.fit
    lines = [finding.sentence,
             f"{data.shots} shots, level {data.level}, {finding.mismatch.tests_made} tests over "
             f"{data.clusters['count']} clusters ({data.clusters['by']})"]
    lines += [f"fitted to {kind}: " + ", ".join(f"{name} {value:.3g}" for name, value in values.items())
              for kind, values in data.fitted.items() if values]
    if finding.mismatch.found and where.stage_probability:
        lines.append("stages: " + ", ".join(f"{stage} {p:.2f}" for stage, p in where.stage_probability.items()))
    if where.inseparable:
        lines.append(f"{where.covariate} goes with {', '.join(where.inseparable)}: these data cannot tell them apart")
    if finding.mismatch.found and where.times_s:
        lines.append(f"along the flight: {where.times_s[0]:.2f} to {where.times_s[1]:.2f} s")
    if fit and fit.gain_per_shot is not None:
        lines.append(f"a free correction gains {fit.gain_per_shot:.3g} +- {fit.gain_se:.2g} nats a shot on shots it "
                     "has not seen")
    lines += [f"left out: {line}" for line in data.left_out]
    return lines
