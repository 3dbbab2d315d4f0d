"""How far a long computation is."""

from collections.abc import Callable

#: called with the current step's description, the number of steps done, and of all steps
Progress = Callable[[str, int, int], None]
#: called with the current step's description, or another line of text
Reporter = Callable[[str], None]
#: called with the number of steps done, and of all steps
Steps = Callable[[int, int], None]


def no_report(*what: object) -> None:
    """Report to no one."""
