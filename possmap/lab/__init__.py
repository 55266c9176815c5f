"""Around the method: robots simulated, recorded, calibrated and judged."""
