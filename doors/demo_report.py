"""The demo's one page: what was launched, what was learnt, what the gate was worth, where the physics is wrong."""

import csv
import json
from pathlib import Path

import numpy as np

from robot.recording.reader import TickReader
from robot.recording.session import load_session_config, load_trials
from sim.coefficients import load_coefficients
from sim.discover.discover import Investigation
from sim.discover.page import make_pictures
from sim.intervals import difference, wilson
from sim.pictures import Share, draw_fit_map, draw_shares, draw_shot, draw_trajectories
from sim.report import make_page, make_png, paragraph, picture, table
from sim.shots import Dataset, load_dataset

NS = 1e-9
BEFORE_S, AFTER_S = 1.5, 1.0
OUTCOMES = ("miss", "two", "three")


class Demo:
    """Where everything of one demo lies."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.seed = folder, seed
        sessions = folder / "sessions"
        self.collect, self.gated, self.ungated = (sessions / name for name in ("practice", "gated", "ungated"))
        self.shots, self.gated_shots, self.ungated_shots, self.all_shots, self.simulated = (
            folder / "data" / name for name in ("practice", "gated", "ungated", "all", "simulated"))
        self.coefficients, self.fit_map = folder / "coefficients.toml", folder / "fit_map.npz"
        self.weights, self.gate, self.ratings = folder / "weights", folder / "gate.onnx", folder / "ratings.csv"
        self.finding, self.finding_page = folder / "finding.json", folder / "discover.html"


def headline(demo: Demo) -> list[str]:
    """The numbers that matter, in words."""
    gated, ungated = load_dataset(demo.gated_shots), load_dataset(demo.ungated_shots)
    lines = [f"practice: {len(load_dataset(demo.shots).shots)} marked shots; with the gate the robot fired "
             f"{len(gated.shots)} of {len(load_trials(demo.gated))} asked for, without it {len(ungated.shots)}"]
    for name, kinds in SCORES:
        with_gate, without = _score(gated, kinds), _score(ungated, kinds)
        low, high = difference(with_gate, without)
        lines.append(f"{name}: {_share(with_gate)} with the gate, {_share(without)} without; "
                     f"difference {low:+.0%} to {high:+.0%} (95 %)")
    right, total = _agreement(demo)
    coefficients = load_coefficients(demo.coefficients)
    lines.append(f"gate against outcome, on shots it has never seen: right on {right} of {total} "
                 f"({_interval(right, total)})")
    lines.append("fit: " + ", ".join(f"{term}.{name} = {value:.3f}" for term, values in coefficients.items()
                                     for name, value in values.items()))
    lines.append("discover: " + json.loads(demo.finding.read_text(encoding="utf-8"))["sentence"])
    return lines


SCORES = (("two or three points", ("two", "three")), ("three points", ("three",)))


def save_report(demo: Demo, found: Investigation) -> Path:
    """Write index.html; returns its path."""
    lines = headline(demo)
    sections = [
        ("In numbers", "<ul>" + "".join(f"<li>{line}</li>" for line in lines) + "</ul>"),
        ("What the gate is worth", _gate_worth(demo)),
        ("Where simulation and recordings disagree", _disagreement(demo, found)),
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
    gated, ungated = load_dataset(demo.gated_shots), load_dataset(demo.ungated_shots)
    with_gate, without = _score(gated, ("three",)), _score(ungated, ("three",))
    return (f"Of the shots the gate let through {_share(with_gate)} scored three points; of the same driver's shots "
            f"without it, {_share(without)}.")


def _score(dataset: Dataset, kinds: tuple[str, ...]) -> tuple[int, int]:
    outcomes = dataset.shots.text("outcome")
    return sum(outcome in kinds for outcome in outcomes), len(outcomes)


def _share(score: tuple[int, int]) -> str:
    return f"{score[0] / max(score[1], 1):.0%} ({score[0]} of {score[1]})"


def _interval(hits: int, tries: int) -> str:
    low, high = wilson(hits, tries)
    return f"{hits / max(tries, 1):.0%}, 95 % interval {low:.0%} to {high:.0%}"


def _gate_worth(demo: Demo) -> str:
    gated, ungated = load_dataset(demo.gated_shots), load_dataset(demo.ungated_shots)
    shares = [Share(f"{name}, {which}", *_score(dataset, kinds)) for name, kinds in SCORES
              for which, dataset in (("with the gate", gated), ("without", ungated))]
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
    ticks = [tick for tick, _ in TickReader(demo.collect) if -BEFORE_S <= (tick.inputs.t_ns - fed) * NS <= AFTER_S]
    return picture(make_png(draw_shot(ticks, config, fed)), "wheel speed, hood angle and battery around one shot",
                   "The red line is the moment the ball is fed. Nobody typed the dip in: it is the contact in MuJoCo.")


def _trajectories(demo: Demo) -> str:
    data = load_dataset(demo.shots)
    figure = draw_trajectories(data.facts, load_coefficients(demo.coefficients), data.shots, 12)
    return picture(make_png(figure), "trajectories", "Where green ones miss the green bar, the simulator is wrong.")


def _fit(demo: Demo) -> str:
    saved = np.load(demo.fit_map)
    chosen = load_coefficients(demo.coefficients)
    figure = draw_fit_map(saved["axis"], saved["share_three"].T, (chosen["drag"]["cd"], chosen["magnus"]["cl"]))
    return picture(make_png(figure), "3-point accuracy over the coefficients")


def _ratings(demo: Demo) -> list[tuple[str, float, float]]:
    """(outcome, p_two, p_three) of each ungated shot that lies in the gate's domain."""
    shots = load_dataset(demo.ungated_shots).shots
    outcome = dict(zip(shots.shot_id, shots.text("outcome"), strict=True))
    with demo.ratings.open(encoding="utf-8", newline="") as file:
        return [(outcome[row["shot_id"]], float(row["p_two"]), float(row["p_three"]))
                for row in csv.DictReader(file) if row["in_domain"] == "true" and row["p_two"]]


def _said(p_two: float, p_three: float) -> str:
    return "three" if p_three >= 0.5 else "two" if p_two >= 0.5 else "miss"


def _agreement(demo: Demo) -> tuple[int, int]:
    ratings = _ratings(demo)
    return sum(_said(p_two, p_three) == outcome for outcome, p_two, p_three in ratings), len(ratings)


def _confusion(demo: Demo) -> str:
    ratings = _ratings(demo)
    pairs = [(outcome, _said(p_two, p_three)) for outcome, p_two, p_three in ratings]
    rows = [[f"it was {was}", *(pairs.count((was, said)) for said in OUTCOMES)] for was in OUTCOMES]
    return table(["", *(f"gate said {said}" for said in OUTCOMES)], rows) + paragraph(
        f"The {len(ratings)} shots of the ungated session that lie in the gate's domain; the gate was trained on the "
        "practice session alone.", dim=True)


def _fine_print(demo: Demo) -> str:
    training = json.loads((demo.weights / "training.json").read_text(encoding="utf-8"))
    rejected = [trial for session in (demo.collect, demo.gated, demo.ungated) for trial in load_trials(session)
                if trial.outcome.outcome == "rejected"]
    rows = [["seed", demo.seed], ["trained on", demo.shots.name], ["epochs", training["epochs"]],
            ["lambda", training["lambda"]], ["shots that the driver rejected", len(rejected)]]
    return table(["", ""], rows) + paragraph(
        "Everything here was recorded by the emulated robot: real runtime, real frames and images, a MuJoCo world that "
        "neither runtime nor fit can see.", dim=True)
