"""The report as a page: verdict first, well-formed, nothing fetched, every kind of verdict."""

import html
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.metadata import version

import msgspec
import numpy as np
import pytest

from tests.sim.discover.worlds import FACTS, World, make_outcomes
from tests.sim.few_terms import few_terms
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.detect.covariates import Covariate
from truearc.sim.discover.detect.localization import curve_of
from truearc.sim.discover.finding import FoundEffect, Interval, Named
from truearc.sim.discover.identifiability import foresee
from truearc.sim.discover.investigate import Investigation, discover
from truearc.sim.discover.report import pages
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.report import Origin

BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")
VOID = {"meta", "img", "br"}
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
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:)", page)
    assert "http" not in re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]*", "", page)
    return " ".join(" ".join(parser.text).split())


@pytest.fixture(scope="module")
def drifting() -> Investigation:
    """Outcomes with sides while the balls get faster by a tenth."""
    return discover(make_outcomes(World(speed_drift=0.1), 120, 4), BELIEVED, terms=FEW)


@pytest.fixture(scope="module")
def quiet() -> Investigation:
    return discover(make_outcomes(World(), 120, 1), BELIEVED, terms=FEW)


def test_the_verdict_comes_first_then_where_then_what_then_the_fine_print(drifting: Investigation) -> None:
    assert drifting.finding.verdict != "none"
    origin = Origin("2026-03-01T10:00:00+01:00", "truearc discover week --report 'a b.html'")
    page = pages.make_report("week <1>", drifting, origin)
    text = read(page)
    first, rest = drifting.finding.sentence.split(". ", 1)
    assert f'<p class="verdict">{html.escape(first)}.</p>\n<p>{html.escape(rest)}</p>' in page
    head = text[:text.index(first)]
    assert f"2026-03-01 10:00:00+01:00 · truearc {version('truearc')}" in head and origin.command in head
    places = [text.index(part) for part in (drifting.finding.sentence, "What these 120 shots could show", "Where it is",
                                            "What it is", "What it is worth", "Fine print")]
    assert places == sorted(places)
    assert "week <1>" in text
    assert all(f"{round(100 * one.probability)}%" in text for one in drifting.finding.what[:2])
    assert "tests, alarm at 0.05" in text and "Not tested" in text


def test_a_set_is_marked_and_a_name_besides_is_told(drifting: Investigation) -> None:
    finding = drifting.finding
    size = Interval(1.0, 0.1, 0.8, 1.2, "m/s")
    wind = Named("wind_x", 0.4, {"speed_m_s": size}, find_terms(["wind_x"])[0].sentence, "flight")
    first = msgspec.structs.replace(finding.what[0], probability=0.5)
    both = msgspec.structs.replace(finding, what=(first, wind), set=(first.term, "wind_x"), verdict="set",
                                  also=(FoundEffect((wind,), ("wind_x",), None),), unexplained=0.1)
    page = pages.make_report("set", replace(drifting, finding=both))
    text = read(page)
    assert page.count('class="fill set"') == 2 and "apart (orange)." in text and "may add up to more than 100 %" in text
    assert "looks most as if there is wind of 1.00 m/s (90 %: 0.80 to 1.20 m/s) toward the target" in text
    assert "an unexplained effect in their place" in text and "10%" in text


def test_nothing_found_still_shows_the_shots_and_what_they_could_have_told(quiet: Investigation) -> None:
    assert quiet.finding.verdict == "none"
    page = pages.make_report("quiet", quiet)
    text = read(page)
    assert "No mismatch" in text and "seen from, with 120 shots" in text and "shots needed" in text
    assert "<details><summary>Effect by effect" not in page and "Simulation and shots" in text
    assert page.count("data:image/png;base64,") >= 2


def test_an_effect_without_a_name_is_drawn_with_its_free_curve(drifting: Investigation) -> None:
    assert drifting.finding.verdict == "unknown"
    where, picture = pages.make_pictures(drifting)[0]
    assert where == "Where it is" and picture.count("data:image/png;base64,") == 3    # curve, covariate, field
    assert 'alt="free curve: launch speed against t_s"' in picture
    assert "change of launch speed over the time in the session" in picture
    place = drifting.steps[0].place
    assert place is not None and isinstance(place.test.what, Covariate)
    share, sd = curve_of(place.correction)
    t_s = place.test.what.values[place.correction.scores.rows]
    true = 0.1 * (t_s - t_s.mean()) / t_s.max()          # of World(speed_drift=0.1), to first order
    assert np.abs(share - true).max() < 0.012 and (np.abs(share - true) < 3.0 * sd + 0.003).all()
    assert 0.0 < sd.max() < 0.02


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
