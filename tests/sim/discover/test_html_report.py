"""The report as a page: story first, well-formed, every kind of verdict; pictures that show what is there."""

import io
import re
from dataclasses import replace
from html import escape as html_escape
from html.parser import HTMLParser
from importlib.metadata import version

import matplotlib.image
import msgspec
import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.sim.discover.made import make_linear, term
from tests.sim.discover.worlds import FACTS, World, make_outcomes
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import curve_of
from truearc.sim.discover.finding import FoundEffect, Interval, Named
from truearc.sim.discover.identifiability import foresee
from truearc.sim.discover.investigate import Investigation, discover, make_belief
from truearc.sim.discover.report import flights, pages
from truearc.sim.discover.report import pictures as pic
from truearc.sim.discover.report.story import tell
from truearc.sim.infer.likelihood.score_table import Column
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.simulate import trajectories
from truearc.sim.report import Origin, make_png

BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")
VOID = {"meta", "br"}
FEW = few_terms("wind_x", "hood_offset", "wheel_slip", "battery_sag", "target_height")


class Balanced(HTMLParser):
    """Collects text; complains of tags that do not close as they opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style"} & set(self.open):
            self.text.append(data)


def read(page: str) -> str:
    """The page's text, after checking that it is a page on its own."""
    parser = Balanced()
    parser.feed(page)
    assert not parser.open
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:|#)", page)
    assert "http" not in page and "url(" not in re.sub(r"url\(#[\w]+\)", "", page)
    return " ".join(" ".join(parser.text).split())


@pytest.fixture(scope="module")
def drifting() -> Investigation:
    """Outcomes with sides while the balls get faster by a tenth."""
    return discover(make_outcomes(World(speed_drift=0.1), 120, 4), BELIEVED, terms=FEW)


@pytest.fixture(scope="module")
def quiet() -> Investigation:
    return discover(make_outcomes(World(), 120, 1), BELIEVED, terms=FEW)


def test_the_story_comes_first_then_pictures_names_and_tests(drifting: Investigation) -> None:
    assert drifting.finding.verdict != "none"
    origin = Origin("2026-03-01T10:00:00+01:00", "truearc discover week --report 'a b.html'")
    page = pages.make_report("week <1>", drifting, origin)
    text, told = read(page), drifting.finding.told
    assert f'<p class="verdict">{html_escape(told.change)}</p>' in page.replace("\N{NO-BREAK SPACE}", " ")
    head = text[:text.index(told.change)]
    assert f"2026-03-01 10:00:00+01:00 · truearc {version('truearc')}" in head and origin.command in head
    places = [text.index(part) for part in (told.change, told.where, told.worth, told.sure, told.next, "Side view of",
                                            "Real shots less simulated ones", "What it may be", "How it was judged",
                                            "What these 120 shots could show")]
    assert places == sorted(places)
    assert "week <1>" in text
    assert all(f"{round(100 * one.probability)}%" in text for one in drifting.finding.what[:2])
    assert "alarm at 0.05" in text and "Not tested" in text
    assert re.search(r"prefers-color-scheme: dark", page) and "<script" not in page


def test_at_most_five_names_have_a_bar_and_the_truth_stands_beside_its_size(drifting: Investigation) -> None:
    finding = msgspec.structs.replace(drifting.finding, unexplained=0.1, what=tuple(
        Named(name, 0.5 - 0.05 * k, {"x": Interval(1.0, 0.1, 0.8, 1.2, "1")}, "", "launch")
        for k, name in enumerate(("wheel_slip", "hood_offset", "drag", "magnus", "wind_x", "wind_y", "wind_z"))))
    page = pages.make_report("many", replace(drifting, finding=finding), truth={"hood_offset": 1.1})
    shown, folded = page[:page.index("3 more</summary>")], page[page.index("3 more</summary>"):]
    assert shown.count('class="effect') == 5 and folded.count('class="effect') == 3
    assert "true: 1.1°" in read(page) and page.count('class="truth"') == 1
    at, truth = (float(re.search(rf'class="{kind}" style="left:([\d.]+)%"', shown.partition("hood offset")[2])[1])
                 for kind in ("at", "truth"))
    assert truth - at == pytest.approx(94.0 * 0.1 / 1.2)      # on a scale from 0 to 1.2


def test_drawn_flights_are_those_of_the_simulation(drifting: Investigation) -> None:
    dataset = drifting.dataset.take([0, 60])
    belief = make_belief(drifting)[0]
    belief = replace(belief, scatter={"speed": 0.01, "elevation_deg": 0.0})
    drawn_arcs = flights._arcs(belief, dataset)
    faster = {**dataset.shots.numbers, "motor_ratio": 1.01 * dataset.shots.number("motor_ratio")}
    for numbers, side in ((dataset.shots.numbers, 0.0), (faster, 1.0 / 1.645)):
        flown = trajectories(dataset.rig, belief.coefficients, Shots(("a", "b"), numbers, {}), among=belief.catalogue)
        for (place, _), (x, z, reach) in zip(flown, drawn_arcs, strict=True):
            inside = x < place[-1, 0]
            np.testing.assert_allclose(np.interp(x, place[:, 0], place[:, 2])[inside], (z + side * reach)[inside],
                                       atol=0.012)


