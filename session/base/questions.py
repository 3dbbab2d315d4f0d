"""What a log does not state: all of it requested at once, each with the option that answers it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from session.base.errors import FormatError


@dataclass(frozen=True)
class Question:
    """what is not known (``the unit of the gyroscope``); option and what may stand behind it: ``--gyro-unit``, ``dps, rad/s, …``; units:
    those of a clock that are plausible, among which gravity may choose."""

    what: str
    option: str
    choices: str = ""
    units: tuple[str, ...] = ()

    @property
    def typed(self) -> str:
        """``--gyro-unit (dps, rad/s)``."""
        return f"{self.option} ({self.choices})" if self.choices else self.option


class QuestionsError(FormatError):
    """A log that cannot be read before questions are answered: file, program, questions."""

    def __init__(self, file: str, dialect: str, questions: Iterable[Question]):
        self.file, self.dialect = file, dialect
        self.questions = tuple(dict.fromkeys(questions))
        whats = [question.what for question in self.questions]
        listed = " and ".join(filter(None, (", ".join(whats[:-1]), whats[-1])))
        super().__init__(f"{file} ({dialect}) does not state {listed}; give {' '.join(question.typed for question in self.questions)}")


def all_of(errors: list[QuestionsError]) -> QuestionsError:
    """One error of several files' questions."""
    files = " and ".join(dict.fromkeys(error.file for error in errors))
    dialects = " and ".join(dict.fromkeys(error.dialect for error in errors))
    return QuestionsError(files, dialects, [question for error in errors for question in error.questions])
