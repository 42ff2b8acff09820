"""A multibody car in MuJoCo, on contact tyres."""
