"""Read what a robot recorded."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from truearc.robot.config.schema import Config
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import Trial, load_header, load_session_config, load_trials
from truearc.robot.types import Tick
from truearc.sim.printed import Printed


class Recording(Printed):
    """A recorded session: iterate over it for its ticks, as often as wanted.

        for tick in Recording("sessions/mon"):
            tick.verdict.fire, tick.verdict.reasons

    A tick holds inputs, estimate, aim, verdict and command, SI units, `t_ns` on the robot's own clock in ns. After an
    iteration `cut_short` says where the recording ends early, None: it does not.

    Raises:
        InputError: the folder is not a recording, or (while iterating) a row cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.header = load_header(self.path)
        self.cut_short: str | None = None

    def __iter__(self) -> Iterator[Tick]:
        reader = TickReader(self.path)
        for tick, _ in reader:
            yield tick
        self.cut_short = reader.cut_short

    @cached_property
    def config(self) -> Config:
        """The configuration that the session ran with; its `rig` is the rig."""
        return load_session_config(self.path)

    @cached_property
    def trials(self) -> tuple[Trial, ...]:
        """Every marked trial in order: its outcome, and the shot, None where a gate held."""
        return tuple(load_trials(self.path))

    def lines(self) -> list[str]:
        """Return what made the recording, and how many trials of which outcome it has."""
        outcomes = [trial.outcome.outcome for trial in self.trials]
        counts = ", ".join(f"{outcomes.count(kind)} {kind}" for kind in dict.fromkeys(outcomes))
        return [f"{self.path}: {len(outcomes)} trials ({counts or 'none'})",
                f"truearc {self.header.truearc}, gate policy {self.header.policy}, started "
                f"{self.header.started or 'on an emulated clock'}"]
