"""Where the controller's model stops predicting a plant."""
