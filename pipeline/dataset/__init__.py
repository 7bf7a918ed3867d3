"""Checks, splits and Parquet shards of the dataset."""
