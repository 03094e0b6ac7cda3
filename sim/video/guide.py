"""What to put in view, how to film, and what a clip will be worth: a page with truearc's sheet to print.

The worth is that of one flight: standard deviations by the Fisher information of the positions that a camera at that
distance and rate gives, with the scale and level that the sheet gives.
"""

from typing import NamedTuple

import cv2
import numpy as np

from truearc.sim.report import make_page, paragraph, table
from truearc.sim.video.ballistics import DRAG_PRIOR, LEAN_SD, LIFT_PRIOR, READOUT_PRIOR, Floats, Priors, derivatives
from truearc.sim.video.calibrate import (
    EXIT_FROM_SHEET_M,
    FLOOR_SD_DEG,
    SHEET_M,
    SHEET_SD,
    SHEET_TAG,
    TAG_SD_PX,
)
from truearc.sim.video.detect import LEAST_DIAMETER

SEEN_DEG = 52.0                       # width of the view of a phone's main camera, held sideways
COLUMNS = 1920                        # of its pictures
CENTRE_SD_PX = 0.4                    # of a centre, as benchmarks.track measures it
DISTANCES_M, RATES_HZ = (5.0, 8.0, 11.0, 15.0), (30.0, 60.0, 120.0)
NINETY = 1.645                        # standard deviations of an interval of 90 %
EXAMPLE = (7.0, 50.0, 1.0)            # speed in m/s, elevation in degrees, seconds in view
EDGE_MM, PAPER_MM = 30.0, (420.0, 297.0)


class Worth(NamedTuple):
    """What one flight will tell.

    Fields:
        width_m: Of the view in the plane of the flight.
        ball_px: Diameter of the ball.
        speed_m_s: Half of the 90 % interval of the exit speed.
        height_m: The same of the height where the flight ends.
        reason: Why the clip is of no use; empty if it is.
    """

    width_m: float
    ball_px: float
    speed_m_s: float
    height_m: float
    reason: str = ""


def worth(distance_m: float, rate_hz: float, diameter_m: float, has_sheet: bool = True) -> Worth:
    """Return what one flight is worth, filmed from a distance.

    Args:
        distance_m: From the plane of the flight.
        rate_hz: Pictures a second.
        diameter_m: Of the ball.
        has_sheet: Whether the sheet is in view; else the ball's diameter gives the scale, and the eye the level.
    """
    width_m = 2.0 * distance_m * float(np.tan(np.radians(SEEN_DEG / 2.0)))
    per_px = width_m / COLUMNS
    ball_px = diameter_m / per_px
    scale_sd = float(np.hypot(SHEET_SD, TAG_SD_PX * per_px / SHEET_M)) if has_sheet else float(
        np.hypot(0.02, 0.4 / ball_px))
    level_rad = np.radians(FLOOR_SD_DEG if has_sheet else 2.0)
    speed, angle, span_s = EXAMPLE[0], np.radians(EXAMPLE[1]), EXAMPLE[2]
    values = np.array([0.0, 0.0, speed * np.cos(angle), speed * np.sin(angle), 9.81, *(prior[0] for prior in _PRIORS)])
    times = np.arange(0.0, span_s, 1.0 / rate_hz)
    jacobian, places = derivatives(values, times, np.linspace(0.2, -0.2, len(times)))
    precision = np.diag([0.0] * 4 + [1e12] + [prior[1] ** -2 for prior in _PRIORS])         # gravity is known
    covariance = np.linalg.inv(np.einsum("nik,nil->kl", jacobian, jacobian) / (CENTRE_SD_PX * per_px) ** 2 + precision)
    along = np.array([np.cos(angle), np.sin(angle)])
    speed_sd = np.hypot(np.sqrt(along @ covariance[2:4, 2:4] @ along), speed * scale_sd)
    end = jacobian[-1, 1]
    height_sd = np.sqrt(end @ covariance @ end + (places[-1, 1] * scale_sd) ** 2 + (places[-1, 0] * level_rad) ** 2)
    few = ball_px < LEAST_DIAMETER
    return Worth(width_m, ball_px, NINETY * float(speed_sd), NINETY * float(height_sd),
                 f"the ball is {ball_px:.0f} pixels wide; {LEAST_DIAMETER:.0f} are needed" if few else "")


_PRIORS: Priors = Priors(DRAG_PRIOR, LIFT_PRIOR, (0.0, LEAN_SD), READOUT_PRIOR)


