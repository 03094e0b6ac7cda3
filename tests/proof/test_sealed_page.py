"""The page of sealed rounds has what their archives say, and a picture of the probabilities in them."""

from itertools import groupby
from pathlib import Path

from benchmarks.proof import BEGIN, END, load, tell_posterior

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/measured/sealed.md"


def test_the_page_is_what_the_archives_say() -> None:
    rounds = sorted(map(load, sorted((PAGE.parent / "sealed").glob("*.tar.xz"))), key=lambda one: one.setting)
    told = [tell_posterior(list(group)) for _, group in groupby(rounds, key=lambda one: one.setting)]
    page = PAGE.read_text(encoding="utf-8")
    assert rounds and page.split(BEGIN)[1].split(END)[0] == "\n".join(told)
