"""The manifest of result archives agrees with the commit that holds them."""

import hashlib
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MANIFEST = ROOT / "benchmarks" / "results" / "MANIFEST.md"
ROW = re.compile(r"^\| `([^`]+)` \| `([0-9a-f]{40})` \| `([0-9a-f]{64})` \| (\d+) \|", re.MULTILINE)


def git(*words: str) -> bytes:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=False)
    if done.returncode:
        pytest.skip(f"no history here: git {' '.join(words)}")
    return done.stdout


def test_manifest_lists_every_archive_of_the_tagged_commit() -> None:
    text = MANIFEST.read_text(encoding="utf-8")
    tagged = re.findall(r"commit\n`([0-9a-f]{40})`", text)[0]
    rows = ROW.findall(text)
    held = git("ls-tree", "--name-only", tagged, "benchmarks/results/").decode().split()
    assert {row[0] for row in rows} == set(held)
    for path, commit, digest, size in rows:
        data = git("show", f"{tagged}:{path}")
        assert (hashlib.sha256(data).hexdigest(), len(data)) == (digest, int(size)), path
        assert git("show", f"{commit}:{path}") == data, path


def test_archives_are_not_tracked() -> None:
    assert git("ls-files", "benchmarks/results/*.xz") == b""
