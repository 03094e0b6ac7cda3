"""Files of a demo: their places, and how they are read back."""

import csv
from pathlib import Path

import truearc as ta

NS = 1e-9                             # s per ns
Score = tuple[int, int]               # how many scored, of how many


class Demo:
    """Places of everything that a demo writes."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.seed = folder, seed
        sessions = folder / "sessions"
        self.collect, self.gated, self.ungated, self.after = (
            sessions / name for name in ("practice", "gated", "ungated", "after"))
        self.shots, self.gated_shots, self.ungated_shots, self.after_shots, self.simulated = (
            folder / "data" / name for name in ("practice", "gated", "ungated", "after", "simulated"))
        self.coefficients, self.fit_map = folder / "coefficients.toml", folder / "fit_map.png"
        self.belief = folder / "belief.toml"
        self.weights, self.gate, self.ratings = folder / "weights", folder / "gate.onnx", folder / "ratings.csv"
        self.network_weights, self.network, self.network_ratings = (
            folder / "network_weights", folder / "network.onnx", folder / "network_ratings.csv")
        self.adopted, self.truth = folder / "adopted.toml", folder / "truth.json"
        self.weights_after, self.gate_after, self.ratings_after = (
            folder / "weights_after", folder / "gate_after.onnx", folder / "ratings_after.csv")
        self.heights_grid, self.heights, self.heights_after = (
            folder / name for name in ("heights_grid.csv", "heights.csv", "heights_after.csv"))
        self.finding, self.finding_page = folder / "finding.json", folder / "discover.html"


def score(dataset: Path, kinds: tuple[str, ...]) -> Score:
    """Count the shots of these outcomes in a dataset, and all of its shots."""
    outcomes = ta.load_dataset(dataset).shots.text("outcome")
    return sum(outcome in kinds for outcome in outcomes), len(outcomes)


def share(scored: Score) -> str:
    return f"{scored[0] / max(scored[1], 1):.0%} ({scored[0]} of {scored[1]})"


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
