"""The findings of `truearc discover` on recordings published by others, one row per data set.

    python -m benchmarks.real_sets DIR [--only mpi,drops]
    python -m benchmarks.real_sets DIR --orders 5 --seeds 3

DIR contains the tables that proof/IMPORTERS.md describes. Each set is imported and investigated with the commands that
docs/measured/real-data.md prints; its row has the number of shots, the first sentence of the answer, and the
improvement of the forecasts of hold-out shots. For sets with tracks, a second table gives the errors of forecasts of
the height at the end of each track from its first 40 %, made by `truearc predict --tracks`, by a plain fit of drag and
lift in SciPy, and by gravity alone. Each half of the flights is forecast with fits to the other half.

One question should have one answer. With --orders or --seeds, each set is asked again with its rows in so many other
orders and with so many seeds; the table then gives each answer, with the range of the size that is stated for its first
name, and how many times it was given.
"""

import contextlib
import io
import json
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import truearc as ta
from benchmarks.options import read_options
from truearc.cli.main import main as truearc
from truearc.errors import InputError
from truearc.sim.data.files import save_dataset
from truearc.sim.discover.select.simulations import FORECAST
from truearc_proof.rivals.claim import end_errors, gather_flights, rms
from truearc_proof.table import make_markdown

LINEAR_DRAG = Path(__file__).parents[1] / "examples" / "linear_drag.py"
# name: title, and what `import` and `discover` are given
SETS = {
    "mpi": ("table-tennis launcher", "mpi", ("mpi_launches.csv", "mpi_tracks.csv"), "--believe", "gravity,drag"),
    "drops": ("ball drops from 47 m", "ball-drops", ("ball_drops.csv",), "--believe", "gravity"),
    "falls": ("a toolbox's ball drops", "sepia-drops",
              tuple(f"sepia_ball_drop/1_field.{what}" for what in ("dat", "height", "radii")),
              "--terms-from", str(LINEAR_DRAG), "--believe", "gravity"),
    "bb": ("a throwing robot", "ball-butler", ("ball_butler_tracks.csv",), "--believe", "gravity"),
    "speeds": ("team 971's exit speeds", "frc-971", ("frc971_wheel_to_ball_speed.csv",)),
    "new-and-old": ("team 254's set points", "frc-254", ("frc_shot_tables.csv",)),
    "two-weeks": ("team 3476's set points", "frc-3476", ("frc3476_tuning_history.csv",)),
    "decode": ("a team's shots at a goal", "ftc-decode", ("ftc_decode_shots.csv",)),
    "clips": ("exits by phone clips", "fuel-clips", ("fuel_clip_shots.csv",)),
}
LAWS = {"mpi": ("drag", "magnus"), "bb": ("drag",)}       # what flies there: as believed and named


def ask(name: str, data: Path, folder: Path) -> tuple[str, ...]:
    """Import a set and ask about it; its row."""
    (title, importer, files, *options), where = SETS[name], folder / name
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        for words in (["import", importer, *(str(data / one) for one in files), "-o", str(where)],
                      ["discover", str(where), *options]):
            said.seek(said.truncate(0))
            if truearc([*words, "--quiet"]):
                raise InputError(f"truearc {' '.join(words)}: no answer")
    answer = said.getvalue().splitlines()[0]
    held_out = re.search(r"forecasts (.*? instead of [^(]*)", said.getvalue())
    return (title, str(len(ta.load_dataset(where).shots)), answer.partition(". ")[0] + ".",
            held_out[1].strip() if held_out else "-")


