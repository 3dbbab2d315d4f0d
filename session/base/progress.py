"""Who works long tells how far he is."""

from collections.abc import Callable

#: told the current step's description, the number of steps done, and of all steps
Progress = Callable[[str, int, int], None]
#: told the current step's description, or another line of text
Told = Callable[[str], None]
#: told the number of steps done, and of all steps
Steps = Callable[[int, int], None]


def untold(*what: object) -> None:
    """Tell no one."""
