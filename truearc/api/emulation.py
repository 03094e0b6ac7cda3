"""Run the emulated robot."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from truearc.api.results import Table, Tabular
from truearc.robot.config.schema import Config
from truearc.robot.config.targets import Target
from truearc.robot.reasons import text
from truearc.robot.recording.session import load_trials
from truearc.robot.runtime import Screen
from truearc.sim.printed import Progress, show_progress
from truearc.sim.world import emulated_robot as engine
from truearc.sim.world.field import BallResult
from truearc.sim.world.options import Options

KINDS = ("three", "two-high", "two", "two-low", "miss-high", "miss-low", "miss-left", "miss-right")


@dataclass(frozen=True)
class Emulation(Tabular):
    """Result of each ball that the emulated robot launched. `where`: its session folder, or its bus; `held`: number of
    held trials for each reason, by one of its texts; target: of the configuration."""

    where: str | Path
    balls: tuple[BallResult, ...]
    held: Mapping[str, int] = field(default_factory=dict)
    target: Target | None = None

    def table(self) -> Table:
        """Return a row per ball: configuration, launch, position at the target's plane, and outcome."""
        return Table(BallResult._fields, self.balls)

    def lines(self) -> list[str]:
        """Return the number of balls launched, and the number with each outcome."""
        counts = Counter(ball.outcome for ball in self.balls)
        words = {kind: kind if self.target is None else self.target.button(kind) for kind in KINDS if counts[kind]}
        marks = ", ".join(f"{counts[kind]} {word}" for kind, word in words.items())
        return [f"{self.where}: {len(self.balls)} ball{'s' * (len(self.balls) != 1)} launched"
                + f" ({marks})" * bool(marks),
                *(f"held {count} time{'s' * (count != 1)}: {why}" for why, count in self.held.items())]


def emulate(config: Config, folder: str | Path, trials: int, seed: int, options: Options | None = None,
            gate_path: Path | None = None, progress: Progress | None = None,
            page: Screen | None = None, aim_path: Path | None = None, clips: Path | None = None) -> Emulation:
    """Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world.

    Args:
        config: Configuration of the launcher (`load_config`).
        folder: Session folder to create.
        trials: Maximum number of trials, launched or held.
        seed: Seed of the world and the driver.
        options: Differences of the world from the rig of the configuration; None: no difference.
        gate_path: ONNX gate that must agree before the robot fires; sets the policy to "model".
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.
        page: Screen that shows the ticks, such as the operator page; time then runs no faster than real time.
        aim_path: Aim file (`truearc aim --robot`) to use; sets the aim policy to "belief".
        clips: New folder for clips of the flights, as a phone beside them would film; None: no clips.

    Returns:
        The true result of each ball, for tests and reports; neither runtime nor fit may see it.

    Raises:
        InputError: a folder exists, the gate or aim file is invalid, the aim file is for another rig, or the
            configuration requires an aim file and none is given.
        OSError: the session cannot be written.
    """
    folder = Path(folder)
    balls = tuple(engine.emulate(config, folder, trials, seed, options, gate_path,
                                 progress or show_progress("emulate"), page,
                                 aim_path=aim_path, clips=clips))
    return Emulation(folder, balls, _held(folder), config.rig.target)


def _held(folder: Path) -> dict[str, int]:
    """How many trials were held for each reason, the commonest first, as the first of them says it."""
    reasons = [reason for trial in load_trials(folder) if trial.outcome.outcome == "held"
               for reason in trial.outcome.reasons]
    said = {reason.code: text(reason) for reason in reversed(reasons)}
    return {said[code]: count for code, count in Counter(reason.code for reason in reasons).most_common()}
