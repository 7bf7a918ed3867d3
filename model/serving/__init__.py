"""A page on this machine that shows a scene from cameras that move (`pbrnet serve`)."""