def test_a_set_is_marked_and_a_name_besides_is_told(drifting: Investigation) -> None:
    finding = drifting.finding
    size = Interval(1.0, 0.1, 0.8, 1.2, "m/s")
    wind = Named("wind_x", 0.4, {"speed_m_s": size}, find_terms(["wind_x"])[0].sentence, "flight")
    first = msgspec.structs.replace(finding.what[0], probability=0.5)
    both = msgspec.structs.replace(finding, what=(first, wind), set=(first.term, "wind_x"), verdict="set",
                                  also=(FoundEffect((wind,), ("wind_x",), None),), unexplained=0.1)
    both = tell(msgspec.structs.replace(both, unknown=None), None)
    page = pages.make_report("set", replace(drifting, finding=both))
    text = read(page)
    assert page.count('class="fill set"') == 2 and "Orange: what these data cannot tell apart." in text
    assert "may add up to more than 100 %" in text
    assert "Beside that, there is wind of 1.00 m/s (90 %: 0.80 to 1.20 m/s) toward the target" in text
    assert "an effect of no term" in text and "10%" in text


def test_nothing_found_still_shows_the_shots_and_what_they_could_have_told(quiet: Investigation) -> None:
    assert quiet.finding.verdict == "none"
    page = pages.make_report("quiet", quiet)
    text = read(page)
    assert re.match(r"Nothing found; these 120 shots could not have shown .* below .*\.", quiet.finding.told.change)
    assert quiet.finding.told.change in text and "If nothing were missing" in text
    assert "seen from, with 120 shots" in text and "shots needed" in text
    assert page.count("<svg ") >= 3


def test_an_effect_without_a_name_is_drawn_with_its_free_curve(drifting: Investigation) -> None:
    assert drifting.finding.verdict == "unknown"
    flown, against, curve, field = pages.make_pictures(drifting)
    assert "Side view" in flown.caption and "bins of" in against.caption and "mean of a cell" in field.caption
    assert 'aria-label="free curve: launch speed against t_s"' in curve.svg
    assert "change of launch speed over the time in the session" in curve.caption
    place = drifting.steps[0].place
    assert place is not None and isinstance(place.test.what, Covariate)
    share, sd = curve_of(place.correction)
    t_s = place.test.what.values[place.correction.scores.rows]
    true = 0.1 * (t_s - t_s.mean()) / t_s.max()          # of World(speed_drift=0.1), to first order
    assert np.abs(share - true).max() < 0.012 and (np.abs(share - true) < 3.0 * sd + 0.003).all()
    assert 0.0 < sd.max() < 0.02


def test_a_free_curve_is_drawn_although_the_fit_has_gained_a_term(drifting: Investigation) -> None:
    """A name may be withheld only after the curve was fitted beside fewer shared columns."""
    step = drifting.steps[0]
    more = step.fitted.beside(step.naming.refits[step.naming.leader])
    assert more.scores.first_shared < step.fitted.scores.first_shared
    before, after = pic.evidence_after(step), pic.evidence_after(replace(step, fitted=more))
    np.testing.assert_array_equal(before.score, after.score)
    assert step.place is not None and before.columns[0].name == step.place.column.name
    assert before.log_score.sum() > step.fitted.scores.log_score.sum() + 5.0       # nats: the curve itself is in it


def test_data_that_say_nothing_make_a_page_all_the_same() -> None:
    shots = Shots(tuple(map(str, range(20))), {"distance_m": np.linspace(2.0, 6.0, 20)}, {})
    mute = discover(Dataset("mute", FACTS, shots))
    assert pages.make_pictures(mute) == []
    assert "cannot say anything" in read(pages.make_report("mute", mute))


def test_what_a_season_could_tell_as_table_and_page() -> None:
    sight = foresee(FACTS, ("gravity", "drag", "magnus"), "L0", 120)
    lines = pages.sight_lines(sight)
    text = read(pages.make_sight_page("rig.toml", sight))
    for one in sight.terms:
        row = next(line for line in lines if re.match(rf"(never seen: )?{one.term}\b", line))
        needed = str(one.shots_needed) if (one.shots_needed or 0) <= 10_000 else "over 10000"
        assert f" {needed} " in f"{row} " if one.shots_needed else row.startswith("never seen")
    assert pages.sight_sentence(sight) in text and text.index(pages.sight_sentence(sight)) < text.index("shots needed")
    assert any(line.startswith("one and the same") and "target_height" in line for line in lines)
    never = {one.term: pages.why_not(one) for one in sight.terms if one.shots_needed is None}
    assert "record battery_v" in never["battery_sag"] and "counted as chance" in never["ball_spread"]
    assert "magnus.cl" in never["ball_compression"]


ROWS = np.arange(80)
ORDER = Covariate((("t_s", np.linspace(0.0, 100.0, 80)), ("order_in_session", ROWS.astype(float))))
SIDE = Factor("supplier", ("north", "south"), ROWS % 2)
BLUE, ORANGE = np.array([[0x1f, 0x5f, 0xa8], [0xc2, 0x57, 0x1a]]) / 255.0


