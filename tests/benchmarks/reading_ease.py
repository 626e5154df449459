"""Reading ease of README and manual: Flesch-Kincaid grade (Kincaid et al. 1975) by the library textstat, goal 10.

    pip install textstat==0.7.4
    python tests/benchmarks/reading_ease.py

Only running text counts: no code, no tables, no headings. Exit code 1 where a page is above the goal.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
GOAL = 10.0


def running_text(markdown: str) -> str:
    """Sentences and list items of a page, each with its full stop."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", markdown, flags=re.S)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("`", "").replace("*", "")
    blocks: list[str] = [""]
    for line in map(str.strip, text.splitlines()):
        item = re.match(r"(?:-|\d+\.) (.*)", line)
        if item is not None:
            blocks.append(item[1])
        elif not line or line.startswith(("|", "#")):
            blocks.append("")
        else:
            blocks[-1] += f" {line}"
    return " ".join(b if b.rstrip()[-1] in ".!?" else f"{b}." for b in blocks if b.strip())


def main() -> int:
    """Print the grade of every page, the hardest first."""
    import textstat

    texts = {page: running_text(page.read_text(encoding="utf-8")) for page in PAGES}
    grades = {page: textstat.flesch_kincaid_grade(text) for page, text in texts.items() if text}
    for page, grade in sorted(grades.items(), key=lambda item: -item[1]):
        print(f"{grade:5.1f}  {page.relative_to(ROOT)}  ({len(texts[page].split())} words of running text)")
    return 1 if max(grades.values()) > GOAL else 0


if __name__ == "__main__":
    sys.exit(main())
