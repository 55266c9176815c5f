"""Everything that has a path: logs in, settings in, the grid file, exports out."""
