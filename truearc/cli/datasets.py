"""The commands that make and check datasets: `init`, `import`, `shots` and `check`."""

import argparse
import re
import shlex
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import truearc as ta
from truearc.cli import common
from truearc.cli.file_kinds import KINDS, as_typed, kind_of
from truearc.errors import OTHER_FORMATS, InputError, about, needs
from truearc.sim.data.importers import load_importers

RIG = Path(__file__).with_name("rig_template.toml")
GAMES = tomllib.loads(Path(__file__).with_name("games.toml").read_text(encoding="utf-8"))
OF_A_GAME = ("[ball]", "[target]", "# [target.ring]")      # blocks of the template that a game replaces
COLUMNS = ("shot_id", "distance_m", "hood_deg", "motor_ratio", "outcome")
TRACKED = {"shots.csv": ("shot_id", "exit_spin_rev_s"), "tracks.csv": ("shot_id", "t_s", "x_m", "y_m", "z_m")}
TRACKED_BELIEF = """[believe]                             # what the simulation has before anything is discovered
terms = ["gravity", "drag", "magnus"]"""
NOT_TRACKED = ("[[launcher.wheel]]", "[target]", "free_speed_rad_s")       # of rig.toml: flights alone need none


def init_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", nargs="?", type=common.OutFolder(("rig.toml", "shots.csv", "tracks.csv")),
                        metavar="DIR", help="dataset directory to make")
    parser.add_argument("--game", choices=GAMES, help="a game whose ball and target rig.toml has, with the source of "
                        "each number (DIR: the game's name, if not given)")
    parser.add_argument("--units", type=lambda text: text.split(","), default=[], metavar="UNIT[,UNIT]",
                        help="in which shots.csv has distances and angles instead of m and deg: mm, cm, in or ft; rad")
    parser.add_argument("--tracks", action="store_true", help="a dataset of flights that a camera saw: tracks.csv, "
                        "too, and a rig.toml without wheels and target")
    parser.add_argument("--robot", type=common.out_file, metavar="FILE", help="launcher.toml to write instead: the "
                        "configuration that the emulated robot runs with, every key with its meaning")


def init(args: argparse.Namespace) -> int:
    """Write templates to fill in: a dataset (rig.toml and shots.csv), or with --robot a launcher's configuration.

    shots.csv gets a row for each shot: a name, the horizontal distance to the target in metres, the hood's angle above
    the horizontal in degrees, motor speed / free speed, and miss, two or three. docs/reference/dataset.md has all of
    them.
    """
    if args.game is not None:
        if args.tracks:
            raise InputError("--game: goes with a rig.toml that has a target, not with --tracks")
        args.dataset = args.dataset or (None if args.robot else Path(args.game))
    if (args.dataset is None) == (args.robot is None):
        raise InputError("DIR or --robot FILE: give one of the two")
    if args.robot is not None and args.units:
        raise InputError("--units: launcher.toml is in SI units; it goes with DIR")
    if args.tracks and (args.robot is not None or args.units):
        raise InputError("--tracks: goes with DIR alone; columns in other units are read by their names (x_mm, x_ft)")
    columns = in_units(args.units)
    if args.robot is not None:
        text = common.SHIPPED.read_text(encoding="utf-8")
        common.write_out(args.robot, text if args.game is None else robot_of_game(text, args.game))
        print(f"{args.robot}: change what differs on your launcher; then: truearc doctor --config {args.robot}")
        return 0
    args.dataset.mkdir(parents=True, exist_ok=True)
    rig = RIG.read_text(encoding="utf-8")
    if args.game is not None:
        rig, columns = of_game(rig, args.game), [*columns, "side"]
    common.write_out(args.dataset / "rig.toml", for_tracks(rig) if args.tracks else rig)
    for name, header in (TRACKED if args.tracks else {"shots.csv": columns}).items():
        common.write_out(args.dataset / name, ",".join(header) + "\n")
    rows = ", a row of shots.csv for each shot and one of tracks.csv for each frame" if args.tracks else (
        " and a row of shots.csv for each shot")
    print(f"{args.dataset}: fill in rig.toml{rows}; then: truearc check {args.dataset}")
    return 0


def of_game(rig: str, game: str) -> str:
    """Return the template rig.toml with the ball and the target of a game."""
    first, *blocks = (block for block in rig.split("\n\n") if not block.startswith(OF_A_GAME))
    of_launcher = next(number for number, block in enumerate(blocks) if block.startswith("[site]"))
    return "\n\n".join([first, *blocks[:of_launcher], GAMES[game]["blocks"].strip(), *blocks[of_launcher:]])


