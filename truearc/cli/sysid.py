"""The command `sysid`: friction, inertia and gains of flywheels and hood."""

import argparse
import hashlib
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

import truearc
from truearc.cli.common import SHIPPED, make_progress, number, origin_of, refuse, write_out
from truearc.cli.outputs import out_file
from truearc.errors import InputError
from truearc.robot.config.schema import Config, load_config

FLYWHEEL, HOOD = "flywheel", "hood"  # as truearc.robot.sysid, which loads the gate, calls them

if TYPE_CHECKING:
    from truearc.sim.sysid.fit import Record


def sysid_options(parser: argparse.ArgumentParser) -> None:
    source = parser.add_mutually_exclusive_group()
    source.add_argument("session", type=Path, nargs="?", help="fit a session that was recorded before")
    source.add_argument("--csv", type=Path, metavar="FILE", help="fit a table with t_s, a column in _V or _Nm, and one "
                        "in _rad_s")
    source.add_argument("--emulate", action="store_true", help="drive the emulated robot instead of a real one")
    parser.add_argument("--config", type=Path, help="launcher.toml; with --emulate the shipped one, if not given")
    parser.add_argument("--only", choices=(FLYWHEEL, HOOD), help="drive only this")
    parser.add_argument("--out", type=Path, metavar="SESSION", help="session folder to make (default: "
                        "sessions/<time>; needed with --emulate)")
    parser.add_argument("--world", type=Path, help="world.toml of the emulated robot")
    parser.add_argument("--seed", type=number(int, 0), help="seed of the emulated robot (default 0)")
    parser.add_argument("-o", dest="gains", type=out_file, metavar="FILE", help="write the gains here, too")
    parser.add_argument("--report", type=out_file, metavar="PAGE",
                        help="HTML page with residuals (needs the sim extra)")


def sysid(args: argparse.Namespace) -> int:
    """Fit friction, inertia and delay of flywheels and hood, and write the gains that follow.

    Drives them by the program of [identify], or takes a recorded session or a CSV file. Writes gains to paste, never
    the configuration. Exit 1 where there is nothing to fit or the program was not finished.
    """
    _check(args)
    if args.csv is not None:
        # pyarrow, which the robot's base install leaves out
        from truearc.sim.sysid.session import load_steps
        return _answer(args, str(args.csv), {"feedforward": load_steps(args.csv)}, None, [])
    from truearc.sim.sysid.session import load_driven
    session = args.session or _drive(args)
    driven = load_driven(session)
    for warning in driven.warnings:
        print(f"truearc sysid: {warning}", file=sys.stderr)
    code = _answer(args, str(session), driven.records, driven.config, driven.warnings)
    return code if driven.whole else 1


def _check(args: argparse.Namespace) -> None:
    driving = args.session is None and args.csv is None
    if driving and not args.emulate and args.config is None:
        raise InputError("give --config to drive a robot, --emulate, a session, or --csv FILE")
    if not driving:
        refuse(args, ("--config", "--only", "--out", "--world", "--seed"), "applies where a robot is driven, not to a "
               "session or table recorded before")
    if not args.emulate:
        refuse(args, ("--world", "--seed"), "applies with --emulate only")
    if args.emulate and args.out is None:
        raise InputError("--emulate needs --out, the session to make")


def _drive(args: argparse.Namespace) -> Path:
    """Drive what was asked for; the session's folder."""
    config = _narrowed(load_config(args.config or SHIPPED), args.only)
    tell = (lambda text: None) if args.quiet else partial(print, file=sys.stderr, flush=True)
    if not args.emulate:
        from truearc.cli.sysid_drive import drive_robot
        return drive_robot(config, args.out, tell)
    # MuJoCo, which the robot's base install leaves out
    from truearc.cli.sysid_drive import drive_twin
    from truearc.sim.world.options import load_options
    from truearc.sim.world.world import World
    drive_twin(config, args.out, World(args.seed or 0, load_options(args.world)), tell)
    return Path(args.out)


def _narrowed(config: Config, only: str | None) -> Config:
    """The configuration that drives one joint only; it is recorded as it ran."""
    if only is None or config.identify is None:
        return config
    other = HOOD if only == FLYWHEEL else FLYWHEEL
    still = replace(getattr(config.identify, other), repeats=0)
    return replace(config, identify=replace(config.identify, **{other: still}))


def _answer(args: argparse.Namespace, source: str, records: "Mapping[str, Record]", config: Config | None,
            notes: Sequence[str]) -> int:
    """Fit, and say what came of it; 1 when there is nothing to fit."""
    if not records:
        return 1
    from truearc.sim.sysid.fit import fit_motion
    from truearc.sim.sysid.sysid_text import make_fragment, make_gains
    show, fits = make_progress("sysid", args.quiet), {}
    for done, (joint, record) in enumerate(records.items()):
        show(done / len(records), joint)
        fits[joint] = fit_motion(record)
    show(1.0, "")
    title = f"truearc sysid {truearc.__version__}: {source}"
    fragment = make_fragment(title, fits, config, notes)
    write_out(args.gains, fragment)
    if args.report is not None:
        # matplotlib, likewise
        from truearc.sim.sysid.html_report import make_fit_page
        origin = origin_of(args)._replace(sha256=_hash(Path(source)))
        write_out(args.report, make_fit_page(title, fits, make_gains(fits, config), notes, origin))
    print(fragment, end="")           # last: whoever reads it may be gone
    return 0


def _hash(source: Path) -> str:
    """SHA-256 of a table, or of a session's ticks."""
    from truearc.robot.recording.session import TELEMETRY
    return hashlib.sha256((source / TELEMETRY if source.is_dir() else source).read_bytes()).hexdigest()
