"""The command `track`: clips of a still camera beside the launcher -> tracks of a dataset."""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli import common
from truearc.errors import InputError, save_whole

if TYPE_CHECKING:
    from truearc.sim.printed import Progress
    from truearc.sim.video.calibrate import Mark
    from truearc.sim.video.track import TrackedClip

BALL_M = 0.178                        # of the guide, where none is stated: the foam ball of the shipped robot
WRITTEN = (*common.DATASET, "flights")


def track_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clips", type=Path, nargs="*", metavar="CLIP", help="video file, or folder of pictures")
    parser.add_argument("-o", "--out", type=common.OutFolder(WRITTEN), metavar="DIR",
                        help="dataset folder to write: tracks.csv, shots.csv, a picture a flight and a clip")
    parser.add_argument("--guide", type=common.out_file, metavar="PAGE", help="write a page that says how to film and "
                        "what a clip will be worth, with the sheet to print; needs no clip")
    parser.add_argument("--ball-diameter", type=common.number(float, 0.01, 1.0), metavar="M", help="in m (default: of "
                        "--rig or --session; without one, the ball that gravity asks for is said)")
    parser.add_argument("--rig", metavar="FILE", help="rig.toml or launcher.toml: ball, release height, target")
    parser.add_argument("--session", type=Path, metavar="SESSION", help="recorded session, to whose shots the "
                        "flights are matched by the pattern of their times")
    parser.add_argument("--by-order", action="store_true", help="match the first flight to the first shot, and so on")
    parser.add_argument("--without", action="append", default=[], metavar="FLIGHT", help="leave out a flight, by the "
                        "name of its picture; flights/index.html shows all, and says this option for those you reject")
    parser.add_argument("--mark", type=parse_mark, action="append", default=[], metavar="X,Y=x,z", help="a known "
                        "place: its pixel, and metres ahead of the exit and above the floor; two give scale and level")
    parser.add_argument("--tag-size", type=common.number(float, 0.01, 2.0), metavar="M", help="side of the black "
                        "square of an AprilTag (36h11) in the plane of the flight")
    parser.add_argument("--exit", type=parse_pixel, metavar="X,Y", help="pixel of the launcher's exit (default: where "
                        "flights begin)")
    parser.add_argument("--rate", type=common.number(float, 1.0, 2000.0), metavar="HZ", help="pictures a second of a "
                        "folder of pictures")
    parser.add_argument("--slow-motion", type=common.number(float, 1.0, 100.0), default=1.0, metavar="FACTOR",
                        help="how many times slower than life the clip plays (4 for 240 frames a second stored as 60)")


def parse_pixel(text: str) -> tuple[float, float]:
    """Return the `type=` of --exit."""
    try:
        x_px, y_px = map(float, text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"got {text!r}; expected a pixel X,Y such as 131,208") from error
    return x_px, y_px


def parse_mark(text: str) -> "Mark":
    """Return the `type=` of --mark."""
    from truearc.sim.video.calibrate import Mark
    pixel, _, place = text.partition("=")
    try:
        return Mark(*map(float, (*pixel.split(","), *place.split(","))))
    except (TypeError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"got {text!r}; expected X,Y=x,z such as 131,208=0,0.75: a pixel, and metres "
                                         "ahead of the exit and above the floor") from error


def track(args: argparse.Namespace) -> int:
    """Find the ball in clips of a still side view, and write its tracks in metres.

    Each clip is tested by gravity, which is measured as if it were unknown. A clip that cannot be read is named, and
    the others go on. With --session, flights get the shots of a recording; if two ways to match them fit alike, both
    are named, and neither is used.
    """
    if args.guide is not None:
        from truearc.sim.video.guide import make_guide
        save_whole(args.guide, make_guide(args.ball_diameter or BALL_M).encode())
        print(f"{args.guide}: print the sheet on paper of size A3, without scaling")
        if not args.clips:
            return 0
    if not args.clips or args.out is None:
        raise InputError("name the clips and, with -o, the dataset to write; or --guide PAGE, how to film")
    return _track(args)


def _track(args: argparse.Namespace) -> int:
    from truearc.sim.video import write
    from truearc.sim.video.frames import open_clip
    from truearc.sim.video.track import View, measure, watch
    if args.session is None:
        common.refuse(args, ("--by-order",), "applies with --session only")
    recorded = ta.shots_from_sessions([args.session], args.out.name) if args.session else None
    rig = common.load_any_rig(args.rig) if args.rig else recorded.rig if recorded else None
    diameter_m = args.ball_diameter or (2.0 * rig.ball.radius_m if rig else None)
    view = View(diameter_m, tuple(args.mark), args.tag_size, args.exit, rig.launcher.release_height_m if rig else 0.0,
                rig.ball.mass_kg if rig else None)
    watched, unread = [], 0
    for number, path in enumerate(args.clips):
        show = part_with_time_left(common.make_progress("track", args.quiet), number, len(args.clips))
        try:
            watched.append(watch(open_clip(path, args.rate, args.slow_motion), show))
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            unread += 1
    if not watched:
        raise InputError("no clip could be read")
    clips = measure(watched, view)
    for one in clips:
        say_clip(one)
    named = write.match_flights(clips, recorded, args.by_order) if recorded else write.name_flights(clips)
    named = write.reject(named, clips, args.without)
    print(*named.lines, sep="\n", end="\n" if named.lines else "")
    saved = write.save_tracks(args.out, clips, named, rig, recorded)
    for one, names in zip(clips, named.shot_id, strict=True):
        write.save_pictures(args.out, one, names, recorded)
    save_whole(args.out / write.PICTURES / write.CHOOSE, write.make_choice(clips, args.without).encode())
    print(f"{args.out}: {saved} flights in tracks.csv; look at them in {args.out / write.PICTURES / write.CHOOSE}")
    knows_exit = bool(args.exit or args.mark) or all(one.saw_sheet for one in clips if one.placed)
    for line in advice(rig is not None, saved, knows_exit, args.out):
        print(line)
    sound = all(one.self_test is not None and one.self_test.is_sound for one in clips)
    return 2 if unread else 0 if sound and named.complete else 1


def say_clip(one: "TrackedClip") -> None:
    """Print what a clip showed: a line a flight, the self-test, and what is doubtful."""
    for number in range(len(one.flights)):
        print(one.line(number))
    for line in one.self_test.lines() if one.self_test else []:
        print(f"{one.clip.name}: {line}")
    for line in one.warnings:
        print(f"warning: {line}")
    for line in one.left_out:
        print(f"left out: {line}")


def advice(has_rig: bool, saved: int, knows_exit: bool, out: Path) -> list[str]:
    """Return what to do next."""
    found = []
    if saved and not knows_exit:
        found.append("note: heights count from where flights are first seen; the sheet of --guide, --exit X,Y or "
                     "--mark X,Y=x,z is exact")
    if not has_rig:
        found.append(f"note: {out} has no rig.toml; `truearc init --tracks DIR` makes one to fill in for --rig")
    elif saved:
        found.append(f"next: truearc discover {out}")
    return found


def part_with_time_left(show: "Progress", number: int, clips: int) -> "Progress":
    """Return the progress of one clip of several, which adds the time left for it."""
    begin = time.monotonic()

    def progress(done: float, note: str) -> None:
        left = (time.monotonic() - begin) * (1.0 - done) / done if done > 0.02 else None
        show((number + done) / clips, f"{note}{'' if left is None else f', {left:.0f} s left of this clip'}")

    return progress
