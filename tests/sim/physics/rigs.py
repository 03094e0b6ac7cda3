"""The paper's rig as Facts; the numbers are those of tests.sim.physics.reference."""

import msgspec

from tests.sim.physics import reference
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Rig, Target, Wheel, WorldFacts

GUPPY = Rig(
    ball=Ball(mass_kg=reference.MASS_KG, radius_m=reference.RADIUS_M),
    launcher=LauncherFacts(
        release_height_m=reference.RELEASE_M, free_speed_rad_s=reference.FREE_SPEED_RAD_S,
        wheel=(Wheel("lower", reference.LOWER_RADIUS_M, 1.0, 180.0),
               Wheel("upper", reference.UPPER_RADIUS_M, reference.UPPER_GEAR, 0.0))),
    target=Target(centre_height_m=2.44), air=Air(reference.DENSITY_KG_M3), world=WorldFacts(reference.GRAVITY_M_S2))


def with_wheels(*clocks_deg: float) -> Rig:
    """The same rig with wheels of 0.05 m at these clock angles."""
    wheels = tuple(Wheel(f"w{number}", 0.05, 1.0, clock) for number, clock in enumerate(clocks_deg))
    return msgspec.structs.replace(GUPPY, launcher=msgspec.structs.replace(GUPPY.launcher, wheel=wheels))


def weightless(release_height_m: float = 0.0) -> Rig:
    """The same rig without gravity, releasing at another height."""
    launcher = msgspec.structs.replace(GUPPY.launcher, release_height_m=release_height_m)
    return msgspec.structs.replace(GUPPY, launcher=launcher, world=WorldFacts(0.0))
