"""The commands, each a file: ``python -m agents NAME`` calls `main` of ``NAME.py``."""
