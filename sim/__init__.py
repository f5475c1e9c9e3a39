"""The simulator: worlds, physics, sensor models and drivers, and the referee who alone knows the truth."""
