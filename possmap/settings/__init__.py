"""Settings: their names, their YAML, and which of them are in force."""
