"""The session behind `truearc advise`, which connects and records until signalled, or only examines the keys."""

import argparse
import sys
import tempfile
import threading
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from msgspec.structs import replace

from truearc.cli.doctor_checks import report
from truearc.cli.run_robot import Ending, make_room
from truearc.errors import InputError
from truearc.hw.real.clock import MonotonicClock, wall_clock, wall_offset_ns
from truearc.robot.advice import ADVICE, advise_step
from truearc.robot.aim_file import AimFile, load_aim_for
from truearc.robot.config.rig_spec import Rig, rig_errors
from truearc.robot.config.schema import AimConfig, Config, load_config, load_toml
from truearc.robot.config.shot_map import ShotMap, as_signal, load_map
from truearc.robot.gate import load_gate_for
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.rig import RecordingRig
from truearc.robot.runtime import run
from truearc_frc.advice import PATIENCE_S, AdviceIo, Adviser, advised_columns
from truearc_frc.doctor import look_beside
from truearc_frc.inputs import NtCamera, NtVelocity, keys_of_camera, keys_of_velocity
from truearc_frc.keys import NtKeys
from truearc_frc.table import LISTEN_S, nt4_of


def check(args: argparse.Namespace) -> int:
    """Print the doctor's findings on the robot's keys; return 1 if any is a failure. args: those of `truearc
    advise`."""
    return report([*look_beside(load_config(args.config), args.nt, load_map(args.map),
                                args.seconds or LISTEN_S)], args.json)


def advise(args: argparse.Namespace) -> tuple[int, Path]:
    """Return (ticks, session directory); args: those of `truearc advise`."""
    shot_map = load_map(args.map)
    config = advising(load_config(args.config), args)
    advised_columns(shot_map, config)             # refuses a map that lacks one, before there is a folder
    gate = load_gate_for(args.gate, config.rig)
    aim, aims = _aim_of(args, config)
    started = wall_clock()
    folder = make_room(args.out, started)
    ending = Ending()
    with ExitStack() as wires:
        nt4 = nt4_of(config)
        seeing, driving = (nt4.vision, nt4.velocity) if nt4 else (None, None)
        keys = NtKeys(args.nt, [*keys_of(shot_map), *(keys_of_camera(seeing) if seeing else []),
                                *(keys_of_velocity(driving) if driving else [])])
        wires.callback(keys.close)
        watch = threading.Timer(PATIENCE_S, lambda: None if keys.connected else print(
            f"truearc: NetworkTables server {args.nt}: does not answer; the verdict is STALE until it does",
            file=sys.stderr, flush=True))
        wires.callback(watch.cancel)
        watch.start()
        header = replace(make_header(config, gate, started, aims.get(""), wall_offset_ns()), policy=ADVICE)
        recorder = SessionWriter(folder, header, config, args.gate.read_bytes(), lossless=False, aim=aim)
        wires.callback(recorder.close)
        clock = MonotonicClock()
        rig = AdviceIo(config, shot_map, keys, clock, lambda: ending.asked or recorder.is_over(), args.sigma,
                       NtCamera(config, keys, clock) if seeing else None,
                       NtVelocity(config, keys, clock) if driving else None)
        print(f"{args.nt}: {len(keys_of(shot_map))} keys of the map are read; advice is published under /truearc and "
              f"recorded in {folder}; Ctrl+C ends it", file=sys.stderr, flush=True)
        ticks = run(RecordingRig(rig, recorder.trouble), config, gate, Adviser(recorder, keys, config, gate),
                    partial(advise_step, aims=aims))
    if recorder.failed is not None:
        raise InputError(f"{folder}: the recording stopped: {recorder.failed}")
    return ticks, folder


def advising(config: Config, args: argparse.Namespace) -> Config:
    """Return the configuration that the session keeps: the requested rate and limits, the gate obeyed, and set points
    from an aim file if there is one."""
    gate = replace(config.gate, policy="model", reading_age_s=args.fresh, sighting_age_s=args.fresh)
    rig = config.rig if args.rig is None else _load_rig(args.rig)
    aim = AimConfig("belief", 0.0) if args.aim or args.belief else config.aim
    return replace(config, tick_hz=args.rate, gate=gate, rig=rig, aim=aim)


def keys_of(shot_map: ShotMap) -> list[str]:
    """Return every key that a map names."""
    feed = [] if shot_map.shots.feed is None else [shot_map.shots.feed]
    signals = [as_signal(one) for one in (*shot_map.columns.values(), *feed)]
    keys = [key for one in signals for key in (one.key, one.alive) if key]
    return list(dict.fromkeys([*keys, *filter(None, [shot_map.outcome.key]), *shot_map.outcome.buttons]))


def _load_rig(path: Path) -> Rig:
    rig = load_toml(path, Rig)
    wrong = [f"{path}: {key}: {what}" for key, what in rig_errors(rig)]
    if wrong:
        raise InputError("\n".join(wrong))
    return rig


def _aim_of(args: argparse.Namespace, config: Config) -> tuple[bytes | None, dict[str, AimFile]]:
    """The aim file, its own or made of the belief for this rig, as bytes and as the tick takes it."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "aim.json"
        if args.aim:
            path.write_bytes(args.aim.read_bytes())
        elif args.belief:
            import truearc as ta
            known = ta.load_belief(args.belief)
            table = ta.aim(known, config.rig, progress=lambda done, note: None)
            ta.export_aim(table, known, config.rig, path, note=args.belief.name)
        else:
            return None, {}
        return path.read_bytes(), {"": load_aim_for(path, config)}
