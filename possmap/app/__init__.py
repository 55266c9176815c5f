"""One function per command: read, compute, write; each returns a small summary."""