def robot_of_game(launcher: str, game: str) -> str:
    """Return launcher.toml with the ball and the target of a game, and with its AprilTag, if any."""
    blocks = [block for block in launcher.split("\n\n") if not block.startswith("[rig.target]")]
    own = re.sub(r"^\[(?!rig)", "[rig.", GAMES[game]["blocks"].strip(), flags=re.MULTILINE)
    text = "\n\n".join(own if "[rig.ball]" in block else block for block in blocks)
    if 'facing = "up"' in own:        # lobbed
        text = text.replace("hood_high_deg = 54.0", "hood_high_deg = 68.0")
    if (tag := GAMES[game].get("apriltag")) is None:
        return text
    return "\n\n".join(tag.strip() if "\n# [apriltag]" in block else block.replace('# target = "apriltag"  ',
                                                                                 'target = "apriltag"    ')
                       for block in text.split("\n\n"))


def for_tracks(rig: str) -> str:
    """Return the template rig.toml without what flights alone do not need."""
    blocks = [TRACKED_BELIEF if block.startswith("[believe]") else block for block in rig.split("\n\n")
              if not block.startswith(NOT_TRACKED)]
    return "\n".join(line for line in "\n\n".join(blocks).split("\n") if not line.startswith(NOT_TRACKED))


def in_units(units: list[str]) -> list[str]:
    """Return the columns of shots.csv in these units; InputError for a unit that none of them can be in."""
    from truearc.robot.config.units import CONVERTED
    columns = list(COLUMNS)
    for unit in units:
        read = next((read for read in ("m", "deg") if unit in (read, *CONVERTED[read])), None)
        if read is None:
            known = ", ".join(one for read in ("m", "deg") for one in (read, *CONVERTED[read]))
            raise InputError(f"--units: {unit!r} is not a unit of a distance or an angle; there are {known}")
        columns = [name.removesuffix(read) + unit if name.endswith(f"_{read}") else name for name in columns]
    return columns


def shots_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sessions", type=Path, nargs="+", metavar="SESSION", help="recorded session folder")
    parser.add_argument("-o", "--out", type=common.OutFolder(common.DATASET), required=True, metavar="DIR",
                        help="dataset folder to write")
    parser.add_argument("--repeatability", action="store_true",
                        help="one row a configuration, labelled by the paper's R2/R3 rule (section IV-A)")


def shots(args: argparse.Namespace) -> int:
    """Turn recorded sessions into a dataset of shots (rig.toml, shots.csv, traces.csv)."""
    from truearc.sim.data.recordings import label_by_repeatability
    progress = common.make_progress("shots", args.quiet)
    dataset = ta.shots_from_sessions(args.sessions, args.out.name)
    progress(0.8, "read")
    if args.repeatability:
        dataset = label_by_repeatability(dataset)
    ta.save_dataset(args.out, dataset)
    progress(1.0, f"{len(dataset.shots)} rows")
    outcomes = dataset.shots.text("outcome")
    target = dataset.rig.target
    up = target is not None and target.hit_or_miss
    counts = ", ".join(f"{outcomes.count(kind)} {'hit' if up and kind == 'two' else kind}"
                       for kind in ("three", "two", "miss") if not up or kind != "three")
    print(f"{args.out}: {len(dataset.shots)} shots ({counts}); {len(dataset.left_out)} left out")
    for line in [] if args.quiet else dataset.left_out:
        print(f"  left out: {line}", file=sys.stderr)
    return 0


def check_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    parser.add_argument("--believe", type=common.listed(str), metavar="TERMS", help="terms of the simulation, "
                        "comma-separated; else rig.toml's")
    common.add_accept(parser)
    parser.add_argument("--seed", type=common.number(int, 0), help="of the season that is planned without "
                        "shots, or of where shots without results pass")


def check(args: argparse.Namespace) -> int:
    """Check a dataset before anything is fitted: whether it can be read, is plausible, and which effects it could show.

    With fewer than ten shots, a season of them is planned for the rig.
    """
    from truearc.sim.check.check import check_plausible
    from truearc.sim.compute import keep_compiled
    from truearc.sim.discover.report.pages import sight_summary
    keep_compiled()
    from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, say_few
    dataset = check_plausible(ta.load_dataset(args.dataset), args.accept)
    print("\n".join([*dataset.lines(), *ranges(dataset), *plausibility(dataset),
                     *(f"note: {line}" for line in dataset.notes())]))
    few = len(dataset.shots) < FEWEST_SHOTS
    for line in lacking(dataset):
        print(f"warning: {line}")
    if few and dataset.rig.target is None:
        print(f"warning: {say_few(len(dataset.shots))}; no season can be planned: rig.toml has no [target]")
        return 0
    with about(args.dataset):
        could = ta.identifiability(dataset.rig if few else dataset, believe=args.believe, seed=args.seed,
                                   accept=args.accept, progress=common.make_progress("check", args.quiet))
    if few:
        print(f"warning: {say_few(len(dataset.shots))}" if len(dataset.shots) else "\nno shots yet", end="")
    print("; of a season with this rig:" if few else "")
    by_effect = ["truearc", "identifiability", str(Path(args.dataset) / "rig.toml") if few else args.dataset,
                 *(["--believe", ",".join(args.believe)] if args.believe else [])]
    print("\n".join([*sight_summary(could.sight, could.catalogue), f"effect by effect: {shlex.join(by_effect)}"]))
    return 0


