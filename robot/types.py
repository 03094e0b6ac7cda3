"""The values that pass through one tick: Inputs -> Estimate -> Aim -> Verdict -> Command -> Sent.

The whole Tick is the recorded row.

All units are SI, and each name ends with its unit; `t_ns` is the time on the rig's single monotonic clock. The types
are msgspec structs rather than dataclasses because a row is written 200 times a second and replayed 10 000 times a
second. Absent numbers are None, never NaN: JSON has no NaN, and None cannot pass a comparison by accident.
"""

from msgspec import UNSET, Struct, UnsetType, field

from truearc.hw.protocols import AngleReading, ButtonEvent, MotorReading
from truearc.hw.reason import Reason


class Sighting(Struct, frozen=True):
    """The result of vision on one image. `distance_m`: horizontal, camera lens to target plane."""

    t_ns: int                                     # middle of the exposure
    found: bool
    reason: Reason | None = None                  # why not; None when found
    distance_m: float | None = None
    sigma_m: float | None = None                  # one standard deviation
    bearing_deg: float | None = None              # target to the right of the optical axis is positive
    # outer tape corners: bottom right, bottom left, top left, top right
    corners_px: tuple[tuple[float, float], ...] = ()


class AimOffer(Struct, frozen=True):
    """An aim file that awaits the driver; `note` is the page's description of it."""

    sha256: str
    note: str


class RobotVelocity(Struct, frozen=True):
    """The robot's velocity, in its own axes; forward is where the launcher throws."""

    t_ns: int
    forward_m_s: float
    left_m_s: float


class Inputs(Struct, frozen=True, omit_defaults=True):
    """Everything that the tick may know about the outside; a replay needs nothing else.

    Fields after `faults` have defaults, so that older recordings keep their meaning.
    """

    t_ns: int
    cycle: int
    flywheels: tuple[MotorReading, ...]           # the motors on the flywheel belt, in the config's order
    hood_motor: MotorReading
    feeder: MotorReading
    hood_angle: AngleReading | None
    sighting: Sighting | None                     # what vision made of an image that came since the last tick
    buttons: tuple[ButtonEvent, ...]              # since the last tick
    faults: tuple[Reason, ...]                    # wires lost, frames refused
    frames: int = 0                               # CAN frames received since the last tick: its lines of can0.log
    unseen: Reason | None = None                  # why the newest image shows no target; None where it does
    missed: Reason | None = None                  # what the button box did that presses may be lost by
    aim_offer: AimOffer | UnsetType = UNSET       # absent while none is on offer
    velocity: RobotVelocity | UnsetType = UNSET   # newest; absent where none is read, or none can be believed
    aim_accept: str | UnsetType = UNSET           # SHA-256 of the aim file that was just accepted on the page


class Estimate(Struct, frozen=True):
    """The state of the launcher as believed at this tick."""

    motor_rad_s: float                            # mean of the flywheel motors
    motor_ratio: float                            # motor_rad_s / free speed
    motor_spread_rad_s: float                     # largest disagreement between the flywheel motors
    hood_deg: float | None                        # launch elevation from the absolute encoder
    hood_screw_deg: float | None                  # the same from the screw's own encoder; None until homed
    distance_m: float | None                      # horizontal, ball exit to target plane
    distance_sigma_m: float | None
    battery_v: float
    oldest_s: float                               # age of the oldest reading that firing needs
    sighting_s: float | None                      # age of the newest sighting with a target in it
    closing_m_s: float | UnsetType = UNSET        # by which distance_m was brought up to date; falling is negative
    toward_m_s: float | UnsetType = UNSET         # the robot's velocity toward the target; absent: not known
    leftward_m_s: float | UnsetType = UNSET       # and to the left of it
    bearing_deg: float | UnsetType = UNSET        # target to the right of where the launcher points; with a velocity


class Aim(Struct, frozen=True):
    """The target state of the launcher."""

    motor_ratio: float
    hood_deg: float
    source: str                                   # "plan", "belief", "identify"; "idle", "no-aim-file", "no-set-point"
    stand_m: float | UnsetType = UNSET            # it is for this distance, and the robot is elsewhere
    correction: float | UnsetType = UNSET         # by the driver's marks, in the log of the speed; belief only
    lead_deg: float | UnsetType = UNSET           # aim to the left of the target, against wind across; belief only
    virtual_m: float | UnsetType = UNSET          # on the move: distance from which a robot at rest would throw so
    trim: float | UnsetType = UNSET               # on the move: what of the log of the speed is for that


class Verdict(Struct, frozen=True):
    """FIRE or HOLD, and why."""

    fire: bool
    reasons: tuple[Reason, ...]                   # empty exactly when fire is true
    p_two: float | None = None
    p_three: float | None = None


