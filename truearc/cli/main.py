"""The front door: a verb, and the door behind it, imported only when it is opened (the robot never imports JAX)."""

import argparse
import importlib
import os
import sys
from functools import cache
from importlib.metadata import entry_points, version

from truearc.robot.config.schema import InputError

# verb -> what it does; each is a module of `doors` with DESCRIPTION, EXAMPLE, add_arguments(parser) and
# main(args) -> exit code
VERBS = {
    "demo": "the whole loop on the emulated robot, and one report",
    "run": "the robot",
    "doctor": "is the robot fit to run?",
    "deploy": "the robot's computer, made to start by itself",
    "identify": "friction, inertia and gains of flywheels and hood",
    "emulate": "the real runtime on the emulated robot",
    "replay": "recompute every output of a recording",
    "recover": "make a recording that was cut short whole",
    "convert": "a recording as WPILOG, MCAP, CSV or Parquet",
    "shots": "recordings to a dataset",
    "import": "other people's recordings to a dataset",
    "predict": "the seed's simulator, row by row",
    "fit": "drag and lift coefficients from a dataset",
    "synth": "balanced simulated shots",
    "train": "the classifier",
    "sweep": "how much simulated data, and how much to trust it",
    "export": "weights to a stamped ONNX file",
    "verify": "an ONNX file against its trainer and its contract",
    "predict-gate": "the gate's probabilities, row by row",
    "vision": "images to distances",
    "vision calibrate": "a camera from pictures of a board or from taped distances",
    "vision tune": "a page with sliders for what vision takes for the target",
    "discover": "where recordings and simulation disagree",
    "design": "the next shots, to tell apart what discover cannot",
}

# command -> the module behind it, imported only when the command is called
MODULES = {
    "demo": "truearc.cli.start.demo",
    "run": "truearc.cli.robot.run",
    "doctor": "truearc.cli.robot.doctor",
    "deploy": "truearc.cli.robot.deploy",
    "identify": "truearc.cli.robot.sysid",
    "emulate": "truearc.cli.robot.emulate",
    "replay": "truearc.cli.session.replay",
    "recover": "truearc.cli.session.recover",
    "convert": "truearc.cli.session.convert",
    "shots": "truearc.cli.discover.shots",
    "import": "truearc.cli.discover.import_",
    "predict": "truearc.cli.discover.predict",
    "fit": "truearc.cli.discover.fit",
    "synth": "truearc.cli.paper.synth",
    "train": "truearc.cli.gate.train",
    "sweep": "truearc.cli.paper.sweep",
    "export": "truearc.cli.gate.export",
    "verify": "truearc.cli.gate.verify",
    "predict-gate": "truearc.cli.gate.predict_gate",
    "vision": "truearc.cli.robot.vision",
    "vision calibrate": "truearc.cli.robot.vision_calibrate",
    "vision tune": "truearc.cli.robot.vision_tune",
    "discover": "truearc.cli.discover.discover",
    "design": "truearc.cli.discover.design",
}

# Arrays here are small: threads of the linear algebra would only wait for one another and, where another process keeps
# a core busy, for that. Before NumPy is there.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: list[str] | None = None) -> int:
    """Run one verb; exit 0 done, 1 a check failed, 2 bad input."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv == ["--version"]:
        print(f"truearc {version('truearc')}")
        return 0
    verb = next((words for words in (" ".join(argv[:2]), *argv[:1]) if words in MODULES or words in plugins()), None)
    if verb is None:
        return _explain(argv)
    try:
        return _open(verb, argv)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in ("truearc", "truearc_proof"):
            raise                     # ours: a defect, not an install without the companion
        print(f"truearc {verb}: needs {error.name}, which the robot's base install leaves out: "
              "pip install 'truearc[sim]'", file=sys.stderr)
        return 2


@cache
def plugins() -> dict[str, str]:
    """Commands that other distributions add: {command: module}, from the entry points `truearc.commands`."""
    return {point.name: point.value for point in entry_points(group="truearc.commands")}


def _open(verb: str, argv: list[str]) -> int:
    """The door behind the verb; some need the companion's packages for some options only."""
    door = importlib.import_module(MODULES.get(verb) or plugins()[verb])
    parser = argparse.ArgumentParser(prog=f"truearc {verb}", description=door.DESCRIPTION,
                                     epilog=f"example: {door.EXAMPLE}")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    door.add_arguments(parser)
    args = parser.parse_args(argv[len(verb.split()):])
    try:
        code = int(door.main(args))
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f"truearc {verb}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:           # whoever read our output has had enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:          # a place that cannot be read or written
        where = "" if error.filename is None else f"{error.filename}: "
        print(f"truearc {verb}: {where}{error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _explain(argv: list[str]) -> int:
    asked = bool(argv) and argv[0] in ("-h", "--help")
    out = sys.stdout if asked else sys.stderr
    if argv and not asked:
        print(f"truearc: there is no verb {argv[0]!r}", file=out)
    print("usage: truearc VERB ... (truearc VERB --help says more)\n", file=out)
    more = {verb: importlib.import_module(module).SUMMARY for verb, module in plugins().items()}
    for verb, does in (VERBS | more).items():
        print(f"  {verb:16s} {does}", file=out)
    return 0 if asked else 2


if __name__ == "__main__":
    sys.exit(main())
