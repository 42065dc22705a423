"""What an operator types: one file per verb, each thin over the cores and the runtime's processes."""

__version__ = "0.1.0"
