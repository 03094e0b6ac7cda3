"""Effect of the driver's buttons on the tick's memory: arm, request a shot, mark its outcome."""

from msgspec import UNSET
from msgspec.structs import replace

from truearc.robot.aim import step_walk
from truearc.robot.config.schema import Config
from truearc.robot.types import Inputs, Memory, Outcome

# to which side of the target a missed shot goes, by which the correction walks; a shot that scored moves nothing
SIDES = {"miss-low": -1, "miss-high": 1, "two": 0, "two-low": 0, "two-high": 0, "three": 0}


def operate(inputs: Inputs, memory: Memory, config: Config) -> tuple[Memory, tuple[Outcome, ...]]:
    """Apply this tick's presses in order; each outcome button answers the newest unanswered shot.

    A press that got lost may have been that of "arm" by which a driver believes to have disarmed, and may reach into
    the launcher; one that armed costs a second press. So the robot is disarmed, whatever else was pressed meanwhile.
    """
    outcomes: list[Outcome] = []
    for event in inputs.buttons:
        if event.button == "arm":
            memory = replace(_let_go(memory), armed=not memory.armed, disarmed=UNSET)
        elif event.button == "accept":
            memory = _accept(inputs, memory)
        elif event.button == "fire":
            memory = _ask(memory, inputs.t_ns)
        elif event.button == "reject" and memory.last_shot is not None:
            outcomes.append(Outcome(memory.last_shot.trial, inputs.t_ns, "rejected"))
            memory = replace(memory, awaiting=False, aim=None, trial=memory.last_shot.trial + 1)
        elif event.button in SIDES and memory.awaiting and memory.last_shot is not None:
            outcomes.append(Outcome(memory.last_shot.trial, inputs.t_ns, event.button))
            memory = _answer(memory, SIDES[event.button], config)
    if inputs.aim_offer is not UNSET and inputs.aim_accept == inputs.aim_offer.sha256:
        memory = _accept(inputs, memory)
    if inputs.missed is not None:
        memory = replace(_let_go(memory), disarmed=inputs.missed)
    return memory, tuple(outcomes)


def _let_go(memory: Memory) -> Memory:
    # Disarming forgets the request: a shot asked for before must not come when the launcher is armed again.
    return replace(memory, armed=False, request_t_ns=0, steady_t_ns=0, doubt_t_ns=0, aim=None, motion=UNSET)


def _accept(inputs: Inputs, memory: Memory) -> Memory:
    # The correction was one of the aim before: what it made up for is in the new one.
    if memory.armed or inputs.aim_offer is UNSET or memory.aim_sha256 == inputs.aim_offer.sha256:
        return memory
    return replace(memory, aim_sha256=inputs.aim_offer.sha256, walk=(0.0, 0.0, 0.0))


def _ask(memory: Memory, t_ns: int) -> Memory:
    if not memory.armed or memory.awaiting or memory.feed_t_ns:
        return memory
    return replace(memory, request_t_ns=t_ns)


def _answer(memory: Memory, side: int, config: Config) -> Memory:
    assert memory.last_shot is not None
    walk = step_walk(memory.walk, side, memory.last_shot, config)
    return replace(memory, awaiting=False, walk=walk, aim=None, trial=memory.last_shot.trial + 1)
