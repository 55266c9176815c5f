"""How true a map is: pure functions over arrays and core records, no files (docs/evaluate.md)."""
