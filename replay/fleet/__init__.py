"""Many logs at once: ``replay run FOLDER`` and ``replay diagnose FOLDER``."""
