"""The command `deploy`, which installs truearc as a service on the robot's computer."""

import argparse
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from truearc.errors import INSTALL_HINTS, InputError, load_text
from truearc.robot import deploy as target
from truearc.robot.config import named_tables, schema

SOURCE = Path(__file__).parents[2]
KEPT = target.RECORDING.strip().splitlines()[2:]
FAR = "truearc-deploy"                # folder in the home directory there


def deploy_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("host", help="user@host, as for ssh; the user may use sudo")
    parser.add_argument("--config", type=Path, required=True, help="launcher.toml")
    parser.add_argument("--gate", type=Path, help="exported model; needed when the policy is 'model'")
    parser.add_argument("--aim", type=Path, metavar="FILE", help="aim file; needed when the aim policy is 'belief'")
    parser.add_argument("--endpoints", type=Path, metavar="JSON", help="flat_endpoints.json for the doctor")
    parser.add_argument("--wheels", type=Path, metavar="DIR", help="wheels of what truearc needs, for that computer: "
                        "it then needs no network (docs/how-to/deploy.md)")
    parser.add_argument("--plugin", type=Path, action="append", default=[], metavar="PATH", help="wheel or source "
                        "folder of a distribution with motor drivers or readings, to be installed there, too; may be "
                        "repeated; truearc-frc comes by itself where the configuration needs it")
    parser.add_argument("--core", type=int, metavar="N", help="core of the control loop (default: any)")
    parser.add_argument("--priority", type=int, default=50, metavar="P", help="of the control loop")
    parser.add_argument("--can-serial", default="", metavar="S", help="give the CAN adapter with this serial number "
                        "the configured name")
    parser.add_argument("--box-usb", default="", metavar="V:P", help="give the serial device with this USB vendor and "
                        "product the name in [buttons] port")
    parser.add_argument("--exposure-ms", type=float, metavar="MS", help="fix the camera's exposure (needs v4l-utils "
                        "there)")
    parser.add_argument("--dry-run", action="store_true", help="print every command and every file, and do nothing")


def deploy(args: argparse.Namespace) -> int:
    """Install truearc on the robot's computer by ssh, as a service that starts with it.

    Copies the package, its configuration and its model, and runs the doctor there. Exit 1 if a step fails or the doctor
    finds a failure.
    """
    if not re.fullmatch(r"([A-Za-z0-9_][A-Za-z0-9._-]*@)?[A-Za-z0-9][A-Za-z0-9.-]*", args.host):
        raise InputError(f"{args.host!r}: not user@host")
    config = schema.load_config(args.config)
    if args.gate:
        from truearc.robot.gate import load_gate_for
        load_gate_for(args.gate, config.rig)                      # a model that the robot would refuse is refused here
    if args.aim:
        from truearc.robot.aim_file import load_aim_for
        load_aim_for(args.aim, config)
    if args.endpoints:
        from truearc.robot.doctor import load_endpoints
        load_endpoints(args.endpoints)
    parts = target.make_parts(config, target.Parts(
        args.gate is not None, args.endpoints is not None, bool(args.plugin), args.core, args.priority, args.can_serial,
        args.box_usb, args.exposure_ms, args.aim is not None))
    copies = {"constraints.txt": SOURCE / "constraints.txt", "gate.onnx": args.gate, "aim.json": args.aim,
              "flat_endpoints.json": args.endpoints}
    files = {target.CONFIG: target.make_config(load_text(args.config), config), **target.make_files(config, parts)}
    carried = {name: path for name, path in copies.items() if path}
    if config.recording is None:
        print(f"{args.config}: has no [recording]; the robot's {target.CONFIG} gets one: {', '.join(KEPT)}", flush=True)
    wheels, plugins = _wheels(args.wheels), [*_ours(config), *(_plugin(path) for path in args.plugin)]
    if not (SOURCE / "pyproject.toml").exists():
        raise InputError(f"{SOURCE}: deploy builds truearc from its source; run it from a checkout")
    if args.dry_run:
        _explain(args.host, files, carried, wheels, plugins)
        return 0
    with tempfile.TemporaryDirectory(prefix="truearc-") as folder:
        stage = Path(folder) / FAR
        _fill(stage, files, carried, wheels)
        source = target.copy_source(SOURCE, Path(folder) / "source")
        plugins = [target.copy_folder(path, Path(folder) / f"plugin-{number}") if path.is_dir() else path
                   for number, path in enumerate(plugins)]
        for command in make_commands(args.host, str(stage), str(source), plugins):
            if _run(command):
                return 1
    return 0


def make_commands(host: str, stage: str, source: str, plugins: Sequence[Path]) -> list[list[str]]:
    """Return the commands to run here, in order, to fill `stage` and copy it; the last one runs the doctor."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"]
    return [[*pip, f"{stage}/wheels", source],
            *([*pip, f"{stage}/plugins", str(path)] for path in plugins),
            ["ssh", host, shlex.join(["rm", "-rf", FAR])],
            ["scp", "-q", "-r", stage, f"{host}:{FAR}"],
            ["ssh", "-t", host, shlex.join(["sudo", "sh", f"{FAR}/{target.INSTALL}"])]]


def _wheels(folder: Path | None) -> list[Path]:
    if folder is None:
        return []
    found = sorted(path for path in folder.glob("*.whl") if not path.name.startswith("truearc-"))
    if not any(path.name.startswith("numpy-") for path in found):
        raise InputError(f"{folder}: no wheels of what truearc needs; docs/how-to/deploy.md says how to fetch them")
    return found


def _ours(config: schema.Config) -> list[Path]:
    """Folders of this checkout with the distributions that the configuration needs."""
    named = dict.fromkeys(map(named_tables.distribution_of_table, config.readings))
    return [SOURCE / name.removeprefix("truearc-") for name in named if name in INSTALL_HINTS]


def _plugin(path: Path) -> Path:
    if not (path / "pyproject.toml").is_file() and not (path.suffix == ".whl" and path.is_file()):
        raise InputError(f"--plugin {path}: neither a wheel nor a folder with a pyproject.toml")
    return path


def _fill(stage: Path, files: dict[str, str], carried: dict[str, Path], wheels: list[Path]) -> None:
    (stage / "wheels").mkdir(parents=True)
    for name, text in files.items():
        (stage / name).write_text(text, encoding="utf-8", newline="\n")
    for name, path in carried.items():
        shutil.copyfile(path, stage / name)
    for path in wheels:
        shutil.copyfile(path, stage / "wheels" / path.name)


def _explain(host: str, files: dict[str, str], carried: dict[str, Path], wheels: list[Path],
             plugins: list[Path]) -> None:
    for command in make_commands(host, f"STAGE/{FAR}", "COPY_OF_SOURCE", plugins):
        print(f"$ {shlex.join(command)}")
    for name, path in [*carried.items(), *((f"wheels/{path.name}", path) for path in wheels)]:
        print(f"\n=== STAGE/{FAR}/{name}: a copy of {path}")
    for name, text in files.items():
        print(f"\n=== STAGE/{FAR}/{name}\n{text}", end="")


def _run(command: list[str]) -> int:
    print(f"$ {shlex.join(command)}", flush=True)
    code = subprocess.run(command, check=False).returncode
    if code:
        print(f"truearc deploy: exit code {code} from: {shlex.join(command)}", file=sys.stderr)
    return code
