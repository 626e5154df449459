"""``python -m models.cfd`` is ``models cfd``."""

import sys

from models.cli import main

if __name__ == "__main__":
    sys.exit(main(["cfd", *sys.argv[1:]]))
