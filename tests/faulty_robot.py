"""Parts of the emulated robot with things wrong with them (truearc_proof.world.faults)."""

from collections.abc import Mapping
from typing import Any

from truearc.hw.emulated.nodes import Plant
from truearc.robot.config.schema import Config
from truearc.sim.world.emulated_robot import MakeEyes, MakeNodes, TwinEyes, make_nodes
from truearc_proof.world.faults import Fault, FaultyNode


def nodes_with(faults: Mapping[str, tuple[Fault, ...]]) -> MakeNodes:
    """What makes the emulated robot's devices, with `faults` of each: device ("flywheel_a", ...) -> what goes wrong."""
    return lambda config, world: {name: FaultyNode(node, faults[name]) if name in faults else node
                                  for name, node in make_nodes(config, world).items()}


def eyes_with(faults: tuple[Fault, ...]) -> MakeEyes:
    """What makes a camera that gives nothing while one of `faults` stands, whatever its kind."""
    return lambda world, config, seed: _FaultyEyes(world, config, seed, faults)


def parts_with(faults: Mapping[str, tuple[Fault, ...]]) -> dict[str, Any]:
    """Arguments of truearc.sim.world.emulated_robot.emulate with faults of devices and of the "camera"."""
    return {"nodes_of": nodes_with(faults), "eyes_of": eyes_with(faults.get("camera", ()))}


class _FaultyEyes(TwinEyes):
    def __init__(self, plant: Plant, config: Config, seed: int, faults: tuple[Fault, ...]) -> None:
        super().__init__(plant, config, seed)
        self._faults = faults

    def expose(self, t_ns: int) -> None:
        if not any(fault.begin_ns <= t_ns < fault.end_ns for fault in self._faults):
            super().expose(t_ns)
