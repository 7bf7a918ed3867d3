"""Dask cluster, scheduling of views and transfer of files to workers."""
