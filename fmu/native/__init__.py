"""FMUs from C sources, built for this platform and others."""
