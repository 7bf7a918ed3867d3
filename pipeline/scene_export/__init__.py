"""Export of scene folders to GLB, USD and archives."""