class Command(Struct, frozen=True):
    """What the tick requests of each axis: released, or driven with a torque.

    Torque at the motor shaft; positive launches (raises the hood). An axis that is not enabled is released.
    """

    enable_flywheel: bool = False
    enable_hood: bool = False
    enable_feeder: bool = False
    flywheel_torque_nm: float = 0.0               # on each flywheel motor
    hood_torque_nm: float = 0.0
    feeder_torque_nm: float = 0.0


class Sent(Command, frozen=True):
    """What was really sent, after all limits, and how many frames the bus refused.

    For an axis that takes duties, the torque is what the duty means; for one that is not driven, it is 0. The
    flywheels' torque is the mean over their motors.
    """

    refused: int = 0
    # flywheels, hood, feeder: the duty each was sent, None for none; absent when no axis was sent one
    duties: tuple[float | None, ...] | UnsetType = UNSET


class Joint(Struct, frozen=True, omit_defaults=True):
    """What the interlocks remember of wheels or hood (truearc.robot.motion); a timestamp of 0 means not set.

    Speeds and angles are those of the motor, `deg` the launch elevation.
    """

    cause: Reason | None = None                   # why it is released; None while it may be driven
    is_latched: bool = False                      # released until it is disarmed and armed
    taken_t_ns: int = 0                           # not released for the first time since it was armed
    good_t_ns: int = 0                            # while released: its readings have been good since then
    releases_t_ns: tuple[int, int] = (0, 0)       # of the last two, newest first; those in a measured stall not counted
    peak_rad_s: float = 0.0                       # wheels: highest set point of the last seconds
    peak_t_ns: int = 0                            # ... and when it was last the set point
    next_rad_s: float = 0.0                       # ... highest since then
    next_t_ns: int = 0
    push: int = 0                                 # sign of the torque
    push_rad_s: float = 0.0                       # speed when the torque took that sign
    push_t_ns: int = 0                            # ... and when that was
    stuck_t_ns: int = 0                           # driven without motion since then
    hard_t_ns: int = 0                            # ... wheels: with a torque that moves what is free
    slow_t_ns: int = 0                            # wheels: averages have not risen since then, while driven
    slow_rad_s: float = 0.0                       # ... and the average speed then
    level_rad_s: float = 0.0                      # ... average speed
    noise_rad_s: float = 0.0                      # ... average deviation of readings from it
    stuck_at: float = 0.0                         # hood: angle then (rad); wheels: speed then (rad/s)
    jams: int = 0                                 # hood: without motion between them
    dropped_deg: float | None = None              # hood: set point that a small push did not reach
    homing_t_ns: int = 0                          # hood: driven toward the limit switch since then
    homing_rad: float = 0.0                       # ... from here
    differ: int = 0                               # hood: encoder readings in a row that disagree with the screw
    angle_t_ns: int = 0                           # hood: its encoder's newest reading
    angle_deg: float = 0.0
    angle_deg_s: float = 0.0                      # ... and its rate from the one before
    began_t_ns: int = 0                           # hood: encoder and screw are compared since then, until
                                                  # it is homed; negative while it is not driven yet
    began_rad: float = 0.0                        # ... the encoder's reading then
    began_screw_rad: float = 0.0                  # ... and the motor's
    moved_t_ns: int = 0                           # hood without encoder: its motor was seen to move then; 1: not yet
    moved_rad: float = 0.0                        # ... and was here
    hard_ns: int = 0                              # hood: so long without motion by a torque that moves what is free
    pushed_t_ns: int = 0                          # hood: when its torque was last above friction, without motion


class MotionMemory(Struct, frozen=True, omit_defaults=True):
    """Motion interlocks of wheels and hood, while armed."""

    armed_t_ns: int = 0
    active_t_ns: int = 0                          # a target was in sight or a shot asked for
    is_idle: bool = False                         # neither for so long that the wheels are let run down
    wheels: Joint = field(default_factory=Joint)
    hood: Joint = field(default_factory=Joint)
    flywheel_torque_nm: float = 0.0               # of the last tick's command
    hood_torque_nm: float = 0.0


class Unanswered(Struct, frozen=True, omit_defaults=True):
    """Torque that no motion has answered yet, through releases, gaps and disarming."""

    wheels_s: float = 0.0                         # of full torque
    hood_s: float = 0.0                           # above friction
    hood_rad: float | None = None                 # where its encoder was when it last moved


class Pid(Struct, frozen=True):
    """Memory of one PID loop."""

    integral: float = 0.0
    measurement: float = 0.0
    rate: float = 0.0                             # filtered derivative of the measurement
    primed: bool = False


