"""The true map of a site, for pictures and for judging: truth files, maps and plans as images."""
