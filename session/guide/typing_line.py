"""What typed characters ask for: a command each, or a note that ends with Enter."""

from __future__ import annotations

from enum import Enum

ENTER, ESCAPE, ERASE = ("\r", "\n"), "\x1b", ("\x7f", "\b")
LONGEST_NOTE = 200


class Wish(Enum):
    """What a person can ask for."""

    PAUSE = "p"
    DROP = "d"
    NOTE = "n"
    HERE = "Enter"


class TypingLine:
    """``take`` characters; note: the text that is being typed, or None."""

    def __init__(self) -> None:
        self.note: str | None = None

    def take(self, typed: str) -> list[tuple[Wish, str]]:
        """Wishes, in order, and the text of a note."""
        wishes: list[tuple[Wish, str]] = []
        for sign in typed:
            if self.note is None:
                if sign in ENTER:
                    wishes.append((Wish.HERE, ""))
                elif sign.lower() == Wish.NOTE.value:
                    self.note = ""
                elif sign.lower() in (Wish.PAUSE.value, Wish.DROP.value):
                    wishes.append((Wish(sign.lower()), ""))
            elif sign in ENTER:
                if text := " ".join(self.note.split()):
                    wishes.append((Wish.NOTE, text))
                self.note = None
            elif sign == ESCAPE:
                self.note = None
            elif sign in ERASE:
                self.note = self.note[:-1]
            elif sign.isprintable() and len(self.note) < LONGEST_NOTE:
                self.note += sign
        return wishes

    def words(self, closure: bool) -> str:
        """The last line of the screen.  closure: whether the closure run is on."""
        if self.note is not None:
            return f"note: {self.note}_   (Enter keeps it, Esc does not)"
        last = "d the closure run again   Enter it is on its mark" if closure else "d drop the last turn"
        return f"keys: p pause   {last}   n note"