def lacking(dataset: "ta.Dataset") -> list[str]:
    """Return what no shot states of its own settings and results, where there are no tracks or times."""
    from truearc.sim.data.table import WHEEL
    known = {name for name, column in dataset.shots.numbers.items() if (column == column).any()}
    known |= {"wheel_<name>_rad_s" for name in known if WHEEL.fullmatch(name)}
    known |= {"outcome"} if any(dataset.shots.text("outcome")) else set()
    found = ((("distance_m",), "distance to the target"), (("hood_deg", "exit_deg"), "elevation"),
             (("motor_ratio", "exit_speed_m_s", "wheel_<name>_rad_s"), "speed"),
             (("outcome", "miss_height_m"), "result"))
    asked = found if len(dataset.shots) and not {"tracks", "times"} & set(dataset.samples) else ()
    return [f"{dataset.shots.source}: {' or '.join(names)}: no shot states its {what}" for names, what in asked
            if not known & set(names)]


def ranges(dataset: "ta.Dataset") -> list[str]:
    """Return a line per column of numbers: lowest to highest."""
    known = {name: column[column == column] for name, column in dataset.shots.numbers.items()}
    return [f"  {name:20s} {column.min():g} to {column.max():g}" for name, column in known.items() if len(column)]


def plausibility(dataset: "ta.Dataset") -> list[str]:
    """Return what the plausibility checks of a dataset that passed them have to say."""
    from truearc.sim.check.believable import SCORES, judged_shots
    objections = [f"warning: {objection}" for objection in dataset.accepted] or [
        "plausible: every check passed" if len(dataset.shots) else f"{dataset.shots.source}: has no shot yet"]
    flights = {"tracks", "times"} & set(dataset.samples)
    unjudged = [("tracks.csv", "gravity, axes, units of length and time", not flights),
                (f"{SCORES} scoring shots of known distance, angle and speed",
                 "distances, angles and speeds by each other", not flights and not len(judged_shots(dataset)))]
    return objections + [f"  not checked without {needed}: {what}" for needed, what, missing in unjudged if missing]


# --- import

MAP = "shots.toml"


def import_shots_options(parser: argparse.ArgumentParser) -> None:
    importers = load_importers()
    known = "; ".join(f"{importer.name}: {', or '.join(importer.ways)}" for importer in importers)
    parser.add_argument("source", choices=sorted({*OTHER_FORMATS, *(importer.name for importer in importers)}),
                        help=f"{', '.join(OTHER_FORMATS)} or csv: any team's; others: whose recordings (more come "
                        "with pip install ./proof in a checkout)")
    parser.add_argument("files", nargs="+", metavar="FILE", help=f"the public originals, or tables of them: {known}")
    parser.add_argument("-o", "--out", type=common.OutFolder(common.DATASET), required=True, metavar="DIR",
                        help="dataset directory to write")
    parser.add_argument("--only", metavar="COLUMN=TEXT,...", help="of the dataset's shots those with one of these "
                        "texts in the column (ball_quality=new), to compare parts with each other")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--map", metavar="MAP", help="of any team's files: which keys say what: a shots.toml, or an "
                     "installed map, such as ftc-csv, tracker, kinovea")
    how.add_argument("--guess", action="store_true", help="propose that map from the names, units and numbers in the "
                     f"first file, write it to DIR/{MAP}, and import by it; rows of a table that are less than 0.5 s "
                     "apart are a log's, others a shot each")
    parser.add_argument("--outcomes", type=outcome_words, metavar="WORD=MEANING,...", help="with --guess: what "
                        "words of outcomes mean whose meaning is not certain, such as in=three,rim=two,short=miss-low; "
                        "rejected leaves shots out")
    parser.add_argument("--rig", type=Path, metavar="RIG.toml", help="of any team's files: ball, wheels and target "
                        "(truearc init DIR makes one to fill in)")


def outcome_words(text: str) -> dict[str, str]:
    """Return the `type=` of --outcomes: {word of the data: word of a map}."""
    pairs = [pair.rpartition("=") for pair in text.split(",")]
    if not all(word.strip() for word, _, _ in pairs):
        raise argparse.ArgumentTypeError(f"got {text!r}; expected WORD=MEANING,..., such as in=three,rim=two")
    return {word.strip(): meaning.strip() for word, _, meaning in pairs}


