"""The world the controller acts on: signals, vehicle data, road, obstacles, tyre law, plants."""
