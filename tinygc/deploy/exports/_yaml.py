"""YAML by a writer of YAML (PyYAML): a key on a line, lists of numbers and rows of a matrix on one line each, every digit kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def yaml_text(table: Mapping[str, Any], remarks: Mapping[str, str] | None = None) -> str:
    """Keys in their order; arrays as lists; remarks: behind the lines of these keys of the uppermost table, as comments.

    YAML 1.1 takes 1e-05 for a word: the writer knows that it wants the point.
    """
    import yaml

    class Writer(yaml.SafeDumper):
        """Tables are never written within a line."""

    Writer.add_representer(dict, lambda writer, value: writer.represent_mapping("tag:yaml.org,2002:map", value.items(), flow_style=False))
    lines = []
    for key, value in table.items():
        text = yaml.dump({key: _plain(value)}, Dumper=Writer, default_flow_style=None, width=float("inf"), allow_unicode=True)
        lines.append(f"{text.removesuffix(chr(10))}  # {remarks[key]}\n" if remarks and key in remarks else text)
    return "".join(lines)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
