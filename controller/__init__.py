"""Planner, corridor and MPC as one stepping steering controller, and its CAN output port."""
