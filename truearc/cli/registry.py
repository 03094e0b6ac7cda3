"""Every command as data, so that listing the commands imports none of them."""

from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import NamedTuple

GROUPS = (
    ("start", "first steps"),
    ("discover", "from recorded shots to what the simulation lacks"),
    ("gate", "the classifier that lets shots through"),
    ("robot", "run, check, emulate and calibrate a launcher"),
    ("session", "recorded sessions"),
    ("paper", "the paper's own method"),
)
ENTRY_POINTS = "truearc.commands"
OTHER_GROUP = "other"                 # of a command from another distribution that names no group


class Command(NamedTuple):
    """A command.

    Fields:
        name: The words that call it, such as `fit` or `paper fit`.
        module: Module with a docstring (the description in `--help`), EXAMPLE, add_arguments(parser) and
            main(args) -> exit code; importing it loads no numerical library.
        group: The heading of `truearc --help` that lists it; a key of GROUPS, or another distribution's own.
        summary: One line for that list.
        distribution: What to install where a package is missing; empty for truearc itself.
    """

    name: str
    module: str
    group: str
    summary: str
    distribution: str = ""


COMMANDS = (
    Command("demo", "truearc.cli.start.demo", "start", "what was wrong, how large, what that was worth: emulated"),
    Command("init", "truearc.cli.start.init", "start", "templates of a dataset, or of a launcher's configuration"),
    Command("completion", "truearc.cli.start.completion", "start", "completion of commands and options for a shell"),
    Command("import", "truearc.cli.discover.import_", "discover", "other people's recordings to a dataset"),
    Command("shots", "truearc.cli.discover.shots", "discover", "recorded sessions to a dataset"),
    Command("check", "truearc.cli.discover.check", "discover", "whether data are plausible, and what they could show"),
    Command("fit", "truearc.cli.discover.fit", "discover", "coefficients and scatter by maximum a posteriori"),
    Command("predict", "truearc.cli.discover.predict", "discover", "heights and outcomes, or a gate's probabilities"),
    Command("aim", "truearc.cli.discover.aim", "discover", "hood angle and motor speed by distance, by a belief"),
    Command("discover", "truearc.cli.discover.discover", "discover", "where recordings and simulation disagree"),
    Command("follow", "truearc.cli.discover.follow", "discover", "shots as they come: has something changed?"),
    Command("design", "truearc.cli.discover.design", "discover", "the next shots, to separate remaining candidates"),
    Command("identifiability", "truearc.cli.discover.identifiability", "discover",
            "which effects a season of shots could show"),
    Command("train", "truearc.cli.gate.train", "gate", "a gate with the fitted physics in it"),
    Command("export", "truearc.cli.gate.export", "gate", "weights to a stamped ONNX file"),
    Command("verify", "truearc.cli.gate.verify", "gate", "an ONNX file against its trainer and its contract"),
    Command("serve", "truearc.cli.gate.serve", "gate", "a page with a gate's map and sliders, without a robot"),
    Command("run", "truearc.cli.robot.run", "robot", "run the launcher and record it"),
    Command("doctor", "truearc.cli.robot.doctor", "robot", "check everything that a run needs"),
    Command("deploy", "truearc.cli.robot.deploy", "robot", "install truearc as a service on the robot's computer"),
    Command("emulate", "truearc.cli.robot.emulate", "robot", "the real runtime on the emulated robot"),
    Command("sysid", "truearc.cli.robot.sysid", "robot", "friction, inertia and gains of flywheels and hood"),
    Command("vision", "truearc.cli.robot.vision", "robot", "images to distances"),
    Command("vision-calibrate", "truearc.cli.robot.vision_calibrate", "robot",
            "a camera from pictures of a board or from taped distances"),
    Command("vision-tune", "truearc.cli.robot.vision_tune", "robot", "a page with sliders for target detection"),
    Command("session replay", "truearc.cli.session.replay", "session", "recompute every output of a recording"),
    Command("session recover", "truearc.cli.session.recover", "session", "repair a truncated recording"),
    Command("session convert", "truearc.cli.session.convert", "session",
            "a recording as WPILOG, MCAP, CSV or Parquet"),
    Command("paper fit", "truearc.cli.paper.fit", "paper", "drag and lift coefficients by grid search"),
    Command("paper synth", "truearc.cli.paper.synth", "paper", "balanced simulated shots"),
    Command("paper train", "truearc.cli.paper.train", "paper", "the paper's network on recorded and simulated shots"),
    Command("paper sweep", "truearc.cli.paper.sweep", "paper", "how much simulated data, and how to weigh it"),
)
NAMES = {command.name: command for command in COMMANDS}


def find_command(argv: list[str]) -> Command | None:
    """Return the command that `argv` begins with, of two words before of one; None where it begins with none."""
    words = [" ".join(argv[:2]), *argv[:1]]
    own = next((NAMES[word] for word in words if word in NAMES), None)
    if own is not None or not argv or argv[0].startswith("-"):
        return own
    return next((command for word in words for command in load_plugins() if command.name == word), None)


@cache
def load_plugins() -> tuple[Command, ...]:
    """Return the commands of other distributions, from the entry points `truearc.commands`, sorted by name.

    Each names a module like those of COMMANDS that also has SUMMARY, and GROUP where it wants a heading of its own. A
    module that cannot be imported is listed with the reason, so that the other commands go on working.
    """
    plugins = []
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        distribution = point.dist.name if point.dist else ""
        try:
            module = import_module(point.value)
            group, summary = getattr(module, "GROUP", OTHER_GROUP), module.SUMMARY
        except (ImportError, AttributeError) as error:
            group, summary = OTHER_GROUP, f"cannot be loaded: {error}"
        plugins.append(Command(point.name, point.value, group, summary, distribution))
    return tuple(plugins)


def list_commands() -> tuple[Command, ...]:
    """Return every command: truearc's own, then those of other distributions."""
    return (*COMMANDS, *load_plugins())
