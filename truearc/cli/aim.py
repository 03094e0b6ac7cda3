"""The commands `aim`, which makes tables of set points, and `follow`, which proposes a new aim after a change."""

import argparse
import contextlib
import hashlib
import http.client
import math
import re
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli import common
from truearc.errors import about, load_bytes, naming, save_whole
from truearc.robot.config.units import CONVERTED
from truearc.sim.discover.finding import FALSE_ALARM, check_chances

if TYPE_CHECKING:
    from truearc.api.following import Following, Proposed

FORMATS = ("text", "csv", "json", "java", "cpp", "java-6328", "java-254", "csv-2928", "json-3476")
MOST = 1000                           # distances
UNIT = re.compile(r"(.*[\d.]) ?([a-z]+)")
RANGE = re.compile(r"([\d.]*\d) *(?:-|–|to|\.\.) *(\d[\d.]*) ?([a-z]*)")


def aim_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("belief", metavar="BELIEF", help="coefficients.toml, as `truearc fit` and `truearc discover "
                        "--adopt` write it")
    parser.add_argument("--rig", required=True, metavar="FILE", help="rig.toml of a dataset, or launcher.toml")
    parser.add_argument("--distances", type=parse_distances, metavar="LOW:HIGH:STEP", help="in m, or a list such "
                        "as 2,3.5,5; a unit may follow: 6:20:1ft (default: every 0.25 m of the range that the belief "
                        "was fitted to)")
    parser.add_argument("--hood", type=_span, metavar="LOW:HIGH", help="launch elevations in degrees to choose from "
                        "(default: the range that the belief was fitted to)")
    parser.add_argument("--format", choices=FORMATS, default="text", help="text for people, CSV or JSON with every "
                        "number, lines to paste into robot code, or the shape of a team's public "
                        "code: java-6328, java-254, csv-2928, json-3476 (default text)")
    parser.add_argument("-o", "--out", type=common.out_file, metavar="FILE",
                        help="file to write instead of standard output")
    parser.add_argument("--picture", type=common.out_file, metavar="PNG",
                        help="picture of set points and of the band that "
                        "scores")
    parser.add_argument("--robot", type=common.out_file, metavar="FILE",
                        help="aim file for `truearc run --aim`, checked "
                        "against the simulator; --rig should be the robot's launcher.toml then")
    parser.add_argument("--note", metavar="TEXT", help="one line in that file for the driver")
    common.add_terms_from(parser)
    common.add_accept(parser)


def aim(args: argparse.Namespace) -> int:
    """Find the hood angle and motor speed that score most at each distance, under a belief.

    Probabilities include the scatter from shot to shot, the sensors' noise (rig.toml [noise]) and the belief's
    covariance. The last columns of the table give the points that an error of distance, hood angle or motor speed
    costs.
    """
    from truearc.sim.compute import keep_compiled
    keep_compiled()
    if args.picture and args.picture.suffix.lower() != ".png":
        raise ta.InputError(f"--picture: {args.picture}: a PNG is written; end the name with .png")
    rig, belief = common.load_any_rig(args.rig), ta.load_belief(args.belief, common.catalogue_of(args))
    with about(args.rig):
        table = ta.aim(belief, rig, distances_m=args.distances, hood_deg=args.hood, accept=args.accept,
                       progress=common.make_progress("aim", args.quiet))
    if args.robot is None:
        common.refuse(args, ("--note",), "applies with --robot only")
    unit = args.distances.unit if args.distances is not None else "m"
    common.print_or_write(args.out, "\n".join(table.lines(unit)) if args.format == "text" else
                          table.to_text(args.format))
    if args.format != "text":         # which says so itself
        for distance_m, why in table.refused:
            print(f"warning: {distance_m:.2f} m has no set point: {why}", file=sys.stderr)
        for row in table.rows if args.format not in ("csv", "json") else ():           # which have a column of notes
            if row.note:
                print(f"warning: {row.distance_m:.2f} m: {row.note}", file=sys.stderr)
    if args.robot:
        check = ta.export_aim(table, belief, rig, args.robot, note=args.note or "")
        print(f"{args.robot}: aim file; {check}", file=sys.stderr)
    if args.picture:
        from truearc.sim.report import make_png
        save_whole(args.picture, make_png(table.plot()))
    return 0


