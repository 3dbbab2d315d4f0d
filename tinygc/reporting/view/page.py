"""The page as one file that only shows: what the server serves, put into one document that loads nothing."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html import escape
from importlib.resources import files
from typing import Any

#: what the page is made of
FOLDER = files("tinygc.reporting.view").joinpath("files")
SCRIPT = re.compile(r'<script defer src="([\w.]+)"></script>')


def whole_page(content: dict[str, Any], curves: list[dict[str, list]]) -> str:
    """Return the page of a recording as one document, from ``Recording.content`` and ``Curves.between``."""
    data = json.dumps({"content": content, "curves": curves}, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")

    def text_of(name: str) -> str:
        return FOLDER.joinpath(name).read_text(encoding="utf-8")

    page = text_of("page.html").replace("TinyGC: recording", f"TinyGC: {escape(content['session'])}")
    scripts = [text_of(name) for name in SCRIPT.findall(page)]  # at the page's end, where all of it is there
    page = SCRIPT.sub("", page).replace('<link rel="icon" href="icon.svg">\n', "")
    page = page.replace('<link rel="stylesheet" href="page.css">', f"<style>{text_of('page.css')}</style>")
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" for text in scripts)
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src {hashes}; base-uri 'none'; form-action 'none'"
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" content="{policy}">')
    end = f'<script type="application/json" id="data">{data}</script>\n' + "".join(f"<script>{text}</script>\n" for text in scripts)
    return page.replace("</body>", f"{end}</body>")
