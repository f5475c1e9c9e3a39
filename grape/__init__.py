"""grape: mobile-manipulation tasks as behaviour trees, in simulation and on real robots."""

__version__ = "0.1.0"
