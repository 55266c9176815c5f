"""The same wall is one wall: tracks moved so that sightings of it agree (METHOD §8)."""
