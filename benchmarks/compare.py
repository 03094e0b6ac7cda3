"""truearc beside other methods on a toolbox's ball drops: what each detects, names and forecasts.

    python -m benchmarks.compare DIR [--steps N] [--left N]

DIR holds sepia_ball_drop/ with 1_field.* and 1_sim.* of SEPIA's tutorial (proof/IMPORTERS.md): times at heights,
computed with drag that goes with v^2; the drag of its runs goes with v. Each radius, then each height, is left out and
forecast by the other drops, by Kennedy and O'Hagan's calibration of its authors' runs and by truearc's drag with v^2 or
v, whichever fits these better. On concealed worlds other methods answer in `truearc prove --rivals`.
"""

import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import truearc as ta
from benchmarks.options import read_options
from truearc.robot.config.rig_spec import Ball
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc.sim.physics.catalogue import BUILT_IN, Catalogue, catalogue, terms_of_file
from truearc.sim.physics.flight import path
from truearc.sim.physics.term import Exit
from truearc_proof.importers.ball_drops import import_sepia_drops
from truearc_proof.rivals import OURS
from truearc_proof.rivals.claim import rms
from truearc_proof.rivals.residual import STEPS, Calibration, Emulator, Forecast, Runs
from truearc_proof.rounds.marks import names_ranked
from truearc_proof.table import make_markdown

HEAD = ("data", "method", "detects", "names", "90 % interval of the first", "forecast error, held out")
KOH, PLAIN = "kennedy-ohagan", "kennedy-ohagan, no discrepancy"
DATA = "SEPIA's falls"
LAWS = ("drag", "linear_drag")        # too few drops are kept for `discover`, which needs ten: it names one of all
STEP_S, LONGEST_S = 0.005, 8.0
LINEAR_DRAG = Path(__file__).parents[1] / "examples" / "linear_drag.py"
Array = np.ndarray
Left = tuple[str, Array]              # what drops that are left out have in common, and which ones they are [n]
Row = tuple[str, str, str, str, str]  # one method on the falls: all cells but the data's


def falls(folder: Path, steps: int, most: int | None) -> Iterator[Row]:
    """Every method on the drops of a folder; most: leave out the first so many radii and heights only."""
    dataset = import_sepia_drops(*(folder / f"1_field.{end}" for end in ("dat", "height", "radii")))
    among = Catalogue((*catalogue(), *terms_of_file(LINEAR_DRAG, BUILT_IN)))
    found = discover(dataset, ("gravity",), seed=0, terms=among)
    finding = msgspec.json.decode(make_json(found.finding))
    lefts = [(what, column == value) for what, column in zip(("radius", "height"), inputs_of(
        dataset).T, strict=True) for value in np.unique(column)[:most]]
    ours = _error_of(dataset, lefts, [by_law(dataset, among.find(LAWS), ~out) for _, out in lefts])
    yield (OURS, "yes" if finding["mismatch"]["found"] else "no", ", ".join(list(names_ranked(finding))[:1]),
           _interval_of(finding), ours)
    emulator = emulator_of(folder)
    for name in (KOH, PLAIN):
        fit = partial(calibrate, emulator, dataset, name == KOH, steps)
        forecasts = [fit(~out).forecast(inputs_of(dataset)[out]) for _, out in lefts]
        whole = fit(np.ones(len(dataset.shots), dtype=bool))
        off = whole.discrepancy(inputs_of(dataset)) if name == KOH else None     # detected: excludes 0 at any drop
        says = off is not None and bool(((off.low90 > 0.0) | (off.high90 < 0.0)).any())
        low, _, high = whole.theta90[0]
        yield (name, "yes" if says else "no", "", f"{low:.3g} to {high:.3g} (of the runs' law)",
               _error_of(dataset, lefts, forecasts))


def _interval_of(finding: dict[str, Any]) -> str:
    """The likeliest named term's first number."""
    named = finding["what"] if finding["verdict"] in ("named", "set") else ()
    for term in sorted(named, key=lambda one: -one["probability"])[:1]:
        one = next(iter(term["parameters"].values()))
        return f"{one['low90']:.3g} to {one['high90']:.3g}"
    return ""


