"""Path tracing of shading and colour: integrator, emitter sampling, guiding, noise."""
