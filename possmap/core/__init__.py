"""The method: error model, propagation, evidence, fusion, views. No path, no clock, no print."""