def again(name: str, folder: Path, orders: int, seeds: int) -> list[tuple[str, ...]]:
    """Return a row for each answer to the question of an imported set, with other row orders and seeds."""
    dataset, options, said = ta.load_dataset(folder / name), SETS[name][3:], {}
    for order, seed in [*((order, 0) for order in range(orders + 1)), *((0, seed) for seed in range(1, seeds))]:
        where, answer = folder / (f"{name}-{order}" if order else name), folder / "answer.json"
        if order:
            save_dataset(where, dataset.take(np.random.default_rng([order, 59]).permutation(len(dataset.shots))))
        words = ["discover", str(where), *options, "--seed", str(seed), "--json", str(answer), "--force", "--quiet"]
        with contextlib.redirect_stdout(io.StringIO()):
            if truearc(words):
                raise InputError(f"truearc {' '.join(words)}: no answer")
        finding = json.loads(answer.read_text(encoding="utf-8"))
        first = next(iter(finding["what"] or ()), None) if finding["set"] else None
        size = first and (first.get("change") or next(iter(first["parameters"].values())))
        said.setdefault((finding["verdict"], tuple(sorted(finding["set"] or ()))), []).append(size)
    rows = []
    for (verdict, names), sizes in sorted(said.items(), key=lambda one: -len(one[1])):
        known = [one["value"] for one in sizes if one]
        span = f"{min(known):.3g} to {max(known):.3g} ({sizes[0]['low90']:.3g} to {sizes[0]['high90']:.3g})"
        rows.append((SETS[name][0], f"{verdict}: {', '.join(names)}" if names else verdict, span if known else "-",
                     str(len(sizes))))
    return rows


def forecast(name: str, folder: Path) -> tuple[str, ...]:
    """How far ends of tracks are from forecasts, by truearc, a plain fit and gravity; and how many are in the band."""
    dataset, laws = ta.load_dataset(folder / name), LAWS[name]
    flat = {"hood_deg": np.zeros(len(dataset.shots)), **dataset.shots.numbers}      # no spin depends on it
    flights = gather_flights(replace(dataset, shots=replace(dataset.shots, numbers=flat)))
    said: dict[str, tuple[Any, ...]] = {}
    side = np.arange(len(dataset.shots)) % 2
    plain, tracks = np.zeros(len(flights)), dataset.tracks
    assert tracks is not None
    for half in (0, 1):
        mine, other = (np.flatnonzero(side == one).tolist() for one in (half, 1 - half))
        belief = ta.fit(dataset.take(other), ["gravity", *laws]).belief
        said |= {row[0]: row for row in ta.predict(dataset.take(mine), belief, tracks=FORECAST).rows}

        def off(weights: np.ndarray) -> np.ndarray:
            return end_errors(flights, laws, np.tile(weights, (len(flights), 1)))

        fitted = least_squares(lambda one, kept=other: off(one)[kept], [0.1] * len(laws), method="lm", max_nfev=15)
        plain[mine] = off(fitted.x)[mine]
    ends = [(dataset.shots.shot_id[row], tracks.z_m[where[-1]]) for row, where in tracks.by_shot()]
    ours = np.array([(said[shot][4] - z_m, said[shot][7]) for shot, z_m in ends]).T
    errors = (ours[0], plain, end_errors(flights, (), np.zeros((len(flights), 0))))
    return (SETS[name][0], *(f"{1000.0 * rms(one):.1f} mm" for one in errors),
            f"{(np.abs(ours[0]) < ours[1]).sum()} of {len(ends)}")


def main() -> int:
    args = read_options(__doc__, dir=(..., "folder of the recordings"), only=(",".join(SETS), "comma-separated"),
                        orders=(0, "of rows, besides their own"), seeds=(0, "from 0 on"))
    asked = args.only.split(",")
    if unknown := set(asked) - set(SETS):
        raise SystemExit(f"--only: there is no {', '.join(sorted(unknown))}; there are {', '.join(SETS)}")
    with tempfile.TemporaryDirectory() as folder:
        print(make_markdown(("set", "shots", "answer", "forecast of hold-out shots"),
                            [ask(name, args.dir, Path(folder)) for name in asked]), flush=True)
        if args.orders or args.seeds:
            print(make_markdown(("set", "answer", "size of the first name, 90 % interval of the first", "times"),
                                [row for name in asked for row in again(name, Path(folder), args.orders, args.seeds)]))
            return 0
        if ahead := [forecast(name, Path(folder)) for name in asked if name in LAWS]:
            print(make_markdown(("ends of tracks", "truearc", "plain fit", "gravity", "in the 90 % band"), ahead))
    return 0


if __name__ == "__main__":
    sys.exit(main())
