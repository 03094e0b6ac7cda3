"""The commands for a launcher and its camera: `run`, `doctor`, `emulate`, `sysid`, `vision` and its calibration."""

import argparse
import hashlib
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress, number, origin_of, out_file, packaged_cameras, refuse, write_out
from truearc.errors import InputError
from truearc.robot.aim_file import load_plan, with_plan
from truearc.robot.config.schema import Config, load_config
from truearc.robot.operator_ui import OFF, PORT, add_page_argument, parse_page

if TYPE_CHECKING:
    from truearc.api.emulation import Emulation
    from truearc.sim.sysid.fit import Record

VIRTUAL = "virtual"
WATCHDOG_MS = 100                     # without --watchdog-ms


def run_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--can", metavar="INTERFACE:CHANNEL", help="instead of [can], such as slcan:/dev/ttyACM0")
    parser.add_argument("--buttons", metavar="PORT", help="instead of [buttons] port")
    parser.add_argument("--camera", metavar="DEVICE", help="instead of [camera] device; a URL, too")
    parser.add_argument("--plan", type=Path, metavar="TABLE", help="shoot these configurations: a CSV file with "
                        "distance_m, motor_ratio, hood_deg, or a dataset directory; it says where to stand")
    parser.add_argument("--repeats", type=int, metavar="N", help="shots at each configuration (default: [collect])")
    parser.add_argument("--gate", type=Path, help="exported model; needed when the policy is 'model'")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file of `truearc aim --robot`, which [aim] "
                        "policy = \"belief\" needs")
    parser.add_argument("--aim-inbox", type=Path, metavar="DIR", help="offer the driver the newest aim file that is "
                        "put into this folder; the accept button takes it while disarmed")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder to make the session's folder in")
    add_page_argument(parser, str(PORT))
    parser.add_argument("--core", type=number(int, 0), metavar="N",
                        help="keep the control loop on this core (default: any)")
    parser.add_argument("--priority", type=number(int, 0, 99), default=50, metavar="P",
                        help="SCHED_FIFO priority of the control loop, where the system allows it; 0 asks for none")
    parser.add_argument("--layout", choices=("three", "one"), default="three",      # keys of run_processes.LAYOUTS
                        help="processes: three (control, vision, recorder), or all in one, to compare")


def run(args: argparse.Namespace) -> int:
    """Run the launcher on its real wires and record it; ends on Ctrl-C or SIGTERM with the motors idle."""
    from truearc.cli.run_robot import run_robot
    return run_robot(args)


def doctor_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--gate", type=Path, help="model, as for truearc run")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file, as for truearc run")
    parser.add_argument("--out", type=Path, default=Path("sessions"), help="folder for sessions, as for truearc run")
    parser.add_argument("--endpoints", type=Path, metavar="JSON", help="flat_endpoints.json of the axes' firmware: "
                        "their watchdogs and encoder filters are asked, too")
    parser.add_argument("--move", action="store_true", help="also turn the wheels slowly, and the hood to its limit "
                        "switch and back, once you have typed yes: directions, scales, lags, the switch")
    parser.add_argument("--priority", type=number(int, 1, 99), default=50, metavar="P", help="as for truearc run")
    parser.add_argument("--seconds", type=number(float, 0.5, 600.0), default=2.0, metavar="S",
                        help="to listen to the bus")
    parser.add_argument("--set", action="store_true", help="compare the watchdogs and limits that the axes keep with "
                        "the rig, and write and save what differs after a yes; with --endpoints")
    parser.add_argument("--yes", action="store_true", help="with --set or --move: do not ask; with --move, "
                        "all balls are out, and hands away")
    parser.add_argument("--json", action="store_true", help="findings as JSON")


def doctor(args: argparse.Namespace) -> int:
    """Check everything that a run needs; print one line each with its state and what to do about it.

    Without --set it changes nothing but an exposure that the configuration fixes; without --move it moves nothing. Stop
    a running robot first, because it holds camera and button box. Exit 1 if anything fails.
    """
    from truearc.cli.doctor_checks import check_robot, set_devices
    if args.set:
        refuse(args, ("--move",), "apart from --set: what is written first is looked at first")
        return set_devices(args)
    return check_robot(args)


