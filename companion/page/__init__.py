"""The live page: ``companion --page [HOST]:PORT``."""