def _numbers(text: str, separator: str) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, text.split(separator)))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not numbers with {separator!r} between them") from error
    if not all(map(math.isfinite, numbers)):
        raise argparse.ArgumentTypeError(f"got {text}; expected finite numbers")
    return numbers


class Distances(tuple[float, ...]):
    """Distances in m; `unit`: the unit in which they were given and are printed."""

    unit = "m"


def parse_distances(text: str) -> Distances:
    """Parse distances from a list or from LOW:HIGH:STEP; a unit of length may follow the last number."""
    if ends := RANGE.fullmatch(text):
        low, high = float(ends[1]), float(ends[2])
        raise argparse.ArgumentTypeError(f"got {text!r}; from {low:g} to {high:g} is --distances "
                                         f"{low:g}:{high:g}:{max(high - low, 0.6) / 6.0:.1g}{ends[3]}, with the step")
    stated = UNIT.fullmatch(text)
    if stated is None:
        return Distances(_listed_or_stepped(text))
    lengths = {"m": 1.0, **CONVERTED["m"]}
    if stated[2] not in lengths:
        raise argparse.ArgumentTypeError(f"got the unit {stated[2]!r}; expected one of {', '.join(lengths)}")
    found = Distances(lengths[stated[2]] * number for number in _listed_or_stepped(stated[1]))
    found.unit = stated[2]
    return found


def _listed_or_stepped(text: str) -> tuple[float, ...]:
    if ":" not in text:
        return _numbers(text, ",")
    numbers = _numbers(text, ":")
    if len(numbers) != 3 or numbers[2] <= 0.0 or not 0.0 < numbers[0] <= numbers[1]:
        raise argparse.ArgumentTypeError(f"got {text}; expected LOW:HIGH:STEP, ascending and above 0, such as 2:7:0.25")
    low, high, step = numbers
    count = int((high - low) / step + 1e-9) + 1
    if count > MOST:
        raise argparse.ArgumentTypeError(f"got {count} distances; at most {MOST} are possible")
    return tuple(low + step * index for index in range(count))


def _span(text: str) -> tuple[float, float]:
    numbers = _numbers(text, ":")
    if len(numbers) != 2 or not numbers[0] <= numbers[1]:
        raise argparse.ArgumentTypeError(f"got {text}; expected LOW:HIGH such as 30:54")
    return numbers[0], numbers[1]


# --- follow

PROPOSAL, BELIEF, AIM = "proposal.json", "belief.toml", "aim.json"
PATIENCE_S = 10.0                     # with the robot's page
AGAIN = 10                            # further shots, after which an alarm is put to discovery again


def follow_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", type=Path, nargs="+", metavar="SESSION", help="recorded session folders, or dataset "
                        "folders, of shots since the belief")
    parser.add_argument("--belief", required=True, metavar="FILE", help="coefficients.toml that is believed, from "
                        "`truearc fit` or `truearc discover --adopt`")
    parser.add_argument("--rig", metavar="FILE", help="rig.toml or launcher.toml to aim with (default: the rig of the "
                        "recordings)")
    parser.add_argument("--once", action="store_true", help="look once at what is there, and end")
    parser.add_argument("--every", type=common.number(float, 0.1, 3600.0), metavar="S", help="seconds between looks "
                        "(default 1)")
    parser.add_argument("--out", type=common.OutFolder((PROPOSAL, BELIEF, AIM)), metavar="DIR",
                        help=f"folder for {PROPOSAL}, "
                        f"{BELIEF} and the robot's {AIM}, written where a change is proposed")
    parser.add_argument("--send", type=_url, metavar="URL", help="address of the robot's operator page: the aim file "
                        "is sent there and offered to the driver; with --out and --token")
    parser.add_argument("--token", type=Path, metavar="FILE", help="file with the token of the robot's aim inbox")
    parser.add_argument("--distances", type=parse_distances, metavar="LOW:HIGH:STEP", help="of the set points, in m, "
                        "or a list such as 2,3.5,5 (default: every 0.25 m that the shots cover)")
    parser.add_argument("--false-alarm", type=float, default=FALSE_ALARM, metavar="P", help="probability of an alarm "
                        "in an endless session in which nothing changes")
    parser.add_argument("--seed", type=common.number(int, 0), default=0, help="of everything drawn at random")
    common.add_accept(parser)
    common.add_terms_from(parser)