def emulate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--trials", type=number(int, 1), metavar="N", help="needed without --plan")
    parser.add_argument("--plan", type=Path, metavar="TABLE", help="shoot these configurations instead of walking: a "
                        "CSV file with distance_m, motor_ratio, hood_deg, or a dataset directory")
    parser.add_argument("--repeats", type=int, metavar="N", help="shots at each configuration (default: [collect])")
    parser.add_argument("--out", type=Path, metavar="SESSION", help="folder to make; needed unless --bus is another "
                        "than virtual")
    parser.add_argument("--bus", default=VIRTUAL, metavar="INTERFACE:CHANNEL", help="slcan:auto (a serial adapter on "
                        "a pseudo-terminal), slcan:socket or socketcan:vcan0: play the devices alone, in real time, "
                        "for `truearc run` in another process, which records (default: virtual, all in this process)")
    parser.add_argument("--watchdog-ms", type=number(int, 1), metavar="MS", help="with --bus: watchdog timeout of "
                        "the motor drivers; more on a machine that stalls (default: 100)")
    parser.add_argument("--config", type=Path, default=SHIPPED, help="launcher.toml (default: the shipped one)")
    parser.add_argument("--world", type=Path, help="world.toml; the robot never sees it (default: an honest world)")
    parser.add_argument("--gate", type=Path, help="model that must agree before the robot fires")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim by this file of `truearc aim --robot`")
    parser.add_argument("--film", type=Path, metavar="CLIPS", help="folder to make for clips of the flights, by an "
                        "emulated phone beside them (extra `video`); their truth goes into CLIPS-truth.csv")
    parser.add_argument("--seed", type=number(int, 0), default=0, help="seed of the world")
    add_page_argument(parser, OFF, ", for which time passes no faster than it does")


def emulate(args: argparse.Namespace) -> int:
    """Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world."""
    config = load_config(args.config)
    # the emulated robot stands still, and sees with a camera of its own
    config = replace(config, readings={
        name: {key: value for key, value in table.items() if key not in ("vision", "velocity")}
        for name, table in config.readings.items()})
    config = with_plan(config, load_plan(args.plan, config) if args.plan else (), args.repeats)
    trials = _trials(args.trials, config)
    print(_serve(args, config, trials) if args.bus != VIRTUAL else _emulate(args, config, trials))
    return 0


def _emulate(args: argparse.Namespace, config: Config, trials: int) -> "Emulation":
    refuse(args, ("--watchdog-ms",), "applies with --bus only")
    if args.out is None:
        raise InputError("--out is needed: the folder to record into")
    if config.gate.policy == "model" and args.gate is None:
        raise InputError(f"{args.config}: gate.policy is 'model', so --gate is needed")
    from truearc.cli.gate import make_command
    from truearc.hw.real.clock import MonotonicClock
    from truearc.robot.eyes import open_their_screens
    from truearc.robot.operator_ui.server import open_page
    from truearc.robot.runtime import open_screens
    from truearc.sim.world.options import load_options
    asks = make_command(args.gate, config) if args.gate else ()
    page = open_screens((partial(open_page, args.page, config, args.out.name, gate_command=asks),
                         partial(open_their_screens, config, args.gate, True)), MonotonicClock())
    try:
        return ta.emulate(config, args.out, trials, args.seed, load_options(args.world), args.gate,
                          make_progress("emulate", args.quiet), page=page, aim_path=args.aim, clips=args.film)
    finally:
        if page is not None:
            page.close()


def _serve(args: argparse.Namespace, config: Config, trials: int) -> "Emulation":
    refuse(args, ("--quiet",), "does not apply with --bus: no progress is shown")
    for option, value in (("--out", args.out), ("--gate", args.gate), ("--aim", args.aim),
                          ("--film", args.film), ("--page", parse_page(args.page))):
        if value is not None:
            raise InputError(f"{option} is for `truearc run` with --bus {args.bus}: that process is the robot")
    from truearc.api.emulation import Emulation
    from truearc.sim.world.emulated_robot import serve
    from truearc.sim.world.options import load_options

    def say(command: str) -> None:
        needed = {" --gate GATE.onnx": config.gate.policy == "model", " --aim AIM.json": config.aim.policy == "belief"}
        files = "".join(option for option, is_needed in needed.items() if is_needed)
        print(f"the devices wait on {args.bus}; start the robot in another terminal:\n  {command}{files}", flush=True)

    return Emulation(args.bus, tuple(serve(config, args.config, args.bus, args.watchdog_ms or WATCHDOG_MS, trials,
                                           args.seed, load_options(args.world), say)))


def _trials(asked: int | None, config: Config) -> int:
    """How many: as asked, or every prescribed shot."""
    prescribed = len(config.collect.prescribed) * config.collect.repeats
    if asked is None and not prescribed:
        raise InputError("--trials is needed, or --plan, which says how many by itself")
    if asked is not None and 0 < prescribed < asked:
        raise InputError(f"--trials {asked}: the plan has {prescribed} shots, repeats included")
    return prescribed if asked is None else asked


# --- sysid

