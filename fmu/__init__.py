"""FMI co-simulation: any FMU as a plant, native plant FMUs built on first use."""
