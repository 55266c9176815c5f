"""From what a robot recorded to what it reports: samples become runs, turns and walls."""