def drawn(figure: Figure | None) -> np.ndarray:
    assert figure is not None
    return matplotlib.image.imread(io.BytesIO(make_png(figure)))[..., :3]


def share_like(image: np.ndarray, colour: np.ndarray) -> float:
    return float((np.abs(image - colour).max(axis=2) < 0.12).mean())


def test_a_bin_holds_the_weighted_mean_with_its_error() -> None:
    score, information = np.array([2.0, 4.0, 9.0, 8.0]), np.array([1.0, 2.0, 3.0, 4.0])
    value, error = pic.LinearResiduals(score, information).estimate(np.ones(4, dtype=bool))
    assert value == pytest.approx(np.average(score / information, weights=information))
    assert error >= 1.0 / np.sqrt(10.0)
    assert np.isnan(pic.LinearResiduals(score, information).estimate(np.arange(4) < 2)[0])


def test_bins_are_even_or_the_values_there_are() -> None:
    even = pic.bins_of(ORDER, ROWS)
    assert np.bincount(even.index).tolist() == [10] * 8
    assert (np.diff(even.middle) > 0.0).all()
    assert pic.bins_of(SIDE, ROWS).labels == ("north", "south")
    few = pic.bins_of(Covariate((("hood_change", np.where(ROWS % 3, 1.0, -1.0)),)), ROWS)
    assert few.middle.tolist() == [-1.0, 1.0] and (few.middle[few.index] == np.where(ROWS % 3, 1.0, -1.0)).all()
    gaps = Covariate((("x", np.where(ROWS < 10, np.nan, ROWS.astype(float))),))
    assert (pic.bins_of(gaps, ROWS).index[:10] == -1).all()


def test_the_field_is_coloured_where_shots_are_off() -> None:
    across, up = np.tile(np.arange(10.0), 8), np.repeat(np.arange(8.0), 10)
    off = np.where(across > 5.0, 0.1, 0.0)
    information = np.full(80, 1e4)
    seen = pic.LinearResiduals(off * information, information)
    residual = pic.Residual("height", None, "arrival", 100.0, "cm", seen, None)
    image = drawn(pic.draw_field(residual, ("distance [m]", across), ("elevation", up), ""))
    red = (image[..., 0] > 0.3) & (image[..., 2] < 0.2)
    assert red.mean() > 0.1
    width = image.shape[1]
    assert red[:, :width // 3].sum() < 0.05 * red[:, width // 3:].sum()
    assert pic.draw_field(residual, ("distance [m]", np.full(80, 3.0)), ("elevation", up), "") is None


def test_bands_along_the_flight_show_what_was_pushed() -> None:
    spans = [(0.0, 0.2), (0.2, 0.4), (0.4, float("inf"))]
    bands = tuple(Column(f"push vertical from {a}", "free", "flight", "vertical", "m/s2", 1.5, times_s=(a, b))
                  for a, b in spans)
    observed = np.tile([0.0, 0.0, 5.0], (40, 1)) + np.random.default_rng(3).normal(size=(40, 3))
    evidence = make_linear(np.tile(np.eye(3), (40, 1, 1)), bands, np.zeros(0), observed)
    image = drawn(pic.draw_flight(evidence, None, "", [("", np.ones(40, dtype=bool))]))
    rows = np.flatnonzero((np.abs(image - BLUE).max(axis=2) < 0.12).any(axis=1))
    assert rows[-1] - rows[0] > 0.4 * image.shape[0]
    two = drawn(pic.draw_flight(evidence, evidence, "wind", pic.halves(ORDER, ROWS[:40])))
    panels = two[:, :two.shape[1] // 2], two[:, two.shape[1] // 2:]
    assert all(share_like(panel, colour) > 1e-4 for panel in panels for colour in (BLUE, ORANGE))
    assert share_like(image, ORANGE) == 0.0
    assert pic.draw_flight(make_linear(np.ones((4, 1, 1)), (term("a"),), np.zeros(0)), None, "", []) is None


@pytest.mark.parametrize(("by_hood", "drawn"), [(1.2, "distance_m"), (3.0, "hood_deg")])
def test_residuals_go_with_distance_unless_another_explains_far_more(by_hood: float, drawn: str) -> None:
    """Both explain a part; of the hood's the size varies."""
    rng, rows = np.random.default_rng(0), np.arange(160)
    distance, hood = (Covariate(((name, rng.uniform(-1.0, 1.0, 160)),)) for name in ("distance_m", "hood_deg"))
    score = distance.values + by_hood * hood.values + 0.1 * rng.normal(size=160)
    before, after = (pic.LinearResiduals(values, np.ones(160)) for values in (score, 0.0 * score))
    for corrected, expected in ((after, drawn), (None, "distance_m")):
        residual = pic.Residual("height", None, "arrival", 1.0, "", before, corrected)
        chosen = pic.choose([residual], (hood, distance), rows)
        assert chosen is not None and chosen[1].name == expected
