"""Kinds of generated faults by what they touch, and what they are composed from."""
