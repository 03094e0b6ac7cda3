"""Commits since FIRST have a subject of at most 72 characters and a body."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FIRST = "dbbf881"                     # earlier ones were made without the rule
LONGEST_SUBJECT = 72
END = "\x1e"


def objections(message: str) -> list[str]:
    """What is wrong with a commit's message."""
    subject, _, body = message.strip().partition("\n")
    return ([f"{len(subject)} characters: {subject}"] if len(subject) > LONGEST_SUBJECT else []) + (
        [] if body.strip() else [f"without a body: {subject}"])


def test_commits_have_a_short_subject_and_a_body() -> None:
    log = subprocess.run(["git", "log", "--no-merges", f"--format=%B{END}", f"{FIRST}..HEAD"], cwd=ROOT,
                         capture_output=True, text=True, check=False)
    if log.returncode:
        pytest.skip(f"no git history back to {FIRST} here (an sdist, or a shallow clone)")
    messages = [message for message in log.stdout.split(END) if message.strip()]
    assert [one for message in messages for one in objections(message)] == []


@pytest.mark.parametrize(("message", "count"), [
    ("a: b\n\nWhy.\n", 0), (f"a: {'b' * 70}\n\nWhy.\n", 1), ("a: b\n", 1), ("b" * 73, 2)])
def test_objections_are_about_length_and_body(message: str, count: int) -> None:
    assert len(objections(message)) == count
