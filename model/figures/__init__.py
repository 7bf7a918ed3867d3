"""Charts, tables and picture rows of the report and the studies."""
