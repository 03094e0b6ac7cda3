"""The self-test of a clip: gravity, measured as if it were unknown, tells whether scale and clock are right.

Every flight of a clip gives an acceleration in diameters of the ball. With the scale it is in m/s2; without one, it
says how large the ball must be. Scale and clock enter differently, g ~ scale x clock^-2, and which of them is likelier
to be wrong follows from how well each is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truearc.sim.printed import Printed
from truearc.sim.video.ballistics import DRAG, LEAN, LIFT, READOUT, Priors
from truearc.sim.video.calibrate import DIAMETER_SD, DIAMETER_SD_PX, Calibration, depths
from truearc.sim.video.link import Flight, settle

EARTH_M_S2 = 9.81
SOUND_M_S2 = (9.6, 10.0)              # outside: the clip is flagged
NINETY = 1.645                        # standard deviations of an interval of 90 %
FACTORS = (2.0, 4.0, 5.0, 8.0, 10.0, 16.0, 32.0)          # of slow motion, in cameras
NEAR = 0.15                           # share by which a gravity may differ from that of such a factor
PITCH_SD_DEG = 4.0                    # how far a camera on the floor or in the stands looks up or down
POOLED_SHARE = 0.25                   # of a prior's standard deviation: how much flights of one clip differ in it
LEAN_SEEN_DEG = 3.0                   # more than a phone is off by when it was levelled


@dataclass(frozen=True)
class SelfTest(Printed):
    """Gravity by the flights of a clip.

    gravity_m_s2: With the clip's scale; NaN without one.
    sd_m_s2: Standard deviation, that of the scale included.
    diameter_m: Of the ball that gravity asks for, with its standard deviation.
    stated_m: The diameter that was stated; None if none was.
    cause: Likeliest cause of a wrong gravity; empty if it is sound.
    lean_deg: Angle between gravity and the picture's vertical.
    readout_s: Of the rolling shutter, as far as the flights tell.
    """

    gravity_m_s2: float
    sd_m_s2: float
    diameter_m: float
    diameter_sd_m: float
    stated_m: float | None
    cause: str
    lean_deg: float
    readout_s: float

    @property
    def is_sound(self) -> bool:
        """Whether the clip has a scale, and its gravity is that of the earth."""
        return SOUND_M_S2[0] <= self.gravity_m_s2 <= SOUND_M_S2[1]

    def lines(self) -> list[str]:
        low, high = (100.0 * (self.diameter_m + sign * NINETY * self.diameter_sd_m) for sign in (-1, 1))
        asked = f"gravity asks for a ball of {100 * self.diameter_m:.1f} cm (90 % interval {low:.1f} to {high:.1f} cm)"
        if np.isnan(self.gravity_m_s2):
            return [f"no scale: {asked}; state --ball-diameter, marks or a tag"]
        doubt = NINETY * self.sd_m_s2
        said = (f"g = {self.gravity_m_s2:.2f} m/s2 (90 % interval {self.gravity_m_s2 - doubt:.2f} to "
                f"{self.gravity_m_s2 + doubt:.2f})")
        found = [f"{said}: scale and clock agree" if self.is_sound else f"warning: {said}: {self.cause}; {asked}" if
                 self.stated_m else f"warning: {said}: {self.cause}"]
        if abs(self.lean_deg) > LEAN_SEEN_DEG:
            found.append(f"warning: gravity leans {abs(self.lean_deg):.1f} degrees from the picture's vertical: "
                         "level the camera, or give two marks")
        return found


def pool(flights: Sequence[Flight], priors: Priors) -> tuple[list[Flight], Priors]:
    """Return flights of one clip, fitted with what they share as their prior, and that: drag, lift, lean and read-out.

    Args:
        flights: Of one clip, fitted with `priors`.
        priors: Of a single flight, in diameters.
    """
    shared = []
    for number, (mean, broad) in zip((DRAG, LIFT, LEAN, READOUT), priors, strict=True):
        precision = np.array([flight.fit.covariance[number, number] ** -1.0 for flight in flights])
        told = np.array([flight.fit.values[number] for flight in flights]) * precision
        total = max(precision.sum() - (len(flights) - 1) * broad ** -2, broad ** -2)      # the prior counts once
        centre = (told.sum() - (len(flights) - 1) * mean * broad ** -2) / total
        shared.append((float(centre), float(max(total ** -0.5, POOLED_SHARE * broad))))
    pooled = Priors(*shared)
    return [settle(flight.blobs, pooled) or flight for flight in flights], pooled


def measure_gravity(flights: Sequence[Flight], shared: Priors, calibration: Calibration,
                    diameter_m: float | None) -> SelfTest:
    """Measure gravity by the flights of a clip, at least one.

    Args:
        flights: Those of one clip that fall alike.
        shared: What they share, of `pool`.
        calibration: The clip's.
        diameter_m: Of the ball, as stated; None if it was not.
    """
    unit_px = float(np.median([flight.unit_px for flight in flights]))
    falls_px, sds_px = np.array([(flight.gravity, flight.fit.gravity_sd) for flight in flights]).T * [
        flight.unit_px * far for flight, far in zip(flights, depths(flights), strict=True)]
    fall_px, sd_px = _mean(falls_px, sds_px)
    share = float(np.sqrt((sd_px / fall_px) ** 2 + DIAMETER_SD ** 2 + (DIAMETER_SD_PX / unit_px) ** 2))
    asked_m = EARTH_M_S2 * unit_px / fall_px
    scale = calibration.metres_per_px
    gravity = float("nan") if scale is None else fall_px * scale
    sd = gravity * float(np.hypot(sd_px / fall_px, calibration.scale_sd)) if scale else float("nan")
    cause = "" if scale is None or SOUND_M_S2[0] <= gravity <= SOUND_M_S2[1] else _cause(gravity, calibration)
    return SelfTest(gravity, sd, asked_m, asked_m * share, diameter_m, cause,
                    float(np.degrees(np.arctan(shared.lean[0]))), shared.readout[0])


def _mean(values: np.ndarray, sds: np.ndarray) -> tuple[float, float]:
    """Mean of measurements that scatter more than they state, if they do, and its sd (DerSimonian and Laird 1986)."""
    weights = sds ** -2.0
    fixed = (weights * values).sum() / weights.sum()
    excess = (weights * (values - fixed) ** 2).sum() - (len(values) - 1)
    room = weights.sum() - (weights ** 2).sum() / weights.sum()
    between = max(excess / room, 0.0) if len(values) > 1 else 0.0
    weights = 1.0 / (sds ** 2 + between)
    return float((weights * values).sum() / weights.sum()), float(weights.sum() ** -0.5)


def _cause(gravity: float, calibration: Calibration) -> str:
    """The likeliest cause of a wrong gravity: the one that is the fewest standard deviations off."""
    off = float(np.log(gravity / EARTH_M_S2))
    for factor in FACTORS:
        if abs(off + 2.0 * np.log(factor)) < NEAR:
            return f"the clip is probably in slow motion, {factor:g} times; state --slow-motion {factor:g}"
    on = " and ".join(source.name for source in calibration.sources)
    causes = [(abs(off) / calibration.scale_sd,
               f"lengths are probably {abs(np.expm1(off)):.0%} too {'long' if off > 0 else 'short'}; check {on}"),
              (abs(off) / 2.0 / calibration.clock_sd,
               f"the clock probably runs {abs(np.expm1(off / 2.0)):.0%} too {'slow' if off > 0 else 'fast'}; "
               "check the frame rate")]
    if off < 0.0:
        causes.append((float(np.degrees(np.arccos(np.exp(off)))) / PITCH_SD_DEG,
                       f"the camera probably looks up or down by {np.degrees(np.arccos(np.exp(off))):.0f} degrees; "
                       "aim it level"))
    return min(causes)[1]
