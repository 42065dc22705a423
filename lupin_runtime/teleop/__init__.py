"""Driving with a gamepad: reads the kernel's input events, and commands a velocity only while the dead-man button is held."""
