"""Export of the dataset to formats that other projects read: one module a format, a registry."""
