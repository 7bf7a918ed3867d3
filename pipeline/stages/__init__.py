"""Stages of the pipeline and the jobs that workers do for them."""