def make_guide(diameter_m: float) -> str:
    """Return the page: where to stand, what to put in view, what a clip is worth, and the sheet to print."""
    rows = []
    for distance_m in DISTANCES_M:
        for rate_hz in RATES_HZ:
            with_sheet, without = (worth(distance_m, rate_hz, diameter_m, seen) for seen in (True, False))
            rows.append((f"{distance_m:g}", f"{with_sheet.width_m:.1f}", f"{rate_hz:g}", f"{with_sheet.ball_px:.0f}",
                         *((with_sheet.reason, "") if with_sheet.reason else
                           (f"{with_sheet.speed_m_s:.2f} / {without.speed_m_s:.2f}",
                            f"{100 * with_sheet.height_m:.0f} / {100 * without.height_m:.0f}"))))
    ahead_cm = 100.0 * EXIT_FROM_SHEET_M[0]
    steps = "".join(f"<li>{line}</li>" for line in (
        "Put the phone on a tripod or a box, level, beside the middle of the flights and square to them. It must not "
        "move.",
        "Film sideways, with 60 pictures a second or more, in bright light: the exposure must be short. No slow "
        "motion, no zoom during the clip.",
        "Stand so far away that launcher, target and the highest point of the flights are in view.",
        f"Print the sheet below on paper of size A3, without scaling: its black square is {1000 * SHEET_M:.0f} mm "
        "wide.",
        f"Hang it on the robot, upright, in the plane of the flights, its centre {ahead_cm:.0f} cm behind the exit and "
        "at the height of the ball's centre as it leaves.",
        "Begin to film before the first shot, and wait unevenly between shots: clips and recording are matched by the "
        "pattern of these waits."))
    header = ("distance, m", "width of the view, m", "pictures a second", "ball, pixels", "exit speed, ± m/s",
              "height at the end, ± cm")
    speed, angle, _ = EXAMPLE
    verdict = "Hang the sheet on the robot, put the phone on a tripod, and film 60 pictures a second."
    return make_page("How to film flights", verdict, [
                         ("Do this", f"{_drawing()}<ol>{steps}</ol>"),
                         ("What a clip is worth", paragraph(
                             f"Half of the 90 % interval that one flight of {speed:g} m/s at {angle:g} degrees gives, "
                             f"with the sheet / without it, for a ball of {100 * diameter_m:.1f} cm.")
                          + table(header, rows)),
                         ("The sheet", sheet_svg())])


def sheet_svg() -> str:
    """Return the sheet in its true size, for paper of size A3."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    cells = cv2.aruco.generateImageMarker(family, SHEET_TAG, 8)
    side = 1000.0 * SHEET_M / 8
    left, top = (PAPER_MM[0] - 1000.0 * SHEET_M) / 2.0, (PAPER_MM[1] - 1000.0 * SHEET_M) / 2.0
    black = "".join(f'<rect x="{left + side * x:g}" y="{top + side * y:g}" width="{side + 0.05:g}" '
                    f'height="{side + 0.05:g}"/>' for y, x in zip(*np.nonzero(np.asarray(cells) == 0), strict=True))
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{PAPER_MM[0]:g}mm" height="{PAPER_MM[1]:g}mm" '
            f'viewBox="0 0 {PAPER_MM[0]:g} {PAPER_MM[1]:g}" shape-rendering="crispEdges" style="break-before:page">'
            f'<rect width="{PAPER_MM[0]:g}" height="{PAPER_MM[1]:g}" fill="#fff"/>{black}'
            f'<text x="{left:g}" y="{top - 6:g}" font-size="7" font-family="sans-serif">truearc: the upper edge; the '
            f'black square is {1000.0 * SHEET_M:g} mm wide</text></svg>')


def _drawing() -> str:
    """The scene as the phone sees it."""
    arc: Floats = np.column_stack([np.linspace(120.0, 520.0, 24), np.zeros(24)])
    arc[:, 1] = 175.0 - 0.62 * (arc[:, 0] - 120.0) + 0.00115 * (arc[:, 0] - 120.0) ** 2
    balls = "".join(f'<circle cx="{x:.0f}" cy="{y:.0f}" r="6" fill="#d99000"/>' for x, y in arc)
    return ('<svg viewBox="0 0 640 260" style="width:100%;max-width:640px" font-family="sans-serif" font-size="13">'
            '<rect width="640" height="260" fill="#e9edf0"/><rect y="215" width="640" height="45" fill="#c9ced2"/>'
            '<rect x="30" y="185" width="95" height="38" fill="#555"/><rect x="102" y="160" width="18" height="30" '
            'fill="#476a8a"/><rect x="58" y="158" width="30" height="30" fill="#fff" stroke="#999"/>'
            '<rect x="62" y="162" width="22" height="22" fill="#111"/><rect x="66" y="166" width="6" height="6" '
            f'fill="#fff"/>{balls}<rect x="530" y="60" width="14" height="60" fill="#777"/>'
            '<rect x="535" y="120" width="4" height="100" fill="#777"/>'
            '<text x="30" y="148">the sheet</text><text x="90" y="206" fill="#fff">exit</text>'
            '<text x="505" y="50">target</text><text x="190" y="245">the phone sees all of this, sideways, from a '
            'tripod</text></svg>')
