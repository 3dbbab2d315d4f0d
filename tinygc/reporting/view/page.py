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


def whole_page(content: dict[str, Any], curves: list[dict[str, list]]) -> str:
    """Return the page of a recording as one document, from ``Recording.content`` and ``Curves.between``."""
    data = json.dumps({"content": content, "curves": curves}, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    hashes: list[str] = []

    def text_of(name: str) -> str:
        return FOLDER.joinpath(name).read_text(encoding="utf-8")

    def script(found: re.Match[str]) -> str:
        text = text_of(found[1])
        hashes.append(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'")
        return f"<script>{text}</script>"

    page = text_of("page.html").replace("TinyGC: recording", f"TinyGC: {escape(content['session'])}")
    page = re.sub(r'<script defer src="([\w.]+)"></script>', "", page).replace("</body>", f"{_scripts(page)}</body>")
    page = page.replace('<link rel="icon" href="icon.svg">\n', "").replace(
        '<link rel="stylesheet" href="page.css">', f"<style>{text_of('page.css')}</style>"
    )
    page = re.sub(r'<script src="([\w.]+)"></script>', script, page)
    policy = f"default-src 'none'; style-src 'unsafe-inline'; script-src {' '.join(hashes)}; base-uri 'none'; form-action 'none'"
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" content="{policy}">')
    return page.replace("<script>", f'<script type="application/json" id="data">{data}</script>\n<script>', 1)


def _scripts(page: str) -> str:
    """The page's scripts at its end, where all of it is there."""
    return "".join(f'<script src="{name}"></script>\n' for name in re.findall(r'<script defer src="([\w.]+)">', page))
