"""How to steer there: the car's model, its prediction, and the quadratic programme."""
