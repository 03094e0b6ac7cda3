"""What could be true: every hypothesis that fit, synth, discovery and the generic tests know."""

from collections.abc import Iterable, Mapping
from typing import Any

from robot.config import BadInput
from sim.physics.nameless import CURVE, NAMELESS, POINT
from sim.physics.term import (
    AirTerm,
    ArrivalTerm,
    Circumstances,
    FlightTerm,
    InFlight,
    LaunchTerm,
    Parameter,
    SensingTerm,
    Term,
    WatchTerm,
    complete,
)
from sim.physics.terms.added_mass import AddedMass
from sim.physics.terms.air_change import AirChange
from sim.physics.terms.air_density import AirDensity
from sim.physics.terms.ball_compression import BallCompression
from sim.physics.terms.ball_spread import BallSpread
from sim.physics.terms.ball_wear import BallWear
from sim.physics.terms.battery_sag import BatterySag
from sim.physics.terms.buoyancy import Buoyancy
from sim.physics.terms.distance_bias import DistanceBias
from sim.physics.terms.distance_scale import DistanceScale
from sim.physics.terms.drag import Drag
from sim.physics.terms.drag_reynolds import DragReynolds
from sim.physics.terms.drag_wear import DragWear
from sim.physics.terms.encoder_scale import EncoderScale
from sim.physics.terms.exit_efficiency import ExitEfficiency
from sim.physics.terms.gravity import Gravity
from sim.physics.terms.hood_backlash import HoodBacklash
from sim.physics.terms.hood_offset import HoodOffset
from sim.physics.terms.lift_saturation import LiftSaturation
from sim.physics.terms.magnus import Magnus
from sim.physics.terms.rapid_fire import RapidFire
from sim.physics.terms.release_height import ReleaseHeight
from sim.physics.terms.rim_catch import RimCatch
from sim.physics.terms.spin_decay import SpinDecay
from sim.physics.terms.spin_drag import SpinDrag
from sim.physics.terms.target_height import TargetHeight
from sim.physics.terms.track_clock import TrackClock
from sim.physics.terms.track_perspective import TrackPerspective
from sim.physics.terms.track_scale import TrackScale
from sim.physics.terms.track_tilt import TrackTilt
from sim.physics.terms.vision_latency import VisionLatency
from sim.physics.terms.wheel_droop import WheelDroop
from sim.physics.terms.wheel_slip import WheelSlip
from sim.physics.terms.wind_x import WindX
from sim.physics.terms.wind_y import WindY
from sim.physics.terms.wind_z import WindZ

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
    """Terms by name, in the catalogue's order, effects without a name last; BadInput names the first that there is none
    of."""
    wanted = set(names)
    for name in sorted(wanted - {term.name for term in (*TERMS, *NAMELESS)}):
        raise BadInput(f"there is no term {name!r}; the catalogue has {', '.join(sorted(one.name for one in TERMS))}")
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

    Numbers of a term that follows a circumstance become arrays like it; BadInput names a term that there is none of.
    """
    return {term.name: term.at_shot(complete(term, params[term.name]), circumstances) for term in find_terms(params)}


def find_parameter(name: str) -> Parameter:
    """The parameter called "term.parameter", or a curve's point; BadInput when the catalogue has none of that name."""
    term_name, _, key = name.partition(".")
    if term_name == CURVE:
        return POINT
    for term in find_terms([term_name]):
        for parameter in term.parameters:
            if parameter.name == key:
                return parameter
    raise BadInput(f"{name}: {term_name} has no such parameter")
