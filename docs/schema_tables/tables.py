"""docs/formats/tables.md: what ``table`` writes with ``--json``."""

from __future__ import annotations

from .shapes import FLAG, NUMBER, TEXT, maybe

TABLES = {
    "tinygc-table-command/1": {
        "action": TEXT,
        "makes?": [{"name": TEXT, "title": TEXT}],
        "name?": TEXT,
        "make?": TEXT,
        "axes?": [{"name": TEXT, "angle_deg": maybe(NUMBER)}],
        "moving?": maybe(FLAG),
        "table_s?": maybe(NUMBER),
    }
}
