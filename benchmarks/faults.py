"""Is a fault of the tracker mistaken for physics of the ball?

    python -m benchmarks.faults --worlds 10 --seed 61 --out FILE
    python -m benchmarks.faults --table FILE

The tracks of worlds in which nothing is hidden (truearc_proof.truth, L2) are corrupted as by a bad tracker, with
nothing of truearc.sim.physics. Discovery runs on each, and on the original tracks.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from benchmarks.worlds import Job, Line, fill_and_tell, read_args, world_of
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Tracks
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import discover
from truearc_proof.rounds.tables import said
from truearc_proof.table import make_markdown
from truearc_proof.truth.generate import shoot

NONE, SHOTS = "none", 300
LONG = 1.05                           # too long a metre, too slow a clock
SHRINKING = -0.02                     # of the scale, per m of height
LOST_FRAMES = 2                       # in the middle of a flight, without saying so


def scaled(tracks: Tracks, scale: float | np.ndarray) -> Tracks:
    return replace(tracks, x_m=scale * tracks.x_m, y_m=scale * tracks.y_m, z_m=scale * tracks.z_m)


def lost_frames(tracks: Tracks) -> Tracks:
    """In the middle of each track the camera drops frames, and what follows is stamped as if it had not."""
    t_s, kept = tracks.t_s.copy(), np.ones(len(tracks.t_s), dtype=bool)
    for shot in np.unique(tracks.shot):
        mine = np.flatnonzero(tracks.shot == shot)
        mine = mine[np.argsort(t_s[mine])]
        lost, later = np.split(mine[len(mine) // 2:], [LOST_FRAMES])
        kept[lost] = False
        t_s[later] -= LOST_FRAMES * np.median(np.diff(tracks.t_s[mine]))
    return Tracks(tracks.shot[kept], t_s[kept], tracks.x_m[kept], tracks.y_m[kept], tracks.z_m[kept])


def turned(tracks: Tracks, toward: str, deg: float) -> Tracks:
    """The tracker's x axis is not the launcher's. Towards z the horizon is not level, and what lies ahead seems higher;
    towards y it points beside the target."""
    cosine, sine, other = np.cos(np.radians(deg)), np.sin(np.radians(deg)), getattr(tracks, toward)
    return replace(tracks, x_m=cosine * tracks.x_m - sine * other, **{toward: cosine * other + sine * tracks.x_m})


FAULTS: dict[str, Callable[[Tracks], Tracks]] = {
    "scale 5 % too long": lambda tracks: scaled(tracks, LONG),     # a metre measured in the wrong plane
    "clock 5 % slow": lambda tracks: replace(tracks, t_s=LONG * tracks.t_s),
    "2 frames lost": lost_frames, "tilted 4 deg": lambda tracks: turned(tracks, "z_m", 4.0),
    "turned 5 deg": lambda tracks: turned(tracks, "y_m", 5.0),
    "2 % smaller per m": lambda tracks: scaled(tracks, 1.0 + SHRINKING * tracks.z_m)}     # it looks up


def run(job: tuple[str, Job]) -> Line:
    """What discovery says of one set of tracks with one fault (or none)."""
    keep_compiled()
    fault, world = job
    dataset = shoot(world_of(world))
    assert dataset.tracks is not None
    tracks = dataset.tracks if fault == NONE else FAULTS[fault](dataset.tracks)
    finding = msgspec.json.decode(make_json(discover(replace(dataset, tracks=tracks), seed=world.index).finding))
    return {"fault": fault, "number": world.index, "found": finding["mismatch"]["found"],
            **{key: finding[key] for key in ("verdict", "where", "sentence", "what", "set", "also")}}


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: one row a fault. Shares have Wilson 95 % intervals and counts."""
    rows = []
    for fault in dict.fromkeys(one["fault"] for one in lines):
        mine = [one for one in lines if one["fault"] == fault]
        rows.append([fault, "simulated", *(said(sum(marks), len(marks)) for marks in (
            [one["found"] for one in mine], [blames_the_air(one) for one in mine])),
            counted(one["verdict"] for one in mine), counted(_names(mine))])
    head = ("fault", "tracks", "something found", "attributed to the air alone", "verdicts", "names")
    return make_markdown(head, rows)


def blames_the_air(line: Line) -> bool:
    """Return True if the first effect found is of the flight, and all its candidate terms are."""
    left = [one["stage"] for one in line["what"] if one["term"] in (line["set"] or ())]
    return bool(line["found"]) and all(stage == "flight" for stage in left or [line["where"]["stage"]])


def _names(lines: Sequence[Line]) -> Iterator[str]:
    for line in lines:
        for each in (line, *line["also"]) if line["found"] else ():
            yield " or ".join(each["set"]) if each["set"] else "unexplained effect"


def counted(words: Iterator[str]) -> str:
    """How often each word comes, the commonest first; "-" where there is none."""
    return ", ".join(f"{count} {word}" for word, count in Counter(words).most_common()) or "-"


def main() -> int:
    args = read_args(__doc__, worlds=10, shots=(SHOTS, "of each world"), seed=(11, "below 1000 to develop on"),
                     only=(str, "faults, comma-separated; else all, and none"))

    def plan() -> dict[str, tuple[str, Job]]:
        return {f"{fault}/simulated/{args.seed}/{index}":
                (fault, Job("nulls", "clean", "L2", args.shots, 0.0, args.seed, index))
                for index in range(args.worlds) for fault in (NONE, *FAULTS)
                if args.only is None or fault in args.only.split(",")}

    return fill_and_tell(args, plan, run, make_table)


if __name__ == "__main__":
    sys.exit(main())
