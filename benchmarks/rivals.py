"""truearc and the field on the data of others and on concealed worlds: what each detects, names and forecasts.

    python -m benchmarks.rivals DIR [--only falls,drops,worlds] [--steps N] [--left N] [--picture FILE]

DIR holds ball_drops.csv, as `truearc import ball-drops` reads it, and sepia_ball_drop/ with 1_field.* and 1_sim.* of
SEPIA's tutorial (proof/IMPORTERS.md). Falls are SEPIA's: each radius, then each height, is left out, forecast by
the other drops, by Kennedy and O'Hagan's calibration of its authors' runs and by truearc's drag with v^2 or v,
whichever fits these better. Ends of tracks are forecast as in benchmarks/field.py. Worlds are development worlds (seed
701), one a hidden term.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

import truearc as ta
from benchmarks.field_table import claim_of
from benchmarks.suite import plan_jobs, true_parameter, world_of
from truearc.robot.config.rig_spec import Ball
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc.sim.physics.catalogue import BUILT_IN, Catalogue, catalogue, terms_of_file
from truearc.sim.physics.flight import path
from truearc.sim.physics.launch import Exit
from truearc.sim.report import new_figure
from truearc_proof.importers.ball_drops import import_ball_drops, import_sepia_drops
from truearc_proof.rivals import OURS, RIVALS, find_rival
from truearc_proof.rivals.claim import Claim, believed_of, rms
from truearc_proof.rivals.koh import STEPS, Calibration, Emulator, Forecast, Runs
from truearc_proof.table import make_markdown
from truearc_proof.truth.generate import shoot

HEAD = ("data", "method", "detects", "names", "90 % interval of the first", "forecast error, held out")
KOH, PLAIN = "kennedy-ohagan", "kennedy-ohagan, no discrepancy"
NO_TRACKS = "does not apply: it reads tracks"
IS_GP = "does not apply: a fast simulation needs no emulator; gp is the rest of it"
RANKS_ALL = (OURS, "argmax")          # others name what they keep
LAWS = ("drag", "linear_drag")        # too few drops are kept for `discover`, which needs ten: it names one of all
HIDDEN = ("clean", "drag_reynolds", "wind_x", "spin_drag")
SEED, SHOTS = 701, 300
STEP_S, LONGEST_S = 0.005, 8.0
COLOURS = {OURS: "#1f5fa8", KOH: "#c2571a", PLAIN: "#7a7a7a"}
LINEAR_DRAG = Path(__file__).parents[1] / "examples" / "linear_drag.py"
Array = np.ndarray


class Row(NamedTuple):
    """One method on one set of data."""

    data: str
    method: str
    detects: str
    names: str
    interval: str
    error: str


class Left(NamedTuple):
    """Drops left out: what they have in common, and which ones they are [n]."""

    what: str
    out: Array


Told = list[tuple[Left, Forecast]]
Method = Callable[[Array], Forecast]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dir", type=Path, help="folder of the recordings")
    parser.add_argument("--only", default="falls,drops,worlds", help="comma-separated, of falls, drops, worlds (all)")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of the calibration's chains ({STEPS})")
    parser.add_argument("--left", type=int, help="leave out the first N radii and the first N heights only")
    parser.add_argument("--picture", metavar="FILE", help="draw the falls' forecasts, radius by radius")
    args = parser.parse_args()
    keep_compiled()
    rows: list[Row] = []
    for part in args.only.split(","):
        rows += {"falls": partial(falls, args.dir / "sepia_ball_drop", args.steps, args.picture, args.left),
                 "drops": partial(drops, args.dir / "ball_drops.csv"), "worlds": worlds}[part]()
    print(make_markdown(HEAD, rows))


def drops(file: Path) -> Iterator[Row]:
    """Filmed falls of eleven balls."""
    yield from by_tracks("real ball drops", import_ball_drops(file), ("gravity",))


def worlds() -> Iterator[Row]:
    """One world for each of HIDDEN."""
    for name in HIDDEN:
        job, = plan_jobs(["nulls" if name == "clean" else "effects"], ["L2"], [SHOTS], 1, SEED, {"L2": 1.0}, [name])
        truth = true_parameter(job)
        yield from by_tracks(f"world: {name}" + (f" {truth[1]:.3g}" if truth else ""), shoot(world_of(job)), None)


def by_tracks(data: str, dataset: Dataset, believe: tuple[str, ...] | None) -> Iterator[Row]:
    """Everybody on a dataset with tracks."""
    found = discover(dataset, believe, seed=0)
    finding = msgspec.json.decode(make_json(found.finding))
    yield row_of(data, OURS, claim_of(finding), interval_of(finding))
    believed = believed_of(found)
    assert believed is not None
    for rival in RIVALS:
        yield row_of(data, rival, find_rival(rival)(dataset, believed, 0))
    yield Row(data, KOH, IS_GP, "", "", "")


def row_of(data: str, method: str, claim: Claim, interval: str = "") -> Row:
    """A claim as text; its own interval where none is given."""
    if not interval and "low90" in claim.figures:
        interval = f"{claim.figures['low90']:.3g} to {claim.figures['high90']:.3g}"
    error = "" if claim.before_m is None or claim.after_m is None else f"{claim.before_m:.3g} -> {claim.after_m:.3g} m"
    names = ", ".join(claim.names[:1 if method in RANKS_ALL else 3])
    return Row(data, method, "yes" if claim.says_something else "no", names, interval, error)


def interval_of(finding: dict[str, Any]) -> str:
    """The likeliest named term's first number."""
    named = finding["what"] if finding["verdict"] in ("named", "set") else ()
    for term in sorted(named, key=lambda one: -one["probability"])[:1]:
        one = next(iter(term["parameters"].values()))
        return f"{one['low90']:.3g} to {one['high90']:.3g}"
    return ""


