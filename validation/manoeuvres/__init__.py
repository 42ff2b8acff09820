"""Open-loop manoeuvres, their metrics and ratings."""
