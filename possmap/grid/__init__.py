"""The grid file ``*.possmap``: tiles, ledger, settings in one SQLite file (docs/grid-file.md)."""
