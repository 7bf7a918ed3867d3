"""Commands of the `pbrnet` command line."""
