"""Helpers that several tests share: simulated worlds, fakes and reference implementations."""
