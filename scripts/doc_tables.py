# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of a document: cells, markdown, and putting them between <!-- table NAME --> and <!-- end -->."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def seconds(value: float) -> str:
    """Three digits at most."""
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 0.1 else 3
    return f"{value:.{digits}f}"


def error(value: float) -> str:
    """Two digits, as in 1.1e-4."""
    return re.sub(r"e-0*", "e-", f"{value:.1e}") if value else "0"


def markdown(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def put(text: str, name: str, table: str) -> str:
    """The document with this table in the place of that name; without one it stays as it was."""
    pattern = rf"(<!-- table {name} -->\n).*?(<!-- end -->)"
    return re.sub(pattern, lambda match: f"{match[1]}{table}\n{match[2]}", text, flags=re.S)