def follow(args: argparse.Namespace) -> int:
    """Watch the shots since a belief, and propose another belief with its aim if something has changed.

    Sessions that are being recorded, or dataset folders that grow, are read again after each marked shot. However often
    that happens, the probability of an alarm is at most --false-alarm if nothing changes. After an alarm, discovery
    runs on the shots since the change, and the proposal is printed and written to --out. It changes nothing on a robot.
    End with Ctrl-C.
    """
    check_chances(args.false_alarm, args.seed, ("--false-alarm", "--seed"))
    if args.send is None:
        common.refuse(args, ("--token",), "applies with --send only")
    elif args.out is None or args.token is None:
        raise ta.InputError("--send: --out and --token are needed, too")
    from truearc.sim.compute import keep_compiled
    keep_compiled()
    belief = ta.load_belief(args.belief, common.catalogue_of(args))
    watch = ShotWatch(args, belief, None if args.rig is None else common.load_any_rig(args.rig))
    if args.once:
        common.refuse(args, ("--every",), "does not apply with --once")
        watch.look()
        return 0
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            watch.look_if_grown()
            time.sleep(args.every or 1.0)
    return 0


@dataclass
class ShotWatch:
    """The shots of some folders, read repeatedly.

    seen: sizes and times of the files at the last look; tried: shots at the last discovery; said: the last message.
    """

    args: argparse.Namespace
    belief: "ta.Belief"
    rig: "ta.Rig | None" = None
    seen: tuple[tuple[int, int], ...] | None = None
    tried: int = 0
    said: str = ""

    def look_if_grown(self) -> None:
        """Look if a file has changed since; wait for folders without a marked shot."""
        now = _stamp(self.args.paths)
        if now == self.seen:
            return
        self.seen = now
        try:
            self.look()
        except ta.InputError as error:
            if str(error) != self.said:
                print(f"waiting: {error}", file=sys.stderr, flush=True)
            self.said = str(error)

    def look(self) -> None:
        """Test all shots; after an alarm run discovery and propose."""
        dataset = read_shots(self.args.paths)
        rig = dataset.rig if self.rig is None else self.rig
        check_rig(rig, dataset, self.args.rig)
        found = ta.follow(dataset, self.belief, false_alarm=self.args.false_alarm, seed=self.args.seed,
                          accept=self.args.accept)
        print(found, flush=True)
        shots = len(found.e_values)
        if found.alarm is None or (self.tried and shots < self.tried + AGAIN):
            return
        if not found.can_be_named:
            print("more shots are needed to say what it is", flush=True)
            return
        self.tried = shots
        self._propose(found, rig)

    def _propose(self, found: "Following", rig: "ta.Rig") -> None:
        from truearc.api.following import propose, sealed
        from truearc.sim.discover.finding import BeliefFile
        progress = common.make_progress("discover", self.args.quiet)
        before = BeliefFile(self.args.belief, hashlib.sha256(load_bytes(self.args.belief)).hexdigest())
        try:
            made = propose(found, found.find(progress), rig, (before, BELIEF), self.args.distances,
                           common.make_progress("aim", self.args.quiet))
        except ta.InputError as error:
            print(error, flush=True)
            return
        print(made, flush=True)
        if self.args.out is not None:
            folder = Path(self.args.out)
            folder.mkdir(parents=True, exist_ok=True)
            made.belief.save(folder / BELIEF)
            content = (folder / BELIEF).read_bytes()
            proposal = sealed(made, content, datetime.now(UTC).isoformat(timespec="seconds"))
            common.write_out(folder / PROPOSAL, proposal.to_json())
            print(f"{folder / PROPOSAL}: {proposal.proposal.id}", flush=True)
            self._hand_over(made, rig, folder / AIM)

    def _hand_over(self, made: "Proposed", rig: "ta.Rig", path: Path) -> None:
        """Write the aim file, and send it; what goes wrong is printed, and following goes on."""
        from truearc.robot.aim_file import LONGEST_NOTE  # which loads the gate
        note = "".join(one for one in made.proposal.sentence if one.isprintable())[:LONGEST_NOTE]
        try:
            ta.export_aim(made.after, made.belief, rig, path, note=note)
            if self.args.send is not None:
                send_aim(self.args.send, self.args.token, path)
                print(f"{self.args.send}: offered to the driver", flush=True)
        except ta.InputError as error:
            print(f"not handed over: {error}", flush=True)


