"""Reading ease of README and manual: Flesch-Kincaid grade (Kincaid et al. 1975) by the library textstat, goal 10.

    pip install textstat==0.7.4 'setuptools<81'
    python tests/benchmarks documents.reading_ease
    python tests/benchmarks documents.reading_ease --hardest 100    # of the notebook, too

Only running text counts: no code, no tables, no headings. Exit code 1 where a page is above the goal. ``--hardest N``
lists single sentences instead, those of table cells too. A sentence is as hard as its grade plus a fifth of its words.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import command_line
from result_file import add_option, figure, write_result

ROOT = Path(__file__).resolve().parents[3]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NOTEBOOK = sorted((ROOT / "docs" / "lab").glob("*.md"))
PAIRS = ROOT / "docs" / "lab" / "words.md"
"""Old sentences beside new ones: not a page to measure."""
GOAL = 10.0
README_WORDS = 700
NEXT_SENTENCE = r"(?<=[.!?])\s+(?=[A-Z(]|--|\S*_\S)"
"""A sentence begins with a capital letter, or with the name of something in the program."""
PER_WORD = 0.2
"""What one word adds to the hardness of a sentence, beside its grade."""
SHORTEST_WORDS = 8
"""The grade of shorter sentences depends on one long name."""


def plain(markdown: str) -> str:
    """The text without code blocks, comments, addresses of links and marks."""
    text = re.sub(r"```.*?```|<!--.*?-->|^    .*?$|^Command: .*?$", "", markdown, flags=re.S | re.M)
    return re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("`", "").replace("*", "")


def blocks(markdown: str) -> list[str]:
    """Paragraphs and list items of a page."""
    found: list[str] = [""]
    for line in map(str.strip, plain(markdown).splitlines()):
        item = re.match(r"(?:-|\d+\.) (.*)", line)
        if item is not None:
            found.append(item[1])
        elif not line or line.startswith(("|", "#")):
            found.append("")
        else:
            found[-1] += f" {line}"
    return [block.strip() for block in found if block.strip()]


def running_text(markdown: str) -> str:
    """Sentences and list items of a page, each with its full stop."""
    return " ".join(b if b[-1] in ".!?" else f"{b}." for b in blocks(markdown))


def sentences(markdown: str) -> list[str]:
    """Every sentence of running text and of table cells."""
    rows = [line.strip() for line in plain(markdown).splitlines() if line.strip().startswith("|")]
    cells = [
        cell.strip()
        for row in rows
        for cell in row.strip("|").split("|")
        if re.search("[a-z]", cell)
    ]
    return [s for text in (*blocks(markdown), *cells) for s in re.split(NEXT_SENTENCE, text)]


def grades() -> dict[Path, float]:
    """Flesch-Kincaid grade of each page of the manual."""
    import textstat

    texts = {page: running_text(page.read_text(encoding="utf-8")) for page in PAGES}
    return {page: textstat.flesch_kincaid_grade(text) for page, text in texts.items() if text}


def hardest(count: int) -> list[tuple[float, Path, str]]:
    """The sentences that are hardest to read, of README, manual and notebook: hardness, page, sentence."""
    import textstat

    found = [
        (textstat.flesch_kincaid_grade(sentence) + PER_WORD * len(sentence.split()), page, sentence)
        for page in (*PAGES, *NOTEBOOK)
        if page != PAIRS
        for sentence in sentences(page.read_text(encoding="utf-8"))
        if len(sentence.split()) >= SHORTEST_WORDS
    ]
    return sorted(found, key=lambda row: -row[0])[:count]


def main() -> int:
    """Print the grade of every page, the hardest first, or the hardest sentences."""
    parser = command_line.parser(__doc__)
    parser.add_argument(
        "--hardest", type=int, metavar="N", help="list the N hardest sentences instead"
    )
    add_option(parser)
    a = parser.parse_args()
    if a.hardest is not None:
        for hardness, page, sentence in hardest(a.hardest):
            print(f"{hardness:5.1f}  {page.relative_to(ROOT)}: {sentence}")
        return 0
    found = grades()
    for page, grade in sorted(found.items(), key=lambda item: -item[1]):
        words = len(running_text(page.read_text(encoding="utf-8")).split())
        print(f"{grade:5.1f}  {page.relative_to(ROOT)}  ({words} words of running text)")
    worst = max(found.values())
    readme = found[PAGES[0]]
    words = len(PAGES[0].read_text(encoding="utf-8").split())
    figures = [
        figure(
            "Flesch-Kincaid grade of the hardest page",
            f"{worst:.1f}",
            goal=f"{GOAL:g}",
            met=worst <= GOAL,
        ),
        figure("of the README", f"{readme:.1f}", goal=f"{GOAL:g}", met=readme <= GOAL),
        figure(
            "words of the README", f"{words}", goal=f"{README_WORDS}", met=words <= README_WORDS
        ),
    ]
    write_result(a, figures, seeds=f"{len(found)} pages", repeatable=True)
    return 1 if worst > GOAL else 0


if __name__ == "__main__":
    sys.exit(main())