class Shot(Struct, frozen=True):
    """One fed ball, as known at the moment of feeding."""

    trial: int
    t_ns: int
    config_id: str                                # rows of the plan that repeat share it
    distance_m: float
    distance_sigma_m: float
    hood_deg: float
    motor_ratio: float
    motor_rad_s: float
    battery_v: float
    since_last_shot_s: float | None
    p_two: float | None
    p_three: float | None
    speed_m_s: float | UnsetType = UNSET          # of the robot, where it was shot on the move


class Outcome(Struct, frozen=True):
    """The driver's mark of a shot, or that a request was never granted."""

    trial: int
    t_ns: int
    outcome: str                                  # the button that marked it, "rejected" or "held"
    reasons: tuple[Reason, ...] = ()              # for "held": what stood in the way


class Progress(Struct, frozen=True):
    """The progress of `truearc sysid`: the current phase, its start, and what ended the program."""

    phase: int = 0                                # index into truearc.robot.sysid.phases
    since_t_ns: int = 0                           # 0 = the operator has not armed yet
    over: Reason | None = None                    # done, or why it was stopped; nothing is driven any more


class Track(Struct, frozen=True):
    """Distance from exit to target plane and its rate, filtered, as of the newest sighting."""

    t_ns: int
    distance_m: float
    rate_m_s: float


class Watched(Struct, frozen=True):
    """What advice remembers of a launcher that another program drives; a timestamp of 0 means never."""

    speed_t_ns: int = 0
    speed_rad_s: float = 0.0                      # of the flywheel motors
    hood_t_ns: int = 0
    hood_deg: float = 0.0
    distance_t_ns: int = 0
    distance_m: float = 0.0                       # as the sighting has it
    battery_t_ns: int = 0
    battery_v: float = 0.0
    jumped_t_ns: int = 0                          # when a key last jumped
    jumped: str = ""                              # which
    steady_t_ns: int = 0                          # the speed has been steady_rad_s, within tolerance, since then
    steady_rad_s: float = 0.0


class Count(Struct, frozen=True):
    """The hood motor's newest reading, if only its count gives the hood's position."""

    t_ns: int
    position_rad: float
    velocity_rad_s: float


class Memory(Struct, frozen=True):
    """Everything that one tick passes to the next."""

    armed: bool = False
    homed: bool = False
    screw_zero_rad: float = 0.0                   # hood motor position at the limit switch
    flywheel: Pid = field(default_factory=Pid)
    hood: Pid = field(default_factory=Pid)
    trial: int = 0                                # index into the plan
    request_t_ns: int = 0                         # a fire request stands since then; 0 = none
    doubt_t_ns: int = 0                           # since then only the model has stood in the way; 0 = not so
    aim: Aim | None = None                        # held from the request until the trial is over
    # the distance that it is for, None: any; absent only in recordings from before it was there
    aim_place_m: float | UnsetType | None = None
    steady_t_ns: int = 0                          # wheels and hood have been within tolerance since then; 0 = not so
    feed_t_ns: int = 0                            # feeding since then; 0 = not feeding
    last_shot: Shot | None = None
    awaiting: bool = False                        # the last shot has no outcome yet
    walk: tuple[float, float, float] = (0.0, 0.0, 0.0)    # log speed correction learnt from the driver's marks
    last_sighting: Sighting | None = None         # newest with a target in it
    disarmed: Reason | UnsetType = UNSET          # what the button box did that disarmed it; absent where it did not
    identify: Progress | UnsetType = UNSET        # only while identifying, so that other recordings know nothing of it
    track: Track | UnsetType = UNSET              # only where `aim.policy` is "belief"
    aim_sha256: str | UnsetType = UNSET           # of the aim file that the driver accepted; absent: the first one
    watched: Watched | UnsetType = UNSET          # only while advising
    count: Count | UnsetType = UNSET              # only without a hood encoder
    switch: Count | UnsetType = UNSET             # the first in a row that say that the limit switch is closed, homing
    zero_deg: float | UnsetType = UNSET           # of a hood encoder that homing zeroes; absent until it has
    motion: MotionMemory | UnsetType = UNSET            # only while armed
    failures: int | UnsetType = UNSET             # of the hood, latched without its motion being known; absent: none
    wheel_failures: int | UnsetType = UNSET       # of the wheels, latched while nothing shows that they turn
    unanswered: Unanswered | UnsetType = UNSET    # absent: all torque has shown in motion


class Tick(Struct, frozen=True):
    """One recorded row."""

    inputs: Inputs
    estimate: Estimate
    aim: Aim
    verdict: Verdict
    command: Command
    memory: Memory
    shot: Shot | None = None
    outcomes: tuple[Outcome, ...] = ()
    sent: Sent | None = None
