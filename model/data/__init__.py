"""Dataset reader and encoding of the networks' inputs."""
