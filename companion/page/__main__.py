"""``python -m companion.page HOST PORT``."""

from companion.page.server import main

if __name__ == "__main__":
    raise SystemExit(main())
