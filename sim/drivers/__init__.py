"""Simulated drivers: they see the machine through sensor models, and move it through its actuators, alone."""

from grape.sim.drivers.bundle import SensorOptions, SimulatedDrivers, connect

__all__ = ["SensorOptions", "SimulatedDrivers", "connect"]
