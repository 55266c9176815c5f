"""The same work by the workers of a dask cluster (docs/cluster.md)."""
