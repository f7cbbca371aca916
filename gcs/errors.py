"""Errors of this project, one tree. Facts are attributes, so that callers need not parse texts.

Command-line entries catch ``GcsError``: its text is for the user and says what to do.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs.mistake_codes import MistakeCode
from gcs.safe_text import printable

_MAX_LISTED = 50
"""Mistakes of one file that are listed."""


class GcsError(Exception):
    """Root of every error that this project raises. Its text is safe to show."""

    def __init__(self, text: str = "") -> None:
        super().__init__(printable(text, keep="\n"))


class ConfigError(GcsError):
    """A configuration is wrong.

    Attributes
    ----------
    file : str
        The file (or scenario name) that was read.
    key : str
        Dotted path of the key, empty when the file as a whole is at fault.
    code : MistakeCode
        Kind of the mistake.
    expected : str
        What would have been right.
    all : sequence of ConfigError
        Every mistake that was found with it, itself first.
    """

    def __init__(self, file: str, key: str, code: MistakeCode, expected: str) -> None:
        self.file = file
        self.key = key
        self.code = code
        self.expected = expected
        self.all: Sequence[ConfigError] = (self,)
        super().__init__(f"{file}: {self.mistake}")

    @property
    def mistake(self) -> str:
        """Key and what was expected there, without the file."""
        return f"{self.key}: {self.expected}" if self.key else self.expected

    @property
    def rows(self) -> list[dict[str, str]]:
        """Every mistake as plain data, for JSON."""
        return [
            {"file": one.file, "key": one.key, "code": one.code.value, "expected": one.expected}
            for one in self.all
        ]

    @classmethod
    def of_all(cls, mistakes: Sequence[ConfigError]) -> ConfigError:
        """Return one error for all mistakes of a file; its attributes are those of the first."""
        first, *others = mistakes = [one for error in mistakes for one in error.all]
        first.all = mistakes
        if others:
            listed = [error.mistake for error in mistakes[:_MAX_LISTED]]
            listed += [f"and {len(mistakes) - _MAX_LISTED} more"] if len(mistakes) > _MAX_LISTED else []
            lines = "\n  ".join(listed)
            GcsError.__init__(first, f"{first.file}: {len(mistakes)} mistakes:\n  {lines}")
        return first


class TerrainFileError(GcsError):
    """A file of an elevation model cannot be used; its text continues "davos.tif: ..."."""


class LinkError(GcsError):
    """A link cannot be opened or used; ``endpoint`` names it."""

    def __init__(self, endpoint: str, problem: str) -> None:
        self.endpoint = endpoint
        self.problem = problem
        super().__init__(f"{endpoint}: {problem}")


class NoAnswerError(LinkError):
    """A running service does not answer."""


class ReplacedError(LinkError):
    """Another node of the mission commands the vehicles."""


class WireError(GcsError):
    """A payload from outside is malformed; ``key`` is its source."""

    def __init__(self, key: str, problem: str) -> None:
        self.key = key
        self.problem = problem
        super().__init__(f"{key}: {problem}")


class RecordingError(GcsError):
    """A recording cannot be read or written; ``path`` names it."""

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class JournalError(GcsError):
    """A journal cannot be read or written; ``path`` names it."""

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class InterruptedRunError(GcsError):
    """The user interrupted a run; the text says what remains."""


class SimulationError(GcsError):
    """A process of the simulation failed or could not be started."""


class ConsoleError(GcsError):
    """The console cannot be served."""
