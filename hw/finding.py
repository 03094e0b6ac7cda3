"""What one check found."""

from msgspec import Struct

OK, WARNING, FAILURE = "ok", "warning", "failure"


class Finding(Struct, frozen=True):
    """One line: what was looked at, how it is, and what to do about it (empty when it is well)."""

    check: str
    level: str                        # OK, WARNING (it runs, with something less) or FAILURE (it will not run well)
    says: str
    do: str = ""


def ok(check: str, says: str) -> Finding:
    return Finding(check, OK, says)


def warning(check: str, says: str, do: str) -> Finding:
    return Finding(check, WARNING, says, do)


def failure(check: str, says: str, do: str) -> Finding:
    return Finding(check, FAILURE, says, do)


def line(finding: Finding) -> str:
    """The finding as it is printed; a failure is in capitals."""
    level = finding.level.upper() if finding.level == FAILURE else finding.level
    return f"{level:8s} {finding.check}: {finding.says}" + (f" -> {finding.do}" if finding.do else "")