FLYWHEEL, HOOD = "flywheel", "hood"  # as truearc.robot.sysid, which loads the gate, calls them



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
    """Fit friction, inertia and delay of flywheels and hood, and write the resulting gains.

    Drives them by the program of [identify], or takes a recorded session or a CSV file. Writes gains to paste, never
    the configuration. Exit 1 if there is nothing to fit or the program was not completed.
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
        from truearc.cli.run_robot import drive_robot
        return drive_robot(config, args.out, tell)
    # MuJoCo, which the robot's base install leaves out
    from truearc.cli.run_robot import drive_twin
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
    title = f"truearc sysid {ta.__version__}: {source}"
    fragment = make_fragment(title, fits, config, notes)
    write_out(args.gains, fragment)
    if args.report is not None:
        # matplotlib, likewise
        from truearc.robot.recording.session import TELEMETRY
        from truearc.sim.sysid.html_report import make_fit_page
        content = (Path(source) / TELEMETRY if Path(source).is_dir() else Path(source)).read_bytes()
        origin = origin_of(args)._replace(sha256=hashlib.sha256(content).hexdigest())
        write_out(args.report, make_fit_page(title, fits, make_gains(fits, config), notes, origin))
    print(fragment, end="")           # last: whoever reads it may be gone
    return 0


# --- cameras

SMALLEST_M = 1e-6                     # of a standard deviation


def vision_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="+", metavar="IMAGE", help="8-bit colour image (JPEG, PNG, BMP, WebP)")
    parser.add_argument("--camera", metavar="FILE",
                        help="camera.toml or launcher.toml, or the name of a packaged camera "
                             f"({', '.join(packaged_cameras())}); without it, the packaged launcher.toml")
    parser.add_argument("--labels", metavar="FILE",
                        help="CSV with columns file,label_distance_m: prints an error table")


def vision(args: argparse.Namespace) -> int:
    """Find the retro-reflective target in images; CSV on stdout, reasons on stderr.

    Distances are horizontal, lens to tape centre, along the line of sight. Corners are x y pairs in pixels: bottom
    right, bottom left, top left, top right. A file that cannot be read as an image has an empty `found`. A picture of
    another size than the camera's is treated as another mode of its sensor that shows the full height: one that was
    cropped or turned gets a wrong distance. See also `truearc vision-calibrate` and `truearc vision-tune`.
    Exit 2 where a file was not an image; the others are answered all the same.
    """
    from truearc.cli.vision_images import measure_images
    return measure_images(args)


def vision_calibrate_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="*", metavar="IMAGE",
                        help="pictures of the board; with --distances, only these of the files it names")
    parser.add_argument("--board", metavar="BOARD",
                        help="chessboard:COLUMNSxROWS:SQUARE_M (inner corners) or "
                             "charuco:COLUMNSxROWS:SQUARE_M:MARKER_M:DICT_4X4_50 (squares)")
    parser.add_argument("--distances", metavar="CSV",
                        help="columns file,distance_m (or label_distance_m); files lie beside it or are given as IMAGE")
    parser.add_argument("--camera", metavar="FILE", help="where to begin: as for `truearc vision`")
    parser.add_argument("--tape-sigma", type=number(float, SMALLEST_M, 10.0), metavar="M",
                        help="standard deviation of one taped distance, metres (default 0.01)")
    parser.add_argument("--bias-sigma", type=number(float, SMALLEST_M, 10.0), metavar="M",
                        help="how well it is known that the tape began below the lens, metres (default 0.02)")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE",
                        help="camera.toml to write; without it, on stdout")


def vision_calibrate(args: argparse.Namespace) -> int:
    """Calibrate a camera and write camera.toml with its uncertainties.

    With --board: focal length, axis and lens distortion from pictures of a chessboard or ChArUco board, held at many
    slants all over the picture. With --distances: a better focal length from pictures of the target whose horizontal
    distance (lens to tape centre) was measured with a tape; three are enough.
    """
    if bool(args.board) == bool(args.distances):
        raise InputError("--board or --distances: one of the two is needed")
    if args.board:
        refuse(args, ("--tape-sigma", "--bias-sigma"), "applies with --distances only")
    from truearc.cli.vision_images import calibrate_camera
    return calibrate_camera(args)


def vision_tune_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sources", nargs="*", metavar="IMAGE|FOLDER",
                        help="pictures, folders of pictures, or recorded sessions; none: the live camera")
    parser.add_argument("--camera", metavar="FILE", help="where to begin: as for `truearc vision`")
    parser.add_argument("-o", "--out", type=out_file, metavar="FILE", default="camera.toml",
                        help="file that Save writes")
    parser.add_argument("--port", type=int, default=5807, help="of the page; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", help="of the page; the default is this machine only")


def vision_tune(args: argparse.Namespace) -> int:
    """Serve a page on this machine with sliders for the settings of target detection.

    It shows pictures, or the live camera, with the mask, the regions, and why each is the target or not. Recorded
    pictures can all be run through changed settings at once; Save writes them to --out.
    """
    from truearc.cli.vision_tuner import serve_tuner
    return serve_tuner(args)
