"""Benchmark of discovery from filmed sessions: emulated worlds with one change each, tracked by `truearc track`.

    python -m benchmarks.filmed --worlds 60 --out FILE
    python -m benchmarks.filmed --table FILE

The emulated robot practises once, in an unchanged world, and its shots are filmed; what the paper's physics lacks is
found and adopted. In each world one of the demo's changes that has a term of the catalogue is at work; marked shots are
filmed, tracked and matched, and compared with practice. The same shots are judged with the world's true tracks, with
noise of NOISE_M, and by outcomes and telemetry alone, each beside a practice of its own kind. FILE has a line a world;
practice is kept beside it, in FILE.practice. Development used seeds below 8000.
"""

import csv
import math
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from msgspec import structs
from scipy.stats import binomtest

import truearc as ta
from benchmarks.demo_seeds import size_of
from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.cli.common import SHIPPED
from truearc.cli.demo_acts import EFFECTS, NOTHING, PAPER, WorldChange, marked_settings, practice_settings, shoot_filmed
from truearc.hw.emulated.imaging.phone import Phone
from truearc.robot.config.rig_spec import Rig, Tracker
from truearc.robot.config.schema import load_config
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset, Tracks
from truearc.sim.printed import make_text
from truearc.sim.video.write import match_flights, save_tracks
from truearc.sim.world.options import Options
from truearc.sim.world.world import ShotSetting, mark_of, season_of

CHANGES = tuple(effect for effect in EFFECTS if effect.terms)
KINDS = ("filmed", "true", "telemetry")
NOISE_M = 0.0013                      # of a position of the tracker, as benchmarks.track measures it
Sizes = tuple[int, int, Sequence[str]]            # shots of practice and of an event, and kinds of data


def film(rig: Rig, options: Options, seed: int, settings: Sequence[ShotSetting]) -> dict[str, Dataset]:
    """Shoot, film, track and match; return the session by KINDS."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        trials, tracked = shoot_filmed(home / "clips", rig, options, seed, settings, Phone())
        shots = season_of(rig, seed, trials, "L1", [mark_of(trial.result.outcome, rig) for trial in trials]).dataset
        save_tracks(home / "data", tracked, match_flights(tracked, shots), rig, shots)
        with (home / "clips-truth.csv").open() as file:
            rows = list(csv.DictReader(file))
        of_shot = {str(trial.result.shot): row for row, trial in enumerate(trials)}
        places = np.array([(of_shot[row["shot"]], *(float(row[name]) for name in ("time_s", "x_m", "z_m")))
                           for row in rows if row["shot"] in of_shot])
        first = defaultdict[float, float](lambda: math.inf)
        for shot, time_s, *_ in places:
            first[shot] = min(first[shot], time_s)
        rng = np.random.default_rng([seed, 11])
        x_m, z_m = places[:, 2:].T + NOISE_M * rng.normal(size=(2, len(places)))
        tracks = Tracks(places[:, 0].astype(int), places[:, 1] - [first[shot] for shot in places[:, 0]], x_m,
                        np.zeros(len(places)), z_m)
        sure = structs.replace(shots.rig, tracker=Tracker(calibrated=True))
        return {"filmed": ta.load_dataset(home / "data"), "true": replace(shots, tracks=tracks, facts=sure),
                "telemetry": shots}


def practise(rig: Rig, folder: Path, shots: int, kinds: Sequence[str]) -> dict[str, tuple[Dataset, ta.Belief]]:
    """Practice and belief of each kind; kept in the folder, as it is the same for all worlds."""
    if not (folder / "telemetry.toml").exists():
        played = film(rig, NOTHING.options, 7, practice_settings(rig, 7, shots))
        for kind in kinds:            # telemetry, the last, says that all are there
            data = played[kind]
            ta.save_dataset(folder / kind, replace(data, film=None))
            ta.discover(data, believe=PAPER, seed=7).adopt().save(folder / f"{kind}.toml")
    return {kind: (ta.load_dataset(folder / kind), ta.load_belief(folder / f"{kind}.toml")) for kind in kinds}


def run(rig: Rig, folder: Path, sizes: Sizes, job: tuple[int, WorldChange]) -> Line:
    """One world."""
    keep_compiled()
    seed, effect = job
    known = practise(rig, folder, sizes[0], sizes[2])
    settings = marked_settings(rig, known["telemetry"][1], effect.options, seed, sizes[1])
    line: Line = {"seed": seed, "change": effect.name, "terms": dict(effect.terms)}
    played = film(rig, effect.options, seed, settings)
    for kind in sizes[2]:
        data, (before, belief) = played[kind], known[kind]
        found = ta.discover(data, belief=belief, since=before, seed=seed)
        line[kind] = {"verdict": found.record.verdict, "tracked": 0 if data.tracks is None else
                      len(set(data.tracks.shot)), "shots": len(data.shots),
                      "names": [one.term for one in (found.best, *found.alternatives) if one],
                      "size": size_of(found.best) if found.best else None}
    return line


def make_table(lines: Sequence[Line]) -> str:
    """How often the first name is right and its interval holds, by kind of data; 95 % intervals (Clopper, Pearson)."""
    rows = []
    for kind in (kind for kind in KINDS if kind in lines[0]):
        right = [line[kind]["names"][:1] and line[kind]["names"][0] in line["terms"] for line in lines]
        held = [line[kind]["size"][1] <= line["terms"][line[kind]["names"][0]] <= line[kind]["size"][2]
                for line, ok in zip(lines, right, strict=True) if ok]
        rows.append((kind, _share(sum(map(bool, right)), len(right)), _share(sum(held), len(held)),
                     _share(sum(line[kind]["tracked"] for line in lines), sum(line[kind]["shots"] for line in lines))))
    both = [[line[kind]["names"][:1] and line[kind]["names"][0] in line["terms"] for kind in KINDS[:2]]
            for line in lines if KINDS[0] in line]
    said = f"right with true tracks only: {sum(b and not a for a, b in map(_bools, both))}; when filmed only: " \
           f"{sum(a and not b for a, b in map(_bools, both))}"
    return "\n".join([*make_text(("data", "first name right", "90 % interval holds", "shots with a track"), rows,
                                 right=range(1, 4)), said])


def _bools(pair: Sequence[object]) -> tuple[bool, bool]:
    return bool(pair[0]), bool(pair[1])


def _share(hits: int, tries: int) -> str:
    if not tries:
        return "-"
    low, high = binomtest(hits, tries).proportion_ci(0.95)
    return f"{hits}/{tries} = {hits / tries:.2f} ({low:.2f}-{high:.2f})"


def main() -> int:
    args = read_args(__doc__, worlds=60, first=(8000, "seed; the next is one more"),
                     quick=(False, "a few of the shots, telemetry alone: to try this script"))
    sizes = (24, 12, KINDS[2:]) if args.quick else (80, 40, KINDS)
    jobs = {f"{seed}/{sizes[1]}": (seed, CHANGES[seed % len(CHANGES)]) for seed in range(args.first,
                                                                                          args.first + args.worlds)}
    beside = (args.out or args.table).with_suffix(".practice")
    return fill_and_tell(args, lambda: jobs, partial(run, load_config(SHIPPED).rig, beside, sizes), make_table)


if __name__ == "__main__":
    sys.exit(main())
