"""What a check found: a line for each part."""

from __future__ import annotations

from dataclasses import dataclass

PASSED, FAILED, NOT_CHECKED = "passed", "failed", "not checked"


class Wrong(Exception):
    """What a part finds wrong, in one line."""


class NotChecked(Exception):
    """Why a part does not apply, or cannot be checked on this machine."""


@dataclass(frozen=True)
class Part:
    """name; result: passed, failed or not checked; says: the numbers, or why."""

    name: str
    result: str
    says: str

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return self.result != FAILED


@dataclass(frozen=True)
class Report:
    """id of the effect, and its parts in order."""

    id: str
    parts: tuple[Part, ...]

    @property
    def ok(self) -> bool:
        """Whether no part failed."""
        return all(part.ok for part in self.parts)

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the parts that failed."""
        return tuple(part.name for part in self.parts if not part.ok)

    def __getitem__(self, name: str) -> Part:
        return next(part for part in self.parts if part.name == name)

    def __str__(self) -> str:
        return "\n".join([self.id, *(f"  {part.name:8} {part.result:11}  {part.says}" for part in self.parts)])

    def require(self) -> Report:
        """Itself; AssertionError with all of it where a part failed: ``check(EFFECT).require()`` is a test."""
        if not self.ok:
            raise AssertionError(str(self))
        return self
