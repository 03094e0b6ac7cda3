"""What could be true: every hypothesis that fit, synth, discovery and the generic tests know."""

from collections.abc import Iterable, Mapping
from typing import Any

from truearc.robot.config.schema import InputError
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics.nonparametric import CURVE, NAMELESS, POINT
from truearc.sim.physics.term import (
    AirTerm,
    ArrivalTerm,
    FlightTerm,
    InFlight,
    LaunchTerm,
    Parameter,
    SensingTerm,
    Term,
    WatchTerm,
    complete,
)
from truearc.sim.physics.terms.arrival.rim_catch import RimCatch
from truearc.sim.physics.terms.arrival.target_height import TargetHeight
from truearc.sim.physics.terms.flight.added_mass import AddedMass
from truearc.sim.physics.terms.flight.air_change import AirChange
from truearc.sim.physics.terms.flight.air_density import AirDensity
from truearc.sim.physics.terms.flight.buoyancy import Buoyancy
from truearc.sim.physics.terms.flight.drag import Drag
from truearc.sim.physics.terms.flight.drag_reynolds import DragReynolds
from truearc.sim.physics.terms.flight.drag_wear import DragWear
from truearc.sim.physics.terms.flight.gravity import Gravity
from truearc.sim.physics.terms.flight.lift_saturation import LiftSaturation
from truearc.sim.physics.terms.flight.magnus import Magnus
from truearc.sim.physics.terms.flight.spin_decay import SpinDecay
from truearc.sim.physics.terms.flight.spin_drag import SpinDrag
from truearc.sim.physics.terms.flight.wind_x import WindX
from truearc.sim.physics.terms.flight.wind_y import WindY
from truearc.sim.physics.terms.flight.wind_z import WindZ
from truearc.sim.physics.terms.launch.ball_compression import BallCompression
from truearc.sim.physics.terms.launch.ball_spread import BallSpread
from truearc.sim.physics.terms.launch.ball_wear import BallWear
from truearc.sim.physics.terms.launch.battery_sag import BatterySag
from truearc.sim.physics.terms.launch.exit_efficiency import ExitEfficiency
from truearc.sim.physics.terms.launch.rapid_fire import RapidFire
from truearc.sim.physics.terms.launch.release_height import ReleaseHeight
from truearc.sim.physics.terms.launch.wheel_droop import WheelDroop
from truearc.sim.physics.terms.launch.wheel_slip import WheelSlip
from truearc.sim.physics.terms.sensing.distance_bias import DistanceBias
from truearc.sim.physics.terms.sensing.distance_scale import DistanceScale
from truearc.sim.physics.terms.sensing.encoder_scale import EncoderScale
from truearc.sim.physics.terms.sensing.hood_backlash import HoodBacklash
from truearc.sim.physics.terms.sensing.hood_offset import HoodOffset
from truearc.sim.physics.terms.sensing.track_clock import TrackClock
from truearc.sim.physics.terms.sensing.track_perspective import TrackPerspective
from truearc.sim.physics.terms.sensing.track_scale import TrackScale
from truearc.sim.physics.terms.sensing.track_tilt import TrackTilt
from truearc.sim.physics.terms.sensing.vision_latency import VisionLatency

# The order in which they act. Launch: slip is a matter of the wheels' speed, the losses of what is left of it. In the
# air: what air the ball meets, then forces, then shares of the forces before them; added mass is a share of them all.
TERMS: tuple[Term, ...] = (
    HoodOffset(), HoodBacklash(), EncoderScale(), DistanceScale(), DistanceBias(), VisionLatency(), TrackScale(),
    TrackTilt(), TrackClock(), TrackPerspective(),
    WheelSlip(), ExitEfficiency(), WheelDroop(), BallCompression(), BallWear(), BallSpread(), BatterySag(),
    RapidFire(), ReleaseHeight(),
    SpinDecay(), WindX(), WindY(), WindZ(),
    Gravity(), Drag(), Magnus(), SpinDrag(), DragReynolds(), LiftSaturation(), DragWear(), AirDensity(), AirChange(),
    Buoyancy(), AddedMass(),
    TargetHeight(), RimCatch(),
)


def find_terms(names: Iterable[str]) -> tuple[Term, ...]:
    """Terms by name, in the catalogue's order, effects without a name last; InputError names the first that there is
    none of."""
    wanted = set(names)
    for name in sorted(wanted - {term.name for term in (*TERMS, *NAMELESS)}):
        raise InputError(f"there is no term {name!r}; the catalogue has {', '.join(sorted(one.name for one in TERMS))}")
    return tuple(term for term in (*TERMS, *NAMELESS) if term.name in wanted)


def sensing_terms(names: Iterable[str]) -> tuple[SensingTerm, ...]:
    """Those of the named terms that correct what the robot's sensors say of a configuration."""
    return tuple(term for term in find_terms(names) if isinstance(term, SensingTerm))


def watch_terms(names: Iterable[str]) -> tuple[WatchTerm, ...]:
    """Those of the named terms that are about the tracker."""
    return tuple(term for term in find_terms(names) if isinstance(term, WatchTerm))


def launch_terms(names: Iterable[str]) -> tuple[LaunchTerm, ...]:
    """Those of the named terms that act while the wheels hold the ball."""
    return tuple(term for term in find_terms(names) if isinstance(term, LaunchTerm))


def flight_terms(names: Iterable[str]) -> tuple[InFlight, ...]:
    """Those of the named terms that act in the air, on the ball or on what air it meets."""
    return tuple(term for term in find_terms(names) if isinstance(term, FlightTerm | AirTerm))


def arrival_terms(names: Iterable[str]) -> tuple[ArrivalTerm, ...]:
    """Those of the named terms that are about the target."""
    return tuple(term for term in find_terms(names) if isinstance(term, ArrivalTerm))


def effective(params: Mapping[str, Mapping[str, Any]], circumstances: Circumstances) -> dict[str, dict[str, Any]]:
    """{term: {parameter: value}}, complete, as the terms' hooks take them for shots under these circumstances.

    Numbers of a term that follows a circumstance become arrays like it; InputError names a term that there is none of.
    """
    return {term.name: term.at_shot(complete(term, params[term.name]), circumstances) for term in find_terms(params)}


def find_parameter(name: str) -> Parameter:
    """The parameter called "term.parameter", or a curve's point; InputError when the catalogue has none of that
    name."""
    term_name, _, key = name.partition(".")
    if term_name == CURVE:
        return POINT
    for term in find_terms([term_name]):
        for parameter in term.parameters:
            if parameter.name == key:
                return parameter
    raise InputError(f"{name}: {term_name} has no such parameter")
