"""Where the car is to drive: segments, clothoids, way-points and the reference path made of them."""
