"""Planner, corridor and MPC as one stepping steering controller, and its CAN output port."""

from sidestep.controller.config import PRESETS, ControllerConfig
from sidestep.controller.plan import Plan
from sidestep.controller.steering import SteeringController

__all__ = ["PRESETS", "ControllerConfig", "Plan", "SteeringController"]
