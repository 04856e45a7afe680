"""Counts lines and modules of the product, addon/ and headless/, as formatted by ruff. `python tools/count_lines.py [--by-folder]`."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def counted() -> dict[str, tuple[int, int]]:
    """Folder -> (lines, modules)."""
    lines: Counter[str] = Counter()
    modules: Counter[str] = Counter()
    for top in ("addon", "headless"):
        for path in (ROOT / top).rglob("*.py"):
            folder = str(path.parent.relative_to(ROOT))
            lines[folder] += len(path.read_text("utf-8").splitlines())
            modules[folder] += 1
    return {folder: (lines[folder], modules[folder]) for folder in sorted(lines)}


def main(arguments: list[str]) -> None:
    found = counted()
    if "--by-folder" in arguments:
        for folder, (lines, modules) in found.items():
            print(f"{folder:32} {lines:6} lines {modules:4} modules")
    lines, modules = (sum(pair[k] for pair in found.values()) for k in (0, 1))
    print(f"{'product':32} {lines:6} lines {modules:4} modules")


if __name__ == "__main__":
    main(sys.argv[1:])