def falls(folder: Path, steps: int, picture: str | None, most: int | None = None) -> Iterator[Row]:
    """SEPIA's falls: times at heights, computed with drag that goes with v^2; the runs' drag goes with v."""
    data = "SEPIA's falls"
    dataset = import_sepia_drops(*(folder / f"1_field.{end}" for end in ("dat", "height", "radii")))
    among = Catalogue((*catalogue(), *terms_of_file(LINEAR_DRAG, BUILT_IN)))
    found = discover(dataset, ("gravity",), seed=0, terms=among)
    finding, believed = msgspec.json.decode(make_json(found.finding)), believed_of(found)
    assert believed is not None
    claims = {OURS: claim_of(finding), "argmax": find_rival("argmax")(dataset, believed, 0)}
    emulator = emulator_of(folder)
    methods: dict[str, Method] = {OURS: partial(by_law, dataset, among.find(LAWS))}
    methods |= {name: partial(by_calibration, emulator, dataset, name == KOH, steps) for name in (KOH, PLAIN)}
    told = {name: [(left, method(~left.out)) for left in lefts(dataset, most)] for name, method in methods.items()}
    for name, claim in claims.items():
        yield row_of(data, name, claim, interval_of(finding) if name == OURS else "")._replace(
            error=error_of(dataset, told[OURS]))
    yield from (Row(data, rival, NO_TRACKS, "", "", "") for rival in RIVALS if rival not in claims)
    for name in (KOH, PLAIN):
        yield _calibrated(data, name, calibrate(emulator, dataset, name == KOH, steps), dataset, told[name])
    if picture:
        draw(picture, dataset, told)


def _calibrated(data: str, name: str, found: Calibration, dataset: Dataset, told: Told) -> Row:
    """The discrepancy is detected where its 90 % interval excludes 0 at any drop."""
    error = found.discrepancy(inputs_of(dataset)) if name == KOH else None
    says = error is not None and bool(((error.low90 > 0.0) | (error.high90 < 0.0)).any())
    low, _, high = found.theta90[0]
    return Row(data, name, "yes" if says else "no", "", f"{low:.3g} to {high:.3g} (of the runs' law)",
               error_of(dataset, told))


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


def lefts(dataset: Dataset, most: int | None = None) -> list[Left]:
    """Each radius and each height in turn, or the first `most` of either."""
    return [Left(f"{what} {value:g} m", column == value) for what, column in zip(("radius", "height"), inputs_of(
        dataset).T, strict=True) for value in np.unique(column)[:most]]


def calibrate(emulator: Emulator, dataset: Dataset, discrepancy: bool, steps: int, kept: Array | None = None
              ) -> Calibration:
    """With the kept drops; None: all."""
    assert dataset.times is not None
    kept = np.ones(len(dataset.shots), dtype=bool) if kept is None else kept
    return Calibration(emulator, inputs_of(dataset)[kept], dataset.times.t_s[kept], discrepancy, steps=steps)


def by_calibration(emulator: Emulator, dataset: Dataset, discrepancy: bool, steps: int, kept: Array) -> Forecast:
    """Times of the drops that are not kept."""
    return calibrate(emulator, dataset, discrepancy, steps, kept).forecast(inputs_of(dataset)[~kept])


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


def error_of(dataset: Dataset, told: Told) -> str:
    """RMS by what was left out, and how many times lie in their intervals."""
    assert dataset.times is not None
    off: dict[str, list[float]] = {"radius": [], "height": []}
    inside = []
    for left, forecast in told:
        seen = dataset.times.t_s[left.out]
        off[left.what.partition(" ")[0]] += list(forecast.mean - seen)
        inside += list((forecast.low90 <= seen) & (seen <= forecast.high90))
    each = ", ".join(f"{what} {1000.0 * rms(np.array(errors)):.0f} ms" for what, errors in off.items())
    return f"{each}; {sum(inside)} of {len(inside)} in 90 %"


def draw(file: str, dataset: Dataset, told: dict[str, Told]) -> None:
    """Each radius left out in turn: forecast less measured time over the height fallen, with 90 % intervals."""
    assert dataset.times is not None
    figure = new_figure(10.0, 3.4)
    panels = figure.subplots(1, 3, sharey=True)
    for name, colour in COLOURS.items():
        radii = [one for one in told[name] if one[0].what.startswith("radius")]
        for panel, (left, forecast) in zip(panels, radii, strict=False):
            seen, fallen_m = dataset.times.t_s[left.out], inputs_of(dataset)[left.out, 1]
            panel.plot(fallen_m, forecast.mean - seen, "o-", color=colour, label=name)
            panel.fill_between(fallen_m, forecast.low90 - seen, forecast.high90 - seen, color=colour, alpha=0.15, lw=0)
            panel.set_title(f"{left.what} left out")
            panel.set_xlabel("height fallen, m")
    for panel in panels:
        panel.axhline(0.0, color="black", lw=0.8)
    panels[0].set_ylabel("forecast less measured, s")
    panels[0].legend(fontsize=8, loc="upper left")
    figure.savefig(file)


if __name__ == "__main__":
    main()
