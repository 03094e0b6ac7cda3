"""A report page: its origin and first sentence, and that a phone shows it without scrolling sideways."""

from importlib.metadata import version
from pathlib import Path

import pytest

from tests.robot.operator_ui.browser import BROWSER, Browser
from truearc.sim.report import PHONE_IN, Origin, make_page, make_png, new_panels, picture, table

BARS = (Path(__file__).parents[2] / "sim" / "discover" / "report" / "finding.css").read_text(encoding="utf-8")
BAR = '<div class="bars"><div>an unexplained effect in their place</div><div class="track"></div></div>'


def body_of(page: str) -> str:
    return page[page.index("<body>"):]


def test_only_the_first_sentence_is_in_the_box() -> None:
    page = body_of(make_page("t", "Off by 9.8 m (90 %: 9 to 10). It is wind & rain. Aim higher.", []))
    assert '<p class="verdict">Off by 9.8 m (90 %: 9 to 10).</p>\n<p>It is wind &amp; rain. Aim higher.</p>' in page
    alone = body_of(make_page("t", "Nothing was found.", [("Next", "<p>a</p>")]))
    assert '<p class="verdict">Nothing was found.</p>\n<h2>Next</h2>' in alone


def test_the_origin_is_at_the_top_and_an_unknown_part_is_left_out() -> None:
    origin = Origin("2026-03-01T10:00:00+01:00", "truearc fit <a>", "ab" * 32)
    page = body_of(make_page("t", "Verdict.", [], origin))
    head = page[:page.index("Verdict.")]
    assert f"2026-03-01 10:00:00+01:00 · truearc {version('truearc')} · data SHA-256 {'ab' * 8}<br>" in head
    assert "<code>truearc fit &lt;a&gt;</code>" in head
    assert f'<p class="origin">truearc {version("truearc")}</p>' in make_page("t", "Verdict.", [])
    assert make_page("t", "Verdict.", [], origin) == make_page("t", "Verdict.", [], origin)


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="needs chromium")
def test_a_phone_shows_a_page_without_scrolling_sideways(tmp_path: Path) -> None:
    """Wide tables and pictures scroll in their own box; letters of a picture keep a legible size."""
    drawn = [picture(make_png(new_panels(width_in, 3.0)[0]), "empty") for width_in in (PHONE_IN, 9.0)]
    wide = table([f"a column {k}" for k in range(12)], [[f"unbroken_name_{k}" for k in range(12)]])
    file = tmp_path / "page.html"
    file.write_text(make_page("t", "A_name_that_is_never_broken_" * 4, [
        ("", f"<style>{BARS}</style>"), ("Pictures", "".join(drawn)), ("Table", wide), ("Bars", BAR),
        ("Gains", f"<pre>{'gain = 1.0  ' * 20}</pre>")], Origin(command="truearc discover " + "a/" * 60)),
        encoding="utf-8")
    browser = Browser(tmp_path / "profile")
    browser.size(390, 844, mobile=True)
    browser.open(file.as_uri())
    browser.wait("document.title === 't' && document.readyState === 'complete'")
    assert browser.evaluate("document.documentElement.scrollWidth") == 390
    assert not browser.evaluate("""[...document.querySelectorAll('body *')].filter(one => !one.closest('.scroll')
        && one.getBoundingClientRect().right > 391).length""")
    # 10 points at 130 dots per inch are 18 pixels: half of that is legible
    assert browser.evaluate(
        "Math.min(...[...document.images].map(one => one.getBoundingClientRect().width / one.naturalWidth))") >= 0.55
    browser.close()