def import_shots(args: argparse.Namespace) -> int:
    """Turn the logs, tables and recordings of others into a dataset directory (docs/how-to/importing.md)."""
    from truearc.sim.data.import_shots import only
    from truearc.sim.printed import left_out_lines
    importer = next((importer for importer in load_importers() if importer.name == args.source), None)
    if importer is None:
        raise ta.InputError(f"{args.source}: {needs(args.source)}")
    if not importer.takes(args.files):
        raise ta.InputError(f"{args.source} takes {', or '.join(importer.ways)}; not {' '.join(args.files)}"
                            f"{_as_own(args)}")
    shot_map = ""
    if importer.load is None:
        dataset, shot_map = _by_map(args)
    elif args.map or args.guess or args.rig:
        any_team = " and ".join(one.name for one in load_importers() if one.load is None)
        raise ta.InputError(f"--map, --guess and --rig are for {any_team}; {args.source} knows its files' form")
    else:
        try:
            dataset = importer.load(*args.files)
        except ta.InputError as error:
            raise ta.InputError(f"{error}{_as_own(args)}") from error
    if args.only is not None:
        dataset = only(dataset, args.only)
    ta.save_dataset(args.out, dataset)
    if shot_map:
        (args.out / MAP).write_text(shot_map, encoding="utf-8")
    kind, table = ("times", dataset.times) if dataset.times is not None else ("track samples", dataset.tracks)
    print(f"{args.out}: {len(dataset.shots)} shots, {0 if table is None else len(table.t_s)} {kind}")
    for line in left_out_lines(dataset.left_out):
        print(line)
    for line in dataset.notes():
        print(f"note: {line}")
    return 0


def _as_own(args: argparse.Namespace) -> str:
    """The command for files that are not of the form that was named, by what the first of them is."""
    use = KINDS.get(kind_of(Path(args.files[0])), {}).get("use", "")
    return as_typed(f"\nFor a file of your own: {use.format(path=shlex.join(args.files))}", args) if use else ""


def _by_map(args: argparse.Namespace) -> "tuple[ta.Dataset, str]":
    """(the dataset with the command, the map's text where it was guessed)."""
    from truearc.robot.config.shot_map import plain
    from truearc.sim.data.guess_map import NoSuchOutcomeError
    from truearc.sim.data.import_shots import guess
    if not args.rig:
        raise ta.InputError(f"{args.source}: --rig RIG.toml is needed: a log does not say what ball, wheels and target "
                            "there are; `truearc init DIR` makes one to fill in")
    load = partial(ta.import_shots, args.files, rig=args.rig, name=args.out.name,
                   progress=common.make_progress("import", args.quiet))
    again = ["truearc", "import", args.source, *args.files, "--rig", str(args.rig), "-o", str(args.out)]
    if args.map:
        return replace(load(shot_map=args.map), imported=shlex.join([*again, "--map", str(args.map), "--force"])), ""
    if not args.guess:
        raise ta.InputError(f"{args.source}: --map MAP is needed, or --guess, which proposes one")

    def guessing(absent: Sequence[str] = ()) -> str:
        words = [f"{text}={word}" for text, word in (args.outcomes or {}).items() if plain(text) not in absent]
        return shlex.join([*again, "--guess", *(["--outcomes", ",".join(words)] if words else [])])
    try:
        guessed = guess(args.files, args.rig, args.outcomes, common.make_progress("guess", args.quiet))
    except NoSuchOutcomeError as error:
        raise ta.InputError(f"{error}\nWithout these words: {guessing(error.absent)}") from error
    except ta.InputError as error:
        raise ta.InputError(f"{error}\nCorrect what is named, and run: {guessing()}") from error
    print(f"guessed from the names, units and numbers of {args.files[0]}; make sure of it:")
    for line in guessed.lines:
        print(f"  {line}")
    if guessed.asked:
        proposed = ",".join(f"{text}={word}" for text, word in guessed.proposed.items())
        raise ta.InputError(f"{guessed.asked}. Correct it in the command and run: "
                            f"{shlex.join([*again, '--guess', '--outcomes', proposed])}")
    try:
        return replace(load(shot_map=guessed.map), imported=f"{guessing()} --force"), guessed.to_toml()
    except ta.InputError as error:
        print(f"\nthe map, to save as {MAP} and correct:\n\n{guessed.to_toml()}")
        raise ta.InputError(f"{error}\nCorrect what is named; or save the map above as {MAP}, correct it (words of "
                            f"outcomes: outcome.values), and run: {shlex.join([*again, '--map', MAP])}") from error
