"""Play the emulated robot."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from truearc.api.results import Table
from truearc.robot.config.schema import Config
from truearc.robot.reasons import text
from truearc.robot.recording.session import load_trials
from truearc.robot.runtime import Screen
from truearc.sim.printed import Printed, Progress
from truearc.sim.world import emulated_robot as engine
from truearc.sim.world.field import BallResult
from truearc.sim.world.options import Options

KINDS = ("three", "two-high", "two", "two-low", "miss-high", "miss-low")


@dataclass(frozen=True)
class Emulation(Printed):
    """What became of each ball that the emulated robot launched; `where`: its session's folder, or its bus; `held`: how
    many trials were held for a reason, by one of its texts."""

    where: str | Path
    balls: tuple[BallResult, ...]
    held: Mapping[str, int] = field(default_factory=dict)

    def table(self) -> Table:
        """Return a row per ball: configuration, launch, where it crossed the target's plane, and its outcome."""
        return Table(BallResult._fields, self.balls)

    def lines(self) -> list[str]:
        """Return how many balls were launched, and how many had each outcome."""
        counts = Counter(ball.outcome for ball in self.balls)
        marks = ", ".join(f"{counts[kind]} {kind}" for kind in KINDS if counts[kind])
        return [f"{self.where}: {len(self.balls)} ball{'s' * (len(self.balls) != 1)} launched"
                + f" ({marks})" * bool(marks),
                *(f"held {count} time{'s' * (count != 1)}: {why}" for why, count in self.held.items())]


def emulate(config: Config, folder: str | Path, trials: int, seed: int, options: Options | None = None,
            gate_path: Path | None = None, progress: Progress = lambda done, note: None,
            page: Screen | None = None, aim_path: Path | None = None) -> Emulation:
    """Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world.

    Args:
        config: Of the launcher (`load_config`).
        folder: Session folder to make.
        trials: How many balls are launched, at most, or held.
        seed: Of the world and the driver.
        options: How the world differs from the rig of the configuration; None: not at all.
        gate_path: ONNX gate that must agree before the robot fires; the policy becomes "model".
        progress: Called with the share done, 0 to 1, and a note.
        page: Shows the ticks, as the operator page does; time then passes no faster than it does.
        aim_path: Aim file (`truearc aim --robot`) to aim by; the aim policy becomes "belief".

    Returns:
        The true result of each ball, for tests and reports; neither runtime nor fit may see it.

    Raises:
        InputError: the folder exists, the gate is not one, the aim file is not one or for another rig, or the
            configuration asks for an aim file and there is none.
        OSError: the session cannot be written.
    """
    folder = Path(folder)
    balls = tuple(engine.emulate(config, folder, trials, seed, options, gate_path, progress, page, aim_path=aim_path))
    return Emulation(folder, balls, _held(folder))


def _held(folder: Path) -> dict[str, int]:
    """How many trials were held for each reason, the commonest first, as the first of them says it."""
    reasons = [reason for trial in load_trials(folder) if trial.outcome.outcome == "held"
               for reason in trial.outcome.reasons]
    said = {reason.code: text(reason) for reason in reversed(reasons)}
    return {said[code]: count for code, count in Counter(reason.code for reason in reasons).most_common()}
