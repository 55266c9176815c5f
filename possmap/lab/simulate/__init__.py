"""Cheap robots in an unknown building: what truly happens, and what they believe."""
