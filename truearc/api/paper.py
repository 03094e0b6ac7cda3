"""The paper's method: simulated shots, the network, and sweeps over the amount of simulated data.

Its grid search is `truearc.fit(dataset, method="grid")`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import hash_dataset
from truearc.sim.gate.network_training import NetworkTraining, Shares, make_record, rows_of, train_network
from truearc.sim.paper import Recipe
from truearc.sim.paper import sweep as sweeps
from truearc.sim.paper.network import accuracy, save_weights
from truearc.sim.paper.sweep import Mean, SweepNetwork, SweepScore, SweepSetting, Verdict
from truearc.sim.paper.synthetic import load_provenance, say_synthetic, write_synthetic
from truearc.sim.paper.train_many import Trained, train_many
from truearc.sim.printed import Printed, Progress, make_text, save_csv, show_progress
from truearc.sim.report import make_png

__all__ = ["NetworkSweep", "NetworkTraining", "Recipe", "Shares", "check_plausible", "load_provenance", "say_synthetic",
           "sweep_networks", "train_network", "write_synthetic"]

HEADER = ("simulated", "lambda", "cross-entropy: validation", "held out", "right, held out: outcome", "two", "three")
FIGURES = ("validation_loss", "heldout_loss", "outcome", "two", "three")


@dataclass(frozen=True, eq=False)
class NetworkSweep(Printed):
    """Networks for several settings, each with the same seeds.

    `scores`: scores of each network on validation and hold-out shots. `verdict`: the best setting against its rival;
    None with a single setting. `best`, `trained`, `record`: the network of the first seed with the best setting.
    `notes`: notes on excluded shots.
    """

    settings: tuple[SweepSetting, ...]
    scores: tuple[SweepScore, ...]
    verdict: Verdict | None
    best: SweepNetwork
    trained: Trained
    record: dict[str, Any]
    notes: tuple[str, ...]

    @cached_property
    def means(self) -> list[tuple[SweepSetting, list[Mean]]]:
        """The means of FIGURES over the networks of each setting."""
        return [(setting, [sweeps.mean_of([getattr(score, name) for score in sweeps.of_setting(self.scores, setting)])
                           for name in FIGURES]) for setting in self.settings]

    def plot(self) -> Figure:
        """Plot hold-out cross-entropy and accuracy over the number of simulated shots, with 95 % intervals."""
        return sweeps.draw_sweep(self.scores, self.settings)

    def save(self, directory: str | Path) -> None:
        """Write networks.csv, settings.csv, sweep.png, and the best network as weights in best/.

        Raises:
            InputError: a file cannot be written.
        """
        home = Path(directory)
        home.mkdir(parents=True, exist_ok=True)
        save_csv(home / "networks.csv", SweepScore._fields, self.scores)
        header = ["size", "weight", "seeds", *(f"{name}{end}" for name in FIGURES for end in ("", "_half95"))]
        save_csv(home / "settings.csv", header, [
            [*setting, len(sweeps.of_setting(self.scores, setting)),
             *("" if number != number else number for mean in row for number in mean)] for setting, row in self.means])
        (home / "sweep.png").write_bytes(make_png(self.plot()))
        save_weights(home / "best", self.trained.network, self.record)

    def lines(self) -> list[str]:
        """Return a line per setting, and the gain of the best one over its rival."""
        rows = [[f"{setting.size}", f"{setting.weight:g}", _pm(loss), _pm(heldout),
                 *(_pm(share, 100) for share in shares)] for setting, (loss, heldout, *shares) in self.means]
        return [*make_text(HEADER, rows, right=range(len(HEADER))),
                *([] if self.verdict is None else [_sentence(self.verdict)])]


def sweep_networks(real: Dataset, simulated: Dataset | None, sizes: Sequence[int], weights: Sequence[float], *,
                   seeds: int = 20, coefficients: Any = None, recipe: Recipe | None = None,
                   shares: Shares | None = None, seed: int = 0,
                   progress: Progress | None = None) -> NetworkSweep:
    """Train the paper's network with each number and weight of simulated shots, and compare them on hold-out shots.

    Args:
        real: Recorded shots with outcome, distance_m [m], hood_deg [deg] and motor_ratio [1].
        simulated: Simulated shots to draw from; None: only recorded shots.
        sizes: Numbers of simulated shots.
        weights: Weights of the simulated loss (the paper's lambda).
        seeds: Number of networks per setting, each with its own splits.
        coefficients: Coefficients of the simulated shots, for the record.
        recipe: Step size, maximum steps and patience; None: the defaults.
        shares: Shares of hold-out and validation shots; None: the defaults. Its weight and epochs do not apply.
        seed: The first of the seeds.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Raises:
        InputError: an invalid size, weight or share, or too few shots.
    """
    recipe, shares = recipe or Recipe(), shares or Shares()
    settings = sweeps.settings_of(sizes, weights)
    rows, notes = rows_of(real, real.name)
    extra, more = (None, []) if simulated is None else rows_of(simulated, simulated.name)
    networks = sweeps.plan(rows, extra, settings, range(seed, seed + seeds), shares.holdout, shares.validation)
    trained = train_many([network.job for network in networks], recipe, progress or show_progress("train"))
    scores = [sweeps.judge(network, one) for network, one in zip(networks, trained, strict=True)]
    verdict = sweeps.compare(scores, settings)
    best = verdict.best if verdict else settings[0]
    chosen = next(number for number, network in enumerate(networks) if network.setting == best)
    made = {"holdout": shares.holdout, "validation": shares.validation, "real_sha256": hash_dataset(real),
            "sim_sha256": None if simulated is None else hash_dataset(simulated), "coefficients": coefficients}
    network, job = networks[chosen], networks[chosen].job
    right = {name: accuracy(trained[chosen].network, part) for name, part in
             (("train", job.real), ("validation", job.validation), ("heldout", network.heldout)) if part is not None}
    record = make_record(made, recipe, job, rows, right, trained[chosen])
    return NetworkSweep(tuple(settings), tuple(scores), verdict, network, trained[chosen], record, (*notes, *more))


def _pm(mean: Mean, factor: float = 1.0) -> str:
    digits, unit = (1, " %") if factor == 100 else (3, "")
    half = "" if mean.half != mean.half else f"+-{factor * mean.half:.{digits}f}"
    return f"{factor * mean.value:.{digits}f}{half}{unit}"


def _sentence(verdict: Verdict) -> str:
    """Return the verdict as text, with what chance alone could do; the intervals are 95 %."""
    gain = verdict.gain
    if gain.half != gain.half:
        size = f"by {gain.value:+.3f} for the one seed tried, from which chance cannot be judged"
    elif abs(gain.value) <= gain.half:
        size = f"by {gain.value:+.3f} +- {gain.half:.3f}, which is within what the draw of seeds does by chance"
    else:
        size = (f"by {gain.value:+.3f} +- {gain.half:.3f}, which is beyond chance "
                + ("and better" if gain.value > 0 else "and WORSE"))
    return (f"best on the validation shots: {verdict.best.words()}; on shots held out its cross-entropy is lower than "
            f"that of {verdict.rival.words()} {size} (seeds share the recorded shots: another session may differ)")
