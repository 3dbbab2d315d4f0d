"""``python -m session.public NAME DIR``: session folders of a public set of recordings, written by the annex of public sets."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from session.io.annexes import MissingAnnexError, need


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code of the annex's command; 2, and one line, where the annex was removed."""
    try:
        annex = need("public recordings")
    except MissingAnnexError as error:
        print(f"session.public: {error}", file=sys.stderr)
        return 2
    return annex.main(arguments)


if __name__ == "__main__":
    sys.exit(main())