def emulator_of(folder: Path) -> Emulator:
    """Of the toolbox's runs: times over radius and height fallen, and over the runs' drag."""
    design, height_m, time_s = (np.loadtxt(folder / f"1_sim.{end}") for end in ("design", "height", "dat"))
    radius_m, drag = np.repeat(design, len(height_m), axis=0).T
    return Emulator(Runs(np.column_stack([radius_m, np.tile(height_m, len(design))]), drag[:, None], time_s.T.ravel()))


def inputs_of(dataset: Dataset) -> Array:
    """[n, 2] radius and height fallen, both in m."""
    assert dataset.times is not None
    fallen_m = dataset.rig.launcher.release_height_m - dataset.times.height_m
    return np.column_stack([dataset.shots.number("radius_m"), fallen_m])


def calibrate(emulator: Emulator, dataset: Dataset, discrepancy: bool, steps: int, kept: Array) -> Calibration:
    """With the kept drops."""
    assert dataset.times is not None
    return Calibration(emulator, inputs_of(dataset)[kept], dataset.times.t_s[kept], discrepancy, steps=steps)


def by_law(dataset: Dataset, laws: Sequence[Any], kept: Array) -> Forecast:
    """Times of the drops that are not kept, by gravity and the more probable law by the kept ones; intervals by its
    coefficient's and the stated error of a time."""
    fits = [(law, ta.fit(dataset.take(np.flatnonzero(kept).tolist()), ["gravity", law])) for law in laws]
    term, best = max(fits, key=lambda one: one[1].solution.log_posterior)
    fitted, = best.intervals
    left = dataset.take(np.flatnonzero(~kept).tolist())
    assert left.times is not None
    fallen_m, balls = inputs_of(left)[:, 1], np.column_stack([left.shots.number("mass_kg"), inputs_of(left)[:, 0]])
    values, still, times = np.array([fitted.value, fitted.low90, fitted.high90]), np.zeros(3), np.zeros((3, len(balls)))
    for ball in np.unique(balls, axis=0):
        flown = path(msgspec.structs.replace(left.rig, ball=Ball(*ball.tolist())),
                     (*catalogue().find(["gravity"]), term),
                     {"gravity": {"scale": 1.0 + still}, term.name: {fitted.name.partition(".")[2]: values}},
                     Exit(still, still - np.pi / 2.0, still), int(LONGEST_S / STEP_S), STEP_S)
        mine = (balls == ball).all(axis=1)
        times[:, mine] = [np.interp(fallen_m[mine], track[0] - track, STEP_S * np.arange(len(track)))
                          for track in np.asarray(flown.position_m.z).T]
    middle, low, high = times
    wide = np.hypot(0.5 * np.abs(high - low), 1.645 * left.times.sigma_s)
    return Forecast(middle, middle - wide, middle + wide)


def _error_of(dataset: Dataset, lefts: Sequence[Left], forecasts: Sequence[Forecast]) -> str:
    """RMS by what was left out, and how many times lie in their intervals."""
    assert dataset.times is not None
    off: dict[str, list[float]] = {"radius": [], "height": []}
    inside = []
    for (what, out), forecast in zip(lefts, forecasts, strict=True):
        seen = dataset.times.t_s[out]
        off[what] += list(forecast.mean - seen)
        inside += list((forecast.low90 <= seen) & (seen <= forecast.high90))
    each = ", ".join(f"{what} {1000.0 * rms(np.array(errors)):.0f} ms" for what, errors in off.items())
    return f"{each}; {sum(inside)} of {len(inside)} in 90 %"


def main() -> int:
    args = read_options(__doc__, dir=(..., "folder of the recordings"), steps=(STEPS, "of the calibration's chains"),
                        left=(int, "leave out the first N radii and the first N heights only"))
    keep_compiled()
    rows = falls(args.dir / "sepia_ball_drop", args.steps, args.left)
    print(make_markdown(HEAD, [(DATA, *row) for row in rows]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
