"""The operator's toolkit: commands, and the packages behind them (connection, facts, checks, playbook, ...)."""

__version__ = "0.1.0"