def send_aim(url: str, token: Path, path: Path) -> None:
    """Put an aim file into the inbox of the robot whose page has this address.

    Raises:
        InputError: the token cannot be read, the page does not answer, or it refuses; with its reason.
    """
    with naming(token):
        said = load_bytes(token).decode("ascii").strip()
    request = urllib.request.Request(url.rstrip("/") + "/aim", path.read_bytes(), method="PUT", headers={
        "Content-Type": "application/json", "Authorization": f"Bearer {said}"})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S):
            return
    except urllib.error.HTTPError as error:
        raise ta.InputError(f"{url}: {error.code}: {error.read(1000).decode(errors='replace')}") from error
    except (OSError, http.client.HTTPException) as error:
        raise ta.InputError(f"{url}: no answer ({getattr(error, 'reason', error)})") from error


def read_shots(paths: Sequence[Path]) -> "ta.Dataset":
    """Read the shots of sessions, or of datasets, one after another.

    Raises:
        InputError: both kinds at once, two rigs, a shot_id twice, or no marked shot.
    """
    from truearc.robot.recording.session import HEADER
    from truearc.sim.data.dataset import join_datasets
    sessions = [path for path in paths if (path / HEADER).exists()]
    if sessions and len(sessions) < len(paths):
        other = next(path for path in paths if path not in sessions)
        raise ta.InputError(f"{other}: not a recorded session, but {sessions[0]} is; give sessions or datasets")
    if sessions:
        return ta.shots_from_sessions(sessions, sessions[-1].resolve().name)
    first, *rest = map(ta.load_dataset, paths)
    for path, one in zip(paths[1:], rest, strict=True):
        check_rig(first.rig, one, str(path))
        with about(str(path), ValueError):
            first = join_datasets(first, one)
    return first


def check_rig(rig: "ta.Rig", dataset: "ta.Dataset", name: str | None) -> None:
    """Raise InputError unless ball, launcher and target are those of the shots."""
    for part in ("ball", "launcher", "target"):
        if getattr(rig, part) != getattr(dataset.rig, part):
            raise ta.InputError(f"{name}: {part} differs from that of {dataset.name}: a belief is of one rig")


def _url(text: str) -> str:
    if not text.startswith(("http://", "https://")):
        raise argparse.ArgumentTypeError(f"got {text}; expected an address such as http://robot.local:5808")
    return text


def _stamp(paths: Sequence[Path]) -> tuple[tuple[int, int], ...]:
    """Size and time of every file that shots are read from."""
    from truearc.robot.recording.session import HEADER, TRIALS
    files = [path / TRIALS if (path / HEADER).exists() else path for path in paths]
    inner = [one for file in files for one in (sorted(file.iterdir()) if file.is_dir() else [file]) if one.is_file()]
    return tuple((one.stat().st_size, one.stat().st_mtime_ns) for one in inner)
