"""How ``fuse`` goes: logs are found, read, judged, laid out and stamped, and who does the work."""
