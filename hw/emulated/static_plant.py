"""A plant that is only looked at: the target before a camera, as something else places it."""

import numpy as np

from truearc.hw.emulated.plant import View

NOTHING = View(np.diag([1.0, -1.0, -1.0, 1.0]), 1.0, 1.0)     # the target is at the lens: it is not drawn


class Stage:
    """As much of truearc.hw.emulated.plant.Plant as a camera looks at; whoever has it changes `now`."""

    def __init__(self, now: View) -> None:
        self.now = now

    def view(self) -> View:
        return self.now
