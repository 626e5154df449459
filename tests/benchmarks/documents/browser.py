"""Pictures of a page: on a phone and on a desktop, dark and light, and a print.

python tests/benchmarks documents.browser PAGE.html --out SHOTS
"""

from __future__ import annotations

from pathlib import Path

import command_line
from browser import DESKTOP, PHONE, Browser


def main() -> int:
    """Pictures of one page."""
    p = command_line.parser(__doc__)
    p.add_argument("page", type=Path)
    p.add_argument("--out", type=Path, default=Path("."))
    a = p.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    with Browser() as browser:
        for name, size in (("phone", PHONE), ("desktop", DESKTOP)):
            for dark in (False, True):
                seen = browser.open(a.page.resolve().as_uri(), size, dark=dark)
                target = a.out / f"{a.page.stem}-{name}-{'dark' if dark else 'light'}.png"
                target.write_bytes(browser.picture())
                print(
                    f"{target}: width {seen.width} px, smallest text {seen.smallest_text_px:.1f} px"
                )
                print(
                    f"  cells cut: {seen.cut_cells}; texts out of their chart: {list(seen.outside)}"
                )
                print(f"  console: {list(seen.console)}; requests: {list(seen.requests)}")
        (a.out / f"{a.page.stem}.pdf").write_bytes(browser.print())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
