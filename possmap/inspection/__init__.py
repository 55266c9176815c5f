"""What a grid says of itself, of a place, of its robots, and of another grid."""
