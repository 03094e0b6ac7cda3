"""The demo's one page: what was launched, what was learnt, what the gate was worth, where the physics is wrong."""

import json
from pathlib import Path

import numpy as np

import truearc as ta
from truearc.cli.start.demo_files import NS, Demo, score, share
from truearc.cli.start.demo_worth import put_in, rated, worth_of_it
from truearc.robot.recording.session import load_session_config, load_trials
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.discover.api import Investigation
from truearc.sim.discover.report.html_report import make_pictures
from truearc.sim.infer.coefficients import load_coefficients
from truearc.sim.intervals import difference
from truearc.sim.metrics import Figures, figures_of
from truearc.sim.plots import Share, draw_shares, draw_shot, draw_trajectories
from truearc.sim.report import make_page, make_png, paragraph, picture, table

BEFORE_S, AFTER_S = 1.5, 1.0


def headline(demo: Demo) -> list[str]:
    """Return the main results as text."""
    lines = []
    for name, kinds in SCORES:
        with_gate, without = score(demo.gated_shots, kinds), score(demo.ungated_shots, kinds)
        low, high = difference(with_gate, without)
        lines.append(f"{name}: {share(with_gate)} with the gate, {share(without)} without; "
                     f"difference {low:+.0%} to {high:+.0%} (95 %)")
    lines.insert(0, f"practice: {len(ta.load_dataset(demo.shots).shots)} marked shots; with the gate the robot fired "
                 f"{with_gate[1]} of {len(load_trials(demo.gated))} asked for, without it {without[1]}")
    *_, (ours, network) = _judged(demo)
    lines.append(f"forecasts of {ours.shots} shots that neither had seen: our gate right on {ours.accuracy:.0%} "
                 f"(Brier {ours.brier:.3f}), the paper's network on {network.accuracy:.0%} (Brier {network.brier:.3f})")
    coefficients = load_coefficients(demo.coefficients)
    lines.append("fit (grid): " + ", ".join(f"{term}.{name} = {value:.3f}" for term, values in coefficients.items()
                                     for name, value in values.items()))
    lines.append("discover: " + json.loads(demo.finding.read_text(encoding="utf-8"))["sentence"])
    return [*lines, put_in(demo)]


SCORES = (("two or three points", ("two", "three")), ("three points", ("three",)))


def save_report(demo: Demo, found: Investigation) -> Path:
    """Write index.html; returns its path."""
    lines = headline(demo)
    sections = [
        ("In numbers", "<ul>" + "".join(f"<li>{line}</li>" for line in lines) + "</ul>"),
        ("What the gate is worth", _gate_worth(demo)),
        ("Where simulation and recordings disagree", _disagreement(demo, found)),
        ("What putting it in is worth", worth_of_it(demo)),
        ("One shot", _one_shot(demo)),
        ("Recorded shots, flown by the fitted simulator", _trajectories(demo)),
        ("The fit", _fit(demo)),
        ("Gate against outcome", _confusion(demo)),
        ("Fine print", _fine_print(demo)),
    ]
    page = demo.folder / "index.html"
    page.write_text(make_page("truearc demo: the emulated robot", _verdict(demo), sections), encoding="utf-8")
    return page


def _verdict(demo: Demo) -> str:
    with_gate, without = score(demo.gated_shots, ("three",)), score(demo.ungated_shots, ("three",))
    return (f"Of the shots the gate let through {share(with_gate)} scored three points; of the same driver's shots "
            f"without it, {share(without)}.")


def _gate_worth(demo: Demo) -> str:
    shares = [Share(f"{name}, {which}", *score(dataset, kinds)) for name, kinds in SCORES
              for which, dataset in (("with the gate", demo.gated_shots), ("without", demo.ungated_shots))]
    held = [trial for trial in load_trials(demo.gated) if trial.outcome.outcome == "held"]
    return picture(make_png(draw_shares(shares)), "shares with and without the gate") + paragraph(
        f"Both sessions have the same driver, places, set points and seed; they differ in the gate alone. It held "
        f"{len(held)} of {len(load_trials(demo.gated))} requests. Bars: Wilson 95 % intervals.", dim=True)


def _disagreement(demo: Demo, found: Investigation) -> str:
    pictures = "".join(body for _, body in make_pictures(found))
    return paragraph(found.finding.sentence) + pictures + (
        f'<p class="dim">The whole finding: <a href="{demo.finding_page.name}">{demo.finding_page.name}</a>; '
        f'as data: <a href="{demo.finding.name}">{demo.finding.name}</a>.</p>')


def _one_shot(demo: Demo) -> str:
    config = load_session_config(demo.collect)
    shots = [trial.shot for trial in load_trials(demo.collect) if trial.shot is not None]
    fed = shots[len(shots) // 2].t_ns
    ticks = [tick for tick in ta.Recording(demo.collect) if -BEFORE_S <= (tick.inputs.t_ns - fed) * NS <= AFTER_S]
    return picture(make_png(draw_shot(ticks, config, fed)), "wheel speed, hood angle and battery around one shot",
                   "The red line is the moment the ball is fed. The dip comes from the contact in MuJoCo.")


def _trajectories(demo: Demo) -> str:
    data = ta.load_dataset(demo.shots)
    figure = draw_trajectories(data.rig, load_coefficients(demo.coefficients), data.shots, 12)
    return picture(make_png(figure), "trajectories", "Where green ones miss the green bar, the simulator is wrong.")


def _fit(demo: Demo) -> str:
    return picture(demo.fit_map.read_bytes(), "3-point accuracy over the coefficients, and the pairs that tie")


def _judged(demo: Demo) -> tuple[np.ndarray, np.ndarray, tuple[Figures, Figures]]:
    """Return our gate's p [n, 2], the levels [n], and figures of our gate and the network, inside our gate's domain."""
    (ours, network), level = rated(demo, (demo.ratings, demo.network_ratings), inside=1)
    return ours, level, (figures_of(ours, level), figures_of(network, level))


def _confusion(demo: Demo) -> str:
    ours, level, judged = _judged(demo)
    said = (ours >= 0.5).sum(axis=1)
    rows = [[f"it was {was}", *(int(((level == k) & (said == j)).sum()) for j in range(3))]
            for k, was in enumerate(OUTCOMES)]
    figures = [[name, f"{one.accuracy:.0%}", f"{one.f1_three:.2f}", f"{one.brier:.3f}", f"{one.ece:.3f}",
                f"{one.log_score:.2f}"] for name, one in zip(("our gate", "the paper's network"), judged, strict=True)]
    return (table(["", *(f"our gate said {said}" for said in OUTCOMES)], rows)
            + table(["", "outcome right", "F1 of three", "Brier", "calibration error", "log score"], figures)
            + paragraph(f"The {len(level)} shots of the ungated session that lie in our gate's domain; both "
                        "gates were trained on the practice session alone. Of Brier and calibration error less is "
                        "better, of the others more.", dim=True))


def _fine_print(demo: Demo) -> str:
    training = json.loads((demo.network_weights / "training.json").read_text(encoding="utf-8"))
    rejected = [trial for session in (demo.collect, demo.gated, demo.ungated) for trial in load_trials(session)
                if trial.outcome.outcome == "rejected"]
    rows: list[list[object]] = [
        ["seed", demo.seed], ["trained on", demo.shots.name], ["steps of the paper's network", training["steps"]],
        ["its lambda", training["lambda"]], ["shots that the driver rejected", len(rejected)]]
    return table(["", ""], rows) + paragraph(
        "Everything here was recorded by the emulated robot: real runtime, real frames and images, a MuJoCo world that "
        "neither runtime nor fit can see.", dim=True)
