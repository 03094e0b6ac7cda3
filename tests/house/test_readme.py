"""The README stays short, and its headline figures lead to their measurements."""

import re
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150
    assert len(README.split("\n## Install\n")[0].split()) <= 600


def test_first_commands_are_demo_and_test() -> None:
    block = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)[0]
    assert [line.split("#")[0].strip() for line in block.splitlines()] == ["make demo", "make test"]


def test_ten_figures_of_few_words_have_links() -> None:
    section = README.split("\n## Measured\n")[1].split("\n## ")[0].strip().splitlines()
    figures = [re.fullmatch(r"- \[(.+)\]\((docs/[\w./-]+#[\w-]+)\)", line) for line in section]
    assert len(figures) == 10
    assert all(figure is not None and len(figure[1].split()) <= 15 for figure in figures)
