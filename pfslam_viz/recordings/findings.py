"""What a look at a whole recording found: how bad it is, what it is, and what the user can do about it."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

Severity = Literal["wrong", "doubtful", "note"]
SEVERITIES: tuple[Severity, ...] = ("wrong", "doubtful", "note")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found.

    Attributes:
        severity: ``"wrong"``: a map made of it would be wrong, so that it is refused; ``"doubtful"``: it may be;
            ``"note"``: it was handled, or does no harm.
        what: a name for the kind of thing that never changes, such as ``"stamps_in_milliseconds"``.
        message: a line that says what was seen and what was made of it.
        advice: what the user can do; may be empty.
        scan: the first scan that it concerns, counted in the recording as it was loaded, if it concerns single ones.
    """

    severity: Severity
    what: str
    message: str
    advice: str = ""
    scan: int | None = None

    @property
    def line(self) -> str:
        """Message and advice in one line."""
        return f"{self.message}; {self.advice}" if self.advice else self.message

    def as_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return asdict(self)


def of(findings: Iterable[Finding], severity: Severity) -> list[Finding]:
    """Those of one severity."""
    return [finding for finding in findings if finding.severity == severity]


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """The worst first."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def verdict(findings: Iterable[Finding]) -> str:
    """All of it in one line: "good", "2 doubts", or "cannot be replayed: ..."."""
    found = tuple(findings)
    if wrong := of(found, "wrong"):
        more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
        return f"cannot be replayed: {wrong[0].message}{more}"
    doubts = len(of(found, "doubtful"))
    return "good" if doubts == 0 else "1 doubt" if doubts == 1 else f"{doubts} doubts"
