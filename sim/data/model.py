"""A dataset in memory: columns, SI, one row a shot."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from truearc.robot.config.rig_spec import Rig
from truearc.sim.printed import Printed

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Shots:
    """Shots in columns. `numbers`: float64 [n], nan = missing. `texts`: one string a shot, "" = missing.

    `source`: the file they were read from, for messages about them.
    """

    shot_id: tuple[str, ...]
    numbers: dict[str, Floats]
    texts: dict[str, tuple[str, ...]]
    source: str = "shots"

    def __len__(self) -> int:
        return len(self.shot_id)

    def number(self, name: str) -> Floats:
        """A numeric column; all nan when the dataset has none of that name."""
        return self.numbers[name] if name in self.numbers else np.full(len(self), np.nan)

    def text(self, name: str) -> tuple[str, ...]:
        """A text column; all "" when the dataset has none of that name."""
        return self.texts[name] if name in self.texts else ("",) * len(self)

    def take(self, index: Any) -> "Shots":
        """The shots at integer positions or under a boolean mask, in that order."""
        rows = np.arange(len(self))[np.asarray(index)]
        return Shots(tuple(self.shot_id[row] for row in rows),
                     {name: column[rows] for name, column in self.numbers.items()},
                     {name: tuple(column[row] for row in rows) for name, column in self.texts.items()}, self.source)


@dataclass(frozen=True)
class Tracks:
    """Measured ball positions, launcher frame. `shot`: row in Shots; all [m]."""

    shot: npt.NDArray[np.int64]
    t_s: Floats
    x_m: Floats
    y_m: Floats
    z_m: Floats


@dataclass(frozen=True)
class Traces:
    """Telemetry through shots; `t_s` = 0 when the ball is fed. `shot`: row in Shots; all [m]."""

    shot: npt.NDArray[np.int64]
    t_s: Floats
    signal: tuple[str, ...]
    value: Floats


@dataclass(frozen=True)
class Dataset(Printed):
    """All that a directory of shots says; `left_out`: what its maker left out and why, one line each.

    `accepted`: objections to its plausibility that the user accepted or that only warn.
    """

    name: str
    facts: Rig
    shots: Shots
    tracks: Tracks | None = None
    traces: Traces | None = None
    left_out: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()

    @property
    def rig(self) -> Rig:
        """The rig that the shots were made with."""
        return self.facts

    def lines(self) -> list[str]:
        """Return how many shots, outcomes and samples there are, which columns, and what was left out."""
        outcomes = self.shots.text("outcome")
        counts = {kind or "unmarked": outcomes.count(kind) for kind in dict.fromkeys(outcomes)}
        lines = [f"{self.name}: {len(self.shots)} shots "
                 f"({', '.join(f'{count} {kind}' for kind, count in counts.items())})",
                 f"columns: {', '.join(['shot_id', *self.shots.numbers, *self.shots.texts])}"]
        lines += [f"{name}: {len(table.t_s)} samples" for name, table in (("tracks", self.tracks),
                                                                          ("traces", self.traces)) if table]
        return lines + [f"left out: {line}" for line in self.left_out]
