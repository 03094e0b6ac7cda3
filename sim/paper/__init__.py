"""The paper's own method (grid fit, synthetic data, network, training and sweep), and its defaults.

The command line uses the same defaults, so this module loads no numerical library.
"""

import math
from dataclasses import dataclass

from truearc.errors import InputError

LOW, HIGH, STEP = 0.0, 5.0, 0.005     # the paper's grid of both coefficients, bounds included
STEPS = 1_000_000
PATIENCE = 200_000
CHECK = 5000                          # steps between two looks at the losses


@dataclass(frozen=True)
class Recipe:
    """Settings of training. The rate is the paper's, which states no length.

    Raises:
        InputError: A count is below 1, or the rate is not above 0; the message names the option.
    """

    learning_rate: float = 1e-4
    steps: int = STEPS                # at most
    patience: int = PATIENCE          # steps without gain on the validation rows; without any, all steps are made
    check: int = CHECK

    def __post_init__(self) -> None:
        for name in ("steps", "patience", "check"):
            if getattr(self, name) < 1:
                raise InputError(f"--{name} is {getattr(self, name)}; at least 1 is needed")
        if not 0.0 < self.learning_rate < math.inf:
            raise InputError(f"--learning-rate is {self.learning_rate}; it must be more than 0")


DEFAULT_RECIPE = Recipe()
