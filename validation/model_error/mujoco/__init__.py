"""MuJoCo's car against theory."""
